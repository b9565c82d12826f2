"""The paper's baseline: fixed routes over the map, and a return at 15 % of the battery."""

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
    """The paper's baseline: each drone flies a fixed route over the map.

    Drone 0 flies around a ring. Odd drones fly back and forth along a column, even drones along a
    row. Drones know the buildings and climb over those in their way, without a ceiling. They never
    descend on their own; only a return to a charging station takes them down.
    """

    ceiling = False

    def begin(self, world: World, streams: Streams, carried: bool = False) -> None:
        """Determine the routes of all drones."""
        world.scenario.require_cells("the baseline")
        self._grid = world.grid
        self._index = {action: k for k, action in enumerate(world.actions)}
        self._ring = ring(*world.grid.cells)
        self._starts = world.starts
        if not carried:
            self._direction = [1] * len(world.starts)

    def memory(self) -> list[int]:
        """Return the direction in which each drone flies along its column or row: 1 or -1."""
        return list(self._direction)

    def remember(self, memory: list[int]) -> None:
        """Let the drones fly on in these directions."""
        self._direction = list(memory)

    def act(self, observation: Observation, mask: Sequence[bool]) -> int:
        """Return to charge at 15 % of the battery; else fly to the route's next cell, or climb."""
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
        """Return the next cell of the drone's route, or the cell where it first joins the route."""
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
