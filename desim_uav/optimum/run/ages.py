"""A lower bound of the mean age at the ground of what sensors measure, on given sample paths.

docs/explanation/bounds.md proves it. It holds for every policy, including policies that know the
sample paths.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from desim_uav.model.services import LAST, collecting_of
from desim_uav.optimum.gathering import refuse_other_gathering
from desim_uav.optimum.run.alone import ANYWHERE
from desim_uav.optimum.run.battery import refuse_other_batteries
from desim_uav.optimum.run.descent import Search, lowest
from desim_uav.optimum.run.rates import rates_of
from desim_uav.optimum.run.sensors import Updates, least_ages, updates_of
from desim_uav.optimum.run.trips import Payments, best_trips, follow_trips, trips_of
from desim_uav.sample_path import draw
from desim_uav.world import World

ROUNDS = 100
"""The number of times that prices are changed for each episode."""

FIRST_GAP, MEMORY = 0.3, 0.7
"""See ``Search``; the gap is in steps. The weight of earlier subgradients is lower than elsewhere,
as there are more prices."""

EVERY, LANDING = 2.0, 1.0
"""The price of a landing at first, and how many steps before the end it begins to fall to 0."""

SLACK_S = 1e-3
"""By how much rounding may change a mean age, in seconds; it changes each time by microseconds."""


class BoundedAges:
    """A run of a world with sensors on the sample paths of a seed, without warm-up.

    Raises ScenarioError, with all keys that prevent it, and UsageError if a battery or a way of
    charging is not of a known kind.
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
        self.shape = len(self.sensors), self.steps, self.trips.longest, len(self.trips.flown)

    def age_at_least_s(self) -> float:
        """Return the bound of the mean age over sensors and episodes, in seconds."""
        first, ages = self.first_prices(), []
        for path in self.paths:
            updates = updates_of(
                path.requests,
                self.sensors,
                self.last_only,
                self.steps,
                self.world.step_us,
                self.mbps,
            )
            ages.append(self.highest(updates, first))
        return max(0.0, float(np.mean(ages)) * self.world.step_us / 1e6 - SLACK_S)

    def first_prices(self) -> NDArray[np.float64]:
        """Return prices of landings alone, with which the search begins."""
        aloft = np.zeros(self.shape)
        for t in range(self.steps):
            left = np.maximum(0.0, self.steps - t - 1 - self.trips.flown)
            aloft[:, t, 0] = LANDING * np.minimum(1.0, left / EVERY)
        return np.concatenate([aloft.ravel(), np.zeros(self.shape[0] * self.steps)])

    def highest(self, updates: Updates, prices: NDArray[np.float64]) -> float:
        """Return the highest bound of an episode that is found, in steps."""
        left = self.rounds

        def bound_at(prices: NDArray[np.float64]) -> tuple[float, NDArray[np.float64]]:
            bound, slope = self.at_least(updates, prices)
            return -bound, -slope

        def go_on(low: float) -> bool:
            nonlocal left
            left -= 1
            self.on_work()
            return left > 0

        return -lowest(bound_at, prices, Search(FIRST_GAP, MEMORY, True, np.inf), go_on)[0]

    def at_least(
        self, updates: Updates, prices: NDArray[np.float64]
    ) -> tuple[float, NDArray[np.float64]]:
        """Return the bound of an episode at some prices, in steps, and a subgradient.

        ``prices`` are those of drones in the air, then those of bits, for a mean update.
        """
        cut, scale = int(np.prod(self.shape)), 1.0 / max(float(updates.size.mean()), 1e-12)
        bits = prices[cut:].reshape(self.shape[:2]) * scale
        asked = Payments(prices[:cut].reshape(self.shape), bits, updates.most)
        paid, earned = self._none(updates), self._none(updates)
        total = least_ages(updates, self.trips.flown, asked, paid)
        plan = best_trips(self.trips, asked)
        for start, count in self.starts:
            own = self._none(updates)
            follow_trips(self.trips, asked, plan, start, own)
            total -= count * plan.value(start)
            earned.aloft[:] += count * own.aloft
            earned.bits[:] += count * own.bits
        aloft, sent = paid.aloft - earned.aloft, scale * (paid.bits - earned.bits)
        unit = float(self.shape[0] * self.steps)
        return total / unit, np.concatenate([aloft.ravel(), sent.ravel()]) / unit

    def _none(self, updates: Updates) -> Payments:
        """Return payments for nothing."""
        return Payments(np.zeros(self.shape), np.zeros(self.shape[:2]), updates.most)


def _starts(world: World) -> list[tuple[int, int]]:
    """Return how many drones begin an episode in which cell, or ANYWHERE."""
    if world.scenario.episode.carry_over:
        return [(ANYWHERE, len(world.starts))]
    ny = world.grid.cells[1]
    return sorted(Counter(ix * ny + iy for ix, iy in world.starts).items())
