"""The paper's table: its nine cases, learned and evaluated on many seeds, beside what it printed.

A job is one policy in one case on one seed. A learner trains in the world of its seed and is then
evaluated greedily on sample paths it has never met; the baseline is evaluated on the same ones. A
finished job is a file, so that nothing is lost and the same command goes on where it was.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from desim_uav import __version__
from desim_uav.checksums import of_row
from desim_uav.errors import UsageError
from desim_uav.experiment.evaluate import evaluate
from desim_uav.experiment.paper_table import (
    Claim,
    Line,
    claims,
    lines,
    markdown,
    rows_csv,
    table_csv,
)
from desim_uav.experiment.processes import run_each
from desim_uav.experiment.published import POLICIES, PUBLISHED
from desim_uav.experiment.train import train
from desim_uav.optimum.cover import Places, cover, fair_cover
from desim_uav.run_folder import try_writing, write_whole
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
    """One policy in one case on one seed; ``preset``: as the paper's code had it, or as we do."""

    case: int
    policy: str
    seed: int
    preset: str | None
    episodes: int | None

    @property
    def name(self) -> str:
        """A name for its files."""
        return f"case{self.case}-{self.policy}-{self.preset or 'default'}-s{self.seed}"

    def scenario(self) -> Scenario:
        """The scenario it trains and is evaluated in."""
        settings = [f"seed={self.seed}"]
        settings += [] if self.preset is None else [f"preset={self.preset}"]
        if self.policy != "baseline":
            settings += [f"learning.algorithm={self.policy}"]
            settings += [] if self.episodes is None else [f"learning.episodes={self.episodes}"]
        return load(scenario_path(f"case{self.case}"), settings)

    def identity(self) -> str:
        """What a finished job must share with this one to stand for it."""
        scenario = scenario_hash(self.scenario())
        return f"{__version__}/{scenario}/{self.policy}/{EPISODES}+{WARMUP}"


def jobs(
    cases: Sequence[int], seeds: range, episodes: int | None, presets: Sequence[str | None]
) -> list[Job]:
    """List all jobs of a table, the long ones first."""
    found = [
        Job(case, policy, seed, preset, episodes)
        for preset in presets
        for case in sorted(cases, reverse=True)
        for policy in POLICIES
        for seed in seeds
    ]
    return sorted(found, key=lambda job: job.policy == "baseline")


def numbers(text: str) -> list[int]:
    """The cases of a text such as ``1-3,8``. Raises UsageError."""
    found: set[int] = set()
    for part in text.split(","):
        ends = [end.strip() for end in part.split("-")]
        if len(ends) > 2 or not all(end in CASES for end in ends) or ends[0] > ends[-1]:
            raise UsageError(f"--cases {text}: write 1-9, or 1,4,8; the paper has cases 1 to 9")
        found.update(range(int(ends[0]), int(ends[-1]) + 1))
    return sorted(found)


def open_folder(folder: Path) -> None:
    """Make the folder of a table before anything is trained. Raises UsageError."""
    try:
        for name in ("jobs", "policies"):
            (folder / name).mkdir(parents=True, exist_ok=True)
            try_writing(folder / name)
    except OSError as error:
        raise UsageError(f"--out {folder}: {error.strerror}") from error


def report(rows: Sequence[dict[str, Any]], folder: Path, command: str) -> Report:
    """Make the table of the rows there are, and write it: rows.csv, table.csv and table.md."""
    rows = [row | best_cover(row["case"], row["seed"]) for row in rows]
    table, found = lines(rows), claims(rows)
    write_whole(folder / "rows.csv", rows_csv(rows).encode())
    write_whole(folder / "table.csv", table_csv(table).encode())
    seeds = {row["seed"] for row in rows}
    write_whole(folder / "table.md", markdown(table, found, seeds, command).encode())
    return Report(table, found, folder)


class Report(NamedTuple):
    """The paper's table, and what is claimed of it."""

    table: list[Line]
    claims: list[Claim]
    folder: Path

    @property
    def failed(self) -> list[Claim]:
        """The gates that do not hold."""
        return [claim for claim in self.claims if claim.gate and not claim.holds]


def run_jobs(
    todo: Sequence[Job],
    folder: Path,
    workers: int,
    on_job: Callable[[], None] = lambda: None,
    engine: str = "batch",
) -> list[dict[str, Any]]:
    """The rows of all jobs; those the folder holds already are not run again.

    ``engine``: des or batch; the rows are the same, so they may be of the other engine. Raises
    UsageError where nothing can be written to the folder.
    """
    open_folder(folder)
    finished = {job: _finished(job, folder) for job in todo}
    rows = [row for row in finished.values() if row is not None]
    for _ in rows:
        on_job()

    def on_end(number: int, row: dict[str, Any]) -> None:
        rows.append(row)
        on_job()

    left = [(job, folder, engine) for job, row in finished.items() if row is None]
    run_each(run_job, left, workers, on_end)
    return rows


def run_job(job: Job, folder: Path, engine: str = "batch") -> dict[str, Any]:
    """Train if it learns, evaluate, keep the row (and the table) in the folder."""
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
        world = build_world(scenario, scenario.effective_world_seed)
        table, progress = train(scenario, world, engine=engine)
        file = folder / "policies" / f"{job.name}.npz"
        write_whole(file, table.to_bytes())
        policy = str(file)
        row["episodes"] = scenario.learning.episodes
        last = progress[-scenario.drones.count :]
        row |= {f"last_{key}": _mean([getattr(one, key) for one in last]) for key in LAST_EPISODE}
    row |= evaluate(scenario, policy, job.seed, EPISODES, WARMUP, engine)
    file = folder / "jobs" / f"{job.name}.json"
    kept = {"identity": job.identity(), "row": row, "sha256": of_row(row)}
    content = json.dumps(kept, indent=1, allow_nan=False)
    write_whole(file, content.encode())
    return row


@cache
def best_cover(case: int, seed: int) -> dict[str, float | None]:
    """The QoE3 that hovering forever over the best cells would give, where users stand still.

    No policy does better; with a battery none can do as well. ``fair``: the most that hovering
    drones are rewarded by R1 for, over the steps of an episode, and the range of QoE3 it leaves.
    """
    scenario = load(scenario_path(f"case{case}"), [f"seed={seed}"])
    found: dict[str, float | None] = dict.fromkeys(BEST_COVER)
    if getattr(scenario.users.mobility, "kind", "") != "static":
        return found
    world = build_world(scenario, scenario.effective_world_seed)
    places, percent = Places(world), 100 / len(world.homes)
    best = cover(places)
    found["cover_qoe3_percent"] = percent * best.users if best.exact else None
    fair = None if scenario.limited_battery else fair_cover(places)
    if fair is not None:
        reward = fair.score / len(world.homes) / scenario.drones.count
        found["fair_reward"] = reward * scenario.episode.steps
        found["fair_qoe3_percent"] = percent * fair.users
        found["fair_least_qoe3_percent"] = None if fair.least is None else percent * fair.least
    return found


def _finished(job: Job, folder: Path) -> dict[str, Any] | None:
    """The row of a job that was finished before, if it was this very job."""
    try:
        found = json.loads((folder / "jobs" / f"{job.name}.json").read_text(encoding="utf-8"))
        if (found["identity"], found["sha256"]) == (job.identity(), of_row(found["row"])):
            return dict(found["row"])
    except (OSError, ValueError, KeyError, TypeError):
        pass
    return None


def _mean(values: Sequence[float | None]) -> float | None:
    there = [value for value in values if value is not None]
    return float(np.mean(there)) if there else None
