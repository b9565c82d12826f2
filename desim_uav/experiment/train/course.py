"""A training in memory: it learns from its episodes, with pauses between them."""

from __future__ import annotations

import platform
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

from desim_uav import __version__
from desim_uav.columns import to_frame
from desim_uav.engine.choose import engine_for
from desim_uav.errors import SimulationError
from desim_uav.experiment.interrupt import asked_to_stop, at_once
from desim_uav.experiment.provenance import clock
from desim_uav.learning.training import Progress, Training
from desim_uav.policies.tabular import QTable, described
from desim_uav.records import TRAINING
from desim_uav.run_folder import world_hash
from desim_uav.scenario.load import dump, scenario_hash
from desim_uav.scenario.schema import Scenario
from desim_uav.world import build_world

POLICY = "policy.npz"
LAST = 100
"""The number of last episodes over whose means a training is summarized."""

OnEpisode = Callable[[list[Progress]], None]


class Asked(NamedTuple):
    """How a training was asked for: the command, the keys that were set, and its label."""

    command: Sequence[str] = ()
    overrides: Sequence[str] = ()
    name: str | None = None


NOT_SAID: Asked = Asked()


@dataclass
class TrainingCourse:
    """A training and its rows so far, one per drone and episode; ``folder`` is where it is kept.

    ``first`` is the episode at which it was resumed. ``stopped`` says that a callback has ended it
    before its last episode; it then counts as finished.
    """

    training: Training
    asked: Asked = NOT_SAID
    rows: list[Progress] = field(default_factory=list)
    folder: Path | None = None
    first: int = 0
    stopped: bool = False
    now: Callable[[], str] = field(default_factory=clock)
    started: str = ""
    finished: str = ""

    def __post_init__(self) -> None:
        """Note the time."""
        self.started = self.now()

    @property
    def interrupted(self) -> bool:
        """Whether Ctrl-C ended the training before its last episode."""
        return not self.stopped and self.training.episode < self.training.settings.episodes

    def summary(self) -> dict[str, Any]:
        """Return the means of the last episodes, and the folder and policy file if there is one."""
        training, last = self.training, to_frame(TRAINING, self.rows)
        last = last[last["episode"] >= training.episode - LAST]
        folder = self.folder
        where = {} if folder is None else {"folder": str(folder), "policy": str(folder / POLICY)}
        return {
            **({"name": self.asked.name} if self.asked.name else {}),
            "scenario": training.world.scenario.name,
            "algorithm": training.settings.algorithm,
            "seed": training.seed,
            "world_seed": training.world.seed,
            "episodes": training.episode,
            "over_last": min(LAST, training.episode),
            "reward_mean": _mean(last["reward"]),
            "qoe1_percent": _mean(last["qoe1_percent"]),
            "qoe2_iterations": _mean(last["qoe2_iterations"]),
            "qoe3_percent": _mean(last["qoe3_percent"]),
            "crashes_per_drone_episode": _mean(last["crashes"]),
            **where,
        }


@dataclass(frozen=True)
class TrainingPause:
    """An action after every ``every`` episodes; if it returns False, the training stops.

    With ``at_end`` it is also done after the last episode, whatever its number.
    """

    every: int
    act: Callable[[TrainingCourse], bool | None]
    at_end: bool = False

    def after(self, episode: int) -> int:
        """Return the next episode after which the action is due."""
        return episode + self.every - episode % self.every

    def is_due(self, episode: int, last: int) -> bool:
        """Return whether the action is due after ``episode`` of ``last`` episodes."""
        return episode % self.every == 0 or (self.at_end and episode == last)


def train(scenario: Scenario, engine: str = "auto") -> tuple[QTable, list[Progress]]:
    """Train from beginning to end; return the learned table, and a row per drone and episode.

    ``engine`` is auto (that of ``engine_for``), des or batch. Raises SimulationError if values
    are learned that are not finite.
    """
    course = begin(scenario, engine)
    learn(course)
    return learned(course.training), course.rows


def train_in_memory(
    scenario: Scenario,
    *,
    asked: Asked,
    engine: str,
    pauses: Sequence[TrainingPause],
    on_episode: OnEpisode,
) -> TrainingCourse:
    """Train and write nothing. Ctrl-C ends the training after the current episodes."""
    course = begin(scenario, engine, asked)
    with asked_to_stop("these episodes") as stop:
        learn(course, pauses, on_episode, stop)
    return course


def begin(scenario: Scenario, engine: str = "auto", asked: Asked = NOT_SAID) -> TrainingCourse:
    """Begin a training; ``engine`` is auto (that of ``engine_for``), des or batch."""
    world = at_once(build_world, scenario, scenario.effective_world_seed)
    kind = engine_for(world) if engine == "auto" else engine
    return TrainingCourse(Training(world, scenario.seed, kind), asked)


def learn(
    course: TrainingCourse,
    pauses: Sequence[TrainingPause] = (),
    on_episode: OnEpisode = lambda rows: None,
    stop: Callable[[], bool] = lambda: False,
) -> None:
    """Learn until the last episode, until ``stop()`` is true, or until a pause returns False.

    Compiled code learns several episodes at once. Pauses come exactly after the episodes at which
    they are due, and do not change the result.
    """
    training, last = course.training, course.training.settings.episodes
    drones = len(training.learners)
    while training.episode < last and not stop() and not course.stopped:
        following = min([last, *(pause.after(training.episode) for pause in pauses)])
        rows = at_once(training.play, following - training.episode)
        course.rows += rows
        for first in range(0, len(rows), drones):
            on_episode(rows[first : first + drones])
        for pause in pauses:
            if pause.is_due(training.episode, last) and pause.act(course) is False:
                course.stopped = training.episode < last
    course.finished = course.now()


def learned(training: Training) -> QTable:
    """Return the policy of a finished training. Raises SimulationError if it is not of numbers."""
    if not np.isfinite(training.q).all():
        raise SimulationError(
            f"learning.algorithm: {training.settings.algorithm!r} has learned values that are not "
            "finite"
        )
    return table_of(training)


def table_of(training: Training) -> QTable:
    """Return the policy that a training has learned so far: the mean of each drone's Q-tables."""
    world, scenario = training.world, training.world.scenario
    about = {
        "features": described(training.features),
        "actions": [action.name.lower() for action in world.actions],
        "scenario": scenario.name,
        "scenario_hash": scenario_hash(scenario),
        "scenario_yaml": dump(scenario),
        "world_seed": world.seed,
        "world_hash": world_hash(world),
        "seed": training.seed,
        "algorithm": training.settings.algorithm,
        "episodes": training.episode,
        "versions": {
            "desim-uav": __version__,
            "python": platform.python_version(),
            "numpy": np.__version__,
        },
    }
    return QTable(training.q.mean(axis=1, dtype=np.float32), about)


def _mean(column: pd.Series) -> float | None:
    there = column.dropna()
    return float(there.mean()) if len(there) else None
