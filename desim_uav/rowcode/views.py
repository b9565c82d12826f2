"""Rows in blocks of memory that Python reads and writes by name, as compiled code does."""

from __future__ import annotations

import ctypes
from collections.abc import Iterable
from functools import cache, cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from desim_uav.rowcode.rows import (
    Queue,
    R,
    Row,
    Table,
    Words,
    held_by,
    is_row,
    origin_of,
    packed,
    place,
    width_of,
    words_of,
)


class Numbers(np.ndarray[Any, Any]):
    """An array that keeps its ``address``, for which NumPy takes longer than for an element."""

    @cached_property
    def address(self) -> int:
        """The address of the array's memory."""
        return place(self)


class Views(list[Any]):
    """The views of all rows of a table, which are also a structured ``array``."""

    def __init__(self, views: Iterable[Any], array: NDArray[Any]) -> None:
        super().__init__(views)
        self.array = array

    @cached_property
    def address(self) -> int:
        """The address of the first row."""
        return place(self.array)


class View(ctypes.Structure):
    """A row in a block of memory; its fields are read by name, its tables as arrays or views."""

    __slots__ = ("_at", "_block", "_kept")

    def __new__(cls, block: Words, of: Any, at: int = 0) -> Any:
        """Return a view of the row of class ``of`` at a word."""
        return _view_class(of).from_buffer(block, 8 * at)

    def __init__(self, block: Words, of: type[Row], at: int = 0) -> None:
        self._block, self._at = block, at
        self._kept: dict[str, Any] = {}


def in_memory(one: R) -> R:
    """Return a copy of a row in a block of memory of its own, as a view of it."""
    view: Any = View(packed(one), type(one))
    copied: R = view
    return copied


@cache
def _view_class(of: type[Row]) -> Any:
    """Return the class of views of a class of rows: numbers are fields of its structure."""
    formats = {int: ctypes.c_int64, float: ctypes.c_double}
    fields = [
        (name, formats[kind]) if kind in formats else ("", ctypes.c_int64 * words_of(kind))
        for name, kind in of.kinds.items()
    ]
    others = {name: _field(of, name) for name, kind in of.kinds.items() if kind not in formats}
    return type(f"{of.__name__}View", (View,), {"__slots__": (), "_fields_": fields, **others})


def _field(cls: type[Row], name: str) -> property:
    """Return the property of views that reads, and writes if it is a queue, a field of rows."""
    kind, offset = cls.kinds[name], cls.places[name]

    def read(view: Any) -> Any:
        if name in view._kept:
            return view._kept[name]
        block, place = view._block, view._at + offset
        if is_row(kind):
            view._kept[name] = inner = View(block, kind, place)
            return inner
        of = held_by(kind)
        entries: Any = array_of(block, cls, name, view._at)
        if is_row(of):
            begin = (entries.ctypes.data - block.ctypes.data) // 8
            rows = (View(block, of, begin + k * of.words) for k in range(len(entries)))
            entries = Views(rows, entries)
        if origin_of(kind) is Table:  # whose length does not change
            view._kept[name] = entries
        return entries

    def write(view: Any, value: Any) -> None:
        if origin_of(kind) is not Queue:
            raise AttributeError(f"{cls.__name__}.{name} is no number")
        block, place, of = view._block, view._at + offset, held_by(kind)
        begin = place + int(block[place]) // 8
        written = np.array(list(value), dtype_of(of) if is_row(of) else of).view(np.int64)
        block[place + 1], block[begin : begin + written.size] = len(value), written

    return property(read, write)


def array_of(block: Words, cls: type[Row], name: str, at: int = 0) -> NDArray[Any]:
    """Return a table or queue of the row at word ``at`` as a (structured) array over its memory."""
    kind, place = cls.kinds[name], at + cls.places[name]
    base = at if origin_of(kind) is Table else place
    begin, count = base + int(block[place]) // 8, int(block[place + 1])
    of = held_by(kind)
    words = block[begin : begin + count * width_of(of)]
    return words.view(dtype_of(of) if is_row(of) else np.float64 if of is float else np.int64)


@cache
def dtype_of(cls: type[Row]) -> np.dtype[Any]:
    """Return the NumPy data type of a class of rows."""
    formats = {int: "i8", float: "f8"}
    return np.dtype(
        {
            "names": list(cls.kinds),
            "formats": [
                dtype_of(kind) if is_row(kind) else formats.get(kind, (np.int64, words_of(kind)))
                for kind in cls.kinds.values()
            ],
            "offsets": [8 * place for place in cls.places.values()],
            "itemsize": 8 * cls.words,
        }
    )


def zeros(cls: type[Row], count: int) -> Any:
    """Return so many rows of a class without tables as a structured array, whose numbers are 0."""
    row_class: Any = cls
    return np.zeros(count, dtype_of(row_class))


def records(cls: type[Row], numbers: Any) -> Any:
    """Return rows of a class without tables as a structured array, of the numbers of each."""
    numbers = np.asarray(numbers).reshape(-1, len(cls.kinds))
    array = zeros(cls, len(numbers))
    for column, name in enumerate(cls.kinds):
        array[name] = numbers[:, column]
    return array
