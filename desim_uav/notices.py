"""Lines on stdout, and characters that the encoding of a terminal lacks.

Control characters in other people's text are not sent to the terminal. Notices on stderr are
printed by ``errors.notice``.
"""

from __future__ import annotations

import sys
from typing import Any

from desim_uav.errors import printable


def tell(line: object = "") -> None:
    """Print one line on stdout, without control characters."""
    print(printable(str(line)))


def replace_lacking() -> None:
    """Let stdout and stderr replace characters that their encoding lacks, from now on."""
    for stream in (sys.stdout, sys.stderr):
        reconfigure: Any = getattr(stream, "reconfigure", None)
        if reconfigure is not None and getattr(stream, "errors", None) == "strict":
            reconfigure(errors="replace")
