"""The checksums of a folder's files: what has changed since they were written is not read.

They stand in ``SHA256SUMS``, as ``sha256sum -c`` reads it.
"""

from __future__ import annotations

import hashlib
import json
import re
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from desim_uav.errors import PolicyError

SUMS = "SHA256SUMS"
LONGEST = 2**20
LINE = re.compile(r"\\?([0-9A-Fa-f]{64}) [ *](?:\./)?([^\0]+)")
"""As ``sha256sum`` writes it, in binary mode and of other folders too, and as it reads it."""


def of_files(files: Iterable[Path]) -> str:
    """What ``SHA256SUMS`` says of files of its folder."""
    return _lines({file.name: _sha256(file) for file in files})


def of_contents(contents: Mapping[str, bytes]) -> str:
    """What it says of files of these names and contents."""
    return _lines({name: hashlib.sha256(content).hexdigest() for name, content in contents.items()})


def of_row(row: Mapping[str, Any]) -> str:
    """The checksum of a row's values."""
    return hashlib.sha256(json.dumps(row, sort_keys=True).encode()).hexdigest()


def verify(file: Path, strangers: bool = False) -> None:
    """See that a file is one, as it was written, as far as its folder has checksums.

    ``strangers``: one that the checksums do not name is taken as it is. Raises PolicyError, naming
    it, where it is not, or the checksums are unreadable.
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
            raise PolicyError(f"{file}: not one of the files in {SUMS}")
        found = _sha256(file)
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or error
        wrong = getattr(error, "filename", None) or sums
        raise PolicyError(f"{wrong}: not readable: {reason}") from error
    if found != expected:
        raise PolicyError(
            f"{file}: changed since it was written (without {SUMS} it is taken as it is)"
        )


def _read(sums: Path) -> dict[str, str]:
    if not sums.is_file() or sums.stat().st_size > LONGEST:
        raise ValueError("not a list of checksums")
    found = {}
    lines = sums.read_text(encoding="utf-8").removesuffix("\n").split("\n")
    for number, line in enumerate(lines if lines != [""] else [], 1):
        match = LINE.fullmatch(line)
        if match is None or match[2] in found:
            raise ValueError(f"line {number} is no checksum and name")
        found[match[2]] = match[1].lower()
    return found


def _lines(digests: Mapping[str, str]) -> str:
    return "".join(f"{digests[name]}  {name}\n" for name in sorted(digests))


def _sha256(file: Path) -> str:
    with file.open("rb") as content:
        return hashlib.file_digest(content, "sha256").hexdigest()
