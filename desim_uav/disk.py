"""Files that are written completely or not at all, and the places for them."""

from __future__ import annotations

import errno
import os
import tempfile
import uuid
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import IO

from desim_uav.errors import DesimError, UsageError
from desim_uav.rowcode.regular_file import new_file


def write_whole(path: Path, content: bytes, mode: int = 0o666) -> None:
    """Write a file completely, or leave the old one: a new file replaces it in one step.

    It gets the permissions ``mode``, less those that the umask of the process forbids.

    Raises DesimError if the file cannot be written.
    """
    beside = path.with_name(f".{path.name}-{uuid.uuid4().hex}")
    try:
        with new_file(beside, mode) as file:
            file.write(content)
            sync(file)
        beside.replace(path)
    except OSError as error:
        raise DesimError(f"cannot write {path}: {error.strerror or error}") from error
    finally:
        with suppress(OSError):
            beside.unlink()
    sync_folder(path.parent)


def file_place(out: Path, option: str = "", endings: Sequence[str] = ()) -> Path:
    """Return the place of a file to be written, with links followed. Nothing is made yet.

    ``option`` names the option in messages. Raises UsageError if no file can be written there, or
    if its name has none of the ``endings``, where these say what is written.
    """
    label = f"{option} {out}".strip()
    try:
        place = followed(out)
        if place.exists() and not place.is_file():
            raise UsageError(f"{label}: exists and is not a file")
        if endings and out.suffix.lower() not in endings:
            *others, last = endings
            allowed = f"{', '.join(others)} or {last}" if others else last
            raise UsageError(f"{label}: the file's name must end in {allowed}")
        try_writing(next(folder for folder in place.parents if folder.exists()))
    except OSError as error:
        reason = error.strerror or error
        raise UsageError(f"{label}: the folder cannot be written to: {reason}") from error
    return place


def write_at(place: Path, content: bytes, mode: int = 0o666) -> Path:
    """Write a file in its place, which is returned, and make its folders if they do not exist.

    Raises DesimError if that fails; then new folders are removed again.
    """
    new = [folder for folder in place.parents if not folder.exists()]
    try:
        try:
            place.parent.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise DesimError(f"cannot write {place}: {error.strerror or error}") from error
        write_whole(place, content, mode)
    except BaseException:
        for folder in new:
            with suppress(OSError):  # somebody else's file is in it
                folder.rmdir()
        raise
    return place


def try_writing(folder: Path) -> None:
    """Raise OSError if no file can be made in a folder, independently of its permissions."""
    with tempfile.TemporaryFile(dir=folder):
        pass


def followed(path: Path) -> Path:
    """Return a path with links followed. Raises OSError if they lead in a circle."""
    circle = OSError(errno.ELOOP, os.strerror(errno.ELOOP), str(path))
    try:
        target = path.resolve()
    except RuntimeError as error:  # Python up to 3.12
        raise circle from error
    if target.is_symlink():  # later versions leave the circle as it is
        raise circle
    return target


def sync(file: IO[bytes]) -> None:
    """Have the system write a file to the disk."""
    file.flush()
    os.fsync(file.fileno())


def sync_folder(folder: Path) -> None:
    """Make the new name durable, if the system can."""
    with suppress(OSError):
        descriptor = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(descriptor)
        finally:
            os.close(descriptor)
