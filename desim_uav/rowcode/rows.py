"""Rows with named fields, which are objects in Python and pieces of memory in compiled code.

A class of rows is declared by its annotations::

    @row
    class Drone(Row):
        charge: int
        waiting: Queue[int]

In Python a row is an object with slots, and a ``Table`` or a ``Queue`` is a list. In compiled code
a row is a pointer to its fields, of eight bytes (a word) each, which are accessed by name, as in
``drone.charge`` (see ``compiled_types``). One function over rows therefore runs in both.

A field, or an entry of a table, may be a whole number of fewer bytes (``Int32``, ``Int16``), which
is an ``int`` in Python and whenever compiled code has read it. Such fields share words.

A row stores the positions of its tables as their distances from itself. A block of memory with a
row and all its tables can therefore be copied, pickled and moved as it is.
"""

from __future__ import annotations

import ctypes
from collections import namedtuple
from collections.abc import Iterable
from functools import cache, partial
from typing import (
    TYPE_CHECKING,
    Annotated,
    Any,
    ClassVar,
    Generic,
    Self,
    TypeAlias,
    TypeVar,
    get_type_hints,
)

import numpy as np
from numpy.typing import NDArray

from desim_uav.rowcode.bounds import (
    A_QUEUE,
    A_TABLE,
    CHECKED,
    require_inside,
)

T = TypeVar("T")
R = TypeVar("R", bound="Row")

Words = NDArray[np.int64]
"""A block of memory in words of eight bytes, some of which are floats."""

if TYPE_CHECKING:
    Int32: TypeAlias = int
    Int16: TypeAlias = int
    Fitted: TypeAlias = int
    Maybe = Annotated[T, "or None"]
else:

    class Maybe(Generic[T]):
        """The type of a field that holds a row of type T, which in some worlds is not there.

        In Python it is the row or None. Compiled code must not read a row that is not there.
        """

    class Int32(int):
        """The type of a field or of entries that are whole numbers from -2^31 to 2^31 - 1."""

    class Int16(int):
        """The type of a field or of entries that are whole numbers from -2^15 to 2^15 - 1.

        A number that does not fit is refused where Python writes it to memory, and cut off where
        compiled code does: a world in which one may occur must be refused before.
        """

    class Fitted(int):
        """The type of entries that have 32 bits if all of a table fit in these, and 64 otherwise.

        Python writes such tables, and compiled code only reads them. The count of a table whose
        entries have 32 bits is stored as -1 less the count.
        """


FORMATS: dict[Any, str] = {int: "i8", float: "f8", Int32: "i4", Int16: "i2", Fitted: "i8"}
"""How numbers lie in memory, by the type of a field or of entries, as NumPy names it."""


class Table(list[T], Generic[T]):
    """A list of rows or numbers whose length does not change.

    ``Table(values)`` is a plain list, because indexing one of a subclass takes ten times as long. A
    field may hold an array in its place: of numbers, of rows of whole numbers, or a structured one
    of rows (``views.records``).
    """

    __slots__ = ()

    def __new__(cls, values: Iterable[T] = ()) -> Self:
        """Return a list of values or, if all indices are to be checked, a ``BoundedTable``."""
        if cls is Table and not CHECKED:
            return list(values)  # type: ignore[return-value]
        # Python fills it by ``__init__`` with the values, which may be an iterator.
        return super().__new__(BoundedTable if cls is Table else cls)  # type: ignore[return-value]


Floats = NDArray[np.float64] | Table[float]
Ints = NDArray[np.int64] | Table[int]
"""Numbers in an array, or in a table of a row."""


class Queue(list[T], Generic[T]):
    """A list of rows or numbers whose length changes.

    Compiled code has memory for ``buffer`` entries. If more are added, it drops them and sets
    ``overrun``. ``of`` is the type of the entries.
    """

    __slots__ = ("buffer", "of")
    overrun = 0

    def __init__(self, values: Iterable[T] = (), buffer: int = 0, of: Any = None) -> None:
        super().__init__(values)
        self.buffer, self.of = buffer, of

    def added(self) -> T:
        """Append a new row and return it; the caller must set all its fields."""
        one: T = self.of()
        self.append(one)
        return one

    def space(self, entries: Any) -> tuple[int, int]:
        """Return the address of memory for new entries, and how many fit.

        In compiled code it is that of this queue; in Python that of a table of a view. ``fill``
        then says how many entries are there.
        """
        return entries.address, len(entries)

    def fill(self, entries: Any, count: int) -> None:
        """Replace all entries by the first ones in the memory that ``space`` has returned."""
        self.take(entries, 0, count)

    def take(self, entries: Any, first: int, count: int) -> None:
        """Replace all entries by some of a table of a view, whose rows are of numbers."""
        rows = entries.array[first : first + count].tolist()
        self[:] = map(maker_of(self.of), rows)


