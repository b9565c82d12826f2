"""A sweep: policies, or trainings, in every combination of some keys' values, on common seeds.

A job is one of them on one seed. It is a function of what it is given, wherever it runs, and comes
back as a row; a learner trains first and is then evaluated greedily.
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
    """An arm on a seed: so many episodes after ``warmup``."""

    arm: Arm
    seed: int
    episodes: int
    warmup: int

    @property
    def id(self) -> str:
        """The same for the same job, and for no other: its row's file is named so."""
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
        """What is kept of it."""
        arm, world_seed = self.arm, self.arm.scenario.world_seed
        row = {"job": self.id} | arm.combination.cells | {"policy": arm.policy}
        row |= {"algorithm": arm.algorithm, "seed": self.seed}
        return row | {"world_seed": self.seed if world_seed is None else world_seed} | measures


class Outcome(NamedTuple):
    """What came of a job: its measures, and the table it learned; or why there is none."""

    measures: dict[str, float | None] | None = None
    table: bytes | None = None
    failure: str = ""


class Failure(NamedTuple):
    """A job without a row, and why."""

    job: Job
    reason: str

    def content(self) -> Row:
        """As plain data."""
        arm = self.job.arm
        row = {"job": self.job.id} | arm.combination.cells | {"policy": arm.policy}
        return row | {"seed": self.job.seed, "reason": self.reason}


class Backend(Protocol):
    """Calls a function with the arguments of each task, some at a time, wherever that is.

    ``on_end`` gets a task's number and result; ``on_death`` its number, and why there is none.
    """

    def __call__(
        self,
        function: Callable[..., Any],
        tasks: Sequence[tuple[Any, ...]],
        *,
        on_end: Callable[[int, Any], None],
        on_death: Callable[[int, str], None],
    ) -> None:
        """Raises DesimError where nothing can be run there."""


class Keeper(Protocol):
    """Keeps what jobs give, whole or not at all."""

    def keep(self, job: Job, outcome: Outcome) -> Row:
        """The row of a job that has ended, once it is safe."""


def jobs(found: Sequence[Arm], seeds: range, episodes: int, warmup: int) -> list[Job]:
    """Every arm on every seed, seed by seed. Raises UsageError where they are too many."""
    if len(found) * len(seeds) > MOST:
        raise UsageError(f"{len(found) * len(seeds)} jobs; at most {MOST}")
    return [Job(arm, seed, episodes, warmup) for seed in seeds for arm in found]


def run_jobs(
    todo: Sequence[Job], keeper: Keeper, backend: Backend, on_job: Callable[[], None]
) -> tuple[list[Row], list[Failure], bool]:
    """The rows of the jobs that ended, those that failed, and was it interrupted?"""
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
    """Train if it learns, and evaluate. Whatever goes wrong is said, not raised.

    ``version``: of the package where the sweep was begun.
    """
    try:
        return _run(job, version)
    except DesimError as error:
        return Outcome(failure=" ".join(str(error).split("\n")))
    except FAULTS as error:
        return Outcome(failure=what_failed(error))


def estimates(todo: Sequence[Job], rows: Sequence[Row]) -> list[tuple[Arm, dict[str, Estimate]]]:
    """Of each arm its measures, each over the seeds there are."""
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
        raise DesimError(f"desim-uav {here}, but the sweep was begun with {version}")
    if arm.algorithm is None and policy_digest(arm.source) != arm.digest:
        raise PolicyError(f"{arm.policy}: another file than when the sweep was begun")
    with tempfile.TemporaryDirectory() as folder:
        policy, table = arm.source, None
        if arm.algorithm is not None:
            policy = str(Path(folder) / "policy.npz")
            table = _learned(job)
            Path(policy).write_bytes(table)
        found = evaluate(arm.scenario, policy, job.seed, job.episodes, job.warmup, arm.engine)
        return Outcome(found, table)


def _learned(job: Job) -> bytes:
    """The table of a training in the world of its seed."""
    scenario = job.arm.scenario.model_copy(update={"seed": job.seed})
    world = build_world(scenario, scenario.effective_world_seed)
    table, _ = train(scenario, world, engine=job.arm.engine)
    return table.to_bytes()
