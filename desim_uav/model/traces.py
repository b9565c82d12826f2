"""Reads measured walks and requests from CSV files."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Callable, Mapping
from functools import lru_cache
from pathlib import Path
from typing import Any, TypeVar

from desim_uav.regular_file import content_of

MAX_BYTES = 256 * 2**20


N = TypeVar("N", int, float)

LARGEST = 10**9
"""No number of a table is larger: times in microseconds then stay whole 64-bit numbers."""


def index(text: str) -> int:
    """Parse a whole number from 0 to ``LARGEST``."""
    return _bounded(int(text))


def quantity(text: str) -> float:
    """Parse a number from 0 to ``LARGEST``."""
    number = float(text)
    if not math.isfinite(number):
        raise ValueError("must be a finite number, at least 0")
    return _bounded(number)


def _bounded(number: N) -> N:
    if number < 0:
        raise ValueError("must be at least 0")
    if number > LARGEST:
        raise ValueError(f"must be at most {LARGEST:,}")
    return number


def read_table(path: Path, columns: Mapping[str, Callable[[str], Any]]) -> list[tuple[Any, ...]]:
    """Return the rows of a CSV file with the given columns (in any order), each value parsed.

    The line number of each row is appended to it. Raises ValueError with file and line.
    """
    try:
        status = path.stat()
    except OSError as error:
        raise ValueError(f"{path}: {error.strerror}") from error
    version = (str(path.resolve()), status.st_mtime_ns, status.st_size)
    return list(_read_table(path, tuple(columns.items()), version))


@lru_cache(maxsize=16)
def _read_table(
    path: Path,
    columns: tuple[tuple[str, Callable[[str], Any]], ...],
    version: tuple[str, int, int],
) -> list[tuple[Any, ...]]:
    """Read the file at this ``version`` (path, time of change, size)."""
    try:
        text = content_of(path, MAX_BYTES).decode("utf-8-sig")
    except OSError as error:
        raise ValueError(f"{path}: {error.strerror}") from error
    except UnicodeDecodeError as error:
        raise ValueError(f"{path}: it is not UTF-8 text") from error
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from error
    try:
        return _rows(path, csv.DictReader(io.StringIO(text, newline=""), strict=True), columns)
    except csv.Error as error:
        raise ValueError(f"{path}: {error}") from error


def _rows(
    path: Path, reader: csv.DictReader[str], columns: tuple[tuple[str, Callable[[str], Any]], ...]
) -> list[tuple[Any, ...]]:
    names = ", ".join(name for name, _ in columns)
    missing = [name for name, _ in columns if name not in (reader.fieldnames or [])]
    if missing:
        raise ValueError(f"{path}:1: no column {missing[0]!r}; expected the columns {names}")
    rows = []
    for row in reader:
        values = []
        for name, parse in columns:
            try:
                values.append(parse((row[name] or "").strip()))
            except ValueError as error:
                raise ValueError(
                    f"{path}:{reader.line_num}: {name}: {row[name]!r}: {error}"
                ) from error
        rows.append((*values, reader.line_num))
    return rows
