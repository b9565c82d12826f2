"""The paper's baseline: fixed lines over the map, and home to charge at 15 % of the battery."""

from __future__ import annotations

from collections.abc import Sequence

from desim_uav.model.grid import Cell
from desim_uav.model.rules import MOVES, Action
from desim_uav.model.state import Observation
from desim_uav.model.streams import Streams
from desim_uav.registry import register
from desim_uav.world import World

RETURN_AT = 0.15


@register("policy", "baseline")
class Baseline:
    """Drone 0 flies a ring, odd drones sweep a column, even ones a row; they bounce at the edges.

    It knows the buildings and climbs over whatever is in the way, without a ceiling. It never
    descends by itself: nothing obliges it to, and a return flies down to land.
    """

    ceiling = False

    def begin(self, world: World, streams: Streams, carried: bool = False) -> None:
        """Lay the lines of all drones."""
        self._grid = world.grid
        self._index = {action: k for k, action in enumerate(world.actions)}
        self._ring = ring(*world.grid.cells)
        self._starts = world.starts
        if not carried:
            self._direction = [1] * len(world.starts)

    def act(self, observation: Observation, mask: Sequence[bool]) -> int:
        """Return at 15 %, else the next cell of the line, climbing where it is built."""
        if sum(mask) == 1:
            return list(mask).index(True)
        battery, capacity = observation.battery_s, observation.capacity_s
        if battery is not None and capacity is not None and battery <= RETURN_AT * capacity:
            home = self._index[Action.GOTO_CHARGING_STATION]
            if mask[home]:
                return home
        return self._index[self._fly(observation)]

    def _fly(self, observation: Observation) -> Action:
        cell = observation.cell
        target = self._next_cell(observation.drone, cell)
        action = _towards(cell, target)
        if action is not Action.HOVER:
            dx, dy, _ = MOVES[action]
            ix, iy = cell[0] + dx, cell[1] + dy
            if not self._grid.can_enter(ix, iy, observation.level, ceiling=False):
                return Action.UP
        return action

    def _next_cell(self, drone: int, cell: Cell) -> Cell:
        """Where the drone's line goes from ``cell``, or the cell of the line to fly to first."""
        if drone == 0 and self._ring:
            if cell in self._ring:
                return self._ring[(self._ring.index(cell) + 1) % len(self._ring)]
            return min(self._ring, key=lambda c: abs(c[0] - cell[0]) + abs(c[1] - cell[1]))
        axis = 1 if drone % 2 or self._grid.cells[0] == 1 else 0
        line = self._starts[drone][1 - axis]
        if cell[1 - axis] != line:
            return (line, cell[1]) if axis == 1 else (cell[0], line)
        last = self._grid.cells[axis] - 1
        if cell[axis] + self._direction[drone] not in range(last + 1):
            self._direction[drone] *= -1
        step = self._direction[drone] if last > 0 else 0
        return (line, cell[1] + step) if axis == 1 else (cell[0] + step, line)


def _towards(cell: Cell, target: Cell) -> Action:
    """The first move of the straight way, x first."""
    if target[0] != cell[0]:
        return Action.RIGHT if target[0] > cell[0] else Action.LEFT
    if target[1] != cell[1]:
        return Action.FORWARD if target[1] > cell[1] else Action.BACKWARD
    return Action.HOVER


def ring(nx: int, ny: int) -> list[Cell]:
    """The square of drone 0, clockwise from its north-west corner: cells 2 … n-3 of each axis.

    Where nx or ny is below 6: the outermost ring. On a strip one cell wide there is none: drone 0
    sweeps it.
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
