"""Roots of functions that rise through zero once."""

from __future__ import annotations

from collections.abc import Callable


def root_between(function: Callable[[float], float], low: float, step: float) -> float:
    """Return the root of a function that is not above 0 at ``low`` and rises through it later.

    The root is enclosed by steps that double, and then halved down to neighbouring floats. Raises
    ValueError if the function does not rise above 0 before 1e9.
    """
    high = low + step
    while not function(high) > 0.0:
        low, step = high, 2.0 * step
        high = low + step
        if high > 1e9:
            raise ValueError("the function does not rise above 0")
    while True:
        middle = 0.5 * (low + high)
        if not low < middle < high:
            return middle
        if function(middle) > 0.0:
            high = middle
        else:
            low = middle
