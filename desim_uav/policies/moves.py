"""How the baseline's moves become commands: from cell to cell, or in free flight."""

from __future__ import annotations

import math
from typing import Any, Protocol

from desim_uav.commands.given import Command
from desim_uav.model.geometry.grid import Cell
from desim_uav.model.geometry.prisms import first_entry
from desim_uav.model.motion.legs import direction, reach_along, reach_m
from desim_uav.model.motion.space import ANY_SPEED
from desim_uav.model.radio.tracks import Point
from desim_uav.model.rules import MOVES, US, Action, fastest_of
from desim_uav.world import World


class Moves(Protocol):
    """How drones move from the centre of a cell to the centre of a neighbouring one."""

    def leads(self, drone: int, cell: Cell, level: int, to: Cell) -> bool:
        """Return whether a drone can fly from a cell to a neighbour at its level."""

    def climbs(self, drone: int, cell: Cell, level: int, to: Cell) -> bool:
        """Return whether a drone that climbs comes to a level at which it can fly to a neighbour.

        It is asked only if there is no way at the present level.
        """

    def commands(self, drone: int, action: Action, cell: Cell, level: int) -> list[Command]:
        """Return the commands of an action from a cell, one for each step that it takes."""


class CellMoves:
    """Moves of drones that fly from cell to cell: an action is a command."""

    def __init__(self, world: World) -> None:
        self._grid = world.grid
        self._index = fastest_of(world.actions)

    def leads(self, drone: int, cell: Cell, level: int, to: Cell) -> bool:
        """Return whether no building blocks the neighbour at this level."""
        return self._grid.can_enter(*to, level, ceiling=False)

    def climbs(self, drone: int, cell: Cell, level: int, to: Cell) -> bool:
        """Return True: there is a level above each building."""
        return True

    def commands(self, drone: int, action: Action, cell: Cell, level: int) -> list[Command]:
        """Return the index of the action, at the highest speed if there are several."""
        return [self._index[action]]


class FreeMoves:
    """The same moves in free flight: each is a displacement by the side of a cell, or by a level.

    A drone that starts at the centre of a cell therefore stays on centres, although it is never
    told where in its cell it is. If a step is too short for a move, the move is flown in as many
    equal parts as it needs. If commands are places, each is the next centre. If commands choose a
    cruise speed or a share of tasks, it is the highest one.
    """

    def __init__(self, world: World, ceiling: bool = False) -> None:
        self._world, self._grid, self._ceiling = world, world.grid, ceiling
        self._index = fastest_of(world.actions)

    def leads(self, drone: int, cell: Cell, level: int, to: Cell) -> bool:
        """Return whether the straight way passes no obstacle and no margin of one."""
        return self._is_open(drone, self._place(cell, level), self._place(to, level))

    def climbs(self, drone: int, cell: Cell, level: int, to: Cell) -> bool:
        """Return whether a way straight up, and then straight ahead, passes no obstacle."""
        start = self._place(cell, level)
        return any(
            self._is_open(drone, start, self._place(cell, higher))
            and self.leads(drone, cell, higher, to)
            for higher in range(level + 1, len(self._grid.levels_m))
        )

    def commands(self, drone: int, action: Action, cell: Cell, level: int) -> list[Command]:
        """Return the numbers of the flight for each step; actions without one are indices."""
        if action not in MOVES:
            return [self._index[action]]
        dx, dy, dz = MOVES[action]
        if self._world.type_of(drone).space.whole_map:
            highest = self._grid.levels(self._ceiling) - 1
            there = self._place((cell[0] + dx, cell[1] + dy), min(level + dz, highest))
            return [self._numbers(drone, self._on_map(there))]
        (side_x, side_y), own = self._grid.cell_m, self._world.type_of(drone)
        space, step_s = own.space, self._world.step_us / US
        length_m = side_x if dx else side_y if dy else self._grid.level_step_m
        ahead = (float(dx), float(dy), float(dz))
        most_m = reach_along(space.commanded, space.wind, ANY_SPEED, ahead, step_s)
        parts = max(1, math.ceil(length_m / most_m - 1e-9))
        share = length_m / parts / most_m
        return [self._numbers(drone, [share * one for one in ahead])] * parts

    def towards(self, drone: int, start: Point, stop: Point) -> list[float]:
        """Return the numbers of the command that leads a drone from one place to another.

        It leads less far if a step is too short, and it may be blocked by an obstacle.
        """
        space, step_s = self._world.type_of(drone).space, self._world.step_us / US
        if space.whole_map:
            return self._numbers(drone, self._on_map(stop))
        ahead, length_m = direction(start, stop)
        if length_m == 0.0:
            return self._numbers(drone, [0.0, 0.0, 0.0])
        share = min(
            1.0, length_m / reach_along(space.commanded, space.wind, ANY_SPEED, ahead, step_s)
        )
        limits, up = space.commanded, ahead[2] > 0.0
        level_m = reach_m(limits.level_mps, limits.level_mps2, step_s)
        climb_mps = limits.climb_mps if up else limits.descent_mps
        vertical_m = reach_m(climb_mps, limits.vertical_mps2, step_s)
        aim = [ahead[0] / level_m, ahead[1] / level_m, ahead[2] / vertical_m]
        size = max(math.hypot(aim[0], aim[1]), abs(aim[2]))
        return self._numbers(drone, [share * one / size for one in aim])

    def _numbers(self, drone: int, displacement: list[float]) -> list[float]:
        """Return the numbers of a command: a displacement, and the highest of all choices."""
        own = self._world.type_of(drone)
        highest = [1.0] * (own.chooses_cruise + bool(own.shares))
        return displacement[: self._world.dimensions] + highest + [-1.0] * own.limited

    def _on_map(self, place: Point) -> list[float]:
        """Return the numbers from -1 to 1 that name a place on the map."""
        grid = self._grid
        low_m, high_m = grid.levels_m[0], grid.levels_m[grid.levels(self._ceiling) - 1]
        up = 2.0 * (place[2] - low_m) / (high_m - low_m) - 1.0 if high_m > low_m else 0.0
        return [2.0 * place[0] / grid.width_m - 1.0, 2.0 * place[1] / grid.depth_m - 1.0, up]

    def _place(self, cell: Cell, level: int) -> Point:
        return (*self._grid.centre(*cell), self._grid.levels_m[level])

    def _is_open(self, drone: int, start: Point, stop: Point) -> bool:
        entry: Any = first_entry(self._world.type_of(drone).space.prisms, start, stop)
        return bool(entry == math.inf)


class EachMoves:
    """The moves of drones of which some fly freely and others from cell to cell."""

    def __init__(self, world: World) -> None:
        kinds: tuple[Moves, Moves] = CellMoves(world), FreeMoves(world)
        self._of = [kinds[world.types[number].free] for number in world.type_numbers]

    def leads(self, drone: int, cell: Cell, level: int, to: Cell) -> bool:
        """Return whether a drone can fly from a cell to a neighbour at its level."""
        return self._of[drone].leads(drone, cell, level, to)

    def climbs(self, drone: int, cell: Cell, level: int, to: Cell) -> bool:
        """Return whether a drone that climbs comes to a level at which it can fly there."""
        return self._of[drone].climbs(drone, cell, level, to)

    def commands(self, drone: int, action: Action, cell: Cell, level: int) -> list[Command]:
        """Return the commands of an action of a drone, one for each step that it takes."""
        return self._of[drone].commands(drone, action, cell, level)


def moves_of(world: World) -> Moves:
    """Return how the drones of a world move."""
    if world.mixed:
        return EachMoves(world)
    return FreeMoves(world) if world.free else CellMoves(world)
