"""How a command ends: what is complained of."""

from __future__ import annotations

import sys

from desim_uav.errors import printable


def complain(problems: str) -> None:
    """Say what is wrong on stderr, one problem a line; what a file says moves no cursor."""
    for problem in problems.split("\n"):
        print(f"desim-uav: {printable(problem)}", file=sys.stderr)
