"""The columns of a packed episode, decoded as ``assets/decode.js`` does it."""

from __future__ import annotations

import json
import zlib

import numpy as np
from numpy.typing import NDArray

from desim_uav.report.replay.columns import BYTES, DELTA, FLOAT


def unpack(block: bytes) -> dict[str, NDArray[np.float64]]:
    """Return the columns of a block, as a page reads them."""
    head, _, rest = zlib.decompress(block).partition(b"\n")
    columns, at = {}, 0
    for name, coding, count, size, scale in json.loads(head):
        values = _read(coding, rest[at : at + size])
        assert len(values) == count
        columns[name] = values * scale
        at += size
    return columns


def _read(coding: str, body: bytes) -> NDArray[np.float64]:
    if coding == FLOAT:
        return np.frombuffer(body, "<f8")
    if coding == BYTES:
        return np.frombuffer(body, np.uint8).astype(np.float64)
    values = _from_varints(body)
    return (np.cumsum(values) if coding == DELTA else values).astype(np.float64)


def _from_varints(body: bytes) -> NDArray[np.int64]:
    raw = np.frombuffer(body, np.uint8)
    last = raw < 0x80
    of: NDArray[np.int64] = np.cumsum(last) - last
    firsts = np.flatnonzero(np.concatenate(([True], last[:-1]))) if len(raw) else np.empty(0, int)
    shift = 7 * (np.arange(len(raw)) - firsts[of])
    parts = (raw & 0x7F).astype(np.uint64) << shift.astype(np.uint64)
    whole = np.zeros(int(last.sum()), np.uint64)
    np.add.at(whole, of, parts)
    return (whole >> np.uint64(1)).astype(np.int64) ^ -(whole & np.uint64(1)).astype(np.int64)
