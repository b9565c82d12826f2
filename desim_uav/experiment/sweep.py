"""A sweep: policies, or trainings, in every combination of some keys' values, on common seeds.

A job is one of them on one seed. It is a function of what it is given, wherever it runs, and comes
back as a row; a learner trains first and is then evaluated greedily. What is wrong with a
combination is said before anything runs.
"""

from __future__ import annotations

import hashlib
import inspect
import json
import platform
import tempfile
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple, Protocol

from desim_uav import __version__
from desim_uav.engine.choose import check_engine, engine_for
from desim_uav.errors import DesimError, PolicyError, ScenarioError, UsageError
from desim_uav.experiment.evaluate import MEASURES, evaluate
from desim_uav.experiment.grid import MOST, Axis, Combination, combinations
from desim_uav.experiment.statistics import Estimate, estimate
from desim_uav.experiment.train import train
from desim_uav.learning.learner import load_algorithm
from desim_uav.learning.training import table_features
from desim_uav.model.streams import Purpose, Streams
from desim_uav.policies import load_policy
from desim_uav.registry import names
from desim_uav.scenario.load import load, scenario_hash
from desim_uav.scenario.schema import Scenario
from desim_uav.shipped import find_table
from desim_uav.world import World, build_world

MOST_PROBLEMS = 100
"""Said of a sweep's combinations, at most."""

Row = dict[str, Any]


@dataclass(frozen=True)
class Arm:
    """A policy in a combination, or an ``algorithm`` that learns one there.

    ``source``: the policy with the whole path of its file; ``digest``: of that file. ``engine``:
    des or batch.
    """

    combination: Combination
    policy: str
    algorithm: str | None
    source: str
    digest: str
    scenario: Scenario
    scenario_hash: str
    engine: str

    @property
    def name(self) -> str:
        """What a message calls it."""
        return ", ".join(filter(None, (self.combination.name, self.policy)))


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


def arms(
    path: Path,
    axes: Sequence[Axis],
    policies: Sequence[str],
    algorithms: Sequence[str | None],
    seed: int,
    engine: str | None = None,
) -> list[Arm]:
    """Everything a sweep tries on each seed, by combination; each begins in the world of ``seed``.

    ``algorithms``: what is trained; None is the scenario's own. ``engine``: None is the compiled
    one where it can be. Raises ScenarioError with every problem of every combination; then
    PolicyError, alike.
    """
    found: list[Arm] = []
    problems = _Problems()
    for combination in combinations(axes):
        problems.combinations.append(combination)
        if policies:
            with problems.noted():
                found += _policy_arms(path, combination, policies, seed, engine)
        for algorithm in algorithms:
            with problems.noted():
                found.append(_learning_arm(path, combination, algorithm, seed, engine))
    problems.complain()
    return found


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
    except Exception as error:
        return Outcome(failure=f"{type(error).__name__}: {error}")


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


def policy_digest(policy: str) -> str:
    """The SHA-256 of a policy's file, or of the file of its class; empty for a built-in.

    Raises PolicyError where it cannot be read.
    """
    file = _policy_file(policy)
    if file is None and policy in names("policy"):
        return ""
    try:
        file = file or Path(inspect.getsourcefile(type(load_policy(policy))) or "")
        return hashlib.sha256(file.read_bytes()).hexdigest()
    except (OSError, TypeError) as error:
        raise PolicyError(f"policy {policy!r}: its file cannot be read: {error}") from error


def _policy_arms(
    path: Path, combination: Combination, policies: Sequence[str], seed: int, engine: str | None
) -> Iterator[Arm]:
    scenario, world, chosen = _prepared(path, combination.settings, seed, engine)
    hashed = _hash(scenario)
    for policy in policies:
        load_policy(policy).begin(world, Streams(seed, Purpose.LEARNER), False)
        source = _source(policy)
        yield Arm(
            combination, policy, None, source, policy_digest(policy), scenario, hashed, chosen
        )


def _learning_arm(
    path: Path, combination: Combination, algorithm: str | None, seed: int, engine: str | None
) -> Arm:
    settings = list(combination.settings)
    settings += [] if algorithm is None else [f'learning.algorithm="{algorithm}"']
    scenario, world, chosen = _prepared(path, settings, seed, engine)
    name = scenario.learning.algorithm
    table_features(world, load_algorithm(name).tables)
    return Arm(combination, name, name, "", "", scenario, _hash(scenario), chosen)


def _prepared(
    path: Path, settings: Sequence[str], seed: int, engine: str | None
) -> tuple[Scenario, World, str]:
    """A scenario, its world on a seed, and the engine. Raises ScenarioError, naming the file."""
    scenario = load(path, settings)
    try:
        world = _world(scenario, seed)
        chosen = engine or engine_for(world)
        check_engine(chosen, world)
    except ScenarioError as error:
        raise ScenarioError(*(f"{path}: {problem}" for problem in error.problems)) from error
    return scenario, world, chosen


class _Problems:
    """What is wrong with combinations, each problem once."""

    def __init__(self) -> None:
        self.combinations: list[Combination] = []
        self._of: dict[type[DesimError], dict[str, list[Combination]]] = {
            ScenarioError: {},
            PolicyError: {},
        }

    @contextmanager
    def noted(self) -> Iterator[None]:
        """Note what is raised, as of the latest combination."""
        try:
            yield
        except (ScenarioError, PolicyError) as error:
            for line in str(error).splitlines():
                where = self._of[type(error)].setdefault(line, [])
                where += self.combinations[-1:] if self.combinations[-1] not in where[-1:] else []

    def complain(self) -> None:
        """Raise what was noted: of scenarios, else of policies."""
        for of_type, noted in self._of.items():
            lines = [self._line(problem, where) for problem, where in noted.items()]
            if len(lines) > MOST_PROBLEMS:
                lines[MOST_PROBLEMS:] = [f"and {len(lines) - MOST_PROBLEMS} more"]
            if lines:
                raise of_type(*lines) if of_type is ScenarioError else of_type("\n".join(lines))

    def _line(self, problem: str, where: Sequence[Combination]) -> str:
        """A problem and what the combinations that have it share, or the first of them."""
        shared = [text for text in where[0].varied if all(text in c.varied for c in where)]
        alike = [c for c in self.combinations if set(shared) <= set(c.varied)]
        if len(alike) == len(where):
            return f"{problem} (with {', '.join(shared)})" if shared else problem
        return f"{problem} (with {where[0].name} and {len(where) - 1} more combination(s))"


def _hash(scenario: Scenario) -> str:
    return scenario_hash(scenario.model_copy(update={"seed": 0}))


def _source(policy: str) -> str:
    """A policy's name, which means the same in any folder."""
    kind, colon, argument = policy.partition(":")
    if _policy_file(policy) is None:
        return policy
    if not colon or kind not in names("policy"):
        return str(Path(policy).absolute()) if Path(policy).exists() else policy
    return f"{kind}:{Path(argument).absolute()}" if Path(argument).exists() else policy


def _policy_file(policy: str) -> Path | None:
    """The file that a policy's name holds, if it holds one."""
    kind, _, argument = policy.partition(":")
    if policy.endswith(".npz") and kind != "table":
        return find_table(policy)
    return find_table(argument) if argument and kind in names("policy") else None
