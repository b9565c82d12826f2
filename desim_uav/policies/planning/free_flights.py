"""How drones that fly freely move in plans: over a lattice of points, straight from one to another.

The points are the centres of cells and equally spaced points between them, so that a step leads at
least to the next one. Drones themselves may be at any place: a command leads from there to a point.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from desim_uav.commands.given import Command
from desim_uav.drone_type import DroneType
from desim_uav.model.geometry.prisms import first_entry
from desim_uav.model.geometry.roads import way_home
from desim_uav.model.motion.flight import step_leg
from desim_uav.model.motion.legs import LegBounds, leg_between, reach_along
from desim_uav.model.motion.space import ANY_SPEED, flight_of
from desim_uav.model.radio.tracks import Point
from desim_uav.model.rules import US, Action, fastest_of
from desim_uav.policies.moves import FreeMoves
from desim_uav.policies.planning.flights import NO_RETURN, Flown, PlannedReturn
from desim_uav.world import World

Ints = NDArray[np.int64]
Floats = NDArray[np.float64]
Offset = tuple[int, int, int]
"""A displacement in points along x and y, and in levels."""

MOST_POINTS = 500
"""The most points of a lattice that is finer than it must be."""

AROUND = 16
"""Moves lead to all points within reach along the axes and diagonals of the lattice, and to the
furthest point in so many directions."""


class FreeFlights:
    """Straight moves over a lattice, none longer than what a drone flies in a step.

    A drone charges after a return only, which ends on a station.

    Moves are flown at the highest speed that commands can choose. Where a drone cannot be sure to
    be just over a station, it cannot charge there without a return.
    """

    lands, word = False, "points"

    def __init__(self, world: World, own: DroneType) -> None:
        self.world, self.own, self.space = world, own, own.space
        self.levels = world.grid.levels(True)
        self.return_at = own.return_charge if own.limited else -1
        self._step_s = world.step_us / US
        self._moves = FreeMoves(world, ceiling=True)
        self._index = fastest_of(world.actions)
        self._limits = self.space.commanded
        self._lattice()
        self.moves: tuple[Offset, ...] = ((0, 0, 0), *self._offsets())
        self._away_m = np.empty(max(1, self.space.nodes))

    def _lattice(self) -> None:
        """Divide the sides of cells into as many parts as a step, and a fine lattice, need."""
        (nx, ny), sides_m = self.world.grid.cells, self.world.grid.cell_m
        ahead = ((1.0, 0.0), (0.0, 1.0))
        reach_m = [min(self._reach_m(x, y), self._reach_m(-x, -y)) for x, y in ahead]
        least = [math.ceil(side / far - 1e-9) for side, far in zip(sides_m, reach_m, strict=True)]
        twice = [max(2, parts) for parts in least]
        fine = ((nx - 1) * twice[0] + 1) * ((ny - 1) * twice[1] + 1) * self.levels <= MOST_POINTS
        self.parts = twice if fine else least
        self.shape = ((nx - 1) * self.parts[0] + 1, (ny - 1) * self.parts[1] + 1)
        self.first_m = self.world.grid.centre(0, 0)
        self.spacing_m = [side / k for side, k in zip(sides_m, self.parts, strict=True)]
        numbers = [(x, y) for x in range(self.shape[0]) for y in range(self.shape[1])]
        self.points_m = np.array(self.first_m) + np.array(numbers) * np.array(self.spacing_m)

    def _reach_m(self, x: float, y: float, z: float = 0.0) -> float:
        """Return how far a step leads in a direction."""
        far_m = reach_along(self._limits, self.space.wind, ANY_SPEED, (x, y, z), self._step_s)
        return max(float(far_m), 1e-3)

    def _offsets(self) -> list[Offset]:
        """Return the displacements of moves, the nearest ones first."""
        (dx, dy), (nx, ny) = self.spacing_m, self.shape
        far = [min(n - 1, int(max(self._reach_m(*way), self._reach_m(-way[0], -way[1])) / d) + 1)
               for n, d, way in ((nx, dx, (1.0, 0.0)), (ny, dy, (0.0, 1.0)))]  # fmt: skip
        level: dict[Offset, float] = {}
        for i in range(-far[0], far[0] + 1):
            for j in range(-far[1], far[1] + 1):
                long_m = math.hypot(i * dx, j * dy)
                if long_m and long_m <= self._reach_m(i * dx / long_m, j * dy / long_m) + 1e-6:
                    level[i, j, 0] = long_m
        furthest: dict[int, Offset] = {}
        for offset, long_m in level.items():
            way = round(math.atan2(offset[1] * dy, offset[0] * dx) / math.tau * AROUND) % AROUND
            if long_m > level.get(furthest.get(way, (0, 0, 0)), 0.0) + 1e-6:
                furthest[way] = offset
        kept = {each for each in level if 0 in each[:2] or abs(each[0]) == abs(each[1])}
        kept.update(furthest.values())
        step_m = self.world.grid.level_step_m
        vertical: list[Offset] = [
            (0, 0, up)
            for up in (1, -1)
            if self.levels > 1 and self._reach_m(0.0, 0.0, float(up)) >= step_m - 1e-6
        ]
        return [*sorted(kept, key=lambda each: (level[each], each)), *vertical]

    def _at(self, place: int) -> Point:
        level, point = divmod(place, len(self.points_m))
        x_m, y_m = self.points_m[point].tolist()
        return x_m, y_m, self.world.grid.levels_m[level]

    def _nearest(self, x_m: float, y_m: float, z_m: float) -> int:
        """Return the place that is nearest to a position."""
        x, y = (
            min(max(round((at - first) / d), 0), n - 1)
            for at, first, d, n in zip(
                (x_m, y_m), self.first_m, self.spacing_m, self.shape, strict=True
            )
        )
        away = [abs(z_m - each) for each in self.world.grid.levels_m[: self.levels]]
        return (away.index(min(away)) * self.shape[0] + x) * self.shape[1] + y

    def after(self) -> Ints:
        """Return the place (moves, places) to which each move leads; -1 if it is blocked."""
        nx, ny = self.shape
        led = np.full((len(self.moves), self.levels * nx * ny), -1)
        for move, (dx, dy, up) in enumerate(self.moves):
            for place in range(led.shape[1]):
                level, x, y = place // (nx * ny) + up, place // ny % nx + dx, place % ny + dy
                if 0 <= level < self.levels and 0 <= x < nx and 0 <= y < ny:
                    to = (level * nx + x) * ny + y
                    if first_entry(self.space.prisms, self._at(place), self._at(to)) == math.inf:
                        led[move, place] = to
        return led

    def flown(self, move: Offset) -> Flown:
        """Return what a move takes: a step or, by event, the flight or the patience, if longer."""
        (x_m, y_m), up_m = self.spacing_m, self.world.grid.level_step_m
        low_m = self.world.grid.levels_m[0] + (up_m if move[2] < 0 else 0.0)
        stop = (move[0] * x_m, move[1] * y_m, low_m + move[2] * up_m)
        return self._flown((0.0, 0.0, low_m), stop)

    def is_level(self, move: Offset) -> bool:
        """Return whether a move does not lead up or down."""
        return move[2] == 0

    def _flown(self, start: Point, stop: Point) -> Flown:
        """Return what a command takes that leads from one place to another."""
        leg = leg_between(self._limits, self.space.wind, ANY_SPEED, start, stop)
        lasts_us = self.world.step_us
        if self.world.by_event:
            lasts_us = max(leg.duration_us, self.world.patience_us)
        return Flown(lasts_us, self._drain(leg, lasts_us))

    def _drain(self, leg: Any, lasts_us: int) -> int:
        """Return what a leg, and the hover after it, take of the battery."""
        return self.own.taken_by(flight_of(leg, self.space.wind), lasts_us)

    def back(self, place: int) -> PlannedReturn:
        """Return the return from a place, round all obstacles, at the level of the place."""
        level, (x_m, y_m, z_m) = place // len(self.points_m), self._at(place)
        if level >= len(self.space.levels):
            return PlannedReturn(*NO_RETURN)
        space, ways = self.space, self.space.levels[level]
        station, node, lasts_us = way_home(
            space.prisms, ways.roads, ways.times_us, space.limits, space.wind, ANY_SPEED,
            x_m, y_m, self._away_m,
        )  # fmt: skip
        if station < 0:
            return PlannedReturn(*NO_RETURN)
        there = (*ways.roads.nodes_m[node].tolist(), z_m)
        leg = leg_between(space.limits, space.wind, ANY_SPEED, (x_m, y_m, z_m), there)
        drain = int(ways.drains[station, node]) + self._drain(leg, leg.duration_us)
        return PlannedReturn(int(station), int(lasts_us), drain, True)

    def station_point(self, station: int) -> int:
        """Return the point of a station, which is at the centre of its cell."""
        x, y = self.world.stations[station]
        return x * self.parts[0] * self.shape[1] + y * self.parts[1]

    def place(self, drone: Any, end: bool = False) -> int:
        """Return the place next to a drone or, at the ``end`` of its leg, next to that."""
        return self._nearest(*_stands(drone))

    def lands_at(self, engine: Any, drone: Any, battery_s: float) -> tuple[int, int, float]:
        """Return when a drone that returns lands, as from rest here, where, and its battery."""
        home, charge = drone.course.home, battery_s * self.own.drain_per_s
        if home.station < 0:
            return 0, max(int(drone.course.station), 0), charge
        return int(home.duration_us), int(home.station), charge - home.drain

    def command(self, drone: Any, move: int, to: int) -> Command:
        """Return the numbers of the flight to a place from where a drone is, or of hovering."""
        if move == 0:
            return self._index[Action.HOVER]
        return self._moves.towards(drone.index, _stands(drone), self._at(to))

    def options(self, drone: Any, mask: Sequence[bool]) -> list[Command]:
        """Return the actions other than to fly that the mask allows, and the moves over points."""
        kept: list[Command] = [
            k for k, may in enumerate(mask) if may and self.world.actions[k] is not Action.FLY
        ]
        if not mask[self._index[Action.FLY]]:
            return kept
        here, start = self.place(drone), _stands(drone)
        nx, ny = self.shape
        for dx, dy, up in self.moves[1:]:
            level, x, y = here // (nx * ny) + up, here // ny % nx + dx, here % ny + dy
            if 0 <= level < self.levels and 0 <= x < nx and 0 <= y < ny:
                to = self._at((level * nx + x) * ny + y)
                kept.append(self._moves.towards(drone.index, start, to))
        return kept

    def leads(self, drone: Any, command: Command, after: Ints) -> tuple[int, Flown]:
        """Return the place next to which a command leads, and what it takes."""
        start, grid = _stands(drone), self.world.grid
        if isinstance(command, int):
            return self._nearest(*start), self._flown(start, start)
        x, y, z = [*command[: self.world.dimensions], 0.0][:3]
        bounds = LegBounds(grid.width_m, grid.depth_m, grid.levels_m[0],
                           grid.levels_m[self.levels - 1])  # fmt: skip
        leg, _ = step_leg(
            self._limits, self.space.wind, ANY_SPEED, bounds, self.space.prisms,
            self.space.most_s(self._step_s), start, (x, y, z),
        )  # fmt: skip
        stop = (leg.route[3], leg.route[4], leg.route[5])
        return self._nearest(*stop), self._flown(start, stop)


def _stands(drone: Any) -> Point:
    """Return where a drone hovers, or will do when its leg ends."""
    course = drone.course
    return float(course.x1_m), float(course.y1_m), float(course.z1_m)
