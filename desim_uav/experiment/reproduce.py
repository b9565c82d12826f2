"""The paper's table: its nine cases on many seeds, beside the values that the paper printed.

A job is one policy in one case on one seed. A learner trains in the world of its seed and is then
evaluated greedily on sample paths that were not part of the training; the baseline is evaluated on
the same ones. Each finished job is kept in a file, so the same command continues after an
interruption.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from contextlib import closing
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from desim_uav import __version__
from desim_uav.checksums import of_row
from desim_uav.disk import try_writing, write_whole
from desim_uav.errors import UsageError
from desim_uav.experiment import paper_table
from desim_uav.experiment.evaluate import evaluate
from desim_uav.experiment.processes import run_each
from desim_uav.experiment.published import POLICIES, PUBLISHED
from desim_uav.experiment.train.course import train
from desim_uav.optimum.cover import Spots, cover, fair_cover
from desim_uav.scenario.load import load, scenario_hash
from desim_uav.scenario.schema import Scenario
from desim_uav.shipped import scenario_path
from desim_uav.world import build_world

EPISODES, WARMUP = 20, 2
"""The numbers of episodes that count, and of warm-up episodes that are flown before them."""

FIRST_SEED = 100
"""The first seed of the table. The defaults of learning were chosen on seeds below it."""

CASES = [str(case) for case in PUBLISHED]
BEST_COVER = (
    "cover_qoe3_percent",
    "fair_reward",
    "fair_qoe3_percent",
    "fair_least_qoe3_percent",
)
LAST_EPISODE = ("qoe1_percent", "qoe2_iterations", "qoe3_percent", "reward", "crashes")


@dataclass(frozen=True)
class Job:
    """One policy in one case on one seed; ``preset`` is None for our own settings."""

    case: int
    policy: str
    seed: int
    preset: str | None
    episodes: int | None

    @property
    def name(self) -> str:
        """The name of the job's files."""
        return f"case{self.case}-{self.policy}-{self.preset or 'default'}-s{self.seed}"

    def scenario(self) -> Scenario:
        """Return the scenario of training and evaluation."""
        settings = [f"seed={self.seed}"]
        settings += [] if self.preset is None else [f"preset={self.preset}"]
        if self.policy != "baseline":
            settings += [f"learning.algorithm={self.policy}"]
            settings += [] if self.episodes is None else [f"learning.episodes={self.episodes}"]
        return load(scenario_path(f"case{self.case}"), settings)

    def identity(self) -> str:
        """Return the text by which a finished job is recognized as this one."""
        scenario = scenario_hash(self.scenario())
        return f"{__version__}/{scenario}/{self.policy}/{EPISODES}+{WARMUP}"


def jobs(
    cases: Sequence[int], seeds: range, episodes: int | None, presets: Sequence[str | None]
) -> list[Job]:
    """List all jobs of a table, the long ones first."""
    listing = [
        Job(case, policy, seed, preset, episodes)
        for preset in presets
        for case in sorted(cases, reverse=True)
        for policy in POLICIES
        for seed in seeds
    ]
    return sorted(listing, key=lambda job: job.policy == "baseline")


def numbers(text: str) -> list[int]:
    """Return the cases of a text such as ``1-3,8``. Raises UsageError if it is malformed."""
    cases: set[int] = set()
    for part in text.split(","):
        ends = [end.strip() for end in part.split("-")]
        if len(ends) > 2 or not all(end in CASES for end in ends) or ends[0] > ends[-1]:
            raise UsageError(f"--cases {text}: write 1-9, or 1,4,8; the paper has cases 1 to 9")
        cases.update(range(int(ends[0]), int(ends[-1]) + 1))
    return sorted(cases)


def open_folder(folder: Path) -> None:
    """Make the folder of a table before anything is trained. Raises UsageError if it cannot."""
    try:
        for name in ("jobs", "policies"):
            (folder / name).mkdir(parents=True, exist_ok=True)
            try_writing(folder / name)
    except OSError as error:
        raise UsageError(f"--out {folder}: {error.strerror}") from error


def report(rows: Sequence[dict[str, Any]], folder: Path, command: str) -> Report:
    """Make the table of the finished rows and write rows.csv, table.csv and table.md."""
    rows = [row | best_cover(row["case"], row["seed"]) for row in rows]
    table, claims = paper_table.lines(rows), paper_table.claims(rows)
    write_whole(folder / "rows.csv", paper_table.rows_csv(rows).encode())
    write_whole(folder / "table.csv", paper_table.table_csv(table).encode())
    seeds = {row["seed"] for row in rows}
    write_whole(folder / "table.md", paper_table.markdown(table, claims, seeds, command).encode())
    return Report(table, claims, folder)


