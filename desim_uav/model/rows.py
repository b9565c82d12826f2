"""Rows with named fields: declared once, they are Python objects and memory of compiled code.

A class of rows is declared by its annotations::

    @row
    class Drone(Row):
        battery_us: int
        waiting: Queue[int]

In Python a row is an object with slots, and a ``Table`` or a ``Queue`` is a list. In compiled code
a row is a pointer to its fields, eight bytes each, which ``drone.battery_us`` reads and writes by
name (see ``model.compiled_rows``). So one function over rows runs in both.

A row says where its tables are by their distance from itself. A block of memory with all that a
row holds can therefore be copied, pickled and moved as it is.
"""

from __future__ import annotations

from collections import namedtuple
from collections.abc import Iterable
from functools import cache
from typing import Any, ClassVar, Generic, TypeVar, get_args, get_origin, get_type_hints

import numpy as np
from numpy.typing import NDArray

T = TypeVar("T")
R = TypeVar("R", bound="Row")

Words = NDArray[np.int64]
"""A block of memory: eight bytes per entry, some of which are floats."""


class Table(list[T], Generic[T]):
    """Rows or numbers whose count does not change.

    In its place there may be an array: of numbers, or of rows of whole numbers.
    """

    __slots__ = ()


class Queue(list[T], Generic[T]):
    """Rows or numbers whose count changes.

    ``room``: how many compiled code has memory for. More are lost there, and ``overrun`` is set.
    """

    __slots__ = ("of", "room")
    overrun = 0

    def __init__(self, values: Iterable[T] = (), room: int = 0, of: Any = None) -> None:
        super().__init__(values)
        self.room, self.of = room, of

    def added(self) -> T:
        """Append a row and return it. All of its fields have yet to be set."""
        one: T = self.of()
        self.append(one)
        return one


class Row:
    """A row with named fields: int, float, another row, a Table or a Queue."""

    __slots__ = ()
    kinds: ClassVar[dict[str, Any]] = {}
    """The type of each field."""
    places: ClassVar[dict[str, int]] = {}
    """The word at which each field begins."""
    words: ClassVar[int] = 0
    """How many words a row takes."""


def row(cls: type[R]) -> type[R]:
    """Make a class of rows of a class with annotations: slots, and a layout in memory."""
    names = tuple(cls.__annotations__)
    body = {key: part for key, part in vars(cls).items() if key not in ("__dict__", "__weakref__")}
    made: Any = type(cls.__name__, cls.__bases__, {**body, "__slots__": names})
    hints = get_type_hints(made)
    made.kinds, made.places, at = {name: hints[name] for name in names}, {}, 0
    for name, kind in made.kinds.items():
        made.places[name] = at
        at += _words_of(kind)
    made.words = at
    return made  # type: ignore[no-any-return]


def is_row(kind: Any) -> bool:
    """Return whether a field is a row."""
    return isinstance(kind, type) and issubclass(kind, Row)


def held_by(kind: Any) -> Any:
    """Return what a Table or a Queue holds."""
    return get_args(kind)[0]


def width_of(kind: Any) -> int:
    """Return how many words an entry of a table takes."""
    return kind.words if is_row(kind) else 1


@cache
def layout_of(cls: type[Row]) -> str:
    """Return as text where the fields of a row are, and those of the rows in its fields."""
    fields = [(name, str(kind), cls.places[name]) for name, kind in cls.kinds.items()]
    kinds = (held_by(kind) if get_origin(kind) else kind for kind in cls.kinds.values())
    inner = [layout_of(kind) for kind in kinds if is_row(kind)]
    return f"{cls.__module__}.{cls.__qualname__} {cls.words} {fields} {inner}"


TABLE_WORDS, QUEUE_WORDS = 2, 4
"""A table says where its rows are, and how many; a queue also its room, and whether it overran."""


def _words_of(kind: Any) -> int:
    origin = get_origin(kind)
    if origin is Table:
        return TABLE_WORDS
    return QUEUE_WORDS if origin is Queue else width_of(kind)


def blank(cls: type[R]) -> R:
    """Return a row of zeros and empty tables."""
    made: Any = cls()
    for name, kind in cls.kinds.items():
        origin = get_origin(kind)
        if is_row(kind):
            value = blank(kind)
        elif origin is Queue:
            value = Queue(of=held_by(kind))
        else:
            value = Table() if origin is Table else kind(0)
        setattr(made, name, value)
    return made  # type: ignore[no-any-return]


def fill(cls: type[R], values: Iterable[Any]) -> R:
    """Return a row with these values, in the order of its fields."""
    made = cls()
    for name, value in zip(cls.kinds, values, strict=True):
        setattr(made, name, value)
    return made


@cache
def named(cls: type[Row]) -> Any:
    """Return a class of tuples with the fields of a row."""
    return namedtuple(cls.__name__, list(cls.kinds))


# ---- as memory


def packed(one: Row) -> Words:
    """Return a block of memory with a row at its start and all that its tables hold after it."""
    block = np.zeros(_size(one), np.int64)
    _Packer(block).pack(one)
    return block


