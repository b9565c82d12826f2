"""Messages about the problems with which a command ends."""

from __future__ import annotations

from desim_uav.errors import notice


def complain(problems: str) -> None:
    """Say what is wrong on stderr, one problem a line; what a file says moves no cursor."""
    for problem in problems.split("\n"):
        notice(problem)
