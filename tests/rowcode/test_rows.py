"""Rows with named fields: one function over them gives the same in Python and compiled."""

from __future__ import annotations

import math
import pickle
from collections.abc import Callable
from typing import Any, get_origin

import numba
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from desim_uav.rowcode.compiled_registers import either
from desim_uav.rowcode.compiled_rows import address_of, as_array, call, entries_at, pointer_to
from desim_uav.rowcode.kernels import OPTIONS, rule
from desim_uav.rowcode.packing import locate, located, packed
from desim_uav.rowcode.rows import (
    Fitted,
    Int16,
    Int32,
    Maybe,
    Queue,
    Row,
    Table,
    Words,
    address,
    blank,
    fill,
    held_by,
    is_row,
    row,
)
from desim_uav.rowcode.views import View, array_of, dtype_of, in_memory

ROOM = 6


@row
class Book(Row):
    pages: int
    weight: float


@row
class Box(Row):
    """Rows in a table that have a queue of their own."""

    number: int
    marks: Queue[int]


@row
class Shelf(Row):
    number: int
    load: float
    first: Book
    books: Table[Book]
    boxes: Table[Box]
    marks: Table[int]
    scores: Table[float]
    lent: Queue[int]
    heights: Queue[float]
    returned: Queue[Book]
    sorts: int


def shelf() -> Shelf:
    books = Table(fill(Book, (100 + k, 0.5 * k)) for k in range(3))
    boxes = Table(fill(Box, (k, Queue([k, k + 1], buffer=4))) for k in range(2))
    made = blank(Shelf)
    made.number, made.load, made.first = 4, 2.5, fill(Book, (7, 0.25))
    made.books, made.boxes = books, boxes
    made.marks, made.scores = Table([3, -1, 2**40]), Table([0.1, -0.2, math.inf])
    made.lent = Queue([5, 7, 9, 7], ROOM, int)
    made.heights = Queue([1.5, -0.0], ROOM, float)
    made.returned = Queue([fill(Book, (1, 1.0))], ROOM, Book)
    return made


@row
class Pair(Row):
    a: int
    b: int


@row
class Tables(Row):
    pairs: Table[Pair]
    reals: Table[float]


shelf_at = pointer_to(Shelf)


def compiled(function: Callable[[Shelf, int], None]) -> Callable[[int, int], None]:
    """A function over a shelf, as machine code that is given its address."""

    @numba.njit(**OPTIONS)
    def run(address: int, k: int) -> None:
        function(shelf_at(address), k)

    return run  # type: ignore[no-any-return]


def plain(one: Any, cls: type[Row] = Shelf) -> dict[str, Any]:
    """All numbers of a row, or of a view of one."""
    found: dict[str, Any] = {}
    for name, kind in cls.kinds.items():
        value = getattr(one, name)
        if is_row(kind):
            found[name] = plain(value, kind)
        elif get_origin(kind) is None:
            found[name] = value
        elif is_row(held_by(kind)):
            found[name] = [plain(each, held_by(kind)) for each in value]
        else:
            found[name] = list(value)
    return found


# ---- one function, in Python and compiled


@rule
def write_numbers(shelf: Shelf, k: int) -> None:
    shelf.number = k * k - 3
    shelf.load = shelf.number / 2
    shelf.load += k
    shelf.first.weight = k  # a whole number in a field of floats


@rule
def read_and_write_rows(shelf: Shelf, k: int) -> None:
    shelf.first.pages += k
    for j in range(len(shelf.books)):
        book = shelf.books[j]
        book.pages += j * k
        book.weight = book.weight * 1.5 + shelf.first.weight
        shelf.marks[j] = book.pages
        shelf.scores[j] = book.weight / k
    heaviest(shelf).pages = 0


@rule
def heaviest(shelf: Shelf) -> Book:
    """Return a row."""
    found = shelf.books[0]
    for j in range(1, len(shelf.books)):
        if shelf.books[j].weight > found.weight:
            found = shelf.books[j]
    return found


