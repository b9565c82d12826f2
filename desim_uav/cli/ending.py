"""How a command ends: what it calls, and messages about the problems with which it ends."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from typing import Any

import typer

from desim_uav.errors import Interrupted, notice


def complain(problems: str) -> None:
    """Say what is wrong on stderr, one problem a line; what a file says moves no cursor."""
    for problem in problems.split("\n"):
        notice(problem)


def ended(
    verb: Callable[..., Any], arguments: Mapping[str, Any], otherwise: str = "nothing is kept"
) -> tuple[Any, str]:
    """Call a verb; return its result, and what is to be said if Ctrl-C ended it early, or "".

    Without a result it ends the command, which says ``otherwise``.
    """
    try:
        return verb(**arguments), ""
    except Interrupted as stopped:
        return stopped.result, str(stopped)
    except KeyboardInterrupt:
        complain(f"interrupted; {otherwise}")
        raise typer.Exit(130) from None


def print_json(content: object) -> None:
    """Print plain data as one JSON object."""
    print(json.dumps(content, indent=1))


def end(interrupted: str) -> None:
    """End with exit code 130 if the command was interrupted, and say so."""
    if interrupted:
        complain(interrupted)
        raise typer.Exit(130)