def _size(one: Row) -> int:
    return one.words + _size_behind(one)


def _size_behind(one: Row) -> int:
    """How many words the tables of a row take."""
    total = 0
    for name, kind in one.kinds.items():
        value = getattr(one, name)
        if is_row(kind):
            total += _size_behind(value)
        elif get_origin(kind) is not None:
            of = held_by(kind)
            total += _length(kind, value) * width_of(of)
            if is_row(of) and not isinstance(value, np.ndarray):
                total += sum(_size_behind(each) for each in value)
    return total


def _length(kind: Any, value: Any) -> int:
    """For how many entries there is memory; behind a queue's last row there is one to spare."""
    return len(value) if get_origin(kind) is Table else max(value.room, len(value)) + 1


class _Packer:
    """Writes rows into a block, and their tables behind everything that has been written."""

    def __init__(self, block: Words) -> None:
        self.block, self.floats = block, block.view(np.float64)
        self.end = 0

    def pack(self, one: Row) -> None:
        """Write the row that the block is of."""
        self.end = one.words
        self._write(one, 0)

    def _write(self, one: Row, at: int) -> None:
        for name, kind in one.kinds.items():
            place, value = at + one.places[name], getattr(one, name)
            if is_row(kind):
                self._write(value, place)
            elif get_origin(kind) is not None:
                base = at if get_origin(kind) is Table else place
                header = [8 * (self.end - base), len(value)]
                if get_origin(kind) is Queue:
                    header += [max(value.room, len(value)), 0]
                self.block[place : place + len(header)] = header
                self._write_all(kind, value)
            else:
                self._numbers(kind)[place] = value

    def _write_all(self, kind: Any, values: Any) -> None:
        of, begin = held_by(kind), self.end
        self.end += _length(kind, values) * width_of(of)
        if isinstance(values, np.ndarray):
            self._numbers(of)[begin : begin + values.size] = values.reshape(-1)
        elif is_row(of):
            for k, value in enumerate(values):
                self._write(value, begin + k * of.words)
        elif len(values):
            self._numbers(of)[begin : begin + len(values)] = values

    def _numbers(self, kind: Any) -> Any:
        return self.floats if kind is float else self.block


# ---- memory seen from Python


class View:
    """A row in a block of memory: its fields by name, its tables as arrays and lists of views."""

    __slots__ = ("_at", "_block", "_cls")

    def __init__(self, block: Words, cls: type[Row], at: int = 0) -> None:
        object.__setattr__(self, "_block", block)
        object.__setattr__(self, "_cls", cls)
        object.__setattr__(self, "_at", at)

    def __getattr__(self, name: str) -> Any:
        block, at = self._block, self._at
        kind, place = self._cls.kinds[name], at + self._cls.places[name]
        if is_row(kind):
            return View(block, kind, place)
        origin = get_origin(kind)
        if origin is None:
            return (
                block[place : place + 1].view(np.float64 if kind is float else np.int64)[0].item()
            )
        of, base = held_by(kind), at if origin is Table else place
        begin, count = base + int(block[place]) // 8, int(block[place + 1])
        if not is_row(of):
            return block[begin : begin + count].view(np.float64 if of is float else np.int64)
        return [View(block, of, begin + k * of.words) for k in range(count)]

    def __setattr__(self, name: str, value: Any) -> None:
        kind, place = self._cls.kinds[name], self._at + self._cls.places[name]
        if kind not in (int, float):
            raise AttributeError(f"{self._cls.__name__}.{name} is no number")
        self._block[place : place + 1].view(np.float64 if kind is float else np.int64)[0] = value


def array_of(block: Words, cls: type[Row], name: str, at: int = 0) -> NDArray[Any]:
    """Return the rows of a table, or of a queue, of a row as a structured array over its memory."""
    kind, place = cls.kinds[name], at + cls.places[name]
    base = at if get_origin(kind) is Table else place
    begin, count = base + int(block[place]) // 8, int(block[place + 1])
    of = held_by(kind)
    words = block[begin : begin + count * width_of(of)]
    return words.view(dtype_of(of) if is_row(of) else np.float64 if of is float else np.int64)


@cache
def dtype_of(cls: type[Row]) -> np.dtype[Any]:
    """Return the layout of a row for NumPy."""
    formats = {int: "i8", float: "f8"}
    return np.dtype(
        {
            "names": list(cls.kinds),
            "formats": [
                dtype_of(kind) if is_row(kind) else formats.get(kind, (np.int64, _words_of(kind)))
                for kind in cls.kinds.values()
            ],
            "offsets": [8 * place for place in cls.places.values()],
            "itemsize": 8 * cls.words,
        }
    )


def room_of(block: Words, cls: type[Row], name: str) -> NDArray[Any]:
    """Return all the rows that a queue of a row has room for (see ``array_of``)."""
    place, of = cls.places[name], held_by(cls.kinds[name])
    begin, room = place + int(block[place]) // 8, int(block[place + 2])
    words = block[begin : begin + room * width_of(of)]
    return words.view(dtype_of(of) if is_row(of) else np.float64 if of is float else np.int64)
