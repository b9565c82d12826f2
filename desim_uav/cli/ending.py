"""How a command ends: what is complained of, and signals that end it politely."""

from __future__ import annotations

import signal
import sys

from desim_uav.errors import printable


def complain(problems: str) -> None:
    """Say what is wrong on stderr, one problem a line; what a file says moves no cursor."""
    for problem in problems.split("\n"):
        print(f"desim-uav: {printable(problem)}", file=sys.stderr)


def end_politely() -> None:
    """Make ``kill`` and a lost terminal end a run as Ctrl-C does, unless they are ignored."""
    for name in ("SIGTERM", "SIGHUP"):
        number = getattr(signal, name, None)
        if number is not None and signal.getsignal(number) is signal.SIG_DFL:
            signal.signal(number, signal.default_int_handler)