class Report(NamedTuple):
    """The paper's table, the claims about it, and its folder."""

    table: list[paper_table.PaperLine]
    claims: list[paper_table.Claim]
    folder: Path

    @property
    def failed(self) -> list[paper_table.Claim]:
        """The gates that do not hold."""
        return [claim for claim in self.claims if claim.gate and not claim.holds]


def run_jobs(
    todo: Sequence[Job],
    folder: Path,
    workers: int,
    on_job: Callable[[], None] = lambda: None,
    engine: str = "auto",
) -> list[dict[str, Any]]:
    """Return the rows of all jobs; those that are in the folder are not run again.

    ``engine`` is auto, des or batch. The rows of both are the same, so rows of the other engine are
    reused. Raises UsageError if the folder cannot be written.
    """
    open_folder(folder)
    finished = {job: _finished(job, folder) for job in todo}
    rows = [row for row in finished.values() if row is not None]
    for _ in rows:
        on_job()
    left = [(job, folder, engine) for job, row in finished.items() if row is None]
    with closing(run_each(run_job, left, workers)) as ended:
        for _, row in ended:
            rows.append(row)
            on_job()
    return rows


def run_job(job: Job, folder: Path, engine: str = "auto") -> dict[str, Any]:
    """Train if the policy learns, evaluate, and keep the row and the Q-table in the folder."""
    scenario = job.scenario()
    row: dict[str, Any] = {
        "case": job.case,
        "policy": job.policy,
        "preset": job.preset or "default",
        "seed": job.seed,
        "episodes": None,
    }
    policy = job.policy
    if policy != "baseline":
        table, progress = train(scenario, engine)
        file = folder / "policies" / f"{job.name}.npz"
        write_whole(file, table.to_bytes())
        policy = str(file)
        row["episodes"] = scenario.learning.episodes
        last = progress[-scenario.drone_count :]
        row |= {f"last_{key}": _mean([getattr(one, key) for one in last]) for key in LAST_EPISODE}
    row |= evaluate(scenario, policy, job.seed, EPISODES, WARMUP, engine)
    file = folder / "jobs" / f"{job.name}.json"
    record = {"identity": job.identity(), "row": row, "sha256": of_row(row)}
    content = json.dumps(record, indent=1, allow_nan=False)
    write_whole(file, content.encode())
    return row


@cache
def best_cover(case: int, seed: int) -> dict[str, float | None]:
    """Return the QoE3 of drones that hover forever over the best cells, if users stand still.

    A drone with a battery cannot hover forever, so it reaches less. The ``fair`` entries are the
    largest sum of R1 over an episode for drones that hover, and the range of QoE3 with that sum.
    Values that do not apply are None.
    """
    scenario = load(scenario_path(f"case{case}"), [f"seed={seed}"])
    measures: dict[str, float | None] = dict.fromkeys(BEST_COVER)
    if not scenario.users_stay:
        return measures
    world = build_world(scenario, scenario.effective_world_seed)
    places, percent = Spots(world), 100 / len(world.homes)
    best = cover(places)
    measures["cover_qoe3_percent"] = percent * best.users if best.exact else None
    fair = None if scenario.limited_battery else fair_cover(places)
    if fair is not None:
        reward = fair.score / len(world.homes) / scenario.drone_count
        measures["fair_reward"] = reward * scenario.episode.steps
        measures["fair_qoe3_percent"] = percent * fair.users
        measures["fair_least_qoe3_percent"] = None if fair.least is None else percent * fair.least
    return measures


def _finished(job: Job, folder: Path) -> dict[str, Any] | None:
    """Return the row of this job if it was finished before, else None."""
    try:
        record = json.loads((folder / "jobs" / f"{job.name}.json").read_text(encoding="utf-8"))
        if (record["identity"], record["sha256"]) == (job.identity(), of_row(record["row"])):
            return dict(record["row"])
    except (OSError, ValueError, KeyError, TypeError):
        pass
    return None


def _mean(values: Sequence[float | None]) -> float | None:
    there = [value for value in values if value is not None]
    return float(np.mean(there)) if there else None
