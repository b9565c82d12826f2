"""Sums whose last bit is the same on every version of Python."""

from __future__ import annotations

from collections.abc import Iterable


def in_order(values: Iterable[float]) -> float:
    """Return the sum by one addition after the other; ``sum`` compensates since Python 3.12."""
    total = 0.0
    for value in values:
        total += value
    return float(total)
