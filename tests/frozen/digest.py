"""A digest of a table: of its columns' names, types and values, bit for bit."""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Mapping

import numpy as np
import pandas as pd

DIGITS = 16
"""So many hexadecimal digits of a SHA-256 are kept, which are 64 bits."""

RENAMED = {"bandwidth_kbps": "bandwidth_khz"}
"""The present names of columns that had another name when digests were frozen (steps, points)."""


def of_table(frame: pd.DataFrame, columns: Mapping[str, str]) -> str:
    """Return the digest of these columns of a table; the types are those of ``records``.

    A column that has been added to the table since does not change its digest, nor does one that
    has been ``RENAMED``: it is digested under its old name. The digest does not depend on how
    pandas stores a column either, nor on the payload of a NaN, which stands for null.
    """
    digest = hashlib.sha256()
    for name, dtype in columns.items():
        digest.update(f"{name}:{dtype}:{len(frame)};".encode())
        own = name if name in frame else RENAMED[name]
        for part in _values(frame[own], dtype):
            digest.update(part)
    return digest.hexdigest()[:DIGITS]


def of_array(array: np.ndarray) -> str:
    """Return the digest of an array of numbers: of its shape, type and values."""
    digest = hashlib.sha256(f"{array.shape}:{array.dtype.name};".encode())
    digest.update(array.astype(array.dtype.newbyteorder("<")).tobytes())
    return digest.hexdigest()[:DIGITS]


def _values(column: pd.Series, dtype: str) -> Iterable[bytes]:
    if dtype == "float64":
        values = column.to_numpy(dtype="<f8")
        return [np.where(np.isnan(values), np.nan, values).astype("<f8").tobytes()]
    if dtype in ("int64", "bool"):
        return [column.to_numpy(dtype="<i8").tobytes()]
    empty = column.isna().tolist()
    if dtype == "Int64":
        return [bytes(empty), column.fillna(0).to_numpy(dtype="<i8").tobytes()]
    texts = (
        "" if is_null else value if dtype == "str" else " ".join(str(int(item)) for item in value)
        for value, is_null in zip(column.tolist(), empty, strict=True)
    )
    return [bytes(empty), *(f"{len(text)}:{text};".encode() for text in texts)]
