"""Plans of all drones together: each in turn takes the best plan for what the others leave."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from desim_uav.errors import PolicyError
from desim_uav.model.rules import DECIDES, Action
from desim_uav.model.state import Observation
from desim_uav.policies.planning.best_plan import free_steps, plan_of, values_of
from desim_uav.policies.planning.cover import covered_shares, gains
from desim_uav.policies.planning.ground import Ground
from desim_uav.policies.planning.sight import PlanningSight

Ints = NDArray[np.int64]
Floats = NDArray[np.float64]

MOST_SHARES, MOST_VALUES = 20_000_000, 20_000_000
"""The most numbers that a plan may take: shares of cover, and values of states."""

SHORTEST = 5
"""The least number of steps for which a plan is worth making."""


class Habits(NamedTuple):
    """The numbers by which plans are made (see ``Greedy``)."""

    horizon: int
    waiting: float
    fade: float
    rounds: int
    age: float = 1.0


def horizon_of(ground: Ground, habits: Habits) -> int:
    """Return for how many steps plans are made: fewer than asked for if the scenario is large.

    Raises PolicyError if it is too large for any.
    """
    places, units = len(ground.cells), ground.full + 1
    numbers = len(ground.radii_m) * len(ground.centres_m) * ground.radii_m.shape[1]
    most = int(min(MOST_SHARES // numbers, MOST_VALUES // (places * units))) - 1
    if most < min(SHORTEST, habits.horizon):
        raise PolicyError(
            f"greedy: the scenario is too large: {len(ground.centres_m):,} cells by "
            f"{ground.radii_m.shape[1]:,} users, and {places:,} places by {units:,} steps of "
            f"battery; the product must not exceed {MOST_SHARES // SHORTEST:,}"
        )
    return min(habits.horizon, most)


class TeamPlanner:
    """The plans of all drones from one decision epoch on.

    ``plans`` (drones, steps, 2) has the action and the place of each drone and step (see
    ``best_plan.plan_of``).
    """

    def __init__(self, ground: Ground, sight: PlanningSight, habits: Habits) -> None:
        self.ground, self.sight = ground, sight
        world = ground.world
        self.goes_on = world.scenario.episode.carry_over
        self.steps = horizon_of(ground, habits)
        if not self.goes_on:
            self.steps = min(self.steps, sight.left)
        self.worth, self.called = self._worth(habits)
        expected = sight.expected(ground, self.steps)
        self.shares = covered_shares(*expected, ground.centres_m, ground.radii_m)
        drones, stations = len(sight.drones), max(1, len(world.stations))
        self.plans = np.full((drones, self.steps, 2), -1)
        self.covers = np.zeros((drones, *self.worth.shape))
        self.busy = np.zeros((drones, stations, self.steps), np.int64)
        for d in range(drones):
            self._hold(d)

    def _worth(self, habits: Habits) -> tuple[Floats, Floats]:
        """Return what the cover of each user is worth in each step: (steps, users).

        The second part is what is added because something waits for a link.
        """
        worth = np.ones((self.steps, len(self.sight.users_m)))
        faded = np.exp(-np.arange(min(self.steps, self.sight.left)) / habits.fade)
        called = np.zeros_like(worth)
        called[: len(faded)] = habits.waiting * faded[:, None] * self.sight.backlog
        worth[: len(faded)] += habits.age * self.sight.ages
        world = self.ground.world
        links_of_points = world.links[len(world.types) :]
        for links, point in zip(links_of_points, world.scenario.access_points, strict=True):
            away_m = np.hypot(*(self.sight.users_m - np.array(point.at_m)).T)
            near = away_m <= links.rings_m[0, world.groups, 0]
            worth[:, near] = called[:, near] = 0.0
        return worth, called

    def _worth_to(self, drone: int) -> Floats:
        """Return what the cover of each user by a drone is worth, which may have what it needs."""
        can = (self.sight.only < 0) | (self.sight.only == drone)
        worth: Floats = self.worth + self.called * can
        return worth

    def begin_with(self, before: Ints, age: int) -> None:
        """Begin with plans that were made ``age`` steps ago, as far as drones are still on them."""
        for d, standing in enumerate(self.sight.drones):
            if len(before) != len(self.plans) or standing.ready >= self.steps:
                continue
            rest = before[d, age : age + self.steps]
            now = min(standing.ready, len(rest) - 1)
            if len(rest) == 0 or rest[now, 0] < 0 or rest[now, 1] != standing.place:
                continue
            self.plans[d, : len(rest)] = rest
            self._hold(d)

    def improve(self, rounds: int) -> None:
        """Let each drone in turn take its best plan, until none changes or for so many rounds."""
        free = [d for d, one in enumerate(self.sight.drones) if one.ready < self.steps]
        free.sort(key=lambda d: (self.sight.drones[d].units, d))
        for _ in range(rounds):
            changed = [self._change(d) for d in free]
            if not any(changed):
                break

    def _change(self, drone: int) -> bool:
        """Let a drone take the best plan for what the others leave; return whether it is new."""
        ground, standing = self.ground, self.sight.drones[drone]
        others = np.arange(len(self.plans)) != drone
        left = np.prod(1.0 - self.covers[others], axis=0)
        gained = gains(self.shares, self._worth_to(drone) * left)
        busy = self.busy[others].sum(axis=0)
        free = free_steps(busy, ground.world.scenario.stations.pads)
        charge = (ground.station_of, ground.returns)
        _, best = values_of(
            gained,
            ground.after,
            ground.rings,
            ground.cells,
            ground.drains,
            *charge,
            ground.return_at,
            ground.charge_us,
            ground.world.step_us,
            self._needs(),
            free,
            self._rates(gained),
            standing.ready,
        )
        start = (standing.ready, standing.place, standing.units)
        step_us = ground.world.step_us
        plan = plan_of(
            best, ground.after, ground.drains, *charge, ground.charge_us, step_us, free, start
        )
        changed = not np.array_equal(plan, self.plans[drone])
        self.plans[drone] = plan
        self._hold(drone)
        return changed

    def covered(self) -> float:
        """Return how many users are expected to be covered, summed over all steps of the plans."""
        return float((1.0 - np.prod(1.0 - self.covers, axis=0)).sum())

    def _needs(self) -> Ints:
        """Return the battery that drones need at each place at the end of their plans."""
        return self.ground.needs if self.goes_on else np.minimum(self.ground.needs, 1)

    def _rates(self, gained: Floats) -> tuple[float, float]:
        """Return the worth of a unit of battery, and of a step of charging, after the plan.

        A drone that gains g per step, flies for F steps and charges for C steps gains g F / (F + C)
        per step on average. A unit of battery is worth what it gains more than this.
        """
        world, ground = self.ground.world, self.ground
        if not self.goes_on or not world.scenario.limited_battery or not world.stations:
            return 0.0, 0.0
        gain = float(gained.sum(axis=0).max(axis=(1, 2)).mean())
        takes = ground.charge_us[0] / world.step_us
        return gain * takes / (ground.full + takes), gain * ground.full / (ground.full + takes)

    def _hold(self, drone: int) -> None:
        """Note which users a drone covers by its plan, and when it occupies a pad."""
        ground, standing, plan = self.ground, self.sight.drones[drone], self.plans[drone]
        self.covers[drone], self.busy[drone] = 0.0, 0
        if standing.station >= 0:
            self.busy[drone, standing.station, standing.begins : standing.ready] = 1
        actions, places = plan[:, 0], plan[:, 1]
        moves = len(ground.actions)
        flying = np.flatnonzero((actions >= 0) & (actions < moves))
        at, to = places[flying], ground.after[actions[flying], places[flying]]
        begin = self.shares[flying, ground.rings[at], ground.cells[at]]
        end = self.shares[flying + 1, ground.rings[to], ground.cells[to]]
        self.covers[drone, flying] = 0.5 * (begin + end)
        landed = np.flatnonzero(actions >= moves)
        self.busy[drone, ground.station_of[places[landed]], landed] = 1


def commands_of(
    ground: Ground,
    actions: Ints,
    observations: Sequence[Observation],
    masks: Sequence[Sequence[bool]],
) -> list[int]:
    """Return the commands for one action of a plan per drone, and what is forced otherwise."""
    all_actions = [*ground.actions, Action.GOTO_CHARGING_STATION, Action.CHARGE]
    commands = []
    for observation, mask, k in zip(observations, masks, actions.tolist(), strict=True):
        action = all_actions[k] if k >= 0 and observation.mode in DECIDES else ground.actions[0]
        forced = list(mask).index(True) if sum(mask) == 1 else -1
        commands.append(forced if forced >= 0 else ground.world.actions.index(action))
    return commands
