"""What a training has learned, and how it does meanwhile."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any

import pandas as pd

from desim_uav.api.parameters import Seed, TrainingEpisodes, Warmup
from desim_uav.columns import to_frame
from desim_uav.engine.compiled import BatchSimulation
from desim_uav.experiment.evaluate import evaluate
from desim_uav.experiment.replay.again import Source
from desim_uav.experiment.train.course import POLICY, TrainingCourse, TrainingPause, table_of
from desim_uav.experiment.train.folder import save_training
from desim_uav.learning.training import Progress
from desim_uav.model.sums import in_order
from desim_uav.policies.base import Policy
from desim_uav.policies.tabular import Greedy
from desim_uav.records import TRAINING
from desim_uav.report import notebook
from desim_uav.scenario.schema import Scenario
from desim_uav.typed import typed

if TYPE_CHECKING:
    from matplotlib.figure import Figure

SHOWN = {
    "reward_mean": ("reward per episode", ".3f"),
    "qoe1_percent": ("QoE1 %", ".1f"),
    "qoe2_iterations": ("QoE2 steps", ".2f"),
    "qoe3_percent": ("QoE3 %", ".1f"),
    "crashes_per_drone_episode": ("crashes per drone and episode", ".4f"),
}


class StopTraining(Exception):  # noqa: N818 (it is no error)
    """A callback raises it to end a training; what has been learned is kept."""


@dataclass(frozen=True)
class TrainingProgress:
    """What a callback is told: where the training is, and how it has done since the last call.

    The measures are means over the episodes since the last call, in which the drones explored. They
    are None if no user asked for anything meanwhile.

    Attributes:
        episode: Episodes learned so far.
        episodes: Episodes that were asked for.
        reward: Of a drone in an episode.
        qoe1_percent: QoE1, in percent.
        qoe2_iterations: QoE2, in steps.
        qoe3_percent: QoE3, in percent.
        crashes: Per drone and episode.
        epsilon: How often the drones explored in the last episode.
        alpha: The learning rate of the last episode.
    """

    episode: int
    episodes: int
    reward: float
    qoe1_percent: float | None
    qoe2_iterations: float | None
    qoe3_percent: float | None
    crashes: float
    epsilon: float
    alpha: float
    _course: TrainingCourse = field(repr=False, compare=False)
    _engine: str = field(repr=False, compare=False)

    @property
    def policy(self) -> Policy:
        """The greedy policy of what has been learned until now."""
        return _greedy(self._course)

    @typed
    def evaluate(
        self, episodes: TrainingEpisodes = 5, *, warmup: Warmup = 0, seed: Seed = None
    ) -> dict[str, float | None]:
        """Fly the greedy policy as it is now, in the training's world; return its measures.

        The episodes are none of those that the training learns from, and the training goes on as if
        they had not been flown.

        Args:
            episodes: Episodes that count.
            warmup: Episodes before them.
            seed: What the episodes are drawn from. Default: the training's.
        """
        training = self._course.training
        scenario = training.world.scenario.model_copy(update={"world_seed": training.world.seed})
        number = training.seed if seed is None else seed
        return evaluate(scenario, self.policy, number, episodes, warmup, self._engine)


Callback = Callable[[TrainingProgress], bool | None]
"""Called while a training goes on; if it returns False, the training ends there."""


class TrainingResult:
    """What a training has learned. It can be given as a policy to ``run`` and ``compare``."""

    def __init__(self, course: TrainingCourse) -> None:
        self._course = course
        self.folder = course.folder
        """Where the training is, if it was written as it went."""

    @property
    def scenario(self) -> Scenario:
        """The scenario that was trained in."""
        return self._course.training.world.scenario

    @property
    def episodes(self) -> int:
        """The episodes that were learned."""
        return self._course.training.episode

    @property
    def stopped(self) -> bool:
        """Did the callback end it before its last episode?"""
        return self._course.stopped

    @cached_property
    def policy(self) -> Policy:
        """The greedy policy: the best action by what was learned."""
        return _greedy(self._course)

    @cached_property
    def curve(self) -> pd.DataFrame:
        """One row per episode and drone: reward, ε, α, mean of Q, QoE1 to QoE3, crashes."""
        return to_frame(TRAINING, self._course.rows)

    def summary(self) -> dict[str, Any]:
        """Return the means over the last 100 episodes, and what was trained."""
        return self._course.summary()

    @typed
    def save(self, folder: str | Path | None = None) -> Path:
        """Write the folder that the command line writes: the policy, its curve, a checkpoint.

        Args:
            folder: Where. It must not exist, or be empty. Default:
                ``runs/<scenario>-<algorithm>-s<seed>``.

        Returns:
            The folder. Its ``policy.npz`` is what ``--policy`` takes.

        Raises:
            UsageError: nothing can be written there.
        """
        return save_training(self._course, None if folder is None else Path(folder))

    @typed
    def plot(self, kind: str = "training", out: str | Path | None = None, **options: Any) -> Figure:
        """Draw the learning curves, or with kind ``"policy"`` what was learned.

        Args:
            kind: training or policy.
            out: A file that ends in .png, .pdf or .svg, if the figure is to be written.
            options: Those of ``desim_uav.plot`` for this kind, such as ``window`` or ``drone``.

        Raises as ``desim_uav.plot`` does.
        """
        from desim_uav.api.pictures import plot

        return plot(kind, self, out, **options)

    @contextmanager
    def sources(self) -> Iterator[list[Source]]:
        """Have the training in a folder while something is made of it."""
        if self.folder is not None:
            yield [Source(self.folder)]
            return
        with TemporaryDirectory(prefix="desim-uav-") as scratch:
            yield [Source(save_training(self._course, Path(scratch) / "training"))]

    def __repr__(self) -> str:
        about = self.summary()
        return (
            "<{scenario}, {algorithm}, seed {seed}: {episodes} episode(s), reward {reward_mean:.2f}"
            " over the last {over_last}>".format(**about)
        )

    def _repr_html_(self) -> str:
        about = self.summary()
        title = "{scenario}, {algorithm}, seed {seed}: {episodes} episode(s), means over the last "
        title += "{over_last}"
        values = [about[name] for name in SHOWN]
        forms = [form for _, form in SHOWN.values()]
        row = ["" if v is None else f"{v:{form}}" for v, form in zip(values, forms, strict=True)]
        headings = [heading for heading, _ in SHOWN.values()]
        return notebook.heading(title.format(**about)) + notebook.table(headings, [row], words=[])


def pause_of(callbacks: Sequence[Callback], every: int) -> TrainingPause:
    """Call back after every so many episodes; False, if one of them asks for the end."""
    last = 0

    def call(course: TrainingCourse) -> bool:
        nonlocal last
        drones = len(course.training.learners)
        since = max(last, course.first)
        rows = course.rows[since * drones :]
        last = course.training.episode
        goes_on = True
        for callback in callbacks:
            try:
                answer = callback(_progress(course, rows))
            except StopTraining:
                answer = False
            goes_on = goes_on and (answer is None or bool(answer))
        return goes_on

    return TrainingPause(every, call, at_end=True)


def _progress(course: TrainingCourse, rows: Sequence[Progress]) -> TrainingProgress:
    training, last = course.training, rows[-1]

    def mean(name: str) -> float | None:
        there = [value for row in rows if (value := getattr(row, name)) is not None]
        return in_order(there) / len(there) if there else None

    return TrainingProgress(
        episode=training.episode,
        episodes=training.settings.episodes,
        reward=mean("reward") or 0.0,
        qoe1_percent=mean("qoe1_percent"),
        qoe2_iterations=mean("qoe2_iterations"),
        qoe3_percent=mean("qoe3_percent"),
        crashes=mean("crashes") or 0.0,
        epsilon=last.epsilon,
        alpha=last.alpha,
        _course=course,
        _engine="batch" if isinstance(training.engine, BatchSimulation) else "des",
    )


def _greedy(course: TrainingCourse) -> Greedy:
    """Return the policy of a table that is in memory."""
    training, folder = course.training, course.folder
    name = f"{training.settings.algorithm}-s{training.seed}"
    if folder is not None and (folder / POLICY).exists():
        name = str(folder / POLICY)
    return Greedy.of_table(table_of(training), name)
