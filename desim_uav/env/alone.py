"""An environment belongs to one thread at a time; a second one in it is refused.

Compiled code runs without Python's lock, so two threads in one environment would write to the same
memory, which may end the process.
"""

from __future__ import annotations

import threading
from collections.abc import Callable
from functools import wraps
from typing import Any, Concatenate, ParamSpec, TypeVar

from gymnasium import error

P = ParamSpec("P")
T = TypeVar("T")
Env = TypeVar("Env", bound=Any)


class OneThread:
    """A block of code that one thread at a time may be in; it may enter it more than once.

    Copies and pickles are independent.
    """

    def __init__(self) -> None:
        self.lock = threading.RLock()

    def __reduce__(self) -> tuple[type[OneThread], tuple[()]]:
        """Return how to copy it: as a new block, in which no thread is."""
        return OneThread, ()

    def __enter__(self) -> None:
        """Enter. Raises gymnasium's Error if another thread is in it."""
        if not self.lock.acquire(False):
            raise _occupied()

    def __exit__(self, *_: object) -> None:
        """Leave."""
        self.lock.release()


def _occupied() -> error.Error:
    return error.Error(
        "another thread is using this environment: give each thread an environment of its own "
        "(copy.deepcopy), or step many of them at once with threads=…"
    )


def alone(method: Callable[Concatenate[Env, P], T]) -> Callable[Concatenate[Env, P], T]:
    """Refuse to run a method of an environment while another thread is in one of its methods.

    The environment has a ``OneThread`` as its attribute ``guard``.
    """

    @wraps(method)
    def refusing(self: Env, /, *args: P.args, **kwargs: P.kwargs) -> T:
        lock = self.guard.lock  # not ``with self.guard``, which takes microseconds of each step
        if not lock.acquire(False):
            raise _occupied()
        try:
            return method(self, *args, **kwargs)
        finally:
            lock.release()

    return refusing
