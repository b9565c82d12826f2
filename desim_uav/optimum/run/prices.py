"""Prices of users, from which a bound follows.

The best plans of the drones give a subgradient of the bound in the prices.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from desim_uav.optimum.run.alone import Alone, best_alone, follow, pay_legs
from desim_uav.optimum.run.descent import lowest
from desim_uav.optimum.run.legs import LEGS, Shares

Prices = NDArray[np.float64]
"""(steps, users): the price of covering a user for a step."""


class Slope(NamedTuple):
    """A bound at some prices, and how it changes with them.

    With ``covered`` (steps, users), the shares of steps for which all drones together cover users
    in their best plans, the subgradient is (covered - needed) / scale.
    """

    bound: float
    needed: Prices
    scale: float


class Measure(Protocol):
    """A measure that is bounded: a share between 0 and 1."""

    most: float
    """The largest price that can be of use."""

    def at_most(self, prices: Prices, earned: float) -> Slope:
        """Return the bound, if all drones together earn at most ``earned`` at these prices."""


class SamePrices(NamedTuple):
    """The drones of a type in a run: what each can do, and whom each leg covers.

    ``starts`` says how many begin in which cell with a full battery, or ANYWHERE.
    """

    alone: Alone
    shares: Shares
    starts: Sequence[tuple[int, int]]


class Fleet(NamedTuple):
    """The drones of a run, by their types.

    All of them begin anew after every ``steps`` steps; the run may have several such stretches.
    """

    types: Sequence[SamePrices]
    steps: int

    @property
    def drones(self) -> int:
        """The number of drones."""
        return sum(count for alike in self.types for _, count in alike.starts)


def lowest_bound(
    measure: Measure,
    fleet: Fleet,
    prices: Prices,
    on_round: Callable[[float], bool],
) -> tuple[float, Prices]:
    """Return the lowest bound that is found, beginning with some prices, and its own prices.

    ``on_round`` gets the lowest bound so far, and returns whether to go on.
    """

    def bound_at(prices: Prices) -> tuple[float, Prices]:
        earned, covered = _best_plans(fleet, prices)
        trial = measure.at_most(prices, earned)
        return trial.bound, (covered - trial.needed) / trial.scale

    return lowest(bound_at, prices, measure.most, on_round)


def _best_plans(fleet: Fleet, prices: Prices) -> tuple[float, Prices]:
    """Return what all drones earn at most, and the shares of steps for which they cover users."""
    total, covered = 0.0, np.zeros_like(prices)
    paid = np.empty((fleet.steps, len(fleet.types[0].alone.ahead), LEGS))
    for begin in range(0, len(prices), fleet.steps):
        part = slice(begin, begin + fleet.steps)
        for alone, shares, starts in fleet.types:
            pay_legs(shares, begin, prices[part], paid)
            plan = best_alone(alone, paid, fleet.steps)
            for start, count in starts:
                total += count * plan.value(start)
                own = np.zeros_like(prices[part])
                follow(alone, plan, shares, begin, start, own)
                covered[part] += count * own
    return total, covered