class BoundedTable(Table[T]):
    """A table that checks each index; a negative one is refused, as in compiled code."""

    __slots__ = ()

    def __getitem__(self, k: Any) -> Any:
        """Return an entry. Raises OutsideError if there is none."""
        if k.__class__ is not int or not 0 <= k < len(self):
            require_inside(k, len(self), A_TABLE)
        return list.__getitem__(self, k)

    def __setitem__(self, k: Any, value: Any) -> None:
        """Change an entry. Raises OutsideError if there is none."""
        require_inside(k, len(self), A_TABLE)
        list.__setitem__(self, k, value)


class BoundedQueue(Queue[T]):
    """A queue that checks each index, as a BoundedTable does."""

    __slots__ = ()

    def __getitem__(self, k: Any) -> Any:
        """Return an entry. Raises OutsideError if there is none."""
        if k.__class__ is not int or not 0 <= k < len(self):
            require_inside(k, len(self), A_QUEUE)
        return list.__getitem__(self, k)

    def __setitem__(self, k: Any, value: Any) -> None:
        """Change an entry. Raises OutsideError if there is none."""
        require_inside(k, len(self), A_QUEUE)
        list.__setitem__(self, k, value)

    def pop(self, *place: Any) -> Any:
        """Return the last entry and remove it. Raises OutsideError if there is none."""
        if not place:
            require_inside(len(self) - 1, len(self), A_QUEUE)
        return list.pop(self, *place)

    def insert(self, place: Any, value: Any) -> None:
        """Insert an entry before another one, or at the end. Raises OutsideError elsewhere."""
        require_inside(place, len(self) + 1, A_QUEUE)
        list.insert(self, place, value)

    def remove(self, value: Any) -> None:
        """Remove the first entry that equals a value. Raises OutsideError if there is none."""
        if value not in self:
            require_inside(len(self), len(self), A_QUEUE)
        list.remove(self, value)


if CHECKED:
    for _name in ("__getitem__", "__setitem__", "pop", "insert", "remove"):
        setattr(Queue, _name, vars(BoundedQueue)[_name])


class Row:
    """The base of all rows. A field is an int, a float, another row, a Table or a Queue."""

    __slots__ = ()
    kinds: ClassVar[dict[str, Any]] = {}
    """The type of each field, by name."""
    byte_of: ClassVar[dict[str, int]] = {}
    """The number of the byte at which each field begins, by name."""
    words: ClassVar[int] = 0
    """The length of a row in memory, in words, without the entries of its tables."""
    scratch: ClassVar[tuple[str, ...]] = ()
    """The names of tables of numbers that mean nothing between two calls of a kernel; their entries
    may be in memory that many rows share (see ``packed_apart``)."""
    attached: ClassVar[tuple[str, ...]] = ()
    """The names of other tables whose entries may lie anywhere in memory (see ``attach``)."""


def row(cls: type[R]) -> type[R]:
    """Return a class with annotations as a class of rows, with slots and a layout in memory."""
    names = tuple(cls.__annotations__)
    body = {key: part for key, part in vars(cls).items() if key not in ("__dict__", "__weakref__")}
    row_class: Any = type(cls.__name__, cls.__bases__, {**body, "__slots__": names})
    hints = get_type_hints(row_class)
    row_class.kinds = {name: hints[name] for name in names}
    layout = _Layout()
    row_class.byte_of = {
        name: layout.place(bytes_of(kind, is_far(row_class, name)))
        for name, kind in row_class.kinds.items()
    }
    row_class.words = layout.end // 8
    for name in (*row_class.scratch, *row_class.attached):
        if origin_of(row_class.kinds.get(name)) is not Table:
            raise TypeError(f"{row_class.__qualname__}.scratch: {name!r} is no table of it")
    return row_class  # type: ignore[no-any-return]


class _Layout:
    """The bytes of a row that are in use.

    These are whole words up to ``end``, except for parts that are ``free``, by their sizes.
    """

    def __init__(self) -> None:
        self.end = 0
        self.free: dict[int, list[int]] = {2: [], 4: []}

    def place(self, size: int) -> int:
        """Return the byte at which a field of so many bytes begins."""
        if size >= 8 or size == 0:
            self.end += size
            return self.end - size
        if not self.free[size]:
            whole = self.place(2 * size)
            self.free[size].append(whole + size)
            return whole
        return self.free[size].pop()


def is_far(cls: type[Row], name: str) -> bool:
    """Return whether the entries of a table of a class of rows may lie anywhere in memory."""
    return name in cls.scratch or name in cls.attached


def is_row(kind: Any) -> bool:
    """Return whether a type is a class of rows."""
    return isinstance(kind, type) and issubclass(kind, Row)


def origin_of(kind: Any) -> Any:
    """Return Table, Queue or Maybe for a type of these, else None, faster than typing does."""
    return getattr(kind, "__origin__", None)


def held_by(kind: Any) -> Any:
    """Return the type of the entries of a type of tables or queues, or of the row of a Maybe."""
    return kind.__args__[0]


