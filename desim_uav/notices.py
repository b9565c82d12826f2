"""Lines that are printed: results on stdout, notices and problems on stderr.

Control characters in other people's text are not sent to the terminal, characters that its encoding
lacks are replaced, and it is not an error if the program that reads the output has ended.
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
    """Discard what is still to be written to a stream that nobody reads any more.

    Otherwise Python would report an error when it exits.
    """
    with suppress(OSError, ValueError, AttributeError):
        nowhere = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nowhere, stream.fileno())
        os.close(nowhere)
