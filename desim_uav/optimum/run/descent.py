"""Searches for prices at which a bound is low, along averaged subgradients.

A bound holds at any prices (see docs/explanation/bounds.md); the prices only determine how close it
is. It is convex in the prices.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

FIRST_GAP, MEMORY = 0.05, 0.9
"""By how much the first steps of ``lowest`` try to lower the bound, and the weight of earlier
subgradients in the direction of a step."""

PATIENCE = 5
"""The rounds without a better bound after which steps become smaller."""

SMALLER = 0.7

LEAST_GAIN = 1e-6
"""By how much a bound must be lower than the ones before to count as better."""

FADES = 0.9, 0.99
"""The weight of earlier subgradients, and of their squares, in ``lowest_with_own_steps``."""


def lowest(
    bound_at: Callable[[NDArray[np.float64]], tuple[float, NDArray[np.float64]]],
    prices: NDArray[np.float64],
    most: float,
    on_round: Callable[[float], bool],
) -> tuple[float, NDArray[np.float64]]:
    """Return the lowest bound that is found, beginning with some prices, and its own prices.

    ``bound_at`` returns the bound at some prices, and a subgradient. ``most`` is the largest price
    that can be of use. Where steps become smaller, the search goes on from the best prices.
    ``on_round`` gets the lowest bound so far, and returns whether to go on.
    """
    low, best, direction = np.inf, prices, np.zeros_like(prices)
    gap, since = FIRST_GAP, 0
    going = True
    while going:
        bound, slope = bound_at(prices)
        since += 1
        if bound < low:
            since = 0 if bound < low - LEAST_GAIN else since
            low, best = bound, prices
        direction = MEMORY * direction + (1 - MEMORY) * slope if direction.any() else slope
        if since > PATIENCE:
            gap, since, prices = SMALLER * gap, 0, best
        length = float((direction**2).sum())
        if length > 0.0:
            step = (bound - low + gap) / length
            prices = np.clip(prices - step * direction, 0.0, most)
        going = on_round(low)
    return float(low), best


def lowest_with_own_steps(
    bound_at: Callable[[NDArray[np.float64]], tuple[float, NDArray[np.float64]]],
    prices: NDArray[np.float64],
    first_step: float,
    rounds: int,
    on_round: Callable[[], None],
) -> tuple[float, NDArray[np.float64]]:
    """Return the lowest bound that is found, beginning with some prices, and its own prices.

    Each price has a step of its own, by its averaged subgradient and the mean of its squares
    (Adam: Kingma and Ba 2015). Steps are ``first_step`` at first and fall to 0 in so many rounds.
    It suits prices of which most are rarely paid.
    """
    low, best, (fade, fade_squares) = np.inf, prices, FADES
    mean, squares = np.zeros_like(prices), np.zeros_like(prices)
    for number in range(1, rounds + 1):
        bound, slope = bound_at(prices)
        if bound < low:
            low, best = bound, prices
        mean = fade * mean + (1 - fade) * slope
        squares = fade_squares * squares + (1 - fade_squares) * slope**2
        whole = np.sqrt(squares / (1 - fade_squares**number)) * (1 - fade**number)
        step = first_step * (1.0 - number / rounds)
        prices = np.maximum(prices - step * mean / np.maximum(whole, 1e-12), 0.0)
        on_round()
    return low, best
