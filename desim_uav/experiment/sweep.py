"""A sweep: policies or trainings in every combination of the values of some keys, on common seeds.

A job is one policy or training in one combination on one seed. Its result is a row that depends on
the job only, not on the machine. A learner trains first and is then evaluated greedily.
"""

from __future__ import annotations

import hashlib
import json
import platform
import tempfile
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple, Protocol

from desim_uav import __version__
from desim_uav.errors import DesimError, PolicyError, UsageError
from desim_uav.experiment.evaluate import MEASURES, evaluate
from desim_uav.experiment.grid import MOST
from desim_uav.experiment.statistics import Estimate, estimate
from desim_uav.experiment.sweep_plan import Arm, policy_digest
from desim_uav.experiment.train import train
from desim_uav.registry import FAULTS, what_failed
from desim_uav.world import build_world

Row = dict[str, Any]


@dataclass(frozen=True)
class Job:
    """An arm on one seed, with the numbers of counted and of warm-up episodes."""

    arm: Arm
    seed: int
    episodes: int
    warmup: int

    @property
    def id(self) -> str:
        """A digest that identifies the job; the file of its row has this name."""
        arm = self.arm
        content = {
            "version": __version__,
            "scenario": arm.scenario_hash,
            "cells": arm.combination.cells,
            "policy": [arm.policy, arm.algorithm, arm.digest],
            "episodes": [self.seed, self.warmup, self.episodes],
        }
        text = json.dumps(content, sort_keys=True)
        return hashlib.sha256(text.encode()).hexdigest()[:20]

    def row(self, measures: dict[str, float | None]) -> Row:
        """Return the row that is kept of the job."""
        arm, world_seed = self.arm, self.arm.scenario.world_seed
        row = {"job": self.id} | arm.combination.cells | {"policy": arm.policy}
        row |= {"algorithm": arm.algorithm, "seed": self.seed}
        return row | {"world_seed": self.seed if world_seed is None else world_seed} | measures


class Outcome(NamedTuple):
    """The measures of a job and the Q-table it learned, or the reason for its failure."""

    measures: dict[str, float | None] | None = None
    table: bytes | None = None
    failure: str = ""


class Failure(NamedTuple):
    """A failed job and the reason."""

    job: Job
    reason: str

    def content(self) -> Row:
        """Return the failure as plain data."""
        arm = self.job.arm
        row = {"job": self.job.id} | arm.combination.cells | {"policy": arm.policy}
        return row | {"seed": self.job.seed, "reason": self.reason}


class Backend(Protocol):
    """Calls a function with the arguments of each task, on this machine or elsewhere.

    ``on_end`` gets the number and the result of a task, ``on_death`` the number of a task whose
    process has died, and the reason.
    """

    def __call__(
        self,
        function: Callable[..., Any],
        tasks: Sequence[tuple[Any, ...]],
        *,
        on_end: Callable[[int, Any], None],
        on_death: Callable[[int, str], None],
    ) -> None:
        """Run the tasks. Raises DesimError if nothing can be run there."""


class Keeper(Protocol):
    """Stores the outcomes of jobs, each completely or not at all."""

    def keep(self, job: Job, outcome: Outcome) -> Row:
        """Store the outcome of a job that has ended, and return its row."""


def jobs(found: Sequence[Arm], seeds: range, episodes: int, warmup: int) -> list[Job]:
    """Return the jobs of every arm on every seed. Raises UsageError if there are too many."""
    if len(found) * len(seeds) > MOST:
        raise UsageError(f"{len(found) * len(seeds)} jobs are too many; at most {MOST} are allowed")
    return [Job(arm, seed, episodes, warmup) for seed in seeds for arm in found]


def run_jobs(
    todo: Sequence[Job], keeper: Keeper, backend: Backend, on_job: Callable[[], None]
) -> tuple[list[Row], list[Failure], bool]:
    """Run jobs; return the rows of those that ended, the failures, and whether it was stopped."""
    rows: list[Row] = []
    failures: list[Failure] = []

    def on_end(number: int, outcome: Outcome) -> None:
        if outcome.measures is None:
            failures.append(Failure(todo[number], outcome.failure))
        else:
            rows.append(keeper.keep(todo[number], outcome))
        on_job()

    def on_death(number: int, reason: str) -> None:
        failures.append(Failure(todo[number], reason))
        on_job()

    try:
        tasks = [(job, __version__) for job in todo]
        backend(run_job, tasks, on_end=on_end, on_death=on_death)
    except KeyboardInterrupt:
        return rows, failures, True
    return rows, failures, False


def run_job(job: Job, version: str = __version__) -> Outcome:
    """Train if the arm learns, and evaluate; an error becomes part of the outcome.

    ``version`` is that of the package on the machine where the sweep began.
    """
    try:
        return _run(job, version)
    except DesimError as error:
        return Outcome(failure=" ".join(str(error).split("\n")))
    except FAULTS as error:
        return Outcome(failure=what_failed(error))


def estimates(todo: Sequence[Job], rows: Sequence[Row]) -> list[tuple[Arm, dict[str, Estimate]]]:
    """Return for each arm the estimates of its measures over the seeds that have ended."""
    row_of = {row["job"]: row for row in rows}
    of_arm: dict[int, tuple[Arm, list[Row]]] = {}
    for job in todo:
        _, found = of_arm.setdefault(id(job.arm), (job.arm, []))
        found += [row_of[job.id]] if job.id in row_of else []
    return [
        (arm, {name: estimate(row[name] for row in found) for name in MEASURES})
        for arm, found in of_arm.values()
    ]


def _run(job: Job, version: str) -> Outcome:
    arm = job.arm
    if __version__ != version:
        here = f"{__version__} on {platform.node()}"
        raise DesimError(f"desim-uav is {here}, but the sweep began with {version}")
    if arm.algorithm is None and policy_digest(arm.source) != arm.digest:
        raise PolicyError(f"{arm.policy}: the file has changed since the sweep began")
    with tempfile.TemporaryDirectory() as folder:
        policy, table = arm.source, None
        if arm.algorithm is not None:
            policy = str(Path(folder) / "policy.npz")
            table = _learned(job)
            Path(policy).write_bytes(table)
        found = evaluate(arm.scenario, policy, job.seed, job.episodes, job.warmup, arm.engine)
        return Outcome(found, table)


def _learned(job: Job) -> bytes:
    """Return the Q-table of a training in the world of its seed, as a file's content."""
    scenario = job.arm.scenario.model_copy(update={"seed": job.seed})
    world = build_world(scenario, scenario.effective_world_seed)
    table, _ = train(scenario, world, engine=job.arm.engine)
    return table.to_bytes()
