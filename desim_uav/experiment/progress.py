"""A progress bar on stderr."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

from desim_uav.model.coverage import crossings
from desim_uav.model.kernels import compiled_before


@contextmanager
def progress(show: bool, total: int, unit: str = "episodes") -> Iterator[Callable[[], None]]:
    """A bar that each call of what it gives moves on by one; silent where stderr is no terminal."""
    console = Console(stderr=True)
    if not show or not console.is_terminal:
        yield lambda: None
        return
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn())
    with Progress(*columns, TimeRemainingColumn(), console=console, transient=True) as shown:
        first = not compiled_before(crossings)
        about = "compiling the kernels (the first time only)" if first else unit
        task = shown.add_task(about, total=total)
        yield lambda: shown.update(task, advance=1, description=unit)
