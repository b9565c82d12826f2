"""How far long work has come: a bar on a terminal, one line in a notebook, else a line at times."""

from __future__ import annotations

import importlib
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any, Protocol

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

COMPILING = "compiling the engine for the first time; this takes about a minute"
LINES_EVERY_S = 10.0
"""How often a line is printed at most, where no terminal can show a bar."""

NOTEBOOK_EVERY_S = 0.5
TERMINAL_EVERY_S = 0.1

Text = Callable[[], str]
"""Says what the work is like now; asked only if it is going to be shown."""


class Shown(Protocol):
    """What is told that work has gone on: by ``advance``, or to where it is ``completed``."""

    def __call__(self, text: Text, advance: int = 1, completed: int | None = None) -> None:
        """Show it, unless something was shown a moment ago."""


@contextmanager
def display(show: bool, total: int, unit: str, compiling: bool) -> Iterator[Shown]:
    """Show how far work of ``total`` units has come, on stderr or in a notebook.

    ``compiling``: it begins with machine code being made, which has to be waited for.
    """
    console = Console(stderr=True)
    if not show:
        yield lambda text, advance=1, completed=None: None
    elif console.is_jupyter:
        with _in_notebook(total, unit, compiling) as shown:
            yield shown
    elif console.is_terminal:
        with _on_terminal(console, total, unit, compiling) as shown:
            yield shown
    else:
        if compiling:
            _print(COMPILING)
        yield _Paced(total, LINES_EVERY_S, lambda done, text: _print(_told(done, total, unit)))


class _Paced:
    """Counts what has been done, and shows it now and then."""

    def __init__(self, total: int, every_s: float, show: Callable[[int, Text], None]) -> None:
        self.done = 0
        self._total, self._every_s, self._show = total, every_s, show
        self._shown_s = time.monotonic()

    def __call__(self, text: Text, advance: int = 1, completed: int | None = None) -> None:
        """See ``Shown``."""
        self.done = self.done + advance if completed is None else completed
        now_s = time.monotonic()
        if now_s - self._shown_s >= self._every_s:
            self._shown_s = now_s
            self._show(self.done, text)


@contextmanager
def _on_terminal(console: Console, total: int, unit: str, compiling: bool) -> Iterator[Shown]:
    """Show a bar, which goes when the work has ended."""
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn())
    with Progress(*columns, TimeRemainingColumn(), console=console, transient=True) as progress:
        task = progress.add_task(COMPILING if compiling else unit, total=total)

        def show(done: int, text: Text) -> None:
            progress.update(task, description=text(), completed=done)

        paced = _Paced(total, TERMINAL_EVERY_S, show)
        yield paced
        if paced.done:
            progress.update(task, description=unit, completed=paced.done)


@contextmanager
def _in_notebook(total: int, unit: str, compiling: bool) -> Iterator[Shown]:
    """Show a line under the cell, which goes when the work has ended."""
    from desim_uav.report.markup import tag

    ipython: Any = importlib.import_module("IPython.display")

    def line(text: str) -> dict[str, str]:
        shown = tag("div", text, style="color: gray; font-family: monospace") if text else ""
        return {"text/plain": text, "text/html": shown}

    first = COMPILING if compiling else _told(0, total, unit)
    handle = ipython.display(line(first), raw=True, display_id=True)

    def show(done: int, text: Text) -> None:
        said = text()
        told = _told(done, total, unit) + ("" if said == unit else f"  {said}")
        handle.update(line(told), raw=True)

    try:
        yield _Paced(total, NOTEBOOK_EVERY_S, show)
    finally:
        handle.update(line(""), raw=True)


def _told(done: int, total: int, unit: str) -> str:
    return f"{done:,} of {total:,} {unit}"


def _print(text: str) -> None:
    print(f"desim-uav: {text}", file=sys.stderr, flush=True)
