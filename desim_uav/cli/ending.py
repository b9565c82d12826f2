"""How a command ends: what is complained of, and signals that end it politely."""

from __future__ import annotations

import signal
import sys
from collections.abc import Callable
from pathlib import Path
from typing import TypeVar

from desim_uav.errors import ScenarioError, printable

Result = TypeVar("Result")


def complain(problems: str) -> None:
    """Say what is wrong on stderr, one problem a line; what a file says moves no cursor."""
    for problem in problems.split("\n"):
        print(f"desim-uav: {printable(problem)}", file=sys.stderr)


def located(path: Path, action: Callable[[], Result]) -> Result:
    """Run ``action``; a scenario error found only in drawing the world gets its file's name."""
    try:
        return action()
    except ScenarioError as error:
        raise ScenarioError(*(f"{path}: {problem}" for problem in error.problems)) from error


def end_politely() -> None:
    """Make ``kill`` and a lost terminal end a run as Ctrl-C does, unless they are ignored."""
    for name in ("SIGTERM", "SIGHUP"):
        number = getattr(signal, name, None)
        if number is not None and signal.getsignal(number) is signal.SIG_DFL:
            signal.signal(number, signal.default_int_handler)
