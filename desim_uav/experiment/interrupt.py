"""Ctrl-C ends work at the next suitable point; a second Ctrl-C ends it at once.

Python handles signals in its main thread, between two byte codes, so not while compiled code runs.
Long work therefore runs in a thread of its own (``interruptible``), while the main thread waits for
it and can abandon it.
"""

from __future__ import annotations

import _thread
import ctypes
import os
import signal
import sys
import threading
import time
import weakref
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, suppress
from queue import Empty, SimpleQueue
from types import FrameType
from typing import Any, TypeVar

T = TypeVar("T")

ALWAYS = ("SIGINT", "SIGTERM", "SIGHUP")
UNLESS_USED = ("SIGUSR1", "SIGUSR2", "SIGXCPU", "SIGALRM")
"""Together with ``ALWAYS``, the signals that ask for the end. Batch systems send these to a job
shortly before its time is up. A signal that the program handles itself is left to it."""

INTERRUPTED = 130
"""The exit code of a process that was interrupted."""

LISTEN_S = 0.1
"""The longest delay of a signal that the system has delivered to another thread."""

AGAIN_S = 0.05
"""The time after which a signal comes again that came while an object was destroyed."""

LEAVE_S = 0.5
"""The time that abandoned work has to end by itself before the process ends without it."""

_left: list[_Worker] = []
"""The threads whose work was abandoned before it had ended."""


class Stop:
    """Notes signals; ``stop()`` tells whether one has asked for the end."""

    def __init__(self, what: str) -> None:
        self._what = what
        self._pending = self._now = self._busy = False

    def __call__(self) -> bool:
        """Return whether a signal has asked for the end."""
        return self._pending

    def note(self, number: int, frame: FrameType | None) -> None:
        """Note a signal; the second one raises KeyboardInterrupt."""
        if not self._pending:
            self._pending = True
            if os.isatty(2):  # without print, as a signal may interrupt another print
                os.write(
                    2, f"\nending after {self._what}; press Ctrl-C again to end now\n".encode()
                )
        elif self._busy:
            self._now = True
        else:
            interrupt(number, frame)

    @contextmanager
    def undisturbed(self) -> Iterator[None]:
        """Run the block without interruption; a KeyboardInterrupt is raised after it."""
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
    """Handle signals that ask for the end, and say on a terminal that it follows ``what``.

    Ignored signals stay ignored. Outside the main thread, which receives signals, this has no
    effect.
    """
    stop = Stop(what)
    with _handled(stop.note):
        yield stop


@contextmanager
def undisturbed() -> Iterator[None]:
    """Run a short block without interruption; a KeyboardInterrupt is raised after it."""
    signals = []
    with _handled(lambda number, frame: signals.append(number)):
        yield
    if signals:
        raise KeyboardInterrupt


@contextmanager
def _handled(note: Callable[[int, FrameType | None], None]) -> Iterator[None]:
    """Call ``note`` for the signals that ask for the end, in the main thread."""
    before: dict[int, Any] = {}
    try:
        with suppress(ValueError):  # it is another thread
            for number in asking():
                before[number] = signal.signal(number, note)
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def asking() -> list[int]:
    """Return the signals that ask for the end, without those that are ignored or used otherwise."""
    numbers = [number for name in ALWAYS if (number := getattr(signal, name, None)) is not None]
    others = [number for name in UNLESS_USED if (number := getattr(signal, name, None)) is not None]
    return [
        *[number for number in numbers if signal.getsignal(number) is not signal.SIG_IGN],
        *[number for number in others if _is_ours(signal.getsignal(number))],
    ]


def _is_ours(handler: object) -> bool:
    """Return whether a handler is Python's own or this module's, and not the program's."""
    default = handler in (signal.SIG_DFL, signal.default_int_handler)
    return default or getattr(handler, "__module__", None) == __name__


def end_politely() -> None:
    """Make signals that ask for the end interrupt the program, unless they are ignored or used."""
    for number in asking():
        if signal.getsignal(number) in (signal.SIG_DFL, signal.default_int_handler):
            signal.signal(number, interrupt)


def interrupt(number: int, frame: FrameType | None) -> None:
    """Raise KeyboardInterrupt, as Ctrl-C does, but not while an object is destroyed.

    Python only prints what is raised there, and the program would go on. So the signal comes again.
    """

    def again() -> None:
        time.sleep(AGAIN_S)
        if hasattr(signal, "pthread_kill"):  # which wakes the main thread
            signal.pthread_kill(threading.main_thread().ident or 0, number)
        else:  # Windows
            signal.raise_signal(number)

    while frame is not None:
        code = frame.f_code
        if code.co_name == "__del__" or code is weakref.finalize.__call__.__code__:
            _thread.start_new_thread(again, ())
            return
        frame = frame.f_back
    raise KeyboardInterrupt


def interruptible(items: Iterable[T]) -> Iterator[T]:
    """Yield items that take long to make; a KeyboardInterrupt abandons even compiled code at once.

    Each item is made on demand in another thread. Abandoned work goes on until it returns to
    Python; ``leave`` ends a process that must not wait for that.
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
    """Return what ``work`` returns; a KeyboardInterrupt abandons even compiled code at once."""
    return next(interruptible(work(*arguments) for _ in range(1)))


def leave(code: int) -> None:
    """End the process now if it was interrupted, or if abandoned work is still in compiled code.

    Python would wait for such work. It would also free the memory of a large run object by object,
    which takes seconds, whereas the operating system reclaims it at once.
    """
    try:
        until = time.monotonic() + LEAVE_S
        for worker in _left:
            worker.join(max(0.0, until - time.monotonic()))
        if code != INTERRUPTED and not any(worker.is_alive() for worker in _left):
            return
        for stream in (sys.stdout, sys.stderr):
            with suppress(OSError, ValueError):  # nobody reads it any more, or it is closed
                stream.flush()
    except KeyboardInterrupt:  # once more
        os._exit(INTERRUPTED)
    os._exit(code)


_END: Any = object()


class _Worker(threading.Thread):
    """Makes items one by one, on demand."""

    def __init__(self, items: Iterator[Any]) -> None:
        super().__init__(daemon=True)
        self._items = items
        self._requests: SimpleQueue[bool] = SimpleQueue()
        self._outcomes: SimpleQueue[tuple[Any, BaseException | None]] = SimpleQueue()
        self._busy = False

    def run(self) -> None:
        """Make items on demand until ``end`` is called."""
        with suppress(KeyboardInterrupt):  # raised by ``end``, perhaps between two items
            while self._requests.get():
                try:
                    outcome: tuple[Any, BaseException | None] = next(self._items, _END), None
                except BaseException as error:  # the main thread raises it again
                    outcome = _END, error
                self._outcomes.put(outcome)

    def next(self) -> Any:
        """Return the next item, or ``_END``. Raises what making it raised, or KeyboardInterrupt."""
        self._busy = True
        self._requests.put(True)
        while True:
            try:
                item, error = self._outcomes.get(timeout=LISTEN_S)
            except Empty:  # Python can handle signals here
                continue
            self._busy = False
            if error is not None:
                raise error
            return item

    def end(self) -> None:
        """End the thread; if it is still busy, its Python code gets a KeyboardInterrupt."""
        if self._busy:
            _left.append(self)
            ctypes.pythonapi.PyThreadState_SetAsyncExc(
                ctypes.c_ulong(self.ident or 0), ctypes.py_object(KeyboardInterrupt)
            )
        self._requests.put(False)
