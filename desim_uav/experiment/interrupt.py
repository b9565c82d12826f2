"""Ctrl-C asks for an end at the next good place; a second one ends at once, machine code or not.

Python hears signals in its main thread, between two lines of Python. Long work therefore runs in a
thread of its own (``interruptible``) while the main thread waits for it and can leave it.
"""

from __future__ import annotations

import ctypes
import os
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, suppress
from queue import Empty, SimpleQueue
from types import FrameType
from typing import Any, TypeVar

T = TypeVar("T")

NAMES = ("SIGINT", "SIGTERM", "SIGHUP")

INTERRUPTED = 130
"""The exit code of a process that was interrupted."""

LISTEN_S = 0.1
"""How long a signal waits at most that the system has handed to another thread."""

LEAVE_S = 0.5
"""How long work that was left is given to end by itself before the process ends without it."""

_left: list[_Worker] = []
"""The threads whose work was left before it had ended."""


class Stop:
    """Whether a signal has asked for the end: ``stop()``."""

    def __init__(self, what: str) -> None:
        self._what = what
        self._asked = self._now = self._busy = False

    def __call__(self) -> bool:
        """Has a signal asked for the end?"""
        return self._asked

    def note(self, number: int, frame: FrameType | None) -> None:
        """Note a signal; the second one raises KeyboardInterrupt."""
        if not self._asked:
            self._asked = True
            if os.isatty(2):  # not by print: a signal may come in the middle of another one
                os.write(
                    2, f"\nending after {self._what}; press Ctrl-C again to end now\n".encode()
                )
        elif self._busy:
            self._now = True
        else:
            raise KeyboardInterrupt

    @contextmanager
    def undisturbed(self) -> Iterator[None]:
        """Do what is in here as a whole: a KeyboardInterrupt comes after it."""
        self._busy = True
        try:
            yield
        finally:
            self._busy = False
        if self._now:
            self._now = False
            raise KeyboardInterrupt


@contextmanager
def asked_to_stop(what: str) -> Iterator[Stop]:
    """Listen for signals that ask for the end, and tell a terminal that it comes after ``what``.

    Signals that are ignored stay ignored. Outside the main thread, which gets them, none is heard.
    """
    stop = Stop(what)
    before: dict[int, Any] = {}
    try:
        for number in (getattr(signal, name) for name in NAMES if hasattr(signal, name)):
            if signal.getsignal(number) is not signal.SIG_IGN:
                before[number] = signal.signal(number, stop.note)
    except ValueError:
        pass
    try:
        yield stop
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def interruptible(items: Iterable[T]) -> Iterator[T]:
    """Yield items that take long to make; a KeyboardInterrupt leaves even machine code at once.

    Each item is made when it is asked for, in another thread. Work that was left goes on until it
    comes back to Python; ``leave`` ends a process that must not wait for that.
    """
    if threading.current_thread() is not threading.main_thread():
        yield from items
        return
    worker = _Worker(iter(items))
    worker.start()
    try:
        while (item := worker.next()) is not _END:
            yield item
    finally:
        worker.end()


def at_once(work: Callable[..., T], *arguments: Any) -> T:
    """Return what ``work`` returns; a KeyboardInterrupt leaves even machine code at once."""
    return next(interruptible(work(*arguments) for _ in range(1)))


def leave(code: int) -> None:
    """End the process now if it was interrupted, or has left work in machine code.

    Python would wait for such work. It would also free the memory of a large run object by object,
    which takes seconds, whereas the system takes it back at once.
    """
    until = time.monotonic() + LEAVE_S
    for worker in _left:
        worker.join(max(0.0, until - time.monotonic()))
    if code != INTERRUPTED and not any(worker.is_alive() for worker in _left):
        return
    for stream in (sys.stdout, sys.stderr):
        with suppress(OSError, ValueError):  # nobody reads it any more, or it is closed
            stream.flush()
    os._exit(code)


_END: Any = object()


class _Worker(threading.Thread):
    """Makes items one by one, each when it is asked for one."""

    def __init__(self, items: Iterator[Any]) -> None:
        super().__init__(daemon=True)
        self._items = items
        self._asked: SimpleQueue[bool] = SimpleQueue()
        self._made: SimpleQueue[tuple[Any, BaseException | None]] = SimpleQueue()
        self._busy = False

    def run(self) -> None:
        """Make items until no more is asked for."""
        with suppress(KeyboardInterrupt):  # of ``end``, if it comes between two items
            while self._asked.get():
                try:
                    made: tuple[Any, BaseException | None] = next(self._items, _END), None
                except BaseException as error:  # whatever it is, the main thread raises it
                    made = _END, error
                self._made.put(made)

    def next(self) -> Any:
        """The next item, or ``_END``. Raises what making it has raised, and KeyboardInterrupt."""
        self._busy = True
        self._asked.put(True)
        while True:
            try:
                item, error = self._made.get(timeout=LISTEN_S)
            except Empty:  # Python looks for signals here, too
                continue
            self._busy = False
            if error is not None:
                raise error
            return item

    def end(self) -> None:
        """Ask for no more; Python code that is still at work gets a KeyboardInterrupt, too."""
        if self._busy:
            _left.append(self)
            ctypes.pythonapi.PyThreadState_SetAsyncExc(
                ctypes.c_ulong(self.ident or 0), ctypes.py_object(KeyboardInterrupt)
            )
        self._asked.put(False)
