"""Sums whose last bit is the same everywhere."""

from __future__ import annotations

from collections.abc import Iterable


def in_order(values: Iterable[float]) -> float:
    """The sum, one addition after the other. Python's own ``sum`` corrects itself from 3.12 on."""
    total = 0.0
    for value in values:
        total += value
    return float(total)