@rule
def use_queues_of_rows_in_a_table(shelf: Shelf, k: int) -> None:
    for j in range(len(shelf.boxes)):
        box = shelf.boxes[j]
        box.marks.append(k + j)
        box.marks.remove(j + 1)
        box.number = box.marks[0]


@rule
def append(shelf: Shelf, k: int) -> None:
    shelf.lent.append(k)
    shelf.heights.append(k / 4)
    shelf.heights.append(k)


@rule
def add_a_row(shelf: Shelf, k: int) -> None:
    book = shelf.returned.added()
    book.pages, book.weight = k, 0.25 * k
    shelf.returned[0].pages = len(shelf.returned)


@rule
def pop(shelf: Shelf, k: int) -> None:
    shelf.number = shelf.lent.pop() - k
    shelf.load = shelf.heights.pop() + shelf.returned.pop().weight


@rule
def insert(shelf: Shelf, k: int) -> None:
    shelf.lent.insert(0, k)
    shelf.lent.insert(len(shelf.lent), k + 1)
    shelf.heights.insert(1, 0.5 * k)


@rule
def remove(shelf: Shelf, k: int) -> None:
    """Of two that are equal, the first one goes."""
    shelf.lent.remove(7)
    shelf.heights.remove(1.5)


@rule
def clear(shelf: Shelf, k: int) -> None:
    shelf.lent.clear()
    shelf.returned.clear()
    shelf.lent.append(k)


@rule
def set_entries(shelf: Shelf, k: int) -> None:
    shelf.lent[1] = k
    shelf.heights[0] = k
    shelf.marks[2] = k
    shelf.scores[0] = 1.0 / k


@rule
def count(shelf: Shelf, k: int) -> None:
    tables = len(shelf.books) + 10 * len(shelf.marks)
    queues = len(shelf.lent) + 10 * len(shelf.returned)
    shelf.number = tables + 100 * queues + 10000 * shelf.lent.buffer + shelf.lent.overrun


@pytest.mark.parametrize(
    "function",
    [
        *(write_numbers, read_and_write_rows, use_queues_of_rows_in_a_table),
        *(append, add_a_row, pop, insert, remove, clear, set_entries, count),
    ],
)
def test_python_and_machine_code_do_the_same(function: Callable[[Shelf, int], None]):
    in_python, before = shelf(), plain(shelf())
    block = packed(in_python)
    assert plain(View(block, Shelf)) == before
    function(in_python, 3)
    compiled(function)(block.ctypes.data, 3)
    assert plain(View(block, Shelf)) == plain(in_python) != before


APPEND, POP, INSERT, REMOVE, CLEAR, SET, ADD = range(7)


@rule
def do(shelf: Shelf, what: int, value: int) -> None:
    """One change to the queues, if it is possible."""
    lent, heights, returned = shelf.lent, shelf.heights, shelf.returned
    if what == APPEND and len(lent) < lent.buffer and len(heights) < heights.buffer:
        lent.append(value)
        heights.append(value / 8)
    elif what == POP and len(lent) > 0 and len(heights) > 0:
        shelf.number = lent.pop()
        shelf.load = heights.pop()
    elif what == INSERT and len(lent) < lent.buffer:
        lent.insert(value % (len(lent) + 1), value)
    elif what == REMOVE and len(lent) > 0:
        lent.remove(lent[value % len(lent)])
    elif what == CLEAR:
        lent.clear()
        heights.clear()
        returned.clear()
    elif what == SET and len(lent) > 0:
        lent[value % len(lent)] = value
    elif what == ADD and len(returned) < returned.buffer:
        book = returned.added()
        book.pages, book.weight = value, value / 3


@numba.njit(**OPTIONS)
def done(address: int, what: int, value: int) -> None:
    do(shelf_at(address), what, value)


