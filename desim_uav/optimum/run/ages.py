"""A lower bound of the mean age at the ground of what sensors measure, on given sample paths.

docs/explanation/bounds.md proves it. It holds for every policy, including policies that know the
sample paths.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from desim_uav.errors import UsageError
from desim_uav.model.services import LAST, collecting_of
from desim_uav.optimum.gathering import refuse_other_gathering
from desim_uav.optimum.run.alone import ANYWHERE
from desim_uav.optimum.run.battery import refuse_other_batteries
from desim_uav.optimum.run.descent import lowest_with_own_steps
from desim_uav.optimum.run.rates import rates_of
from desim_uav.optimum.run.sensors import Updates, least_ages, updates_of
from desim_uav.optimum.run.trips import Payments, best_trips, follow_trips, trips_of
from desim_uav.sample_path import draw
from desim_uav.world import World

ROUNDS, FIRST_STEP = 200, 0.15
"""The number of times that prices are changed for the first episode, and by how much at first."""

AFTERWARDS = 0.5
"""The part of both for another episode, which begins with the prices of the one before."""

EVERY, LANDING = 2.0, 1.0
"""The price of a landing at first, and how many steps before the end it begins to fall to 0."""

MOST_PRICES = 2 * 10**7
"""The largest number of prices; the search needs about 100 bytes for each."""

SLACK_S = 1e-3
"""By how much rounding may change a mean age, in seconds; it changes each time by microseconds."""


class BoundedAges:
    """A run of a world with sensors on the sample paths of a seed, without warm-up.

    Raises ScenarioError, with all keys that prevent it, and UsageError if a battery or a way of
    charging is not of a known kind, or if there are too many sensors and steps.
    """

    def __init__(
        self,
        world: World,
        seed: int,
        episodes: int,
        rounds: int = ROUNDS,
        on_work: Callable[[], None] = lambda: None,
    ) -> None:
        refuse_other_gathering(world.scenario)
        kind = world.only_type
        refuse_other_batteries(kind)
        self.world, self.rounds, self.on_work = world, rounds, on_work
        self.paths = [draw(world, seed, episode) for episode in range(episodes)]
        self.steps = world.scenario.episode.steps
        self.sensors = [user for user, service in enumerate(world.senses) if service >= 0]
        names, services = world.services.names, world.scenario.services
        kept = [collecting_of(services[names[world.senses[user]]]) for user in self.sensors]
        self.last_only = [how is not None and how.keeps == LAST for how in kept]
        rates = rates_of(world, kind, np.array(world.homes)[self.sensors, :2])
        self.mbps = rates.mbps.max((0, 1, 2))
        self.trips = trips_of(kind, rates, world.step_us)
        self.starts = _starts(world)
        users, flights = len(self.sensors), len(self.trips.flown)
        self.shapes = (
            (users, self.steps, flights),
            (users, self.steps, self.trips.longest, flights),
            (users, self.steps),
        )
        prices = sum(int(np.prod(shape)) for shape in self.shapes)
        if prices > MOST_PRICES:
            raise UsageError(
                f"users.count, episode.steps: {users} sensors and {self.steps} steps, in trips of "
                f"up to {self.trips.longest} steps, have {prices} prices, more than {MOST_PRICES}; "
                "bound shorter episodes or fewer sensors"
            )

    def age_at_least_s(self) -> float:
        """Return the bound of the mean age over sensors and episodes, in seconds."""
        prices, ages = self.first_prices(), []
        for episode, path in enumerate(self.paths):
            updates = updates_of(
                path.requests,
                self.sensors,
                self.last_only,
                self.steps,
                self.world.step_us,
                self.mbps,
            )
            step = AFTERWARDS * FIRST_STEP if episode else FIRST_STEP
            age, prices = self.highest(updates, prices, step, rounds_in(episode, self.rounds))
            ages.append(age)
        each = self.world.step_us / 1e6 / (len(self.sensors) * self.steps)
        return max(0.0, float(np.mean(ages)) * each - SLACK_S)

    def first_prices(self) -> NDArray[np.float64]:
        """Return prices of landings alone, with which the search begins."""
        landed, near, bits = map(np.zeros, self.shapes)
        for t in range(1, self.steps):
            left = np.maximum(0.0, self.steps - t - self.trips.flown)
            landed[:, t] = LANDING * np.minimum(1.0, left / EVERY)
        return np.concatenate([landed.ravel(), near.ravel(), bits.ravel()])

    def highest(
        self, updates: Updates, prices: NDArray[np.float64], first_step: float, rounds: int
    ) -> tuple[float, NDArray[np.float64]]:
        """Return the highest bound of an episode that is found, in steps squared, and its prices.

        The search begins with some prices, which it changes by ``first_step`` at first.
        """

        def bound_at(prices: NDArray[np.float64]) -> tuple[float, NDArray[np.float64]]:
            bound, slope = self.at_least(updates, prices)
            return -bound, -slope

        low, best = lowest_with_own_steps(bound_at, prices, first_step, rounds, self.on_work)
        return -low, best

    def at_least(
        self, updates: Updates, prices: NDArray[np.float64]
    ) -> tuple[float, NDArray[np.float64]]:
        """Return the bound of the sum of all ages over time in an episode, and a subgradient.

        The sum is in steps squared. ``prices`` are those of landings, those of steps on legs on
        which a sensor can send, and those of bits, for a mean update.
        """
        scale = 1.0 / max(float(updates.size.mean()), 1e-12)
        parts = np.split(prices, np.cumsum([np.prod(shape) for shape in self.shapes])[:-1])
        landed, near, bits = (
            part.reshape(shape) for part, shape in zip(parts, self.shapes, strict=True)
        )
        asked = Payments(landed, near, bits * scale, updates.most)
        paid, earned = self._none(updates), self._none(updates)
        total = least_ages(updates, self.trips.flown, asked, paid)
        plan = best_trips(self.trips, asked)
        for start, count in self.starts:
            total -= count * plan.value(start)
            for _ in range(count):
                follow_trips(self.trips, asked, plan, start, earned)
        slopes = [one - other for one, other in zip(paid[:3], earned[:3], strict=True)]
        slopes[2] *= scale
        return total, np.concatenate([slope.ravel() for slope in slopes])

    def _none(self, updates: Updates) -> Payments:
        """Return payments for nothing."""
        landed, near, bits = map(np.zeros, self.shapes)
        return Payments(landed, near, bits, updates.most)


def rounds_in(episode: int, rounds: int = ROUNDS) -> int:
    """Return how often prices are changed for an episode, if ``rounds`` times for the first."""
    return math.ceil(AFTERWARDS * rounds) if episode else rounds


def _starts(world: World) -> list[tuple[int, int]]:
    """Return how many drones begin an episode in which cell, or ANYWHERE."""
    if world.scenario.episode.carry_over:
        return [(ANYWHERE, len(world.starts))]
    ny = world.grid.cells[1]
    return sorted(Counter(ix * ny + iy for ix, iy in world.starts).items())
