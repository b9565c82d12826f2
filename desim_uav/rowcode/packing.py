"""Rows as blocks of memory: written by Python, and the positions of their tables."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from desim_uav.rowcode.rows import (
    BYTES,
    FAR_WORDS,
    FORMATS,
    Int32,
    Maybe,
    Queue,
    Row,
    Words,
    held_by,
    is_far,
    is_row,
    origin_of,
    place,
    size_of,
)


def packed(one: Row) -> Words:
    """Return a block of memory that begins with a row, followed by the entries of its tables."""
    return _pack(one, False).block


def packed_apart(one: Row) -> tuple[Words, int]:
    """Return such a block without the entries of ``scratch``, and how many words these take.

    The positions of their tables are those that they would have if the memory for all of scratch
    began where the block does. They have to be moved to where it is: ``headers_of`` lists them.
    """
    packer = _pack(one, True)
    return packer.block, packer.apart_end


def _pack(one: Row, apart: bool) -> _Packer:
    """Return a packer that has written a row and all its tables into its block."""
    packer = _Packer(np.zeros(one.words + _size_behind(one, apart), np.int64), apart)
    packer.pack(one)
    return packer


@cache
def headers_of(cls: type[Row]) -> tuple[int, ...]:
    """Return the words of a row that hold the positions of ``scratch``, of rows in it as well."""
    words: list[int] = []
    for name, kind in cls.kinds.items():
        at = cls.byte_of[name] // 8
        if is_row(kind):
            words += [at + word for word in headers_of(kind)]
        elif name in cls.scratch:
            words.append(at)
    return tuple(words)


def _size_behind(one: Row, apart: bool) -> int:
    """Return the length of the entries of a row's tables, in words, with or without scratch."""
    total = 0
    for name, kind in one.kinds.items():
        value = getattr(one, name)
        if apart and name in one.scratch:
            continue
        if is_row(kind):
            total += _size_behind(value, apart)
        elif origin_of(kind) is not None:
            of, value = held_by(kind), _entries(kind, value)
            total += words_for(of, _length(kind, value))
            if is_row(of) and not isinstance(value, np.ndarray):
                total += sum(_size_behind(each, apart) for each in value)
    return total


def _entries(kind: Any, value: Any) -> Any:
    """Return the entries of a table or a queue, or the row of a Maybe as the only one."""
    if origin_of(kind) is Maybe:
        return [] if value is None else [value]
    return value


