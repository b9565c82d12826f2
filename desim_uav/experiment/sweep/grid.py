"""The grid of a sweep: the values that overrides give each key, and their combinations."""

from __future__ import annotations

import json
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from decimal import Decimal
from itertools import product
from typing import Any, NamedTuple

import numpy as np

from desim_uav.errors import UsageError
from desim_uav.scenario.draft import named_override, override_path
from desim_uav.scenario.load import Overrides, override_texts
from desim_uav.scenario.yaml12 import read

MOST = 10**6
"""The largest number of values of a key, and of jobs of a sweep."""

_NUMBER = r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?"
_RANGE = re.compile(rf"({_NUMBER}):({_NUMBER})(?::({_NUMBER}))?")
_CLOSING = {"[": "]", "{": "}"}


class Value(NamedTuple):
    """A value: its text after ``-S``, and the YAML value of that text."""

    text: str
    plain: Any


@dataclass(frozen=True)
class Axis:
    """A key of the scenario and the values it takes, each once."""

    key: str
    values: tuple[Value, ...]

    @property
    def dtype(self) -> str:
        """The type of the key's column: bool, int64, float64, or else string.

        Lists, mappings and values of mixed types are written as JSON. An empty cell means null.
        """
        types = {type(value.plain) for value in self.values} - {type(None)}
        whole = all(abs(v.plain) < 2**63 for v in self.values if type(v.plain) is int)
        for dtype, of in (("bool", {bool}), ("int64", {int}), ("float64", {int, float})):
            if types and types <= of and whole:
                return dtype
        return "string"

    def cell(self, value: Any) -> Any:
        """Return a value as it is stored in the column."""
        if value is None or self.dtype != "string":
            return float(value) if self.dtype == "float64" and value is not None else value
        return value if isinstance(value, str) else json.dumps(value, ensure_ascii=False)


@dataclass(frozen=True)
class Combination:
    """One value for each key: ``settings`` for loading the scenario, ``cells`` for tables.

    ``varied`` has the settings of the keys that take more than one value in the sweep.
    """

    settings: tuple[str, ...]
    cells: dict[str, Any]
    varied: tuple[str, ...]

    @property
    def name(self) -> str:
        """The name of the combination in messages."""
        return ", ".join(self.varied)


def axes(values: Overrides) -> list[Axis]:
    """Return the keys and values of ``-S`` options, or of a mapping from keys to their values.

    Raises UsageError if they are not valid.
    """
    listing = [_axis(override) for override in _overrides(values)]
    keys = [axis.key for axis in listing]
    for key in keys:
        if keys.count(key) > 1:
            raise UsageError(
                f"{named_override(key)}: given twice; separate the values of a key by commas"
            )
    if "seed" in keys:
        raise UsageError(
            f"{named_override('seed')}: each job has its own seed; choose the first seed and the "
            "number of seeds"
        )
    return listing


def combinations(swept: Sequence[Axis]) -> Iterator[Combination]:
    """Yield every combination; the values of the last key change first."""
    for values in product(*(axis.values for axis in swept)):
        pairs = list(zip(swept, values, strict=True))
        yield Combination(
            tuple(f"{axis.key}={value.text}" for axis, value in pairs),
            {axis.key: axis.cell(value.plain) for axis, value in pairs},
            tuple(f"{axis.key}={value.text}" for axis, value in pairs if len(axis.values) > 1),
        )


def _overrides(values: Overrides) -> Iterator[str]:
    """Yield the values of each key as the command line has them."""
    if not isinstance(values, Mapping):
        yield from override_texts(values)
        return
    for key, each in values.items():
        several = list(each) if _is_several(each) else [each]
        if not several:
            raise UsageError(f"{named_override(str(key))}: there is no value to sweep")
        texts = (override_texts({key: value})[0] for value in several)
        yield f"{key}=" + ",".join(text.partition("=")[2] for text in texts)


def _is_several(each: object) -> bool:
    """Return whether these are several values of a key: a list, a range or an array of NumPy."""
    if isinstance(each, np.ndarray):
        return each.ndim > 0
    return isinstance(each, Iterable) and not isinstance(each, str | bytes | Mapping)


def _axis(override: str) -> Axis:
    key = ".".join(str(part) for part in override_path(override))
    texts: list[str] = []
    pieces = list(_pieces(override.partition("=")[2]))
    if len(pieces) > 1 and "" in pieces:
        raise UsageError(f"{named_override(override)}: a value is empty; write null for none")
    for piece in pieces:
        texts += _values(piece, override)
        if len(texts) > MOST:
            raise UsageError(f"{named_override(override)}: more than {MOST} values")
    values = tuple(Value(text, read(text).data) for text in texts)
    canonical: set[str] = set()
    for value in values:
        # 1 and 1.0 are the same value; 1 and true are not
        text = value.text if read(value.text).problems else _canonical(value.plain)
        if text in canonical:
            raise UsageError(f"{named_override(override)}: {value.text} is given twice")
        canonical.add(text)
    return Axis(key, values)


def _canonical(value: object) -> str:
    if isinstance(value, float) and value.is_integer():
        value = int(value)
    return json.dumps(value, sort_keys=True)


def _pieces(text: str) -> Iterator[str]:
    """Split a text at its commas, except for those within brackets or quotes."""
    open_until: list[str] = []
    begin, position, quote, fresh = 0, 0, "", True
    while position < len(text):
        letter = text[position]
        if quote:
            position += letter == "\\" and quote == '"'
            quote = "" if letter == quote else quote
        elif fresh and letter in "'\"":  # within a word it is an apostrophe, as in "it's"
            quote = letter
        elif letter in _CLOSING and (fresh or open_until):
            open_until.append(_CLOSING[letter])
        elif open_until and letter == open_until[-1]:
            open_until.pop()
        elif letter == "," and not open_until:
            yield text[begin:position].strip()
            begin = position + 1
        fresh = letter in ("[{,:" if open_until else ",") or (fresh and letter == " ")
        position += 1
    yield text[begin:].strip()


def _values(piece: str, override: str) -> Iterator[str]:
    """Yield the values of a range, or the piece itself if it is not a range."""
    match = _RANGE.fullmatch(piece)
    if match is None:
        yield piece
        return
    whole = all(text is None or re.fullmatch(r"[-+]?\d+", text) for text in match.groups())
    first, last = Decimal(match[1]), Decimal(match[2])
    step = Decimal(match[3] or 1)
    problem = ""
    if match[3] is None and not whole:
        problem = "a range of decimal numbers needs a step, as in 0.1:0.5:0.1"
    elif step == 0:
        problem = "the step is 0"
    elif (last - first) / step < 0:
        problem = "it contains no value"
    elif (last - first) / step >= MOST:
        problem = f"more than {MOST} values"
    if problem:
        raise UsageError(f"{named_override(override)}: range {piece}: {problem}")
    for number in range(int((last - first) / step) + 1):
        yield format(first + number * step, "f")
