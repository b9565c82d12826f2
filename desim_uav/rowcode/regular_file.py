"""Opens files where others may have put something else: only regular files, and no links to write.

Reading a pipe or a device might never end, so both are refused. Writing follows no link, because
whoever can write to a folder could otherwise have any file of its reader's emptied: a new file is
made under a name that nothing has, and a lock is refused if it is a link or somebody's file.
"""

from __future__ import annotations

import os
import stat
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import IO

MIB = 2**20

AT_ONCE = getattr(os, "O_NONBLOCK", 0)  # a pipe without a writer does not hold us up
BINARY = getattr(os, "O_BINARY", 0)
NO_LINK = getattr(os, "O_NOFOLLOW", 0)


@contextmanager
def opened(path: Path, most: int) -> Iterator[IO[bytes]]:
    """Open a regular file of at most ``most`` bytes for reading.

    Raises OSError if it cannot be opened, and ValueError if it is not a regular file or is larger.
    """
    with os.fdopen(os.open(path, os.O_RDONLY | AT_ONCE | BINARY), "rb") as file:
        status = os.fstat(file.fileno())
        if not stat.S_ISREG(status.st_mode):
            raise ValueError("it is not a regular file")
        _refuse_larger(status.st_size, most)
        yield file


def content_of(path: Path, most: int) -> bytes:
    """Read a regular file of at most ``most`` bytes. Raises what ``opened`` raises."""
    with opened(path, most) as file:
        pieces, size = [], 0
        while size <= most and (piece := file.read(MIB)):  # read(most) takes that much memory
            pieces.append(piece)
            size += len(piece)
    _refuse_larger(size, most)
    return b"".join(pieces)


def text_of(path: Path, most: int) -> str:
    """Read a regular file of UTF-8 text. Raises what ``opened`` raises; ValueError if not UTF-8."""
    return utf8(content_of(path, most))


def utf8(content: bytes) -> str:
    """Return bytes as text. Raises ValueError if they are not UTF-8."""
    try:
        return content.decode("utf-8")
    except UnicodeDecodeError as error:
        raise ValueError("it is not UTF-8 text") from error


@contextmanager
def new_file(path: Path, mode: int = 0o666) -> Iterator[IO[bytes]]:
    """Make a new file for writing, with the permissions ``mode`` less those of the umask.

    Raises OSError if there is anything of this name, a link included.
    """
    flags = os.O_WRONLY | os.O_CREAT | os.O_EXCL | NO_LINK | BINARY
    with os.fdopen(os.open(path, flags, mode), "wb") as file:
        yield file


@contextmanager
def lock_file(path: Path, mark: bytes) -> Iterator[IO[bytes]]:
    """Open a small file for reading and writing, or make it.

    Raises OSError if it cannot be opened, which includes a link, and ValueError if it is not a
    regular file with one name that is empty or begins with ``mark``: it would be somebody's file.
    """
    flags = os.O_RDWR | os.O_CREAT | NO_LINK | AT_ONCE | BINARY
    with os.fdopen(os.open(path, flags, 0o666), "r+b", buffering=0) as file:
        status = os.fstat(file.fileno())
        if not stat.S_ISREG(status.st_mode):
            raise ValueError("it is not a regular file")
        if status.st_nlink > 1:
            raise ValueError("it is a second name of another file")
        if not mark.startswith(file.read(len(mark))):
            raise ValueError("it is not a lock of desim-uav")
        file.seek(0)
        yield file


def _refuse_larger(size: int, most: int) -> None:
    if size > most:
        raise ValueError(f"it is larger than {most // MIB} MiB")
