"""The methods and attributes of queues in compiled code (see ``rows.Queue``)."""

from __future__ import annotations

from typing import Any

from numba import extending

from desim_uav.rowcode.bounds import INSERT, POP, REMOVE
from desim_uav.rowcode.compiled_rows import (
    Line,
    as_array,
    place_of,
    requiring,
    set_spare,
    set_word,
    spare,
    word,
)
from desim_uav.rowcode.rows import width_of

overload_attribute: Any = extending.overload_attribute
overload_method: Any = extending.overload_method

can_pop, can_insert, can_remove = requiring(POP), requiring(INSERT), requiring(REMOVE)


@overload_method(Line, "append")
def _append(line: Any, value: Any) -> Any:
    def append(line: Any, value: Any) -> None:
        count = len(line)
        if count < word(line, 2):
            set_spare(line, count, value)
            set_word(line, 1, count + 1)
        else:
            set_word(line, 3, 1)

    return append


@overload_method(Line, "added")
def _added(line: Any) -> Any:
    def added(line: Any) -> Any:
        count = len(line)
        if count < word(line, 2):
            set_word(line, 1, count + 1)
        else:
            set_word(line, 3, 1)
        return spare(line, count)  # the spare entry if the queue overruns

    return added


@overload_method(Line, "pop")
def _pop(line: Any) -> Any:
    def pop(line: Any) -> Any:
        last = len(line) - 1
        can_pop(line, last, len(line))
        set_word(line, 1, last)
        return spare(line, last)

    return pop


@overload_method(Line, "space")
def _space(line: Any, entries: Any) -> Any:
    def space(line: Any, entries: Any) -> Any:
        return place_of(line), word(line, 2)

    return space


@overload_method(Line, "fill")
def _fill(line: Any, entries: Any, count: Any) -> Any:
    def fill(line: Any, entries: Any, count: Any) -> None:
        if count > word(line, 2):
            set_word(line, 3, 1)
            count = word(line, 2)
        set_word(line, 1, count)

    return fill


@overload_method(Line, "take")
def _take(line: Any, entries: Any, first: Any, count: Any) -> Any:
    width = width_of(line.of)

    def take(line: Any, entries: Any, first: Any, count: Any) -> None:
        if count > word(line, 2):
            set_word(line, 3, 1)
            count = word(line, 2)
        set_word(line, 1, count)
        ours, theirs = as_array(line, (count, width)), as_array(entries, (first + count, width))
        for k in range(count):
            for column in range(width):
                ours[k, column] = theirs[first + k, column]

    return take


@overload_method(Line, "clear")
def _clear(line: Any) -> Any:
    def clear(line: Any) -> None:
        set_word(line, 1, 0)

    return clear


@overload_method(Line, "insert")
def _insert(line: Any, place: Any, value: Any) -> Any:
    def insert(line: Any, place: Any, value: Any) -> None:
        count = len(line)
        can_insert(line, place, count + 1)
        if count < word(line, 2):
            for k in range(count, place, -1):
                set_spare(line, k, spare(line, k - 1))
            set_spare(line, place, value)
            set_word(line, 1, count + 1)
        else:
            set_word(line, 3, 1)

    return insert


@overload_method(Line, "remove")
def _remove(line: Any, value: Any) -> Any:
    def remove(line: Any, value: Any) -> None:
        place, last = 0, len(line) - 1
        can_remove(line, place, last + 1)
        while spare(line, place) != value:
            place += 1
            can_remove(line, place, last + 1)
        for k in range(place, last):
            set_spare(line, k, spare(line, k + 1))
        set_word(line, 1, last)

    return remove


@overload_attribute(Line, "overrun")
def _overrun(line: Any) -> Any:
    def overrun(line: Any) -> Any:
        return word(line, 3)

    return overrun


@overload_attribute(Line, "buffer")
def _buffer(line: Any) -> Any:
    def buffer(line: Any) -> Any:
        return word(line, 2)

    return buffer