@settings(max_examples=60, deadline=None)
@given(st.lists(st.tuples(st.integers(APPEND, ADD), st.integers(0, 9)), max_size=40))
def test_queues_are_the_same_after_any_changes(changes: list[tuple[int, int]]):
    in_python = shelf()
    block = packed(in_python)
    for what, value in changes:
        do(in_python, what, value)
        done(block.ctypes.data, what, value)
        assert plain(View(block, Shelf)) == plain(in_python)


def one_of(kind: type) -> type[Row]:
    """A class of rows that has its name in common with others."""
    return row(type("Own", (Row,), {"__annotations__": {"before": kind, "value": float}}))


def test_rows_of_one_name_are_told_apart_by_their_layout():
    for kind in (int, Book):
        cls = one_of(kind)
        own_at = pointer_to(cls)

        @numba.njit(**OPTIONS)
        def value(address: int, own_at: Any = own_at) -> float:
            return own_at(address).value  # type: ignore[no-any-return]

        before: Any = 1 if kind is int else fill(Book, (1, 0.5))
        assert value(packed(fill(cls, (before, 2.5))).ctypes.data) == 2.5


# ---- what does not fit


@rule
def append_whole(shelf: Shelf, k: int) -> None:
    shelf.lent.append(k)


@rule
def insert_first(shelf: Shelf, k: int) -> None:
    shelf.lent.insert(0, k)


@rule
def append_real(shelf: Shelf, k: int) -> None:
    shelf.heights.append(k)


@rule
def add_book(shelf: Shelf, k: int) -> None:
    book = shelf.returned.added()
    book.pages, book.weight = k, k


COUNT, BUFFER, OVERRUN = 1, 2, 3
"""The halves of words of a queue: how many entries it has, may have, and whether it overran."""


@pytest.mark.parametrize(
    ("function", "name"),
    [
        (append_whole, "lent"),
        (insert_first, "lent"),
        (append_real, "heights"),
        (add_book, "returned"),
    ],
)
def test_what_does_not_fit_is_lost_and_said_and_nothing_else_is_written(
    function: Callable[[Shelf, int], None], name: str
):
    block, run = packed(shelf()), compiled(function)
    queue = Shelf.byte_of[name] // 8
    halves = block[queue : queue + 2].view(np.int32)
    for _ in range(ROOM):
        if halves[COUNT] < ROOM:
            assert halves[OVERRUN] == 0
            run(block.ctypes.data, 3)
    full = block.copy()
    assert halves[1:].tolist() == [ROOM, ROOM, 0]
    run(block.ctypes.data, 4)
    changed = set(np.flatnonzero(block != full).tolist())
    spare = located(full, Shelf, name)[0] + ROOM * Book.words  # behind the last row
    allowed = {spare, spare + 1} if name == "returned" else set()
    assert halves[1:].tolist() == [ROOM, ROOM, 1]
    assert queue + 1 in changed and changed - {queue + 1} <= allowed


def test_python_has_room_for_everything():
    own = shelf()
    for k in range(2 * ROOM):
        own.lent.append(k)
    assert (len(own.lent), own.lent.overrun) == (4 + 2 * ROOM, 0)


def test_a_queue_has_room_for_what_it_holds():
    own = shelf()
    own.lent = Queue(range(9), buffer=2)
    assert array_of(packed(own), Shelf, "lent").tolist() == list(range(9))


# ---- blocks of memory


@pytest.fixture(scope="module")
def add() -> Callable[[int, int], None]:
    return compiled(add_a_row)


def expected() -> dict[str, Any]:
    own = shelf()
    add_a_row(own, 3)
    return plain(own)


@pytest.mark.parametrize("moved", [np.copy, lambda block: pickle.loads(pickle.dumps(block))])
def test_a_block_can_be_copied_and_pickled(add: Any, moved: Callable[[Words], Words]):
    block = packed(shelf())
    other = moved(block)
    block[:] = -1  # nothing there is needed any more
    add(other.ctypes.data, 3)
    assert plain(View(other, Shelf)) == expected()
    assert (block == -1).all()


