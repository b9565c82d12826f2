"""The shortest ways round obstacles at one altitude, from any place to each station.

A shortest way consists of straight lines between corners of obstacles. So the graph of all corners
and stations that see each other, the visibility graph, contains the rest of a shortest way from
wherever it first bends. For each station, the shortest ways from all nodes are a tree, which is
computed once. From any other place, the way is the straight line to one of the nodes that can be
seen, and on along the tree. A way that goes straight on at a corner does not stop there.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from desim_uav.model.geometry.prisms import TOUCH_M, Prisms, deepest_at, first_entry
from desim_uav.model.motion.legs import leg_between
from desim_uav.model.motion.limits import Limits, Wind
from desim_uav.model.radio.tracks import Point
from desim_uav.rowcode.kernels import kernel, maker, part

MOST_NODES = 2000
"""The most corners and stations of a graph: its table has the square of this number of entries."""

EQUAL_M = 1e-9
"""Ways whose lengths differ by no more are equally long: a line, and the same line with a stop."""


class Roads(NamedTuple):
    """The shortest ways from each node of a visibility graph to each station, at one altitude.

    ``nodes_m`` (nodes, 2) has the stations first, then corners. ``lengths_m`` (stations, nodes) are
    the lengths of the ways, inf where there is none, and ``following`` (stations, nodes) the next
    node on the way, or -1 at the station and where there is no way.
    """

    nodes_m: NDArray[np.float64]
    lengths_m: NDArray[np.float64]
    following: NDArray[np.int64]
    altitude_m: float


def roads(
    prisms: Prisms,
    altitude_m: float,
    stations_m: NDArray[np.float64],
    size_m: tuple[float, float],
) -> Roads:
    """Return the ways to stations (stations, 2) on a map of this width and depth.

    Raises ValueError if a station is in an obstacle or if there are more nodes than MOST_NODES.
    """
    for number, (x, y) in enumerate(stations_m.tolist()):
        if deepest_at(prisms, (x, y, altitude_m)) > TOUCH_M:
            raise ValueError(
                f"station {number} at ({x:g}, {y:g}) is in an obstacle or its margin at "
                f"{altitude_m:g} m"
            )
    corners = corners_at(prisms, altitude_m, size_m)
    nodes = len(stations_m) + len(corners)
    if nodes > MOST_NODES:
        raise ValueError(
            f"obstacles have {len(corners)} corners at {altitude_m:g} m, and there are "
            f"{len(stations_m)} stations: more than {MOST_NODES} nodes"
        )
    nodes_m = np.concatenate([stations_m.reshape(-1, 2), prisms.corners_m[corners]])
    sides = np.concatenate([np.zeros((len(stations_m), 4)), _sides(prisms)[corners]])
    lines_m = _lines(prisms, nodes_m, sides, altitude_m)
    lengths_m = np.empty((len(stations_m), nodes))
    following = np.empty((len(stations_m), nodes), np.int64)
    for station in range(len(stations_m)):
        _grow_tree(lines_m, station, lengths_m[station], following[station])
    return Roads(nodes_m, lengths_m, following, float(altitude_m))


def corners_at(prisms: Prisms, altitude_m: float, size_m: tuple[float, float]) -> NDArray[np.int64]:
    """Return the corners on the map of obstacles at an altitude that no other obstacle covers."""
    bottom, top = prisms.heights_m.T
    stands = (bottom + TOUCH_M < altitude_m) & (altitude_m < top - TOUCH_M)
    rows = np.flatnonzero(np.repeat(stands, np.diff(prisms.offsets)))
    places = prisms.corners_m[rows]
    on_map = ((places >= 0.0) & (places <= np.array(size_m))).all(axis=1)
    free = [deepest_at(prisms, (x, y, altitude_m)) <= TOUCH_M for x, y in places[on_map].tolist()]
    corners: NDArray[np.int64] = rows[on_map][np.array(free, bool)]
    return corners


def _sides(prisms: Prisms) -> NDArray[np.float64]:
    """Return the directions of the walls that end and that begin at each corner: (corners, 4)."""
    directions = np.empty((len(prisms.corners_m), 4))
    for first, last in zip(prisms.offsets[:-1], prisms.offsets[1:], strict=True):
        corners = prisms.corners_m[first:last]
        directions[first:last, :2] = corners - np.roll(corners, 1, axis=0)
        directions[first:last, 2:] = np.roll(corners, -1, axis=0) - corners
    return directions


@maker
def _lines(
    prisms: Prisms, nodes_m: NDArray[np.float64], sides: NDArray[np.float64], altitude_m: float
) -> NDArray[np.float64]:
    """Return the lengths of straight lines between nodes that see each other: (nodes, nodes).

    The others are inf. Lines that would cut into the obstacle at one of their ends if they went on,
    or that leave it with a bend away from it, are on no shortest way, and are left out.
    """
    count = len(nodes_m)
    lengths_m = np.full((count, count), np.inf)
    for i in range(count):
        for j in range(i + 1, count):
            dx, dy = nodes_m[j, 0] - nodes_m[i, 0], nodes_m[j, 1] - nodes_m[i, 1]
            if not (_touches(sides[i], dx, dy) and _touches(sides[j], dx, dy)):
                continue
            start = (nodes_m[i, 0], nodes_m[i, 1], altitude_m)
            stop = (nodes_m[j, 0], nodes_m[j, 1], altitude_m)
            if first_entry(prisms, start, stop) == np.inf:
                lengths_m[i, j] = lengths_m[j, i] = np.sqrt(dx * dx + dy * dy)
    return lengths_m


@part
def _touches(sides: NDArray[np.float64], dx: float, dy: float) -> bool:
    """Return whether a line through a corner has its obstacle on one side, and at most touches."""
    into = sides[0] * dy - sides[1] * dx
    out = sides[2] * dy - sides[3] * dx
    length = np.sqrt(dx * dx + dy * dy)
    one = np.sqrt(sides[0] * sides[0] + sides[1] * sides[1])
    other = np.sqrt(sides[2] * sides[2] + sides[3] * sides[3])
    return bool(
        abs(into) <= 1e-9 * one * length
        or abs(out) <= 1e-9 * other * length
        or (into > 0.0) != (out > 0.0)
    )


@maker
def _grow_tree(
    lines_m: NDArray[np.float64],
    station: int,
    lengths_m: NDArray[np.float64],
    following: NDArray[np.int64],
) -> None:
    """Write the tree of shortest ways to a station, by Dijkstra's algorithm.

    Of equally long ways to settle next, that of the node with the lowest number is taken. Of
    equally long ways from a node, that over the node nearest to the station is: it does not stop at
    corners which it passes straight on.
    """
    count = len(lines_m)
    settled = np.zeros(count, np.bool_)
    lengths_m[:], following[:] = np.inf, -1
    lengths_m[station] = 0.0
    for _ in range(count):
        node, least = -1, np.inf
        for k in range(count):
            if not settled[k] and lengths_m[k] < least:
                node, least = k, lengths_m[k]
        if node < 0:
            return
        settled[node] = True
        for k in range(count):
            through = least + lines_m[node, k]
            if through < lengths_m[k] - EQUAL_M:
                lengths_m[k], following[k] = through, node


@part
def _look(ways: Roads, x: float, y: float, away_m: NDArray[np.float64]) -> None:
    """Write how far all nodes are from a place."""
    for k in range(len(ways.nodes_m)):
        dx, dy = ways.nodes_m[k, 0] - x, ways.nodes_m[k, 1] - y
        away_m[k] = np.sqrt(dx * dx + dy * dy)


@kernel
def _first_seen(
    prisms: Prisms, ways: Roads, station: int, x: float, y: float, away_m: NDArray[np.float64]
) -> tuple[int, float]:
    """Return the first node of the shortest way from a place to a station, and the way's length.

    The node is -1 and the length inf if there is no way. The rest of the way is ``following``.
    ``away_m`` (nodes,) has how far all nodes are from the place (``_look``).

    Nodes are tried in the order of the lengths of the ways over them, so the first one that can be
    seen is on a shortest way. Of equally long ways, that with the longest line to its first node is
    taken: it does not stop at corners which it passes straight on.
    """
    before, last = -1.0, -1
    while True:
        node, length = -1, np.inf
        for k in range(len(ways.nodes_m)):
            through = away_m[k] + ways.lengths_m[station, k]
            if through < length and (through > before or (through == before and k > last)):
                node, length = k, through
        if node < 0:
            return -1, np.inf
        if _sees(prisms, ways, x, y, node):
            break
        before, last = length, node
    for k in range(len(ways.nodes_m)):
        equal = away_m[k] + ways.lengths_m[station, k] <= length + EQUAL_M
        if equal and away_m[k] > away_m[node] and _sees(prisms, ways, x, y, k):
            node = k
    return node, length


@part
def _sees(prisms: Prisms, ways: Roads, x: float, y: float, node: int) -> bool:
    """Return whether a node can be seen from a place."""
    here = (x, y, ways.altitude_m)
    there = (ways.nodes_m[node, 0], ways.nodes_m[node, 1], ways.altitude_m)
    return bool(first_entry(prisms, here, there) == np.inf)


@part
def _at(ways: Roads, node: int) -> Point:
    return ways.nodes_m[node, 0], ways.nodes_m[node, 1], ways.altitude_m


@kernel
def way_home(
    prisms: Prisms,
    ways: Roads,
    times_us: NDArray[np.int64],
    limits: Limits,
    wind: Wind,
    cruise_mps: float,
    x: float,
    y: float,
    away_m: NDArray[np.float64],
) -> tuple[int, int, int]:
    """Return the station that is reached first, the first node of the way, and the time in µs.

    To each station the drone takes the shortest way, in minimum time; ``times_us`` (stations,
    nodes) is that from each node, or -1. Of stations that are reached at the same time, that with
    the lowest number is taken; if none is reached, all three numbers are -1. ``away_m`` (nodes,) is
    memory.
    """
    _look(ways, x, y, away_m)
    best, first, soonest = -1, -1, -1
    for station in range(len(times_us)):
        node, _ = _first_seen(prisms, ways, station, x, y, away_m)
        if node < 0 or times_us[station, node] < 0:
            continue
        leg = leg_between(limits, wind, cruise_mps, (x, y, ways.altitude_m), _at(ways, node))
        if leg.duration_us < 0:
            continue
        total = leg.duration_us + times_us[station, node]
        if best < 0 or total < soonest:
            best, first, soonest = station, node, total
    return best, first, soonest
