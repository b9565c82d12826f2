"""Notices to the user when nothing is wrong: one plain line each on stderr."""

from __future__ import annotations

import sys

from desim_uav.errors import printable


def notice(words: str) -> None:
    """Print one line on stderr, as the command line prints its errors."""
    print(f"desim-uav: {printable(words)}", file=sys.stderr)
