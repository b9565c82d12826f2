"""Reads files from untrusted sources: only regular files of a bounded size.

Reading a pipe or a device might never end, so both are refused.
"""

from __future__ import annotations

import os
import stat
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import IO

MIB = 2**20


@contextmanager
def opened(path: Path, most: int) -> Iterator[IO[bytes]]:
    """Open a regular file of at most ``most`` bytes for reading.

    Raises OSError if it cannot be opened, and ValueError if it is not a regular file or is larger.
    """
    at_once = getattr(os, "O_NONBLOCK", 0)  # a pipe without a writer does not hold us up
    binary = getattr(os, "O_BINARY", 0)
    with os.fdopen(os.open(path, os.O_RDONLY | at_once | binary), "rb") as file:
        status = os.fstat(file.fileno())
        if not stat.S_ISREG(status.st_mode):
            raise ValueError("it is not a regular file")
        _refuse_larger(status.st_size, most)
        yield file


def content_of(path: Path, most: int) -> bytes:
    """Read a regular file of at most ``most`` bytes. Raises what ``opened`` raises."""
    with opened(path, most) as file:
        content = file.read(most + 1)
    _refuse_larger(len(content), most)
    return content


def text_of(path: Path, most: int) -> str:
    """Read a regular file of UTF-8 text. Raises what ``opened`` raises; ValueError if not UTF-8."""
    return content_of(path, most).decode("utf-8")


def _refuse_larger(size: int, most: int) -> None:
    if size > most:
        raise ValueError(f"it is larger than {most // MIB} MiB")
