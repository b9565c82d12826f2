"""Lines that are printed: results on stdout, notices and problems on stderr.

Text of others moves no cursor, a character that the terminal's encoding lacks is replaced, and a
reader who has gone away is no failure.
"""

from __future__ import annotations

import os
import sys
from contextlib import suppress
from typing import Any

from desim_uav.errors import printable


def notice(words: str) -> None:
    """Print one line on stderr, as the command line prints its errors."""
    try:
        print(f"desim-uav: {printable(words)}", file=sys.stderr, flush=True)
    except BrokenPipeError:
        drop(sys.stderr)


def tell(line: object = "") -> None:
    """Print one line on stdout, without control characters."""
    print(printable(str(line)))


def replace_lacking() -> None:
    """Let stdout and stderr replace characters that their encoding lacks, from now on."""
    for stream in (sys.stdout, sys.stderr):
        reconfigure: Any = getattr(stream, "reconfigure", None)
        if reconfigure is not None and getattr(stream, "errors", None) == "strict":
            reconfigure(errors="replace")


def drop(stream: Any) -> None:
    """Send nowhere what is still to be written to a stream, which nobody reads any more.

    Python would complain of it at its end.
    """
    with suppress(OSError, ValueError, AttributeError):
        nowhere = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nowhere, stream.fileno())
        os.close(nowhere)
