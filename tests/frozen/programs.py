"""What is frozen: runs and trainings by name, and the digests of what they give."""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Iterator
from functools import lru_cache
from pathlib import Path
from typing import Literal, NamedTuple, Protocol

import numpy as np
import pandas as pd

import desim_uav
from tests.frozen.digest import of_array, of_table
from tests.frozen.scenarios import CASES, COMMITTED, RANDOM, ROOT, SCENARIOS, of_name, of_seed

ENGINES = ("des", "batch")
RUN_TABLES = ("requests", "steps", "episodes", "users", "events", "legs")

Columns = dict[str, dict[str, str]]
"""Of each table the columns that are frozen, with their types."""


class Program(Protocol):
    """A run, an episode or a training whose digests are frozen; ``str`` gives its name."""

    def digests(self, engine: str, columns: Columns) -> dict[str, str]:
        """Return the digest of each table."""


class Run(NamedTuple):
    """A policy in a scenario on a seed: a warm-up episode and two that count."""

    scenario: str
    policy: str
    seed: int

    def __str__(self) -> str:
        return f"{self.scenario}, {self.policy}, seed {self.seed}"

    def digests(self, engine: str, columns: Columns) -> dict[str, str]:
        """Return the digest of each table of the run."""
        tables = self.tables(engine)
        return {name: of_table(tables[name], columns[name]) for name in RUN_TABLES}

    def tables(self, engine: str) -> dict[str, pd.DataFrame]:
        """Return the tables of the run by an engine."""
        case, changes = of_name(self.scenario)
        result = desim_uav.run(
            case,
            changes,
            policy=self._policy(),
            seed=self.seed,
            world_seed=self._world_seed(),
            warmup=1,
            episodes=2,
            events=True,
            engine=engine,
            progress=False,
        )
        return {name: getattr(result, name) for name in RUN_TABLES}

    def _world_seed(self) -> int | None:
        """Return the world of a shipped table; other policies fly in that of the seed."""
        return 0 if self.policy == "learned" and self.scenario in CASES else None

    def _policy(self) -> str | desim_uav.TrainingResult:
        if self.policy != "learned":
            return self.policy
        shipped = self.scenario in CASES
        return f"{self.scenario}.npz" if shipped else _learned(self.scenario, self.seed)


@lru_cache(maxsize=10)
def _learned(scenario: str, seed: int) -> desim_uav.TrainingResult:
    """A table that no one has shipped: after 60 episodes, by the compiled engine."""
    case, changes = of_name(scenario)
    return desim_uav.train(case, changes, seed=seed, episodes=60, engine="batch", progress=False)


class Training(NamedTuple):
    """A training of 40 episodes with an algorithm."""

    scenario: str
    algorithm: str
    seed: int

    def __str__(self) -> str:
        return f"{self.scenario}, trained by {self.algorithm}, seed {self.seed}"

    def digests(self, engine: str, columns: Columns) -> dict[str, str]:
        """Return the digest of the learning curve and that of the tables of values."""
        case, changes = of_name(self.scenario)
        result = desim_uav.train(
            case,
            changes,
            algorithm=self.algorithm,
            seed=self.seed,
            episodes=40,
            engine=engine,
            progress=False,
        )
        with tempfile.TemporaryDirectory() as folder:
            result.save(Path(folder) / "training")
            with np.load(Path(folder) / "training" / "policy.npz") as stored:
                values = stored["q"]
        return {"training": of_table(result.curve, columns["training"]), "policy": of_array(values)}


class Episode(NamedTuple):
    """One episode of a committed scenario, or of a random one with everything (its number)."""

    scenario: str | int
    policy: str

    def __str__(self) -> str:
        name = f"random {self.scenario}" if isinstance(self.scenario, int) else self.scenario
        return f"{name}, {self.policy}"

    def digests(self, engine: str, columns: Columns) -> dict[str, str]:
        """Return the digest of each table of the run."""
        result = desim_uav.run(
            of_seed(self.scenario) if isinstance(self.scenario, int) else ROOT / self.scenario,
            policy=self.policy,
            seed=3,
            warmup=0,
            episodes=1,
            events=True,
            engine=engine,
            progress=False,
        )
        return {name: of_table(getattr(result, name), columns[name]) for name in RUN_TABLES}


POLICIES = ("baseline", "random", "learned")
ALGORITHMS = ("q_learning", "sarsa", "expected_sarsa", "double_q")
TRAINED = ("case1", "case5", "case8", "case9", "replaced at once", "crash ends the episode")
SEEDS = range(10)


def runs(scenario: str, policies: tuple[str, ...] = POLICIES, seeds=SEEDS) -> list[Run]:
    """Return the frozen runs of a scenario."""
    return [Run(scenario, policy, seed) for policy in policies for seed in seeds]


def trainings(scenario: str) -> list[Training]:
    """Return the frozen trainings in a scenario: each algorithm on a seed of its own."""
    return [Training(scenario, algorithm, seed) for seed, algorithm in enumerate(ALGORITHMS)]


def programs() -> Iterator[Run | Training]:
    """Return the frozen runs and trainings of the nine cases and of cases with changed keys."""
    for scenario in SCENARIOS:
        yield from runs(scenario)
    for scenario in TRAINED:
        yield from trainings(scenario)


def episodes() -> Iterator[Episode]:
    """Return the frozen episodes."""
    for scenario in COMMITTED:
        yield Episode(scenario, "random")
    for seed in RANDOM:
        yield Episode(seed, "random")


Sets = Literal["digests", "episodes"]


def sets() -> dict[Sets, Callable[[], Iterator[Program]]]:
    """Return the programs of each file of digests."""
    return {"digests": programs, "episodes": episodes}
