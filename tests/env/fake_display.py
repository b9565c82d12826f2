"""A Matplotlib backend that claims to have a window, and remembers what it showed."""

from __future__ import annotations

from typing import Any, ClassVar

from matplotlib.backend_bases import FigureManagerBase
from matplotlib.backends.backend_agg import FigureCanvasAgg


class FigureManager(FigureManagerBase):
    def show(self) -> None:
        FigureCanvas.opened += 1


class FigureCanvas(FigureCanvasAgg):
    required_interactive_framework = "headless"
    manager_class = FigureManager
    opened: ClassVar[int] = 0
    shown: ClassVar[list[Any]] = []

    def draw(self) -> None:
        super().draw()
        self.shown.append(bytes(self.buffer_rgba()))

    def start_event_loop(self, timeout: float = 0) -> None:
        assert timeout == 0.25
