"""Compact columns of whole numbers: differences, zigzag, groups of seven bits, and deflate.

A block is a line of JSON, [[name, coding, count, bytes, scale], …], followed by the bodies of its
columns. ``assets/decode.js`` reads it.
"""

from __future__ import annotations

import json
import zlib
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

DELTA, PLAIN, BYTES, FLOAT = "delta", "plain", "bytes", "float"


class Column(NamedTuple):
    """Numbers and their coding.

    ``delta`` writes each number as its difference from the one before, ``plain`` as it is,
    ``bytes`` as one byte, and ``float`` as eight bytes. The reader multiplies by ``scale``.
    """

    values: NDArray[np.generic]
    coding: str
    scale: float = 1.0


def delta(values: ArrayLike, scale: float = 1.0) -> Column:
    """Return a column of numbers near their neighbours, rounded to multiples of ``scale``."""
    return Column(_whole(values, scale), DELTA, scale)


def plain(values: ArrayLike) -> Column:
    """Return a column of small whole numbers."""
    return Column(_whole(values, 1.0), PLAIN)


def codes(values: ArrayLike) -> Column:
    """Return a column of whole numbers from 0 to 255."""
    return Column(np.asarray(values, np.uint8), BYTES)


def floats(values: ArrayLike) -> Column:
    """Return a column of exact floating-point numbers."""
    return Column(np.asarray(values, "<f8"), FLOAT)


def pack(columns: Mapping[str, Column]) -> bytes:
    """Return the compressed block of some columns."""
    heads, bodies = [], []
    for name, column in columns.items():
        body = _body(column)
        heads.append([name, column.coding, len(column.values), len(body), column.scale])
        bodies.append(body)
    head = json.dumps(heads, separators=(",", ":")).encode() + b"\n"
    return zlib.compress(head + b"".join(bodies), 9)


def varints(values: NDArray[np.int64]) -> bytes:
    """Return whole numbers as varints: zigzag, then seven bits per byte, the lowest first."""
    rest = ((values << 1) ^ (values >> 63)).astype(np.uint64)
    length = np.ones(len(rest), np.int64)
    for bits in range(7, 64, 7):
        length += rest >= np.uint64(1) << np.uint64(bits)
    ends = np.cumsum(length)
    out = np.zeros(int(ends[-1]) if len(ends) else 0, np.uint8)
    starts, place = ends - length, 0
    going = np.arange(len(rest))
    while len(going):
        more = length[going] > place + 1
        low = (rest[going] & np.uint64(0x7F)).astype(np.uint8)
        out[starts[going] + place] = low | (more.astype(np.uint8) << 7)
        rest[going] >>= np.uint64(7)
        going, place = going[more], place + 1
    return out.tobytes()


def _whole(values: ArrayLike, scale: float) -> NDArray[np.int64]:
    return np.rint(np.asarray(values, np.float64) / scale).astype(np.int64)


def _body(column: Column) -> bytes:
    if column.coding in (BYTES, FLOAT):
        return column.values.tobytes()
    values = column.values.astype(np.int64)
    return varints(np.diff(values, prepend=0) if column.coding == DELTA else values)
