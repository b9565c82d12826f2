"""Reads measured walks and requests from CSV files."""

from __future__ import annotations

import csv
import hashlib
import io
import math
from collections.abc import Callable, Mapping
from functools import lru_cache
from pathlib import Path
from typing import Any, TypeVar

from desim_uav.errors import in_short
from desim_uav.rowcode.regular_file import content_of

MAX_BYTES = 256 * 2**20


T = TypeVar("T")
N = TypeVar("N", int, float)

LARGEST = 10**9
"""No number of a table is larger: times in microseconds then stay whole 64-bit numbers."""


def index(text: str) -> int:
    """Parse a whole number from 0 to ``LARGEST``."""
    try:
        number = int(text)
    except ValueError:
        raise ValueError("must be a whole number") from None
    return _bounded(number)


def number_of(text: str) -> float:
    """Parse a number, which may be infinite or none. Raises ValueError for other texts."""
    try:
        return float(text)
    except ValueError:
        raise ValueError("must be a number") from None


def quantity(text: str) -> float:
    """Parse a number from 0 to ``LARGEST``."""
    number = number_of(text)
    if not math.isfinite(number):
        raise ValueError("must be a finite number, at least 0")
    return _bounded(number)


def coordinate(text: str) -> float:
    """Parse a number from -``LARGEST`` to ``LARGEST``."""
    number = number_of(text)
    if not abs(number) <= LARGEST:
        raise ValueError(f"must be a finite number from {-LARGEST:,} to {LARGEST:,}")
    return number


def _bounded(number: N) -> N:
    if number < 0:
        raise ValueError("must be at least 0")
    if number > LARGEST:
        raise ValueError(f"must be at most {LARGEST:,}")
    return number


def parsed(name: str, text: str, parse: Callable[[str], T]) -> T:
    """Return the value of a text. Raises ValueError with the name and the text."""
    try:
        return parse(text)
    except ValueError as error:
        raise ValueError(f"{name}: {in_short(repr(text))}: {error}") from error


Parsers = Mapping[str, Callable[[str], Any]]
"""The names of columns, and what parses their values."""


def read_table(path: Path, columns: Parsers, optional: Parsers | None = None) -> list[Any]:
    """Return the rows of a CSV file with the given columns (in any order), each value parsed.

    Values of columns that are ``optional`` follow; they are None where there is none. The line
    number of each row is appended to it. Raises ValueError with file and line.
    """
    more = tuple((optional or {}).items())
    return list(_read_table(path, tuple(columns.items()), more, version_of(path)))


Version = tuple[str, str]
"""What distinguishes a file from what it was before: its path, and the digest of its content."""


def version_of(path: Path) -> Version:
    """Return the present version of a file. Raises ValueError if it cannot be read."""
    return str(path.resolve()), hashlib.sha256(bytes_of(path)).hexdigest()


def bytes_of(path: Path) -> bytes:
    """Return the content of a file. Raises ValueError if it cannot be read, or is too large."""
    try:
        return content_of(path, MAX_BYTES)
    except OSError as error:
        raise ValueError(f"{path}: {error.strerror}") from error
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from error


Named = tuple[tuple[str, Callable[[str], Any]], ...]


@lru_cache(maxsize=16)
def _read_table(
    path: Path,
    columns: Named,
    optional: Named,
    version: Version,
) -> list[tuple[Any, ...]]:
    """Read the file at this version."""
    try:
        text = bytes_of(path).decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise ValueError(f"{path}: it is not UTF-8 text") from error
    reader = csv.DictReader(io.StringIO(text, newline=""), strict=True)
    try:
        return _rows(path, reader, columns, optional)
    except csv.Error as error:
        raise ValueError(f"{path}:{reader.reader.line_num}: it is not CSV: {error}") from error


def _rows(
    path: Path, reader: csv.DictReader[str], columns: Named, optional: Named
) -> list[tuple[Any, ...]]:
    names = ", ".join(name for name, _ in columns)
    missing = [name for name, _ in columns if name not in (reader.fieldnames or [])]
    if missing:
        raise ValueError(f"{path}:1: no column {missing[0]!r}; expected the columns {names}")
    parsers = (*columns, *((name, _if_any(parse)) for name, parse in optional))
    rows = []
    for row in reader:
        texts = {name: (row.get(name) or "").strip() for name, _ in parsers}
        try:
            values = [parsed(name, texts[name], parse) for name, parse in parsers]
        except ValueError as error:
            raise ValueError(f"{path}:{reader.line_num}: {error}") from error
        rows.append((*values, reader.line_num))
    return rows


def _if_any(parse: Callable[[str], Any]) -> Callable[[str], Any]:
    """Return a parser for which an empty text is None."""
    return lambda text: parse(text) if text else None
