"""Plans returns to the nearest charging station, by A* over (cell, level) in minimum time."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from heapq import heappop, heappush

import numpy as np
from numpy.typing import NDArray

from desim_uav.model.geometry.grid import Cell, Grid
from desim_uav.rowcode.kernels import kernel, maker

Node = tuple[int, int, int]
"""(cell x, cell y, level)."""


HOPS: dict[Node, Node] = {
    hop: hop for hop in ((1, 0, 0), (-1, 0, 0), (0, 1, 0), (0, -1, 0), (0, 0, 1), (0, 0, -1))
}
"""The hops there are: all plans share these, since a large map has millions of hops."""

DIRECTIONS: dict[Node, int] = {hop: number for number, hop in enumerate(HOPS)}
"""The numbers of the hops, in the order of HOPS."""


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
            goal = np.array((*self.stations[station], 0))
            path = shortest_path(blocked, np.array(self.hop_us), np.array(start), goal)
            if len(path) == 0:
                continue
            hops = tuple(HOPS[dx, dy, dz] for dx, dy, dz in np.diff(path, axis=0).tolist())
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
        hop_us = np.array(self.hop_us)
        return [
            (int(time_on_open_map(hop_us, ix - start[0], iy - start[1], -start[2])), station)
            for station, (ix, iy) in enumerate(self.stations)
        ]


@kernel
def time_on_open_map(hop_us: NDArray[np.int64], dx: int, dy: int, dlevel: int) -> int:
    """Return the shortest time for a distance in cells and levels on a map without buildings."""
    time_us = hop_us[0] * dx if dx > 0 else hop_us[1] * -dx
    time_us += hop_us[2] * dy if dy > 0 else hop_us[3] * -dy
    time_us += hop_us[4] * dlevel if dlevel > 0 else hop_us[5] * -dlevel
    return int(time_us)


@maker
def shortest_path(
    blocked: NDArray[np.bool_],
    hop_us: NDArray[np.int64],
    start: NDArray[np.int64],
    goal: NDArray[np.int64],
) -> NDArray[np.int64]:
    """Return the quickest path from ``start`` to ``goal`` (x, y, level) by A*: (hops + 1, 3).

    The path includes both ends; its shape is (0, 3) if there is none. ``blocked`` has the shape
    (level, x, y); the start may be blocked, and ``hop_us`` the time of each of the HOPS. The
    estimate is the time on a map without buildings. It is the shortest time there, because all
    times are above 0, and therefore consistent, so that each node is settled once. Nodes with equal
    estimates are settled in the order of their numbers.
    """
    levels, nx, ny = blocked.shape
    nodes = levels * nx * ny
    far = np.int64(2**62)
    cost = np.full(nodes, far)
    came_from = np.full(nodes, -1, np.int64)
    settled = np.zeros(nodes, np.bool_)
    heap = [(np.int64(0), np.int64(0))]
    heap.pop()
    source = (start[2] * nx + start[0]) * ny + start[1]
    target = (goal[2] * nx + goal[0]) * ny + goal[1]
    cost[source] = 0
    heappush(heap, (np.int64(0), np.int64(source)))
    while len(heap) > 0:
        node = heappop(heap)[1]
        if settled[node]:
            continue
        settled[node] = True
        if node == target:
            break
        level, ix, iy = node // (nx * ny), node // ny % nx, node % ny
        for move in range(6):
            jx, jy, jz = ix, iy, level
            step = 1 if move % 2 == 0 else -1
            if move < 2:
                jx += step
            elif move < 4:
                jy += step
            else:
                jz += step
            if not (0 <= jx < nx and 0 <= jy < ny and 0 <= jz < levels):
                continue
            if blocked[jz, jx, jy]:
                continue
            neighbour = (jz * nx + jx) * ny + jy
            through = cost[node] + hop_us[move]
            if through < cost[neighbour]:
                cost[neighbour] = through
                came_from[neighbour] = node
                rest_us = time_on_open_map(hop_us, goal[0] - jx, goal[1] - jy, goal[2] - jz)
                estimate = through + rest_us
                heappush(heap, (np.int64(estimate), np.int64(neighbour)))
    if not settled[target]:
        return np.empty((0, 3), np.int64)
    length = 1
    node = target
    while node != source:
        node = came_from[node]
        length += 1
    path = np.empty((length, 3), np.int64)
    node = target
    for k in range(length - 1, -1, -1):
        path[k, 0], path[k, 1], path[k, 2] = node // ny % nx, node % ny, node // (nx * ny)
        node = came_from[node]
    return path
