"""The search for prices at which a bound is low, along averaged subgradients.

A bound holds at any prices (see docs/explanation/bounds.md); the prices only determine how close it
is. It is convex in the prices.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

PATIENCE = 5
"""The rounds without a better bound after which steps become smaller."""

SMALLER = 0.7

LEAST_GAIN = 1e-6
"""By how much a bound must be lower than the ones before to count as better."""


class Search(NamedTuple):
    """How prices are searched.

    ``first_gap``: by how much the first steps try to lower the bound. ``memory``: the weight of
    earlier subgradients in the direction of a step. Where steps become smaller, the search goes on
    from the best prices; if it ``begins_anew``, it forgets the direction, too. ``most``: the
    largest price that can be of use.
    """

    first_gap: float
    memory: float
    begins_anew: bool
    most: float


def lowest(
    bound_at: Callable[[NDArray[np.float64]], tuple[float, NDArray[np.float64]]],
    prices: NDArray[np.float64],
    search: Search,
    on_round: Callable[[float], bool],
) -> tuple[float, NDArray[np.float64]]:
    """Return the lowest bound that is found, beginning with some prices, and its own prices.

    ``bound_at`` returns the bound at some prices, and a subgradient. ``on_round`` gets the lowest
    bound so far, and returns whether to go on.
    """
    low, best, steepest, direction = np.inf, prices, prices, np.zeros_like(prices)
    gap, since, memory = search.first_gap, 0, search.memory
    going = True
    while going:
        bound, slope = bound_at(prices)
        since += 1
        if bound < low:
            since = 0 if bound < low - LEAST_GAIN else since
            low, best, steepest = bound, prices, slope
        direction = memory * direction + (1 - memory) * slope if direction.any() else slope
        if since > PATIENCE:
            gap, since, prices = SMALLER * gap, 0, best
            bound, direction = (low, steepest) if search.begins_anew else (bound, direction)
        length = float((direction**2).sum())
        if length > 0.0:
            step = (bound - low + gap) / length
            prices = np.clip(prices - step * direction, 0.0, search.most)
        going = on_round(low)
    return float(low), best
