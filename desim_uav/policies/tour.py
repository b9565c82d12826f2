"""The tour: the drones share the homes of all users, and each flies round after round past its own.

A tour is made by nearest insertion and shortened by 2-opt [Rosenkrantz, Stearns and Lewis, 1977;
Croes, 1958].
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

from desim_uav.errors import PolicyError, did_you_mean
from desim_uav.model.geometry.grid import Cell
from desim_uav.model.random.streams import Streams
from desim_uav.model.rules import Action
from desim_uav.model.state import Observation
from desim_uav.policies.baseline import Baseline, Way, steps_to
from desim_uav.policies.planning.options import Option, options_of
from desim_uav.registry import register
from desim_uav.world import World

Floats = NDArray[np.float64]

OPTIONS = {"stay": Option(0, 0, 1000)}

IN_RESERVE = 2.0
"""A drone returns with the battery for so many more steps than the return takes."""


@register("policy", "tour")
class Tour(Baseline):
    """Each drone flies round after round past the homes of its part of the users.

    The stops are the cells in which users of the given ``groups`` have their homes; without groups
    they are those of all users. A tour past all stops is cut into one part for each drone, of which
    each is closed again. Drones go along x first, climb over buildings in their way, and leave out
    stops to which no way leads. At each stop they ``stay`` for so many steps. A drone returns to
    charge while its battery holds what the return takes and two steps more, as far as the scenario
    allows it, and then goes on with its round.
    """

    def __init__(self, argument: str = "", groups: Sequence[str] = (), **settings: float) -> None:
        """Take groups and options as text, ``meters+cameras+stay=1``, or by their names.

        Raises ValueError for an unknown option or a bad value.
        """
        words = argument.split("+") if argument else []
        self._groups: list[str] = [*groups, *(word for word in words if "=" not in word)]
        text = "+".join(word for word in words if "=" in word)
        self.options = options_of("tour", text, settings, OPTIONS)
        self.name = f"tour:{argument}" if argument else "tour"
        self._world: World | None = None

    def begin(self, world: World, streams: Streams, carried: bool = False) -> None:
        """Divide the homes among the drones. Raises PolicyError for a group that is not there."""
        super().begin(world, streams, carried)
        if self._world is not world:
            self._world, self._step_s = world, world.step_us / 1e6
            self._rounds = rounds_of(world, self._stops())
        if not carried:
            count = len(world.starts)
            self._next, self._stayed = [0] * count, [0] * count
            self._taken, self._before = [self._step_s] * count, [0.0] * count

    def memory(self) -> Any:
        """Return the next stop of each drone, how long it has stayed, and what steps have taken."""
        stops, batteries = [self._next, self._stayed], [self._taken, self._before]
        return [super().memory(), *map(list, stops), *map(list, batteries)]

    def remember(self, memory: Any) -> None:
        """Let the drones fly on to these stops."""
        routes, next_, stayed, taken, before = memory
        super().remember(routes)
        self._next, self._stayed = list(next_), list(stayed)
        self._taken, self._before = list(taken), list(before)

    def _stops(self) -> list[Cell]:
        """Return the cells in which users of the groups have their homes, in order."""
        assert self._world is not None
        scenario, grid = self._world.scenario, self._world.grid
        for name in self._groups:
            if name not in scenario.group_names:
                there = ", ".join(scenario.group_names) or "none; users are not a list of groups"
                hint = did_you_mean(name, scenario.group_names)
                raise PolicyError(f"tour: unknown group of users {name!r}{hint}; there are {there}")
        homes = self._world.homes[:, :2].tolist()
        if self._groups:
            names = (scenario.group_names[number] for number in scenario.group_numbers)
            homes = [at for at, name in zip(homes, names, strict=True) if name in self._groups]
        return sorted({grid.cell_of(x_m, y_m) for x_m, y_m in homes})

    def _is_low(self, observation: Observation, capacity: float) -> bool:
        """Return whether a drone holds little more than its return takes, as steps have taken."""
        drone, battery = observation.drone, observation.battery_s
        assert battery is not None
        self._taken[drone] = max(self._taken[drone], self._before[drone] - battery)
        self._before[drone] = battery
        return battery <= (observation.return_s or 0.0) + IN_RESERVE * self._taken[drone]

    def _fly(self, observation: Observation) -> Action:
        """Return the move towards the next stop; one to which no way leads is left out."""
        drone = observation.drone
        if not self._rounds[drone]:
            return Action.HOVER
        if observation.cell == self._rounds[drone][self._next[drone]]:
            if self._stayed[drone] < self.options["stay"]:
                self._stayed[drone] += 1
                return Action.HOVER
            self._go_on(drone)
        move = super()._fly(observation)
        if move is Action.HOVER:
            self._go_on(drone)
        return move

    def _go_on(self, drone: int) -> None:
        """Let the stop after the next one be the next one."""
        self._next[drone] = (self._next[drone] + 1) % len(self._rounds[drone])
        self._stayed[drone] = 0

    def _ways(self, drone: int, cell: Cell) -> list[Way]:
        """Return the neighbours that are nearer to the next stop, along x first."""
        return [(step, 1) for step in steps_to(cell, self._rounds[drone][self._next[drone]])]


def rounds_of(world: World, stops: Sequence[Cell]) -> list[list[Cell]]:
    """Return the round of each drone: its stops in order, the nearest one to its start first.

    The tour past all stops is cut behind its longest leg, and then into parts of the same length.
    Parts and drones are matched so that the drones' ways to their parts are short together. If
    there are fewer parts than drones, several drones fly the same.
    """
    if not stops:
        return [[] for _ in world.starts]
    cells, side_m = np.array(stops, float), np.array(world.grid.cell_m)
    at_m = cells * side_m
    order = tour_of(at_m)
    legs_m = _apart(at_m[order], at_m[np.roll(order, -1)])
    first = (int(legs_m.argmax()) + 1) % len(order)
    order, legs_m = np.roll(order, -first), np.roll(legs_m, -first)
    begins_m = np.concatenate(([0.0], np.cumsum(legs_m[:-1])))
    drones = len(world.starts)
    length_m = max(float(begins_m[-1]), 1e-9)
    of_drone = np.minimum((begins_m / length_m * drones).astype(int), drones - 1)
    parts = [order[of_drone == k] for k in range(drones) if (of_drone == k).any()]
    starts_m = np.array(world.starts, float) * side_m
    ways_m = np.array([[_apart(start, at_m[part]).min() for part in parts] for start in starts_m])
    taken = dict(zip(*map(np.ndarray.tolist, linear_sum_assignment(ways_m)), strict=True))
    rounds = []
    for drone, start_m in enumerate(starts_m):
        part = parts[taken.get(drone, int(ways_m[drone].argmin()))]
        part = part[tour_of(at_m[part])]
        nearest = int(_apart(start_m, at_m[part]).argmin())
        rounds.append([stops[k] for k in np.roll(part, -nearest)])
    return rounds


def tour_of(at_m: Floats) -> NDArray[np.int64]:
    """Return the order of a short closed tour past some places (places, 2): their numbers."""
    return _shortened(_inserted(at_m), at_m)


def _inserted(at_m: Floats) -> NDArray[np.int64]:
    """Insert place after place, the nearest one to the tour first, where it is the least detour."""
    tour = [0]
    far_m = _apart(at_m, at_m[0])
    far_m[0] = np.inf
    for _ in range(len(at_m) - 1):
        new = int(far_m.argmin())
        here, following = at_m[tour], at_m[np.roll(tour, -1)]
        detours_m = _apart(here, at_m[new]) + _apart(at_m[new], following) - _apart(here, following)
        tour.insert(int(detours_m.argmin()) + 1, new)
        far_m = np.minimum(far_m, _apart(at_m, at_m[new]))
        far_m[tour] = np.inf
    return np.array(tour)


def _shortened(tour: NDArray[np.int64], at_m: Floats) -> NDArray[np.int64]:
    """Reverse parts of a tour for as long as this makes it shorter (2-opt)."""
    count, shorter = len(tour), True
    while shorter:
        shorter = False
        for k in range(count - 2):
            others = np.arange(k + 2, count)
            a, b = at_m[tour[k]], at_m[tour[k + 1]]
            c, d = at_m[tour[others]], at_m[tour[(others + 1) % count]]
            gains_m = _apart(a, b) + _apart(c, d) - _apart(a, c) - _apart(b, d)
            best = int(gains_m.argmax())
            if gains_m[best] > 1e-6:
                end = others[best] + 1
                tour[k + 1 : end] = tour[k + 1 : end][::-1].copy()
                shorter = True
    return tour


def _apart(one: Floats, other: Floats) -> Floats:
    """Return the way between places along x and y, as drones fly it."""
    apart: Floats = np.abs(one - other).sum(axis=-1)
    return apart
