"""Progress of long work: a bar on a terminal, a line in a notebook, else a line now and then."""

from __future__ import annotations

import importlib
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any, Protocol

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

from desim_uav.errors import notice

COMPILING = "compiling the engine for the first time; this takes about a minute"
COMPILING_PARTS = "compiling parts of the engine for the first time; this takes some seconds"
LINES_EVERY_S = 10.0
"""The least time between two printed lines, if there is no terminal to show a bar."""

NOTEBOOK_EVERY_S = 0.5
TERMINAL_EVERY_S = 0.1

DisplayText = Callable[[], str]
"""Returns the text beside the progress; called only if it will be shown."""


class Update(Protocol):
    """Takes the progress of work: ``advance`` more units, or ``completed`` units in total."""

    def __call__(self, text: DisplayText, advance: int = 1, completed: int | None = None) -> None:
        """Show the progress, unless it was shown a moment ago."""


@contextmanager
def display(show: bool, total: int, unit: str, compiling: str) -> Iterator[Update]:
    """Show the progress of work of ``total`` units, on stderr or in a notebook.

    ``compiling`` is what is said first if the work begins with compiling, else empty.
    """
    console = Console(stderr=True)
    if not show:
        yield lambda text, advance=1, completed=None: None
    elif console.is_jupyter:
        with _in_notebook(total, unit, compiling) as update:
            yield update
    elif console.is_terminal:
        with _on_terminal(console, total, unit, compiling) as update:
            yield update
    else:
        if compiling:
            _print(compiling)
        yield _Paced(total, LINES_EVERY_S, lambda count, text: _print(_share(count, total, unit)))


class _Paced:
    """Counts the units done and shows them at most once per interval."""

    def __init__(
        self, total: int, every_s: float, show: Callable[[int, DisplayText], None]
    ) -> None:
        self.done = 0
        self._total, self._every_s, self._show = total, every_s, show
        self._shown_s = time.monotonic()

    def __call__(self, text: DisplayText, advance: int = 1, completed: int | None = None) -> None:
        """See ``Update``."""
        self.done = self.done + advance if completed is None else completed
        now_s = time.monotonic()
        if now_s - self._shown_s >= self._every_s:
            self._shown_s = now_s
            self._show(self.done, text)


@contextmanager
def _on_terminal(console: Console, total: int, unit: str, compiling: str) -> Iterator[Update]:
    """Show a bar, which disappears when the work has ended."""
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn())
    with Progress(*columns, TimeRemainingColumn(), console=console, transient=True) as progress:
        task = progress.add_task(compiling or unit, total=total)

        def show(count: int, text: DisplayText) -> None:
            progress.update(task, description=text(), completed=count)

        paced = _Paced(total, TERMINAL_EVERY_S, show)
        yield paced
        if paced.done:
            progress.update(task, description=unit, completed=paced.done)


@contextmanager
def _in_notebook(total: int, unit: str, compiling: str) -> Iterator[Update]:
    """Show a line under the cell, which disappears when the work has ended."""
    from desim_uav.report.markup import tag

    ipython: Any = importlib.import_module("IPython.display")

    def line(text: str) -> dict[str, str]:
        html = tag("div", text, style="color: gray; font-family: monospace") if text else ""
        return {"text/plain": text, "text/html": html}

    first = compiling or _share(0, total, unit)
    handle = ipython.display(line(first), raw=True, display_id=True)

    def show(count: int, text: DisplayText) -> None:
        words = text()
        progress = _share(count, total, unit) + ("" if words == unit else f"  {words}")
        handle.update(line(progress), raw=True)

    try:
        yield _Paced(total, NOTEBOOK_EVERY_S, show)
    finally:
        handle.update(line(""), raw=True)


def _share(count: int, total: int, unit: str) -> str:
    return f"{count:,} of {total:,} {unit}"


def _print(text: str) -> None:
    notice(text)