BYTES = {kind: int(name[1]) for kind, name in FORMATS.items()}
"""The sizes of numbers."""


def is_number(kind: Any) -> bool:
    """Return whether a type is one of numbers."""
    return kind in FORMATS


def number(kind: Any, value: Any = 0) -> Any:
    """Return a number as one of Python of the type of a field or of entries: int or float."""
    return float(value) if kind is float else int(value)


def size_of(kind: Any) -> int:
    """Return the length of an entry of this type in a table, in bytes."""
    return 8 * kind.words if is_row(kind) else BYTES[kind]


@cache
def layout_of(cls: type[Row]) -> str:
    """Return the layout in memory of a class of rows, and of the rows in its fields, as text."""
    fields = [(name, str(kind), cls.byte_of[name]) for name, kind in cls.kinds.items()]
    kinds = (held_by(kind) if origin_of(kind) else kind for kind in cls.kinds.values())
    inner = [layout_of(kind) for kind in kinds if is_row(kind)]
    return f"{cls.__module__}.{cls.__qualname__} {cls.words} {fields} {inner}"


NEAR_WORDS, FAR_WORDS, QUEUE_WORDS = 1, 2, 2
"""The words of a table and of a queue.

A table has the distance to its entries in words and their count, as numbers of 32 bits each; one
that ``is_far`` has the distance in bytes and the count as words. A queue is a near table followed
by its buffer and by whether it has overrun, of 32 bits as well. A row that may be missing (Maybe)
is the only entry of a near table, which else has none.
"""


def bytes_of(kind: Any, far: bool = False) -> int:
    """Return the length of a field of this type, in bytes."""
    origin = origin_of(kind)
    if origin is Table or origin is Maybe:
        return 8 * (FAR_WORDS if far else NEAR_WORDS)
    return 8 * QUEUE_WORDS if origin is Queue else size_of(kind)


def blank(cls: type[R]) -> R:
    """Return a row of a class whose numbers are 0, whose tables are empty, and without a Maybe."""
    one: Any = cls()
    for name, kind in cls.kinds.items():
        origin = origin_of(kind)
        if is_row(kind):
            value = blank(kind)
        elif origin is Queue:
            value = Queue(of=held_by(kind))
        else:
            value = None if origin is Maybe else Table() if origin is Table else number(kind)
        setattr(one, name, value)
    return one  # type: ignore[no-any-return]


def fill(cls: type[R], values: Iterable[Any]) -> R:
    """Return a row of a class with these values, in the order of its fields."""
    one = cls()
    for name, value in zip(cls.kinds, values, strict=True):
        setattr(one, name, value)
    return one


@cache
def has_tables(cls: type[Row]) -> bool:
    """Return whether rows of a class have tables or queues, or rows that have some."""
    return any(
        origin_of(kind) or (is_row(kind) and has_tables(kind)) for kind in cls.kinds.values()
    )


def bound(*rows: Row) -> None:
    """Let all tables and queues of rows, and of the rows in them, check each index from now on.

    In the SimPy engine a field of a row may hold another object of Python, or None; it is left out.
    """
    for one in rows:
        if not isinstance(one, Row):
            continue
        for name, kind in one.kinds.items():
            value = getattr(one, name)
            if is_row(kind) or origin_of(kind) is Maybe:
                bound(value)
            elif origin_of(kind):
                setattr(one, name, bounded(value))
                if is_row(held_by(kind)) and has_tables(held_by(kind)):
                    bound(*value)


def bounded(table: Any) -> Any:
    """Return a table or queue as one that checks each index; an array does so itself.

    A table is copied, and a queue changed.
    """
    if type(table) is list:
        return BoundedTable(table)
    if type(table) is Queue:
        table.__class__ = BoundedQueue
    return table


@cache
def named(cls: type[Row], *more: str) -> Any:
    """Return a class of tuples with the fields of a row, and more."""
    return namedtuple(cls.__name__, [*cls.kinds, *more])


@cache
def maker_of(cls: Any) -> Any:
    """Return a function that makes such a tuple of a tuple with all its fields."""
    return partial(tuple.__new__, named(cls))


def place(array: NDArray[Any]) -> int:
    """Return the address of an array's memory."""
    return int(array.ctypes.data)


def address(one: Any) -> int:
    """Return the address of a row or a table in memory, which is valid in this process.

    In Python, it is that of a view, the views of a table, or ``Numbers``; in compiled code, where
    all rows are in memory, it is that of any row or table.
    """
    if isinstance(one, ctypes.Structure):
        return ctypes.addressof(one)
    number: int = one.address
    return number


def shaped(entries: Any, shape: tuple[int, ...]) -> Any:
    """Return the numbers of a table, which is an array in Python, as an array of this shape.

    A compiled rule may return it in a tuple, but not alone.
    """
    return entries.reshape(shape)
