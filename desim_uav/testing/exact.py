"""Tables and values that must be equal to the last bit."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping
from math import isnan
from typing import Any

import numpy as np
import pandas as pd

from desim_uav.api.run_result import RunResult
from desim_uav.errors import UsageError
from desim_uav.records import TABLES

Frames = Mapping[str, pd.DataFrame]


def require(holds: bool, what: str) -> None:
    """Raise AssertionError with ``what`` unless it holds, also if Python runs with ``-O``."""
    if not holds:
        raise AssertionError(what)


def tables_of(result: RunResult) -> dict[str, pd.DataFrame]:
    """Return all tables of a run that has kept its events, by name."""
    frames = {}
    for name in TABLES:
        try:
            frames[name] = getattr(result, name)
        except (AttributeError, UsageError):  # not a table of runs, or not of this scenario
            continue
    return frames


def require_same_tables(some: Frames, others: Frames, names: tuple[str, str]) -> None:
    """Require that all tables are equal bit for bit; ``names`` say whose the two are.

    Raises AssertionError with the first value that differs.
    """
    mine, theirs = names
    require(some.keys() == others.keys(), f"{mine}: {[*some]}; {theirs}: {[*others]}")
    for name, frame in some.items():
        other = others[name]
        require([*frame] == [*other], f"{name}: columns {[*frame]} ({mine}), {[*other]} ({theirs})")
        apart = _first_apart(frame, other)
        if apart is not None:
            row, column, value, value_there = apart
            raise AssertionError(
                f"{name}, row {row}, {column}: {value!r} ({mine}), {value_there!r} ({theirs})"
            )
        require(
            len(frame) == len(other), f"{name}: {len(frame)} rows ({mine}), {len(other)} ({theirs})"
        )


def _first_apart(frame: pd.DataFrame, other: pd.DataFrame) -> tuple[int, str, Any, Any] | None:
    """Return the first row that differs, with its first such column and the two values."""
    apart = None
    for column in frame:
        pairs = zip(frame[column].tolist(), other[column].tolist(), strict=False)
        for row, (one, two) in enumerate(pairs):
            if apart is not None and row >= apart[0]:
                break
            if not same(one, two):
                apart = row, str(column), one, two
    return apart


def same(one: Any, other: Any) -> bool:
    """Return whether two values, or what they hold, are equal and of one type; NaN equals NaN."""
    return difference(one, other) is None


def difference(one: Any, other: Any, where: str = "", skips: Collection[str] = ()) -> str | None:
    """Return where two values differ first, such as ``[4]['seed']: 0 is not 1``, or None.

    Keys of mappings that are in ``skips`` are not compared.
    """
    if isinstance(one, np.ndarray) and isinstance(other, np.ndarray):
        if (one.shape, one.dtype) != (other.shape, other.dtype):
            return f"{where}: {one.dtype} {one.shape} is not {other.dtype} {other.shape}"
        if one.dtype != object and np.array_equal(one, other):
            return None
        return difference(one.tolist(), other.tolist(), where, skips)
    if isinstance(one, Mapping) and isinstance(other, Mapping) and one.keys() == other.keys():
        kept = (key for key in one if key not in skips)
        return _first(difference(one[key], other[key], f"{where}[{key!r}]", skips) for key in kept)
    if isinstance(one, list | tuple) and type(one) is type(other) and len(one) == len(other):
        pairs = enumerate(zip(one, other, strict=True))
        return _first(difference(a, b, f"{where}[{k}]", skips) for k, (a, b) in pairs)
    return None if _equal(one, other) else f"{where}: {one!r} is not {other!r}"


def _first(differences: Iterable[str | None]) -> str | None:
    return next((text for text in differences if text is not None), None)


def _equal(one: Any, other: Any) -> bool:
    if one is pd.NA or other is pd.NA:
        return one is other
    if type(one) is not type(other) or isinstance(one, np.ndarray):
        return False
    return bool(one == other) or (isinstance(one, float) and isnan(one) and isnan(other))
