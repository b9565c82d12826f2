"""Locks of folders, which end with their process."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from datetime import datetime
from pathlib import Path
from typing import IO, Any

from desim_uav.errors import UsageError, in_short
from desim_uav.rowcode.regular_file import lock_file

HOLDER = "process"
"""The first word in each of our lock files, by which they are told from other files."""

fcntl: Any = None
with suppress(ImportError):
    import fcntl


@contextmanager
def held(folder: Path) -> Iterator[None]:
    """Lock a folder, which need not exist yet; the lock ends with its process.

    Raises UsageError, which names the process, if another process holds the lock.
    """
    if fcntl is None:  # a system without such locks
        yield
        return
    file = folder.absolute().parent / f".{folder.absolute().name}.lock"
    with _locked(file, folder) as own:
        try:
            own.truncate(0)
            who = f"{HOLDER} {os.getpid()}, since {datetime.now():%H:%M:%S}"
            with suppress(OSError):  # the disk is full: it holds all the same, without a name
                own.write(who.encode())
            yield
        finally:
            file.unlink(missing_ok=True)


@contextmanager
def _locked(file: Path, folder: Path) -> Iterator[IO[bytes]]:
    while True:
        with ExitStack() as opened:
            try:
                own = opened.enter_context(lock_file(file, HOLDER.encode()))
            except (OSError, ValueError) as error:
                raise _no_lock(file, folder, error) from error
            try:
                fcntl.flock(own, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError:
                who = own.read(200).decode(errors="replace") or "another process"
                raise UsageError(f"{folder}: {in_short(who)} is writing to it") from None
            except OSError:  # a file system without locks
                yield own
                return
            if _is_still(file, own):
                yield own
                return


def _no_lock(file: Path, folder: Path, error: OSError | ValueError) -> UsageError:
    """Return what to say of a lock file that cannot be used."""
    if not os.path.lexists(file):
        return UsageError(f"cannot write to {folder.parent}: {getattr(error, 'strerror', error)}")
    reason = "it is a link" if file.is_symlink() else getattr(error, "strerror", None) or error
    return UsageError(f"{folder} cannot be locked with {file}: {reason}; remove or rename it")


def _is_still(file: Path, own: IO[bytes]) -> bool:
    """Return whether the lock file is still the one that was opened, and not removed since."""
    try:
        return file.stat().st_ino == os.fstat(own.fileno()).st_ino
    except FileNotFoundError:
        return False