def test_a_block_can_be_moved_into_another_one(add: Any):
    block = packed(shelf())
    large = np.full(len(block) + 20, -1, np.int64)
    large[5 : 5 + len(block)] = block
    add(large.ctypes.data + 8 * 5, 3)
    assert plain(View(large, Shelf, 5)) == expected()
    assert (large[:5] == -1).all() and (large[5 + len(block) :] == -1).all()


def test_arrays_stand_for_tables_of_numbers_and_of_rows_of_whole_numbers():
    rows, reals = np.arange(6).reshape(3, 2), np.array([0.5, 1.5])
    own = fill(Tables, (rows, reals))
    view = View(packed(own), Tables)
    assert [(pair.a, pair.b) for pair in view.pairs] == [(0, 1), (2, 3), (4, 5)]
    assert view.reals.tolist() == [0.5, 1.5]


def test_where_fields_are():
    names = ["number", "load", "first", "books", "boxes", "marks", "scores", "lent", "heights"]
    assert [Shelf.byte_of[name] // 8 for name in names] == [0, 1, 2, 4, 5, 6, 7, 8, 10]
    assert (Book.words, Box.words, Shelf.words) == (2, 3, 15)
    assert dtype_of(Shelf).itemsize == 8 * Shelf.words
    assert dtype_of(Shelf)["first"] == dtype_of(Book)


def test_blank_and_filled_rows():
    own = blank(Shelf)
    assert (own.number, own.load, own.first.pages) == (0, 0.0, 0)
    assert (list(own.books), list(own.lent)) == ([], [])
    assert own.returned.added() is own.returned[0]
    with pytest.raises(ValueError, match="zip"):
        fill(Book, (1,))
    with pytest.raises(AttributeError, match="colour"):
        own.colour = 1  # type: ignore[attr-defined]


# ---- memory seen from Python


class TestViews:
    def test_numbers_are_read_and_written(self):
        view = View(packed(shelf()), Shelf)
        view.number, view.load = -5, 3
        view.first.weight = 0.75
        view.books[2].pages = 9
        assert (view.number, view.load, view.first.weight) == (-5, 3.0, 0.75)
        assert [type(value) for value in (view.number, view.load)] == [int, float]
        assert [book.pages for book in view.books] == [100, 101, 9]

    def test_tables_of_numbers_are_arrays_over_the_memory(self):
        block = packed(shelf())
        View(block, Shelf).scores[1] = 6.5
        View(block, Shelf).lent[0] = 8
        assert View(block, Shelf).scores.tolist() == [0.1, 6.5, math.inf]
        assert View(block, Shelf).lent.tolist() == [8, 7, 9, 7]

    def test_a_queue_of_numbers_is_overwritten_as_a_whole(self):
        block = packed(shelf())
        for numbers in ([3, 1], [4, 4, 2, 5, 6, 9], []):
            View(block, Shelf).lent = numbers
            assert View(block, Shelf).lent.tolist() == numbers
        assert View(block, Shelf).returned[0].pages == shelf().returned[0].pages

    def test_a_table_is_not_overwritten(self):
        with pytest.raises(AttributeError, match=r"Shelf\.books is no number"):
            View(packed(shelf()), Shelf).books = 3

    def test_there_are_no_other_fields(self):
        with pytest.raises(AttributeError):
            _ = View(packed(shelf()), Shelf).colour


def test_the_rows_of_a_table_as_an_array():
    block = packed(shelf())
    books = array_of(block, Shelf, "books")
    books["weight"] += 1.0
    assert books.dtype.names == ("pages", "weight")
    assert [book.weight for book in View(block, Shelf).books] == [1.0, 1.5, 2.0]
    assert array_of(block, Shelf, "heights").tolist() == [1.5, 0.0]
    boxes = array_of(block, Shelf, "boxes")
    at = located(block, Shelf, "boxes")[0] + Box.words  # the second box
    assert boxes["number"].tolist() == [0, 1]
    assert array_of(block, Box, "marks", at).tolist() == [1, 2]


# ---- numbers of few bytes, and rows that may be missing


@row
class Slim(Row):
    flag: Int16
    name: Int32
    at_us: int
    count: Int16
    few: Queue[Int16]
    many: Table[Int32]
    extra: Maybe[Book]
    none: Maybe[Book]


def slim() -> Slim:
    made = blank(Slim)
    made.flag, made.name, made.at_us, made.count = -1, -(2**31), 2**40, 2**15 - 1
    made.few, made.many = Queue([-2, 5, 7], ROOM, Int16), Table([-1, 2**31 - 1, 4])
    made.extra = fill(Book, (3, 0.5))
    return made


@rule
def change_all(one: Slim) -> None:
    one.at_us += one.flag + one.name
    one.flag, one.count = one.flag - one.count, -one.flag
    one.few.insert(1, one.many[0] - 9)
    one.few.append(one.few[len(one.few) - 1] + 1)
    one.many[2] += one.many[1] - 5
    one.extra.pages -= one.few[0]
    one.name = len(one.many) - 4


@numba.njit(**OPTIONS)
def change_all_at(address: int) -> None:
    change_all(slim_at(address))


slim_at = pointer_to(Slim)


def as_told(one: Any) -> list[Any]:
    numbers = [int(own) for own in (one.flag, one.name, one.at_us, one.count, one.extra.pages)]
    return [*numbers, list(map(int, one.few)), list(map(int, one.many)), one.none]


def test_numbers_of_few_bytes_share_words_and_are_whole_numbers_in_every_way():
    assert Slim.byte_of == {
        "flag": 0,
        "name": 4,
        "at_us": 8,
        "count": 2,
        "few": 16,
        "many": 32,
        "extra": 40,
        "none": 48,
    }
    own, block = slim(), packed(slim())
    assert as_told(View(block, Slim)) == as_told(own)
    assert array_of(block, Slim, "few").dtype == np.int16
    view = View(block, Slim)
    assert view.many[1] * 4 == 2**33 - 4 and {type(one) for one in (*view.few, view.many[0])} == {
        int
    }
    change_all(own)
    change_all_at(block.ctypes.data)
    assert as_told(View(block, Slim)) == as_told(own)
    assert own.flag == -(2**15) and own.few == [-2, -10, 5, 7, 8]


@pytest.mark.parametrize("value", [2**15, -(2**15) - 1])
def test_a_number_that_does_not_fit_is_refused(value: int):
    view = View(packed(slim()), Slim)
    for name, wrong in (("flag", value), ("few", [1, value])):
        with pytest.raises(OverflowError):
            setattr(view, name, wrong)
        own = slim()
        setattr(own, name, wrong if name == "flag" else Queue(wrong, ROOM, Int16))
        with pytest.raises(OverflowError):
            packed(own)
    assert as_told(view) == as_told(slim())


@row
class Drawn(Row):
    numbers: Table[Fitted]


drawn_at = pointer_to(Drawn)


@numba.njit(**OPTIONS)
def sum_of(address: int) -> tuple[int, int]:
    numbers, total = drawn_at(address).numbers, 0
    for k in range(len(numbers)):
        total += (k + 1) * numbers[k]
    return len(numbers), total


@pytest.mark.parametrize("largest", [7, 2**31 - 1, 2**31, 2**60])
def test_a_table_of_numbers_that_fit_is_read_like_any_other(largest: int):
    numbers = [-3, largest, 0]
    block = packed(fill(Drawn, (Table(numbers),)))
    if largest < 2**31:
        begin, count = located(block, Drawn, "numbers")
        block[begin:].view(np.int32)[:count] = numbers
        locate(block, Drawn, "numbers", 0, begin, -1 - count)
    assert View(block, Drawn).numbers.tolist() == numbers
    assert sum_of(block.ctypes.data) == (3, 2 * largest - 3)


# ---- functions and arrays


@rule
def sort_by(shelf: Shelf, k: int) -> None:
    call(shelf.sorts, (shelf, k))


@numba.njit(**OPTIONS)
def reverse(shelf: Shelf, k: int) -> None:
    for j in range(len(shelf.marks)):
        shelf.number += k * shelf.marks[j]


def test_a_row_holds_the_address_of_a_function():
    in_python: Any = shelf()
    block = packed(in_python)
    in_python.sorts = reverse.py_func
    View(block, Shelf).sorts = address_of(reverse, Shelf, int)
    sort_by(in_python, 3)
    compiled(sort_by)(block.ctypes.data, 3)
    assert View(block, Shelf).number == in_python.number == 4 + 3 * (2 + 2**40)


@rule
def addresses(shelf: Shelf) -> tuple[int, int]:
    return address(shelf), address(shelf.books[1])


@numba.njit(**OPTIONS)
def addresses_at(at: int) -> tuple[int, int]:
    return addresses(shelf_at(at))


@numba.njit(**OPTIONS)
def take(at: int, count: int) -> int:
    here = shelf_at(at)
    here.returned.take(here.books, 1, count)
    return here.returned.overrun


@pytest.mark.parametrize(("count", "overruns"), [(0, 0), (2, 0), (ROOM + 1, 1)])
def test_a_queue_takes_entries_of_a_table(count: int, overruns: int):
    made = shelf()
    made.books = Table(fill(Book, (100 + k, 0.5 * k)) for k in range(ROOM + 2))
    of_machine_code, in_python = in_memory(made), made.returned
    in_python.take(of_machine_code.books, 1, count)
    assert take(address(of_machine_code), count) == overruns
    taken = [(book.pages, book.weight) for book in of_machine_code.returned]
    assert taken == [(book.pages, book.weight) for book in in_python][:ROOM]


ints_at = entries_at(int)


@numba.njit(**OPTIONS)
def fill_space(at: int, count: int) -> int:
    here = shelf_at(at)
    here.lent.clear()
    space = here.lent.space(here.marks)
    ints = ints_at(space[0], space[1])
    for k in range(min(count, len(ints))):
        ints[k] = k * k
    here.lent.fill(here.marks, count)
    return here.lent.overrun


@pytest.mark.parametrize(("count", "overruns"), [(0, 0), (2, 0), (ROOM + 1, 1)])
def test_a_queue_is_filled_in_its_own_memory(count: int, overruns: int):
    of_machine_code: Any = in_memory(shelf())
    assert fill_space(address(of_machine_code), count) == overruns
    assert of_machine_code.lent.tolist() == [k * k for k in range(min(count, ROOM))]


def test_python_fills_a_queue_from_the_table_that_had_the_space():
    table, queue = in_memory(shelf()).books, shelf().returned
    at, room = queue.space(table)
    assert room == len(table) == 3
    assert at == table.array.ctypes.data
    queue.fill(table, 2)
    assert [book.pages for book in queue] == [100, 101]


def test_the_address_of_a_row_is_the_same_in_python_and_compiled():
    copied: Any = in_memory(shelf())
    at, of_second = addresses(copied)
    assert (at, of_second) == addresses_at(at)
    assert [book.pages for book in copied.books] == [book.pages for book in shelf().books]
    assert address(View(copied._block, Shelf)) == at


floats_at, bytes_at = entries_at(float), entries_at(bool)


@numba.njit(**OPTIONS)
def in_arrays(address: int, floats: int, flags: int) -> float:
    """Write into the rows as arrays, and into arrays by their addresses."""
    shelf = shelf_at(address)
    scores = as_array(shelf.scores, (3,))
    marks = as_array(shelf.marks, (1, 3))
    marks[0, 1] = 44
    values, told = floats_at(floats, 2), bytes_at(flags, 2)
    values[1] = scores[0] + scores[1]
    told[1] = 1
    return len(values) + marks.shape[1]


def test_tables_as_arrays_and_arrays_as_entries():
    block, floats, flags = packed(shelf()), np.zeros(3), np.zeros(3, np.bool_)
    assert in_arrays(block.ctypes.data, floats.ctypes.data, flags.ctypes.data) == 5
    assert View(block, Shelf).marks.tolist() == [3, 44, 2**40]
    assert floats.tolist() == [0.0, 0.1 - 0.2, 0.0]
    assert flags.tolist() == [False, True, False]


@numba.njit(**OPTIONS)
def between_stores(address: int) -> tuple[int, int, float, int]:
    """Read fields again after others, and the same memory as an array, have been written."""
    shelf = shelf_at(address)
    marks = as_array(shelf.marks, (1, 3))
    before = shelf.marks[1], shelf.number, shelf.books[0].weight
    shelf.marks[1] = before[0] + 1
    shelf.number += shelf.marks[1]
    marks[0, 1] += 10
    shelf.books[0].pages = 5
    shelf.books[0].weight += marks[0, 1]
    marks[0, 2] = shelf.marks[1] + before[1]
    return shelf.marks[1], shelf.number, shelf.books[0].weight, shelf.marks[2]


def test_what_is_read_after_a_store_is_what_was_stored():
    made = shelf()
    mark, number, weight = made.marks[1], made.number, made.books[0].weight
    expected = mark + 11, number + mark + 1, weight + mark + 11, mark + 11 + number
    assert between_stores(packed(made).ctypes.data) == expected


@numba.njit(**OPTIONS)
def chosen(holds: bool, one: int, other: int) -> int:
    return either(holds, one, other)


def test_one_of_two_numbers():
    assert chosen(True, 3, -(2**60)) == 3
    assert chosen(False, 3, -(2**60)) == -(2**60)


@row
class Indexed(Row):
    """A row that is indexed: what is written at either place is added to both."""

    low: float
    high: float
    writes: int

    @rule
    def __getitem__(self, place: tuple[int, int]) -> float:
        return self.high if place[0] + place[1] > 1 else self.low

    @rule
    def __setitem__(self, place: tuple[int, int], value: float) -> None:
        self.writes += place[1]
        self.low += value
        self.high += 2 * value


indexed_at = pointer_to(Indexed)


@rule
def index(indexed: Any) -> None:
    indexed[0, 3] = indexed[0, 1] + 10 * indexed[1, 1]
    indexed[1, 1] += 0.5


@numba.njit(**OPTIONS)
def index_at(address: int) -> None:
    index(indexed_at(address))


def test_a_row_says_what_its_brackets_do():
    in_python = fill(Indexed, (1.0, 2.0, 0))
    block = packed(in_python)
    index(in_python)
    index_at(block.ctypes.data)
    values = [(one.low, one.high, one.writes) for one in (in_python, View(block, Indexed))]
    assert values[0] == values[1] == (1 + 21 + 44.5, 2 + 42 + 89.0, 4)


singles_at = entries_at(np.float32)


@numba.njit(**OPTIONS)
def in_singles(address: int) -> float:
    values = singles_at(address, 3)
    values[1] = values[0] / 3.0
    return float(values[1])


def test_numbers_in_single_precision_by_their_address():
    values = np.array([1.0, 0.0, 7.0], np.float32)
    assert in_singles(values.ctypes.data) == float(np.float32(1 / 3))
    assert values.tolist() == [1.0, float(np.float32(1 / 3)), 7.0]


@pytest.mark.parametrize("name", ["nothing", "books", "queue"])
def test_scratch_names_tables_of_the_row(name: str):
    class Desk(Row):
        scratch = (name,)
        books: int
        queue: Queue[int]

    with pytest.raises(TypeError, match=rf"Desk\.scratch: '{name}' is no table of it"):
        row(Desk)
