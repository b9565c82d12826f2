"""Rows in blocks of memory that Python reads and writes by name, as compiled code does."""

from __future__ import annotations

import ctypes
from collections.abc import Iterable, Iterator
from functools import cache, cached_property
from operator import attrgetter
from typing import Any

import numpy as np
from numpy.typing import NDArray

from desim_uav.rowcode.packing import fitting, located, packed, words_for
from desim_uav.rowcode.rows import (
    BYTES,
    FORMATS,
    Int16,
    Int32,
    Maybe,
    Queue,
    R,
    Row,
    Words,
    bytes_of,
    held_by,
    is_far,
    is_number,
    is_row,
    origin_of,
    place,
)

IN_STRUCTURES: dict[Any, Any] = {
    int: ctypes.c_int64,
    float: ctypes.c_double,
    Int32: ctypes.c_int32,
    Int16: ctypes.c_int16,
}


class Numbers(np.ndarray[Any, Any]):
    """An array that keeps its ``address``, for which NumPy takes longer than for an element."""

    @cached_property
    def address(self) -> int:
        """The address of the array's memory."""
        return place(self)


class Narrow(np.ndarray[Any, Any]):
    """An array of numbers of few bytes, each of which is read as a whole number of Python.

    Those of NumPy would wrap around in the sums and products of rules that Python runs.
    """

    def __getitem__(self, place: Any) -> Any:
        """Return an entry as an int, or entries as an array."""
        found = super().__getitem__(place)
        return int(found) if isinstance(found, np.integer) else found

    def __iter__(self) -> Iterator[Any]:
        """Yield the entries as ints."""
        return iter(self.tolist())


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
        # A structure of an address is smaller than one of a buffer; ``__init__`` keeps the block.
        return _view_class(of).from_address(place(block) + 8 * int(at))

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
    fields: list[tuple[str, Any]] = []
    others: dict[str, property] = {}
    end = 0
    for name, at in sorted(of.byte_of.items(), key=lambda pair: pair[1]):
        kind = of.kinds[name]
        size = bytes_of(kind, is_far(of, name))
        if at > end:
            fields.append(("", ctypes.c_byte * (at - end)))
        if not is_number(kind):
            fields.append(("", ctypes.c_byte * size))
            others[name] = _field(of, name)
        elif size < 8:
            fields.append((f"_{name}", IN_STRUCTURES[kind]))
            others[name] = _narrow(of, name)
        else:
            fields.append((name, IN_STRUCTURES[kind]))
        end = at + size
    return type(f"{of.__name__}View", (View,), {"__slots__": (), "_fields_": fields, **others})


def _narrow(cls: type[Row], name: str) -> property:
    """Return the property of a number of few bytes, which refuses one that does not fit."""
    kind, own = cls.kinds[name], f"_{name}"
    limit = 1 << (8 * BYTES[kind] - 1)

    def write(view: Any, value: int) -> None:
        if not -limit <= value < limit:
            fitting(kind, value)
        setattr(view, own, value)

    return property(attrgetter(own), write)


def _field(cls: type[Row], name: str) -> property:
    """Return the property of views that reads, and writes if it is a queue, a field of rows."""
    kind, offset = cls.kinds[name], cls.byte_of[name] // 8

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
        elif entries.itemsize < 8:
            entries = entries.view(Narrow)
        if origin_of(kind) is Maybe:
            entries = entries[0] if entries else None
        if origin_of(kind) is not Queue:  # whose length changes
            view._kept[name] = entries
        return entries

    def write(view: Any, value: Any) -> None:
        if origin_of(kind) is not Queue:
            raise AttributeError(f"{cls.__name__}.{name} is no number")
        of, entries = held_by(kind), list(value)
        numbers = np.array(entries, dtype_of(of)) if is_row(of) else fitting(of, entries)
        view._block[view._at + offset :].view(np.int32)[1] = len(entries)
        array_of(view._block, cls, name, view._at)[:] = numbers

    return property(read, write)


def array_of(block: Words, cls: type[Row], name: str, at: int = 0) -> NDArray[Any]:
    """Return a table or queue of the row at word ``at`` as a (structured) array over its memory."""
    of, (begin, count) = held_by(cls.kinds[name]), located(block, cls, name, at)
    if count < 0:  # a table of Fitted
        of, count = Int32, -1 - count
    words = block[begin : begin + words_for(of, count)]
    return words.view(dtype_of(of) if is_row(of) else FORMATS[of])[:count]


@cache
def dtype_of(cls: type[Row]) -> np.dtype[Any]:
    """Return the NumPy data type of a class of rows, each of which has its fields as attributes."""
    formats = [
        dtype_of(kind)
        if is_row(kind)
        else FORMATS.get(kind) or (np.int64, bytes_of(kind, is_far(cls, name)) // 8)
        for name, kind in cls.kinds.items()
    ]
    fields = {
        "names": list(cls.kinds),
        "formats": formats,
        "offsets": list(cls.byte_of.values()),
        "itemsize": 8 * cls.words,
    }
    return np.dtype((np.record, fields))


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
