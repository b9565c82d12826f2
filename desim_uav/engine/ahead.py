"""Compiles the engine in another process, while the SimPy engine plays (see decision 23).

At most one process does so at a time per folder of machine code: it holds a lock there, which ends
with it. It goes on if the process that has started it ends, but not if that is killed; a limit of
time ends it in any case.
"""

from __future__ import annotations

import atexit
import os
import pickle
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import IO, TYPE_CHECKING, Any

from desim_uav.errors import in_short, notice
from desim_uav.rowcode.kernels import cache_folder
from desim_uav.rowcode.regular_file import lock_file

if TYPE_CHECKING:
    from desim_uav.world import World

fcntl: Any = None
with suppress(ImportError):  # a system without such locks
    import fcntl

SWITCH = "DESIM_UAV_COMPILE_AHEAD"
"""The environment variable that is 0 if no process may be started to compile."""

MARK = "the compiled engine is being made by process"
"""The beginning of the text in a lock."""

TRIES = 2
"""How often a process has the same code compiled before it gives up."""

PAUSE_S = 1.0
"""How often a process looks whether another one still compiles."""

PROGRAM = """
import pickle, sys
sys.path[:] = pickle.load(sys.stdin.buffer)
from desim_uav.engine.compiler import main
main(int(sys.argv[1]))
"""


def folder() -> Path | None:
    """Return the folder of the engine's machine code, or None if there is none to write to."""
    from desim_uav.engine.compiled import loop

    return cache_folder(loop.run)


def can_begin() -> bool:
    """Return whether another process can compile for this one."""
    allowed = os.environ.get(SWITCH, "1") != "0"
    return allowed and fcntl is not None and bool(sys.executable) and folder() is not None


def at_work() -> str | None:
    """Return which process compiles into the folder of machine code, or None if none does."""
    where = folder()
    if fcntl is None or where is None or not (where / Lock.NAME).exists():
        return None
    with suppress(OSError, ValueError):
        lock = Lock.take(where)
        if lock is None:
            return in_short((where / Lock.NAME).read_bytes()[:200].decode(errors="replace"))
        lock.file.close()
    return None


@dataclass
class Lock:
    """The lock of a folder of machine code, which lasts as long as any process has it open."""

    NAME = "compiling.lock"
    file: IO[bytes]

    @classmethod
    def take(cls, where: Path) -> Lock | None:
        """Return the lock, or None if another process has it.

        Raises what ``regular_file.lock_file`` raises.
        """
        with lock_file(where / cls.NAME, MARK.encode()) as file:
            own = os.fdopen(os.dup(file.fileno()), "r+b", buffering=0)
        try:
            fcntl.flock(own, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            own.close()
            return None
        return cls(own)

    def name(self, number: int) -> None:
        """Write which process has the lock, and since when."""
        with suppress(OSError):  # the disk is full: it holds all the same, without a name
            self.file.truncate(0)
            self.file.write(f"{MARK} {number}, since {datetime.now():%H:%M:%S}".encode())


@dataclass
class Ahead:
    """The compiling process of this process, if there is one.

    ``line`` is a connection to it, by which it is told that this process ends by itself.
    """

    process: subprocess.Popen[bytes] | None = None
    line: socket.socket | None = None
    tries: int = 0
    waits_for_another: bool = False
    not_before: float = 0.0
    gave_up: bool = False

    def works(self) -> bool:
        """Return whether the process that this one has started is at work."""
        return self.process is not None and self.process.poll() is None

    def has_news(self, worlds: Callable[[], Sequence[World]]) -> bool:
        """Have the code for some worlds compiled, unless somebody is at it.

        Returns whether a process that compiled has ended, so that the code may be on disk now.
        """
        if self.works() or self.gave_up:
            return False
        if self.process is not None:
            self._forget()
            return True
        if time.monotonic() < self.not_before:
            return False
        where = folder()
        try:
            lock = Lock.take(where) if where is not None and can_begin() else None
        except (OSError, ValueError):
            self._give_up()
            return False
        before, self.waits_for_another = self.waits_for_another, lock is None
        if lock is None:
            self.not_before = time.monotonic() + PAUSE_S
        elif before:
            lock.file.close()
        elif self.tries == TRIES:
            lock.file.close()
            self._give_up()
        else:
            self._begin(lock, worlds())
        return lock is not None and before

    def note_on_disk(self) -> None:
        """Note that the code is on disk."""
        self.tries = 0

    def _give_up(self) -> None:
        self.gave_up = True
        notice(
            "the SimPy engine (des) goes on, which is slower: another process should have compiled "
            "the other engine and has not; engine='batch' (--engine batch) compiles it in this one"
        )

    def _begin(self, lock: Lock, worlds: Sequence[World]) -> None:
        """Start the process, or give up if the worlds cannot be told to it."""
        self.tries += 1
        try:
            pickled = pickle.dumps([(world.scenario, world.seed) for world in worlds])
            self._start(lock, pickle.dumps(sys.path) + pickled)
        except (OSError, pickle.PicklingError, AttributeError, TypeError):
            lock.file.close()
            self._forget()
            self._give_up()

    def _start(self, lock: Lock, pickled: bytes) -> None:
        self.line, its = socket.socketpair()
        with lock.file, its, tempfile.TemporaryFile() as file:
            file.write(pickled)
            file.seek(0)
            program = [sys.executable, "-c", PROGRAM, str(its.fileno())]
            descriptors = (its.fileno(), lock.file.fileno())
            nowhere = subprocess.DEVNULL
            self.process = subprocess.Popen(
                program, stdin=file, stdout=nowhere, stderr=nowhere, pass_fds=descriptors
            )
            lock.name(self.process.pid)

    def _forget(self) -> None:
        if self.line is not None:
            self.line.close()
        self.process = self.line = None

    def let_go(self) -> None:
        """Let the process go on when this one has ended."""
        if self.works() and self.line is not None and self.process is not None:
            with suppress(OSError):
                self.line.send(b"+", getattr(socket, "MSG_NOSIGNAL", 0))
            self.process.returncode = 0  # nobody waits for it
        self._forget()

    def leave(self) -> None:
        """Forget the process in a fork of this one, to which it does not belong."""
        if self.process is not None:
            self.process.returncode = 0
        self._forget()


AHEAD = Ahead()

atexit.register(AHEAD.let_go)
with suppress(AttributeError):  # a system without forks
    os.register_at_fork(after_in_child=AHEAD.leave)
