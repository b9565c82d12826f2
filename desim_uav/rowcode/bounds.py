"""Errors for indices outside the bounds of tables and queues, in both engines.

Compiled code does not check indices in the built-in rules, because that would take time. It checks
those in components of one's own and in what these call; with DESIM_UAV_CHECK=1 it checks all.
"""

from __future__ import annotations

import os
import sys
import threading
from collections.abc import Callable
from ctypes import CFUNCTYPE, c_int64, c_void_p, cast
from typing import Any, TypeVar

from desim_uav.errors import SimulationError

F = TypeVar("F", bound=Callable[..., Any])

CHECKED = os.environ.get("DESIM_UAV_CHECK", "0") not in ("", "0")
"""Whether all indices are checked, also those of built-in rules and kernels."""

A_TABLE, A_QUEUE = "a table", "a queue"

CodePlace = tuple[str, int, str]
"""A file, a line and the name of a function."""

_last = threading.local()
"""The last index out of bounds in this thread's compiled code, and the length that it was for."""


class OutsideError(SimulationError, IndexError):
    """An index is outside the bounds of a table, a queue or an array.

    ``owner`` is the name of the component in which that happened, or empty; ``of`` says what was
    indexed, and ``numbers`` are the index and the length. Compiled code, which has noted them
    before (see ``NOTE``), leaves them out.
    """

    def __init__(
        self, owner: str, of: str, place: CodePlace, numbers: tuple[int, int] | None = None
    ) -> None:
        super().__init__(owner, of, place, numbers or _last.numbers)  # by which SimPy copies it
        self.owner, self.of, self.place, self.numbers = self.args

    def __str__(self) -> str:
        """Return the message: the component, the index, the bounds and the place."""
        (index, length), (file, line, function) = self.numbers, self.place
        what = f"IndexError: index {index} is out of bounds for {self.of} with size {length}"
        component = f"component {self.owner!r}" if self.owner else "the simulation"
        return f"{component} failed: {what} ({file}:{line}, in {function})"


def _note(index: int, length: int) -> None:
    _last.numbers = index, length


_noted = CFUNCTYPE(None, c_int64, c_int64)(_note)

NOTE, NOTE_AT = "desim_uav_note_outside", cast(_noted, c_void_p).value
"""The name and the address of the function with which compiled code notes an index and a length.

Compiled code refers to it by its name, because the address differs between processes."""


def is_own(module: str) -> bool:
    """Return whether a module is not part of this package."""
    return module.partition(".")[0] != __name__.partition(".")[0]


def own_class(module: str, function: str) -> str:
    """Return the component of one's own that a function is a method of, or an empty text."""
    return f"{module}:{function.partition('.')[0]}" if is_own(module) else ""


def owner_of(cls: Any) -> str:
    """Return the name of a class of components of one's own; an empty text if it is built in."""
    return f"{cls.__module__}:{cls.__qualname__}" if is_own(cls.__module__) else ""


# ---- in Python


def require_inside(k: Any, length: int, of: str) -> None:
    """Raise OutsideError for an index that is below 0, or not below the length; slices pass.

    The place is in the innermost function outside the modules ``BETWEEN``.
    """
    if not isinstance(k, slice) and not 0 <= k < length:
        owner, place = _place()
        raise OutsideError(owner, of, place, (int(k), length))


def _place() -> tuple[str, CodePlace]:
    """Return the component, if any, and the place of the innermost function outside ``BETWEEN``."""
    frame = sys._getframe(1)
    while frame.f_globals.get("__name__") in (__name__, *BETWEEN) and frame.f_back is not None:
        frame = frame.f_back
    code = frame.f_code
    owner = own_class(frame.f_globals["__name__"], code.co_qualname)
    return owner, (code.co_filename, frame.f_lineno, code.co_qualname)


BETWEEN = {"desim_uav.rowcode.rows"}
"""The modules of rows: a fault in one of their functions is reported at its caller."""
