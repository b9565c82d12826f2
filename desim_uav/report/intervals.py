"""The words beside means over seeds: which interval they have, or that one seed has none.

A row is an entry of a comparison's or sweep's content: its ``measures`` map names to ``n`` (the
number of seeds), ``mean`` and ``half_width`` (None if there is no interval).
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

Rows = Sequence[dict[str, Any]]

NONE_FROM_ONE = "no interval from a single seed"


def have_interval(rows: Rows) -> bool:
    """Tell whether any measure of these rows has an interval."""
    return any(estimate["half_width"] is not None for estimate in _measures(rows))


def have_single(rows: Rows) -> bool:
    """Tell whether any measure of these rows comes from one seed alone."""
    return any(estimate["n"] == 1 for estimate in _measures(rows))


def interval_words(rows: Rows) -> str:
    """Say which intervals are drawn with these rows."""
    if of_one_seed(rows):
        return "one seed allows no interval"
    none = " (none from a single seed)" if have_single(rows) else ""
    return f"95 % t-intervals over seeds{none}"


def of_one_seed(rows: Rows) -> bool:
    """Tell whether these rows have values, but not one interval."""
    return have_single(rows) and not have_interval(rows)


def mean_words(rows: Rows) -> str:
    """Say what the numbers of these rows are, and which interval is beside them."""
    if of_one_seed(rows):
        return "values of one seed, which allows no interval"
    none = " (none from a single seed)" if have_single(rows) else ""
    return f"mean over seeds and 95 % t-interval{none}"


def _measures(rows: Rows) -> Iterable[dict[str, Any]]:
    return (estimate for row in rows for estimate in row["measures"].values())


def sentence(words: str) -> str:
    """Return these words with a capital and a full stop."""
    return words[:1].upper() + words[1:] + "."