def words_for(of: Any, count: int) -> int:
    """Return how many words so many entries of a type take."""
    return -(-count * size_of(of) // 8)


def _length(kind: Any, value: Any) -> int:
    """Return the number of entries with memory.

    A queue of rows has a spare one, which is written if it overruns. All those without a buffer
    share one behind everything.
    """
    if origin_of(kind) is Queue:
        most = _room(value)
        return most + int(most > 0 and is_row(held_by(kind)))
    if isinstance(value, np.ndarray) and is_row(held_by(kind)):
        return int(value.nbytes // size_of(held_by(kind)))
    return len(value)


def _room(queue: Queue[Any]) -> int:
    """Return the number of entries that a queue may have."""
    return int(max(queue.buffer, len(queue)))


class _Packer:
    """Writes rows into a block, and the entries of their tables behind all that is written.

    If scratch is ``apart``, memory of its own is counted for it, up to ``apart_end``.
    """

    def __init__(self, block: Words, apart: bool) -> None:
        self.block, self.apart = block, apart
        self.of_kinds = {kind: block.view(name) for kind, name in FORMATS.items()}
        self.end = self.apart_end = 0
        self.without_room: list[tuple[type[Row], str, int]] = []

    def pack(self, one: Row) -> None:
        """Write a row at the start of the block, and all its tables."""
        self.end = one.words
        self._write(one, 0)
        widths = [held_by(cls.kinds[name]).words for cls, name, _ in self.without_room]
        self.block = np.concatenate((self.block, np.zeros(max(widths, default=0), np.int64)))
        for cls, name, at in self.without_room:
            locate(self.block, cls, name, at, self.end, 0)

    def _write(self, one: Row, at: int) -> None:
        """Write a row at a word of the block, and its tables behind everything."""
        for name, kind in one.kinds.items():
            byte, value = 8 * at + one.byte_of[name], getattr(one, name)
            if is_row(kind):
                self._write(value, byte // 8)
            elif origin_of(kind) is not None:
                self._write_table(one, at, name, _entries(kind, value))
            else:
                self.of_kinds[kind][byte // BYTES[kind]] = value

    def _write_table(self, one: Row, at: int, name: str, value: Any) -> None:
        """Write where the entries of a table or a queue are, and these behind everything."""
        kind, cls = one.kinds[name], type(one)
        count = _length(kind, value)
        if self.apart and name in one.scratch:
            locate(self.block, cls, name, at, self.apart_end, count)
            self.apart_end += words_for(held_by(kind), count)
            return
        locate(self.block, cls, name, at, self.end, count)
        if origin_of(kind) is Queue:
            halves = self.of_kinds[Int32][(8 * at + one.byte_of[name]) // 4 :]
            halves[1], halves[2] = len(value), _room(value)
            if is_row(held_by(kind)) and count == 0:
                self.without_room.append((cls, name, at))
        self._write_all(kind, value, count)

    def _write_all(self, kind: Any, values: Any, count: int) -> None:
        """Write the entries of a table or queue behind everything."""
        of, begin = held_by(kind), self.end
        self.end += words_for(of, count)
        if isinstance(values, np.ndarray) and is_row(of):
            self.block[begin : self.end] = values.reshape(-1).view(np.int64)
        elif is_row(of):
            for k, value in enumerate(values):
                self._write(value, begin + k * of.words)
        elif len(values):
            first = 8 * begin // BYTES[of]
            numbers = fitting(of, values)
            self.of_kinds[of][first : first + numbers.size] = numbers


def fitting(of: Any, values: Any) -> NDArray[Any]:
    """Return numbers as an array of a type of entries. Raises OverflowError if one does not fit."""
    numbers = np.asarray(values).reshape(-1)
    fitted = numbers.astype(FORMATS[of])
    if fitted.itemsize < 8 and (fitted != numbers).any():
        wrong = numbers[fitted != numbers][0]
        raise OverflowError(f"{wrong} does not fit in {BYTES[of]} bytes")
    return fitted


def locate(block: Words, cls: type[Row], name: str, at: int, begin: int, count: int) -> None:
    """Let the entries of a table or queue of the row at word ``at`` begin at a word of a block."""
    place = at + cls.byte_of[name] // 8
    if is_far(cls, name):
        block[place : place + FAR_WORDS] = 8 * (begin - at), count
    else:
        block.view(np.int32)[2 * place : 2 * place + 2] = begin - _base(cls, name, at), count


def located(block: Words, cls: type[Row], name: str, at: int = 0) -> tuple[int, int]:
    """Return the word at which the entries of a table or queue of a row begin, and their count."""
    place = at + cls.byte_of[name] // 8
    if is_far(cls, name):
        return at + int(block[place]) // 8, int(block[place + 1])
    distance, count = block[place : place + 1].view(np.int32).tolist()
    return _base(cls, name, at) + distance, count


def _base(cls: type[Row], name: str, at: int) -> int:
    """Return the word from which the distance of a table of a row, or that of a queue, counts."""
    return at + cls.byte_of[name] // 8 if origin_of(cls.kinds[name]) is Queue else at


def attach(block: Words, cls: type[Row], name: str, array: NDArray[Any]) -> None:
    """Let a table of the row at the beginning of a block be an array, which stays where it is.

    If the table is none of those that may lie anywhere (``is_far``), it must be in the block.
    """
    count = array.nbytes // size_of(held_by(cls.kinds[name]))
    locate(block, cls, name, 0, (place(array) - place(block)) // 8, count)
