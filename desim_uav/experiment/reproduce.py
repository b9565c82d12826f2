"""The paper's table: its nine cases, learned and evaluated on many seeds, beside what it printed.

A job is one policy in one case on one seed. A learner trains in the world of its seed and is then
evaluated greedily on sample paths it has never met; the baseline is evaluated on the same ones. A
finished job is a file, so that nothing is lost and the same command goes on where it was.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from dataclasses import dataclass
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from desim_uav.experiment.evaluate import evaluate
from desim_uav.experiment.published import POLICIES
from desim_uav.experiment.train import train
from desim_uav.run_folder import write_whole
from desim_uav.scenario.load import load, scenario_hash
from desim_uav.scenario.schema import Scenario
from desim_uav.shipped import scenario_path
from desim_uav.world import build_world

EPISODES, WARMUP = 20, 2
"""Evaluated greedily, after so many that are not counted."""

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
        settings += [] if self.policy == "baseline" else [f"learning.algorithm={self.policy}"]
        settings += [] if self.episodes is None else [f"learning.episodes={self.episodes}"]
        return load(scenario_path(f"case{self.case}"), settings)

    def identity(self) -> str:
        """What a finished job must share with this one to stand for it."""
        return f"{scenario_hash(self.scenario())}/{self.policy}/{EPISODES}+{WARMUP}"


def jobs(
    cases: Sequence[int], seeds: int, episodes: int | None, presets: Sequence[str | None]
) -> list[Job]:
    """All jobs of a table, the long ones first."""
    found = [
        Job(case, policy, seed, preset, episodes)
        for preset in presets
        for case in sorted(cases, reverse=True)
        for policy in POLICIES
        for seed in range(seeds)
    ]
    return sorted(found, key=lambda job: job.policy == "baseline")


def run_jobs(
    todo: Sequence[Job], folder: Path, workers: int, on_job: Callable[[], None] = lambda: None
) -> Iterator[dict[str, Any]]:
    """The row of each job, as it ends. Those already in the folder come first."""
    left = []
    for job in todo:
        row = _finished(job, folder)
        if row is None:
            left.append(job)
        else:
            on_job()
            yield row
    for row in _executed(left, folder, workers):
        on_job()
        yield row


def _executed(todo: Sequence[Job], folder: Path, workers: int) -> Iterator[dict[str, Any]]:
    if workers == 1:
        for job in todo:
            yield run_job(job, folder)
        return
    with ProcessPoolExecutor(workers, mp_context=get_context("spawn")) as pool:
        try:
            waiting: set[Future[dict[str, Any]]] = {
                pool.submit(run_job, job, folder) for job in todo
            }
            while waiting:
                done, waiting = wait(waiting, return_when=FIRST_COMPLETED)
                for future in done:
                    yield future.result()
        except BaseException:
            pool.shutdown(wait=False, cancel_futures=True)
            for process in list(getattr(pool, "_processes", {}).values()):
                process.terminate()
            raise


def run_job(job: Job, folder: Path) -> dict[str, Any]:
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
        table, progress = train(scenario, build_world(scenario, scenario.effective_world_seed))
        file = folder / "policies" / f"{job.name}.npz"
        file.parent.mkdir(parents=True, exist_ok=True)
        write_whole(file, table.to_bytes())
        policy = str(file)
        row["episodes"] = scenario.learning.episodes
        last = [vars_of for vars_of in (p._asdict() for p in progress[-scenario.drones.count :])]
        row |= {f"last_{key}": _mean([one[key] for one in last]) for key in LAST_EPISODE}
    row |= evaluate(scenario, policy, job.seed, EPISODES, WARMUP)
    file = folder / "jobs" / f"{job.name}.json"
    file.parent.mkdir(parents=True, exist_ok=True)
    content = json.dumps({"identity": job.identity(), "row": row}, indent=1, allow_nan=False)
    write_whole(file, content.encode())
    return row


def _finished(job: Job, folder: Path) -> dict[str, Any] | None:
    """The row of a job that was finished before, if it was this very job."""
    try:
        found = json.loads((folder / "jobs" / f"{job.name}.json").read_text(encoding="utf-8"))
        if found["identity"] == job.identity():
            return dict(found["row"])
    except (OSError, ValueError, KeyError, TypeError):
        pass
    return None


def _mean(values: Sequence[float | None]) -> float | None:
    there = [value for value in values if value is not None]
    return float(np.mean(there)) if there else None


def rows_frame(rows: Sequence[dict[str, Any]]) -> pd.DataFrame:
    """A row a job, by case, preset, policy and seed."""
    frame = pd.DataFrame(list(rows))
    order = pd.CategoricalDtype(list(POLICIES), ordered=True)
    frame["policy"] = frame["policy"].astype(order)
    return frame.sort_values(["case", "preset", "policy", "seed"], ignore_index=True)
