"""Sums whose last bit is the same everywhere."""

from __future__ import annotations

from collections.abc import Iterable
from functools import reduce
from operator import add


def in_order(values: Iterable[float]) -> float:
    """The sum, one addition after the other. Python's own ``sum`` corrects itself from 3.12 on."""
    return float(reduce(add, values, 0.0))
