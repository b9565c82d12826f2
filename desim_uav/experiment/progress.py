"""What a run, a training or a sweep tells of how far it has come."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from typing import Any, Protocol

from desim_uav.experiment.display import Shown, display
from desim_uav.model.coverage import crossings
from desim_uav.model.kernels import compiled_before
from desim_uav.model.sums import in_order

RECENT = 50
"""Episodes a training's bar averages over."""


class Row(Protocol):
    """What a training says of a drone in an episode (see ``learning.training.Progress``)."""

    @property
    def reward(self) -> float:
        """The sum over the episode."""

    @property
    def epsilon(self) -> float:
        """How often it explored."""


@contextmanager
def progress(
    show: bool, total: int, unit: str = "episodes", engine: str = "des"
) -> Iterator[Callable[[], None]]:
    """Show how far work has come: each call of what this gives is one more of ``total``.

    ``engine``: the one that may have to be compiled.
    """
    kernel: Callable[..., Any] = crossings
    if engine == "batch":
        from desim_uav.engine.batch import calls

        kernel = calls.step
    with display(show, total, unit, not compiled_before(kernel)) as shown:
        yield lambda: shown(lambda: unit)


@contextmanager
def training_progress(show: bool, total: int) -> Iterator[TrainingBar]:
    """Show how far a training has come, with reward, ε and QoE."""
    from desim_uav.learning import fused  # which a run without a training need not load

    with display(show, total, "episodes", not compiled_before(fused.play)) as shown:
        yield TrainingBar(shown)


class TrainingBar:
    """What a training tells of itself, over its last episodes."""

    def __init__(self, shown: Shown) -> None:
        self.shown = shown
        self.recent: deque[Sequence[Row]] = deque(maxlen=RECENT)

    def start(self, episode: int) -> None:
        """Go on from this episode."""
        self.shown(lambda: "episodes", completed=episode)

    def advance(self, rows: Sequence[Row]) -> None:
        """Note that an episode has ended: a row per drone."""
        self.recent.append(rows)
        self.shown(self.told)

    def told(self) -> str:
        """Return the means of the last episodes."""
        reward = _mean(row.reward for rows in self.recent for row in rows)
        qoe1, qoe3 = (
            _mean(value for rows in self.recent if (value := getattr(rows[0], name)) is not None)
            for name in ("qoe1_percent", "qoe3_percent")
        )
        told = f"reward {reward:.2f}  QoE1 {qoe1:.0f} %  QoE3 {qoe3:.0f} %"
        return f"{told}  ε {self.recent[-1][0].epsilon:.3f}"


def _mean(values: Iterable[float]) -> float:
    there = list(values)
    return in_order(there) / len(there) if there else math.nan
