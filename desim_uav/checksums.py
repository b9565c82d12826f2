"""The checksums of a folder's files: a file that has changed since it was written is refused.

They are in the file ``SHA256SUMS``, in the format that ``sha256sum -c`` reads.
"""

from __future__ import annotations

import hashlib
import json
import re
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from desim_uav.errors import PolicyError
from desim_uav.rowcode.regular_file import text_of

SUMS = "SHA256SUMS"
LONGEST = 2**20
LINE = re.compile(r"\\?([0-9A-Fa-f]{64}) [ *](?:\./)?([^\0]+)")
"""A line as ``sha256sum`` writes and reads it, also in binary mode."""


def of_files(files: Iterable[Path]) -> str:
    """Return the content of ``SHA256SUMS`` for these files of its folder."""
    return _lines({file.name: _sha256(file) for file in files})


def of_contents(contents: Mapping[str, bytes]) -> str:
    """Return the content of ``SHA256SUMS`` for files with these names and contents."""
    return _lines({name: hashlib.sha256(content).hexdigest() for name, content in contents.items()})


def of_row(row: Mapping[str, Any]) -> str:
    """Return the checksum of a row's values."""
    return hashlib.sha256(json.dumps(row, sort_keys=True).encode()).hexdigest()


def verify(file: Path, strangers: bool = False) -> None:
    """Check a file against the checksums of its folder, if the folder has any.

    ``strangers``: a file that the checksums do not name is accepted. Raises PolicyError, which
    names the file, if it has changed or is not a regular file, or if the checksums cannot be read.
    A missing file is not an error here.
    """
    sums = file.parent / SUMS
    try:
        if not file.exists():  # what is missing its reader will say
            return
        if not file.is_file():  # a pipe or a device may never end
            raise PolicyError(f"{file}: it is not a regular file")
        if not sums.exists():
            return
        expected = _read(sums).get(file.name)
        if expected is None and strangers:
            return
        if expected is None:
            raise PolicyError(f"{file}: {SUMS} does not list this file")
        actual = _sha256(file)
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or error
        wrong = getattr(error, "filename", None) or sums
        raise PolicyError(f"{wrong}: cannot be read: {reason}") from error
    if actual != expected:
        raise PolicyError(
            f"{file}: the file has changed since it was written (delete {SUMS} to use it anyway)"
        )


def _read(sums: Path) -> dict[str, str]:
    if not sums.is_file():
        raise ValueError("it is not a list of checksums")
    sum_of = {}
    lines = text_of(sums, LONGEST).removesuffix("\n").split("\n")
    for number, line in enumerate(lines if lines != [""] else [], 1):
        match = LINE.fullmatch(line)
        if match is None or match[2] in sum_of:
            raise ValueError(f"line {number} must be a checksum and the name of a file")
        sum_of[match[2]] = match[1].lower()
    return sum_of


def _lines(digests: Mapping[str, str]) -> str:
    return "".join(f"{digests[name]}  {name}\n" for name in sorted(digests))


def _sha256(file: Path) -> str:
    with file.open("rb") as content:
        return hashlib.file_digest(content, "sha256").hexdigest()
