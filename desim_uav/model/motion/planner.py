"""Plans returns to the nearest charging station, by A* over (cell, level) in minimum time."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from desim_uav.model.geometry.grid import Cell, Grid
from desim_uav.rowcode.kernels import kernel, rule

Node = tuple[int, int, int]
"""(cell x, cell y, level)."""


HOPS: dict[Node, Node] = {
    hop: hop for hop in ((1, 0, 0), (-1, 0, 0), (0, 1, 0), (0, -1, 0), (0, 0, 1), (0, 0, -1))
}
"""The hops there are: all plans share these, since a large map has millions of hops."""

DIRECTIONS: dict[Node, int] = {hop: number for number, hop in enumerate(HOPS)}
"""The numbers of the hops, in the order of HOPS."""

MOST_PLANNING = 4 * 10**9
"""The largest squared number of places from all of which returns are planned, in some minutes."""

FAR_US = 2**62
"""The time to a node that is not reached."""


@dataclass(frozen=True)
class Return:
    """A return flight: the station's index, time, battery use, and hops (dx, dy, dlevel)."""

    station: int
    duration_us: int
    drain: int
    hops: tuple[Node, ...]


@dataclass(frozen=True, eq=False)
class Planner:
    """Plans returns and keeps the plans, because a world does not change.

    ``hop_us`` is the time of each of the HOPS, in microseconds, and ``hop_drains`` the battery that
    it takes (None: its time).
    """

    grid: Grid
    stations: Sequence[Cell]
    hop_us: tuple[int, ...]
    hop_drains: tuple[int, ...] | None = None
    _plans: dict[tuple[Node, bool], Return | None] = field(default_factory=dict, repr=False)

    def plan(self, start: Node, ceiling: bool = True) -> Return | None:
        """Return the quickest return from ``start``, or None if there is no way.

        Of equally quick ones, that to the station with the lowest index is taken. ``start`` may be
        blocked by a building, because a drone can believe that it is there.
        """
        key = (start, ceiling)
        if key not in self._plans:
            self._plans[key] = self.search(start, ceiling)
        return self._plans[key]

    def search(self, start: Node, ceiling: bool = True) -> Return | None:
        """Plan without keeping the plan.

        Search all stations; skip those that would be too far even on a map without buildings.
        """
        best: Return | None = None
        blocked = self.grid.blocked[: self.grid.levels(ceiling)]
        for at_least, station in sorted(self._bounds(start)):
            if best is not None and at_least > best.duration_us:
                break
            path = shortest_path(blocked, self.hop_us, start, (*self.stations[station], 0))
            if not path:
                continue
            hops = tuple(
                HOPS[to[0] - at[0], to[1] - at[1], to[2] - at[2]] for at, to in pairwise(path)
            )
            duration = sum(self.hop_us[DIRECTIONS[hop]] for hop in hops)
            if best is None or (duration, station) < (best.duration_us, best.station):
                drained = duration
                if self.hop_drains is not None:
                    drained = sum(self.hop_drains[DIRECTIONS[hop]] for hop in hops)
                best = Return(station, duration, drained, hops)
        return best

    def plans_as(self, other: Planner) -> bool:
        """Return whether the plans of another planner, in the same world, are the same."""
        return (self.hop_us, self.hop_drains) == (other.hop_us, other.hop_drains)

    def _bounds(self, start: Node) -> list[tuple[int, int]]:
        """Return a lower bound of the time to each station, and the station's index, in order."""
        return [
            (time_on_open_map(self.hop_us, ix - start[0], iy - start[1], -start[2]), station)
            for station, (ix, iy) in enumerate(self.stations)
        ]


@rule
def time_on_open_map(hop_us: Any, dx: int, dy: int, dlevel: int) -> int:
    """Return the shortest time for a distance in cells and levels on a map without buildings."""
    time_us = hop_us[0] * dx if dx > 0 else hop_us[1] * -dx
    time_us += hop_us[2] * dy if dy > 0 else hop_us[3] * -dy
    time_us += hop_us[4] * dlevel if dlevel > 0 else hop_us[5] * -dlevel
    return int(time_us)


