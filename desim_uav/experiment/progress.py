"""Progress bars on stderr; silent where that is no terminal."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from typing import Any, Protocol

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

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
    """A bar that each call of what it gives moves on by one; ``engine`` is what may be compiled."""
    kernel: Callable[..., Any] = crossings
    if engine == "batch":
        from desim_uav.engine.batch import calls

        kernel = calls.step
    with _bar(show, total, unit, kernel) as shown:
        yield lambda: shown(unit)


@contextmanager
def training_progress(show: bool, total: int) -> Iterator[TrainingBar]:
    """A bar over the episodes of a training, with reward, ε and QoE."""
    from desim_uav.learning import fused  # which a run without a training need not load

    with _bar(show, total, "episodes", fused.play) as shown:
        yield TrainingBar(shown)


class TrainingBar:
    """What a training tells of itself, over its last episodes."""

    def __init__(self, shown: Callable[..., None]) -> None:
        self.shown = shown
        self.recent: deque[Sequence[Row]] = deque(maxlen=RECENT)

    def start(self, episode: int) -> None:
        """The training goes on from this episode."""
        self.shown("episodes", completed=episode, advance=None)

    def advance(self, rows: Sequence[Row]) -> None:
        """An episode has ended: a row a drone."""
        self.recent.append(rows)
        reward = _mean(row.reward for rows in self.recent for row in rows)
        qoe1, qoe3 = (
            _mean(value for rows in self.recent if (value := getattr(rows[0], name)) is not None)
            for name in ("qoe1_percent", "qoe3_percent")
        )
        told = f"reward {reward:.2f}  QoE1 {qoe1:.0f} %  QoE3 {qoe3:.0f} %"
        self.shown(f"{told}  ε {rows[0].epsilon:.3f}")


def _mean(values: Iterable[float]) -> float:
    there = list(values)
    return in_order(there) / len(there) if there else math.nan


@contextmanager
def _bar(
    show: bool, total: int, unit: str, kernel: Callable[..., Any]
) -> Iterator[Callable[..., None]]:
    """What updates a bar, a text and by how much it moves on; ``kernel`` has to be compiled."""
    console = Console(stderr=True)
    if not show or not console.is_terminal:
        yield lambda text, **moved: None
        return
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn())
    with Progress(*columns, TimeRemainingColumn(), console=console, transient=True) as progress:
        first = not compiled_before(kernel)
        about = "compiling the kernels (the first time only: a minute)" if first else unit
        task = progress.add_task(about, total=total)
        yield lambda text, advance=1, **moved: progress.update(
            task, description=text, advance=advance, **moved
        )
