"""Whether the command line has called a function of the Python interface, and how."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from typing import Any

from desim_uav.errors import DesimWarning

_TYPED: ContextVar[tuple[str, ...]] = ContextVar("typed", default=())


@contextmanager
def begun_by(command: Sequence[str], say: Callable[[str], None]) -> Iterator[None]:
    """Let manifests name this command line, and ``say`` what the functions warn of."""
    token = _TYPED.set(tuple(command))
    with warnings.catch_warnings():
        others = warnings.showwarning

        def show(message: Any, category: type[Warning], *where: Any, **more: Any) -> None:
            if issubclass(category, DesimWarning):
                say(str(message))
            else:
                others(message, category, *where, **more)

        warnings.simplefilter("always", DesimWarning)
        warnings.showwarning = show
        try:
            yield
        finally:
            _TYPED.reset(token)


def command_line() -> list[str]:
    """Return the command line that called, or nothing if Python did."""
    return list(_TYPED.get())
