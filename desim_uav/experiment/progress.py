"""The progress that a run, a training or a sweep shows."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from typing import Protocol

from desim_uav.experiment.display import COMPILING, COMPILING_PARTS, Update, display
from desim_uav.model.sums import in_order
from desim_uav.rowcode.kernels import compiled_before

RECENT = 50
"""The number of episodes that a training's bar averages over."""


class ProgressRow(Protocol):
    """The measures of a drone in a training's episode (see ``learning.training.Progress``)."""

    @property
    def reward(self) -> float:
        """The sum of rewards over the episode."""

    @property
    def epsilon(self) -> float:
        """The probability of exploration."""


@contextmanager
def progress(
    show: bool, total: int, unit: str = "episodes", engine: str = "des"
) -> Iterator[Callable[[], None]]:
    """Show progress and yield a function to call after each of ``total`` units.

    ``engine`` is the engine that may have to be compiled first.
    """
    if engine == "batch":
        from desim_uav.engine.compiled import loop

        is_ready, text = compiled_before(loop.run), COMPILING
    else:
        from desim_uav.engine.des.skies import LISTS

        is_ready, text = any(map(compiled_before, LISTS)), COMPILING_PARTS
    with display(show, total, unit, "" if is_ready else text) as update:
        yield lambda: update(lambda: unit)


@contextmanager
def training_progress(show: bool, total: int) -> Iterator[TrainingBar]:
    """Show the progress of a training, with reward, ε and QoE."""
    from desim_uav.learning import fused  # loaded for trainings only

    with display(
        show, total, "episodes", "" if compiled_before(fused.play) else COMPILING
    ) as update:
        yield TrainingBar(update)


class TrainingBar:
    """The progress of a training, with means over its last episodes."""

    def __init__(self, update: Update) -> None:
        self.update = update
        self.recent: deque[Sequence[ProgressRow]] = deque(maxlen=RECENT)

    def start(self, episode: int) -> None:
        """Continue from this episode."""
        self.update(lambda: "episodes", completed=episode)

    def advance(self, rows: Sequence[ProgressRow]) -> None:
        """Note an episode that has ended, with a row per drone."""
        self.recent.append(rows)
        self.update(self.text)

    def text(self) -> str:
        """Return the means of the last episodes."""
        reward = _mean(row.reward for rows in self.recent for row in rows)
        qoe1, qoe3 = (
            _mean(value for rows in self.recent if (value := getattr(rows[0], name)) is not None)
            for name in ("qoe1_percent", "qoe3_percent")
        )
        means = f"reward {reward:.2f}  QoE1 {qoe1:.0f} %  QoE3 {qoe3:.0f} %"
        return f"{means}  ε {self.recent[-1][0].epsilon:.3f}"


def _mean(values: Iterable[float]) -> float:
    there = list(values)
    return in_order(there) / len(there) if there else math.nan
