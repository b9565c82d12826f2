"""The paper's baseline: fixed routes over the map, and a return at 15 % of the battery."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from desim_uav.commands.given import Command
from desim_uav.model.geometry.grid import Cell
from desim_uav.model.random.streams import Streams
from desim_uav.model.rules import Action, fastest_of
from desim_uav.model.state import Observation
from desim_uav.policies.moves import moves_of
from desim_uav.registry import register
from desim_uav.world import World

RETURN_AT = 0.15

Way = tuple[Cell, int]
"""A neighbouring cell, and the direction in which a drone flies its route from there on."""


@register("policy", "baseline")
class Baseline:
    """The paper's baseline: each drone flies a fixed route over the map.

    Drone 0 flies around a ring. Odd drones fly back and forth along a column, even drones along a
    row. Drones know the buildings and climb over those in their way, without a ceiling. They never
    descend on their own; only a return to a charging station takes them down. If commands choose a
    cruise speed, drones take the highest one.

    In free flight, they fly the same routes from centre to centre of cells, each as a displacement
    (see ``FreeMoves``). A drone turns back where no altitude leads on, at a no-fly zone.
    """

    ceiling = False

    def begin(self, world: World, streams: Streams, carried: bool = False) -> None:
        """Determine the routes of all drones."""
        self._cells, self._free = world.grid.cells, world.free
        self._moves = moves_of(world)
        self._index = fastest_of(world.actions)
        self._ring = ring(*self._cells)
        self._starts = world.starts
        if not carried:
            self._direction = [1] * len(world.starts)
            self._ahead: list[list[Command]] = [[] for _ in world.starts]

    def memory(self) -> Any:
        """Return the direction in which each drone flies along its route: 1 or -1.

        In free flight, return also the commands of the moves that drones have not completed.
        """
        directions = list(self._direction)
        return [directions, [list(own) for own in self._ahead]] if self._free else directions

    def remember(self, memory: Any) -> None:
        """Let the drones fly on in these directions."""
        directions, ahead = memory if self._free else (memory, [[] for _ in memory])
        self._direction, self._ahead = list(directions), [list(own) for own in ahead]

    def act(self, observation: Observation, mask: Sequence[bool]) -> Command:
        """Return to charge at 15 % of the battery; else fly to the route's next cell, or climb."""
        ahead = self._ahead[observation.drone]
        if sum(mask) == 1:
            ahead.clear()
            return list(mask).index(True)
        battery, capacity = observation.battery_s, observation.capacity_s
        if battery is not None and capacity is not None and self._is_low(observation, capacity):
            home = self._index[Action.GOTO_CHARGING_STATION]
            if mask[home]:
                ahead.clear()
                return home
        if not ahead:
            drone, cell, level = observation.drone, observation.cell, observation.level
            ahead.extend(self._moves.commands(drone, self._fly(observation), cell, level))
        return ahead.pop()

    def _is_low(self, observation: Observation, capacity: float) -> bool:
        """Return whether a drone is to return to charge now, if it may."""
        return observation.battery_s is not None and observation.battery_s <= RETURN_AT * capacity

    def _fly(self, observation: Observation) -> Action:
        """Return the move to the first neighbour to which a way leads, or the climb towards it."""
        drone, cell, level = observation.drone, observation.cell, observation.level
        for neighbour, direction in self._ways(drone, cell):
            leads = neighbour == cell or self._moves.leads(drone, cell, level, neighbour)
            if leads or self._moves.climbs(drone, cell, level, neighbour):
                self._direction[drone] = direction
                return _towards(cell, neighbour) if leads else Action.UP
        return Action.HOVER

    def _ways(self, drone: int, cell: Cell) -> list[Way]:
        """Return where a drone would fly next on its route, or to it; the first is the best."""
        onward = self._direction[drone]
        if drone == 0 and self._ring:
            if cell in self._ring:
                here = self._ring.index(cell)
                after = [self._ring[(here + way) % len(self._ring)] for way in (onward, -onward)]
                return [(after[0], onward), (after[1], -onward)]
            near = sorted(self._ring, key=lambda c: abs(c[0] - cell[0]) + abs(c[1] - cell[1]))
            return [(step, onward) for there in near for step in steps_to(cell, there)]
        axis = 1 if drone % 2 or self._cells[0] == 1 else 0
        line = self._starts[drone][1 - axis]
        joining = (line, cell[1]) if axis == 1 else (cell[0], line)
        first = [(step, onward) for step in steps_to(cell, joining)]
        return [*first, *self._along(cell, axis, onward)]

    def _along(self, cell: Cell, axis: int, onward: int) -> list[Way]:
        """Return the next cell along an axis, and that in the other direction if there are both."""
        ways = []
        for way in (onward, -onward):
            at = cell[axis] + way
            if at in range(self._cells[axis]):
                ways.append(((cell[0], at) if axis == 1 else (at, cell[1]), way))
        return ways or [(cell, onward)]


def steps_to(cell: Cell, target: Cell) -> list[Cell]:
    """Return the neighbours that are nearer to ``target``, along x first."""
    moved = [(cell[0] + _sign(target[0] - cell[0]), cell[1])]
    moved.append((cell[0], cell[1] + _sign(target[1] - cell[1])))
    return [step for step in moved if step != cell]


def _sign(number: int) -> int:
    return (number > 0) - (number < 0)


def _towards(cell: Cell, target: Cell) -> Action:
    """Return the first move on the way to ``target``, which goes along x first."""
    if target[0] != cell[0]:
        return Action.RIGHT if target[0] > cell[0] else Action.LEFT
    if target[1] != cell[1]:
        return Action.FORWARD if target[1] > cell[1] else Action.BACKWARD
    return Action.HOVER


def ring(nx: int, ny: int) -> list[Cell]:
    """Return the ring of drone 0, clockwise from its north-west corner: cells 2 … n-3 of each axis.

    If nx or ny is below 6, the ring is the outermost one. A map that is one cell wide has no ring,
    and drone 0 flies back and forth along it.
    """
    if min(nx, ny) == 1:
        return []
    margin = 2 if min(nx, ny) >= 6 else 0
    west, east, south, north = margin, nx - 1 - margin, margin, ny - 1 - margin
    top = [(x, north) for x in range(west, east + 1)]
    right = [(east, y) for y in range(north - 1, south - 1, -1)]
    bottom = [(x, south) for x in range(east - 1, west - 1, -1)]
    left = [(west, y) for y in range(south + 1, north)]
    return top + right + bottom + left
