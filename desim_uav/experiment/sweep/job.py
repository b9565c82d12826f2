"""A job of a sweep: one policy or training in one combination on one seed.

Its result is a row that depends on the job only, not on the machine. A learner trains first and is
then evaluated greedily.
"""

from __future__ import annotations

import hashlib
import json
import platform
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

from desim_uav import __version__
from desim_uav.errors import DesimError, PolicyError, UsageError
from desim_uav.experiment.evaluate import evaluate
from desim_uav.experiment.sweep.grid import MOST
from desim_uav.experiment.sweep.plan import Arm, SweepPlan, policy_digest, unseeded_hash
from desim_uav.experiment.train.course import train
from desim_uav.measures.known import chosen, compared_in
from desim_uav.policies.base import PolicyLike
from desim_uav.policies.tabular import Greedy
from desim_uav.registry import FAULTS, what_failed

JobRow = dict[str, Any]


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

    def row(self, measures: dict[str, float | None]) -> JobRow:
        """Return the row that is kept of the job."""
        arm, world_seed = self.arm, self.arm.scenario.world_seed
        row = {"job": self.id} | arm.combination.cells | {"policy": arm.policy}
        row |= {"algorithm": arm.algorithm, "seed": self.seed}
        return row | {"world_seed": self.seed if world_seed is None else world_seed} | measures


class JobOutcome(NamedTuple):
    """The measures of a job and the Q-table it learned, or the reason for its failure."""

    measures: dict[str, float | None] | None
    table: bytes | None = None
    failure: str = ""

    @classmethod
    def failed(cls, reason: str) -> JobOutcome:
        """Return the outcome of a job that has failed."""
        return cls(None, None, reason)


class Failure(NamedTuple):
    """A failed job and the reason."""

    job: Job
    reason: str

    def content(self) -> JobRow:
        """Return the failure as plain data."""
        arm = self.job.arm
        row = {"job": self.job.id} | arm.combination.cells | {"policy": arm.policy}
        return row | {"seed": self.job.seed, "reason": self.reason}


def jobs(plan: SweepPlan, tried: Sequence[Arm]) -> list[Job]:
    """Return the jobs of every arm on every seed. Raises UsageError if there are too many."""
    count = len(tried) * len(plan.seeds)
    if count > MOST:
        raise UsageError(f"{count} jobs are too many; at most {MOST} are allowed")
    return [Job(arm, seed, plan.episodes, plan.warmup) for seed in plan.seeds for arm in tried]


def measured(todo: Sequence[Job], more: Sequence[str] = ()) -> tuple[str, ...]:
    """Return the names of the measures of these jobs; a row is null where its scenario has none.

    They are those of comparisons in any of the scenarios, and ``more``. Raises UsageError for one
    of these that no scenario has.
    """
    arms = {id(job.arm): job.arm for job in todo}
    scenarios = [arm.scenario for arm in arms.values()]
    return tuple(dict.fromkeys((*compared_in(*scenarios), *chosen(more, *scenarios))))


def run_job(
    job: Job, version: str = __version__, measures: Sequence[str] | None = None
) -> JobOutcome:
    """Train if the arm learns, and evaluate; an error becomes part of the outcome.

    ``version`` is that of the package on the machine where the sweep began.
    """
    try:
        return _run(job, version, measures)
    except DesimError as error:
        return JobOutcome.failed(" ".join(str(error).split("\n")))
    except FAULTS as error:
        return JobOutcome.failed(what_failed(error))


def _run(job: Job, version: str, names: Sequence[str] | None) -> JobOutcome:
    arm, table = job.arm, None
    if __version__ != version:
        here = f"{__version__} on {platform.node()}"
        raise DesimError(f"desim-uav is {here}, but the sweep began with {version}")
    if arm.algorithm is None and policy_digest(arm.source) != arm.digest:
        raise PolicyError(f"{arm.policy}: the file has changed since the sweep began")
    if unseeded_hash(arm.scenario) != arm.scenario_hash:
        name = arm.scenario.name
        raise DesimError(f"{name}: a file or component of it has changed since the sweep began")
    policy: PolicyLike = arm.source
    if arm.algorithm is not None:
        scenario = arm.scenario.model_copy(update={"seed": job.seed})
        table, _ = train(scenario, arm.engine)
        policy = Greedy.of_table(table, arm.policy)
    measures = evaluate(
        *(arm.scenario, policy, job.seed, job.episodes, job.warmup, arm.engine), measures=names
    )
    return JobOutcome(measures, None if table is None else table.to_bytes())