def shortest_path(
    blocked: NDArray[np.bool_], hop_us: Sequence[int], start: Node, goal: Node
) -> list[Node]:
    """Return the nodes of the quickest path from ``start`` to ``goal`` by A*, with both ends.

    The list is empty if there is no path. ``blocked`` has the shape (level, x, y); the start may be
    blocked. ``hop_us`` has the time of each of the HOPS, all above 0.
    """
    (_, nx, ny), nodes = blocked.shape, blocked.size
    times_us = np.array(hop_us, np.int64)
    cost, came_from = np.full(nodes, FAR_US), np.full(nodes, -1)
    waiting = np.empty(6 * nodes + 1, np.int64), np.empty(6 * nodes + 1, np.int64)
    _search(np.ascontiguousarray(blocked), times_us, (*start, *goal), cost, came_from, *waiting)
    source, node = ((at[2] * nx + at[0]) * ny + at[1] for at in (start, goal))
    if cost[node] == FAR_US:
        return []
    path = [node]
    while node != source:
        node = int(came_from[node])
        path.append(node)
    return [(node // ny % nx, node % ny, node // (nx * ny)) for node in reversed(path)]


@kernel
def _search(
    blocked: NDArray[np.bool_],
    hop_us: NDArray[np.int64],
    ends: tuple[int, int, int, int, int, int],
    cost: NDArray[np.int64],
    came_from: NDArray[np.int64],
    estimates_us: NDArray[np.int64],
    waiting: NDArray[np.int64],
) -> None:
    """Write the times from the start, and the nodes before, of all nodes that the search settles.

    The estimate is the time on a map without buildings. It is the shortest time there, because all
    times are above 0, and therefore consistent. Nodes with equal estimates are settled in the order
    of their numbers. Those that wait are in a heap by estimate and number: its two arrays.
    """
    levels, nx, ny = blocked.shape
    x0, y0, z0, x1, y1, z1 = ends
    source, target = (z0 * nx + x0) * ny + y0, (z1 * nx + x1) * ny + y1
    cost[source] = 0
    estimates_us[0], waiting[0], count = 0, source, 1
    while count > 0 and waiting[0] != target:
        node = waiting[0]
        count -= 1
        _take_first(estimates_us, waiting, count)
        level, ix, iy = node // (nx * ny), node // ny % nx, node % ny
        for move in range(6):
            step = 1 - 2 * (move & 1)
            jx = ix + step if move < 2 else ix
            jy = iy + step if 2 <= move < 4 else iy
            jz = level + step if move >= 4 else level
            on_map = 0 <= jx < nx and 0 <= jy < ny and 0 <= jz < levels
            if not on_map or blocked[jz, jx, jy]:
                continue
            neighbour = (jz * nx + jx) * ny + jy
            through = cost[node] + hop_us[move]
            if through < cost[neighbour]:
                cost[neighbour], came_from[neighbour] = through, node
                estimate_us = through + time_on_open_map(hop_us, x1 - jx, y1 - jy, z1 - jz)
                _put(estimates_us, waiting, count, estimate_us, neighbour)
                count += 1


@kernel
def _put(
    keys: NDArray[np.int64], values: NDArray[np.int64], count: int, key: int, value: int
) -> None:
    """Add an entry to a heap of ``count`` entries, the first of which is the least."""
    k = count
    while k > 0:
        above = (k - 1) >> 1
        if keys[above] < key or (keys[above] == key and values[above] <= value):
            break
        keys[k], values[k] = keys[above], values[above]
        k = above
    keys[k], values[k] = key, value


@kernel
def _take_first(keys: NDArray[np.int64], values: NDArray[np.int64], count: int) -> None:
    """Remove the first entry of a heap, in which ``count`` entries remain."""
    key, value, k, below = keys[count], values[count], 0, 1
    while below < count:
        other = below + 1
        if other < count and (
            keys[other] < keys[below]
            or (keys[other] == keys[below] and values[other] < values[below])
        ):
            below = other
        if key < keys[below] or (key == keys[below] and value <= values[below]):
            break
        keys[k], values[k] = keys[below], values[below]
        k, below = below, 2 * below + 1
    keys[k], values[k] = key, value
