"""Ctrl-C asks once for an end at the next good place; a second one ends at once."""

from __future__ import annotations

import os
import signal
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType
from typing import Any

NAMES = ("SIGINT", "SIGTERM", "SIGHUP")


class Stop:
    """Whether somebody has asked for the end: ``stop()``."""

    def __init__(self, what: str) -> None:
        self._what = what
        self._asked = self._now = self._busy = False

    def __call__(self) -> bool:
        """Has somebody?"""
        return self._asked

    def note(self, number: int, frame: FrameType | None) -> None:
        """A signal has come; the second one raises KeyboardInterrupt."""
        if not self._asked:
            self._asked = True
            if os.isatty(2):  # not by print: a signal may come in the middle of another one
                os.write(2, f"\nending after {self._what}; once more ends it now\n".encode())
        elif self._busy:
            self._now = True
        else:
            raise KeyboardInterrupt

    @contextmanager
    def undisturbed(self) -> Iterator[None]:
        """What is done in here is done as a whole: a KeyboardInterrupt comes after it."""
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
    """Listen to whoever asks for the end, and tell a terminal after ``what`` it will come.

    Signals that are ignored stay so. Outside the main thread, which gets them, nobody asks.
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
