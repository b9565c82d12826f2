"""Plans of all drones together: each in turn takes the best plan for what the others leave."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from desim_uav.commands.given import Command
from desim_uav.errors import PolicyError
from desim_uav.model.rules import DECIDES, Action
from desim_uav.model.state import Observation
from desim_uav.policies.planning.best_plan import EPS, LOST, best_of, free_steps, plan_of, values_of
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
    """The numbers by which plans are made (see ``Greedy``): ``horizon`` in ticks."""

    horizon: int
    waiting: float
    fade: float
    rounds: int
    age: float = 1.0
    discount: float = 0.0
    share: float = 1.0
    charge: float = 1.0
    spread: float = 1.0
    margin: float = 0.0
    starts: int = 1


def horizon_of(grounds: Sequence[Ground], habits: Habits) -> int:
    """Return for how many ticks plans are made: fewer than asked for if the scenario is large.

    Raises PolicyError if it is too large for any.
    """
    each = {id(ground): ground for ground in grounds}.values()
    ground = max(each, key=lambda one: len(one.cells) * (one.full + 1))
    places, units = len(ground.cells), ground.full + 1
    numbers = sum(one.radii_m.size * len(one.centres_m) for one in each)
    most = int(min(MOST_SHARES // numbers, MOST_VALUES // (places * units))) - 1
    if most < min(SHORTEST, habits.horizon):
        raise PolicyError(
            f"greedy: the scenario is too large: {len(ground.centres_m):,} "
            f"{ground.flights.word} by {ground.radii_m.shape[1]:,} users, and {places:,} places by "
            f"{units:,} steps of battery; the product must not exceed {MOST_SHARES // SHORTEST:,}"
        )
    return min(habits.horizon, most)


class TeamPlanner:
    """The plans of all drones from one decision epoch on.

    ``plans`` (drones, ticks, 3) has the action, the place and the age of each drone's action in
    each tick (see ``best_plan.plan_of``). ``ends`` (drones,) is what comes after the plans, as the
    dynamic program values it; with one start nobody asks for it.
    """

    def __init__(self, grounds: Sequence[Ground], sight: PlanningSight, habits: Habits) -> None:
        self.grounds, self.sight, self.habits = grounds, sight, habits
        self.world, self.tick_us = grounds[0].world, grounds[0].tick_us
        world = self.world
        self.goes_on = world.scenario.episode.carry_over
        self.steps = horizon_of(grounds, habits)
        if not self.goes_on:
            self.steps = min(self.steps, sight.left)
        self.worth, self.called = self._worth(habits)
        places_m, spread_m = sight.expected(grounds[0], self.steps)
        spread_m = habits.spread * spread_m
        each = {id(ground): ground for ground in grounds}
        shares = {
            key: covered_shares(
                places_m, spread_m, ground.centres_m, (1.0 + habits.margin) * ground.radii_m
            )
            for key, ground in each.items()
        }
        self.shares = [shares[id(ground)] for ground in grounds]
        drones, stations = len(sight.drones), max(1, len(world.stations))
        self.plans = np.full((drones, self.steps, 3), -1)
        self.covers = np.zeros((drones, *self.worth.shape))
        self.busy = np.zeros((drones, stations, self.steps), np.int64)
        self.ends, self.rates, self.settled = np.full(drones, LOST), [(0.0, 0.0)] * drones, False
        for d in range(drones):
            self._hold(d)

    def _worth(self, habits: Habits) -> tuple[Floats, Floats]:
        """Return what the cover of each user is worth in each step: (steps, users).

        The second part is what is added because something waits for a link.
        """
        worth = np.ones((self.steps, len(self.sight.users_m)))
        steps = np.arange(min(self.steps, self.sight.left)) * (self.tick_us / self.world.step_us)
        faded = np.exp(-steps / habits.fade)
        called = np.zeros_like(worth)
        called[: len(faded)] = habits.waiting * faded[:, None] * self.sight.backlog
        worth[: len(faded)] += habits.age * self.sight.ages
        if habits.discount:
            later = np.arange(self.steps)[:, None] * (self.tick_us / self.world.step_us)
            worth, called = (part * np.exp(-habits.discount * later) for part in (worth, called))
        world = self.world
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
        """Begin with plans that were made ``age`` ticks ago, as far as drones are still on them."""
        for d, standing in enumerate(self.sight.drones):
            if len(before) != len(self.plans) or standing.ready >= self.steps:
                continue
            rest = before[d, age : age + self.steps]
            now = min(standing.ready, len(rest) - 1)
            if len(rest) == 0 or rest[now, 0] < 0 or rest[now, 1:].tolist() != [standing.place, 0]:
                continue
            self.plans[d, : len(rest)] = rest
            self._hold(d)

    def improve(self, rounds: int) -> None:
        """Let each drone in turn take its best plan, until none changes or for so many rounds.

        With several ``starts``, the other ones begin without plans and take the drones in an order
        that is drawn; the plans with the greatest ``total`` are kept.
        """
        free = [d for d, one in enumerate(self.sight.drones) if one.ready < self.steps]
        free.sort(key=lambda d: (self.sight.drones[d].units, d))
        self._in_turn(free, rounds)
        for start in range(1, self.habits.starts if len(free) > 1 else 0):
            self.settled, most = True, self.total()
            before = self.plans.copy(), self.covers.copy(), self.busy.copy(), self.ends.copy()
            for d in free:
                self.plans[d] = -1
                self._hold(d)
            rng = np.random.default_rng([self.sight.left, start])
            self._in_turn(rng.permutation(free).tolist(), rounds)
            if self.total() <= most + EPS:
                self.plans, self.covers, self.busy, self.ends = before

    def _in_turn(self, order: Sequence[int], rounds: int) -> None:
        """Let each drone in turn change its plan, until this would change none any more."""
        lasting = 0
        for drone in [*order] * rounds:
            lasting = 1 if self._change(drone) else lasting + 1
            if lasting == len(order):
                break

    def total(self) -> float:
        """Return what all plans together are worth, with what comes after them (``ends``)."""
        together = 1.0 - np.prod(1.0 - self.covers, axis=0)
        together += (1.0 - self.habits.share) * (self.covers.sum(axis=0) - together)
        return float(((self.worth + self.called) * together).sum() + self.ends.sum())

    def _change(self, drone: int) -> bool:
        """Let a drone take the best plan for what the others leave; return whether it is new."""
        ground, standing = self.grounds[drone], self.sight.drones[drone]
        gained, free, value = self._values(drone)
        start = (standing.ready, standing.place, standing.units)
        plan = plan_of(gained, value, ground.ways, free, self.rates[drone], start)
        changed = not np.array_equal(plan, self.plans[drone])
        self.plans[drone] = plan
        self._hold(drone)
        if self.habits.starts > 1:
            gain = (self._left(drone) * self.covers[drone]).sum()
            self.ends[drone] = value[start] - gain
        return changed

    def _left(self, drone: int) -> Floats:
        """Return what the cover of each user by a drone is worth with what the others cover."""
        others = np.arange(len(self.plans)) != drone
        left = np.prod(1.0 - self.covers[others], axis=0)
        left += (1.0 - self.habits.share) * (1.0 - left)
        worth: Floats = self._worth_to(drone) * left
        return worth

    def _values(self, drone: int) -> tuple[Floats, Ints, Floats]:
        """Return gains, free pads and ``values_of`` of a drone, for what the others leave."""
        ground, standing = self.grounds[drone], self.sight.drones[drone]
        others = np.arange(len(self.plans)) != drone
        gained = gains(self.shares[drone], self._left(drone))
        free = free_steps(self.busy[others].sum(axis=0), ground.world.scenario.stations.pads)
        if not self.settled:
            self.rates[drone] = self._rates(ground, gained)
        needs, rates = self._needs(ground), self.rates[drone]
        return gained, free, values_of(gained, ground.ways, needs, free, rates, standing.ready)

    def worths(self, drone: int) -> Floats:
        """Return the worth of the best plan that begins with each action of a drone: (moves + 2,).

        The last two are the return and the charge, whose worth is known only if it is the greatest.
        An action that leads nowhere, or whose worth is not known, has ``LOST``. The drone must
        decide now, and its moves must last for a tick.
        """
        ground, standing = self.grounds[drone], self.sight.drones[drone]
        gained, free, value = self._values(drone)
        here, units = standing.place, standing.units
        worths = np.full(len(ground.after) + 2, LOST)
        for k, (there, drain) in enumerate(zip(ground.after[:, here], ground.drains, strict=True)):
            if there >= 0 and units > drain:
                worths[k] = value[1, there, units - drain]
                worths[k] += gained[0, 0, ground.rings[here], ground.cells[here]]
                worths[k] += gained[1, 0, ground.rings[there], ground.cells[there]]
        at = (0, here, units)
        best = best_of(gained, value, ground.ways, free, self.rates[drone], at)
        if best >= len(ground.after):
            worths[best] = value[at]
        return worths

    def covered(self) -> float:
        """Return how many users are expected to be covered, summed over all steps of the plans."""
        return float((1.0 - np.prod(1.0 - self.covers, axis=0)).sum())

    def _needs(self, ground: Ground) -> Ints:
        """Return the battery that drones need at each place at the end of their plans.

        If nothing comes after the plans, because the last episode ends, any battery is enough.
        """
        ends = not self.goes_on and self.steps == self.sight.left
        return np.minimum(ground.needs, 1) if ends else ground.needs

    def _rates(self, ground: Ground, gained: Floats) -> tuple[float, float]:
        """Return the worth of a unit of battery, and of a tick of charging, after the plan.

        A drone that gains g per tick, flies for F ticks and charges for C ticks gains g F / (F + C)
        per tick on average. A unit of battery is worth what it gains more than this; it lasts for
        about a tick.
        """
        if not self.goes_on or not ground.limited:
            return 0.0, 0.0
        gain = self.habits.charge * float(gained.sum(axis=0).max(axis=(1, 2)).mean())
        takes = ground.charge_us[0] / self.tick_us
        return gain * takes / (ground.full + takes), gain * ground.full / (ground.full + takes)

    def _hold(self, drone: int) -> None:
        """Note which users a drone covers by its plan, and when it occupies a pad."""
        ground, standing, plan = self.grounds[drone], self.sight.drones[drone], self.plans[drone]
        self.covers[drone], self.busy[drone] = 0.0, 0
        if standing.station >= 0:
            self.busy[drone, standing.station, standing.begins : standing.ready] = 1
        actions, places = plan[:, 0], plan[:, 1]
        moves = len(ground.after)
        flying = np.flatnonzero((actions >= 0) & (actions < moves))
        here, there = places[flying], ground.after[actions[flying], places[flying]]
        twice, lasts = 2 * plan[flying, 2], ground.lasts[actions[flying]]
        at = np.where(twice < lasts, here, there)
        to = np.where((twice + 2 < lasts) & (flying + 1 < self.steps), here, there)
        begin = self.shares[drone][flying, ground.rings[at], ground.cells[at]]
        end = self.shares[drone][flying + 1, ground.rings[to], ground.cells[to]]
        self.covers[drone, flying] = 0.5 * (begin + end)
        landed = np.flatnonzero(actions >= moves)
        self.busy[drone, ground.station_of[places[landed]], landed] = 1


def commands_of(
    grounds: Sequence[Ground],
    engine: Any,
    plans: Ints,
    observations: Sequence[Observation],
    masks: Sequence[Sequence[bool]],
) -> list[Command]:
    """Return the commands for what each drone's plan (drones, 3) says, or what is forced."""
    commands: list[Command] = []
    for drone, observation, mask in zip(engine.drones, observations, masks, strict=True):
        ground, (k, place, _) = grounds[drone.index], plans[drone.index].tolist()
        if sum(mask) == 1:
            commands.append(list(mask).index(True))
        elif k < len(ground.after):
            k, place = (k, place) if k >= 0 and observation.mode in DECIDES else (0, place)
            commands.append(ground.flights.command(drone, k, int(ground.after[k, place])))
        else:
            action = (Action.GOTO_CHARGING_STATION, Action.CHARGE)[k - len(ground.after)]
            commands.append(ground.world.actions.index(action))
    return commands
