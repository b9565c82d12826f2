"""What a type of drones needs for free flight in a world: its limits, obstacles, and ways home."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from desim_uav.model.geometry.grid import Grid
from desim_uav.model.geometry.prisms import Prisms, Zone, deepest_at, first_entry, obstacles
from desim_uav.model.geometry.roads import Roads, roads
from desim_uav.model.motion.flight import no_faster
from desim_uav.model.motion.legs import (
    FreeLeg,
    direction,
    leg_between,
    speed_within,
)
from desim_uav.model.motion.limits import Limits, Wind, wind_along
from desim_uav.model.motion.motion import REST, BangCoastBang, Transit, cruise_of, trapezoid
from desim_uav.model.radio.tracks import Point
from desim_uav.model.rules import US

ANY_SPEED = math.inf

NO_CHOICE = (ANY_SPEED, ANY_SPEED)
"""The cruise speeds of drones whose commands choose none: they always fly in minimum time."""

MOST_LINES = 2 * 10**8
"""The largest number of lines between nodes, at all altitudes, that are checked for obstacles: this
takes about a minute."""


class Ways(NamedTuple):
    """The ways home at one altitude, down to the stations.

    ``times_us`` (stations, nodes) is the time from a node until the drone lands on a station, in
    microseconds, and ``drains`` is the battery that this takes. Both are -1 if there is no way.
    """

    roads: Roads
    times_us: NDArray[np.int64]
    drains: NDArray[np.int64]

    @property
    def altitude_m(self) -> float:
        """The altitude, in metres."""
        return self.roads.altitude_m


class Space(NamedTuple):
    """The limits of a type of drones, its grown obstacles, and its ways home by level (or none).

    ``cruise_mps`` are the least and the greatest speed that a command can choose, through the air.
    ``whole_map`` says whether commands name places on the map instead of displacements.
    """

    limits: Limits
    wind: Wind
    prisms: Prisms
    levels: tuple[Ways, ...]
    cruise_mps: tuple[float, float] = NO_CHOICE
    whole_map: bool = False

    @property
    def nodes(self) -> int:
        """The largest number of nodes of a graph of ways home."""
        return max((len(ways.roads.nodes_m) for ways in self.levels), default=0)

    def most_s(self, step_s: float) -> float:
        """Return for how long the leg of a command may last, in seconds: a step, or for ever."""
        return math.inf if self.whole_map else step_s

    @property
    def commanded(self) -> Limits:
        """The limits of commands, which fly no faster than at the greatest cruise speed."""
        return no_faster(self.limits, min(self.limits.level_mps, self.cruise_mps[1]))

    def leg(self, start: Point, stop: Point, duration_us: int) -> FreeLeg:
        """Return the leg between two places that takes so long: in minimum time, or slower.

        A slower one is that of the speed at which it takes this time, if commands can choose it.
        """
        leg = leg_between(self.limits, self.wind, ANY_SPEED, start, stop)
        if duration_us <= leg.duration_us or self.cruise_mps == NO_CHOICE:
            return leg
        speed = speed_within(leg.distance_m, leg.acceleration_mps2, duration_us / US)
        return leg_between(self.limits, self.wind, speed, start, stop)


def limits_of(motion: BangCoastBang) -> Limits:
    """Return the limits of drones that fly by a motion."""
    return Limits(
        float(motion.max_speed_mps),
        float(motion.max_acceleration_mps2),
        float(motion.climb_mps),
        float(motion.descent_mps),
        float(motion.vertical_mps2),
    )


def flight_of(leg: FreeLeg, wind: Wind) -> Transit:
    """Return a free leg in wind as a transit."""
    if leg.distance_m == 0.0:
        return REST
    profile = np.array(
        trapezoid(leg.distance_m, leg.speed_mps, leg.acceleration_mps2, leg.duration_s)
    )
    rises = (leg.route[5] - leg.route[2]) / leg.distance_m
    tail_mps, side_mps = wind_along(wind, direction(leg.route[:3], leg.route[3:])[0])
    return Transit(profile, leg.duration_us, leg.distance_m, rises, tail_mps, side_mps)


def space_of(
    motion: Any,
    wind: Wind,
    energy: Any,
    grid: Grid,
    zones: Sequence[Zone],
    stations_m: NDArray[np.float64],
) -> Space:
    """Return the space of a type of drones; without an ``energy`` model it needs no ways home.

    Raises ValueError if a station is in an obstacle, or if there are too many corners.
    """
    limits, speeds = limits_of(motion), cruise_of(motion)
    cruise_mps = (float(speeds[0]), float(speeds[-1])) if speeds else NO_CHOICE
    prisms = obstacles(grid.height_m, grid.cell_m, zones, motion.margin_m, grid.city)
    whole_map = motion.reach == "map"
    if energy is None:
        return Space(limits, wind, prisms, (), cruise_mps, whole_map)
    nodes, levels = len(prisms.corners_m) + len(stations_m), len(grid.levels_m)
    if levels * nodes * nodes > MOST_LINES:
        raise ValueError(
            f"ways home at {levels} altitudes round {len(prisms.corners_m)} corners of obstacles "
            f"take too long to find; there must be fewer obstacles or levels"
        )
    size_m = (grid.width_m, grid.depth_m)
    finder = _Finder(limits, wind, energy, prisms, grid.levels_m[0])
    for number, (x, y) in enumerate(stations_m.tolist()):
        require_free(prisms, (x, y, grid.levels_m[0]), f"station {number}")
    ways = tuple(
        finder.ways(_roads_at(prisms, altitude_m, stations_m, size_m))
        for altitude_m in grid.levels_m
    )
    return Space(limits, wind, prisms, ways, cruise_mps, whole_map)


def require_free(prisms: Prisms, at: Point, what: str) -> None:
    """Raise ValueError if a place is in an obstacle or its margin."""
    if deepest_at(prisms, at) > 0.0:
        x, y, z = at
        raise ValueError(
            f"{what} at ({x:g}, {y:g}) m is in an obstacle, or within margin_m of one, at {z:g} m"
        )


def _roads_at(
    prisms: Prisms,
    altitude_m: float,
    stations_m: NDArray[np.float64],
    size_m: tuple[float, float],
) -> Roads:
    """Return the ways at an altitude to the stations that are not under an obstacle there.

    The others have no ways.
    """
    open_ = [deepest_at(prisms, (x, y, altitude_m)) <= 0.0 for x, y in stations_m.tolist()]
    network = roads(prisms, altitude_m, stations_m[np.array(open_, bool)], size_m)
    if all(open_):
        return network
    lacking, (count, nodes) = len(stations_m) - sum(open_), network.lengths_m.shape
    lengths_m = np.full((len(stations_m), nodes + lacking), np.inf)
    following = np.full((len(stations_m), nodes + lacking), -1, np.int64)
    nodes_m = np.concatenate([stations_m, network.nodes_m[count:]])
    new = np.concatenate([np.flatnonzero(open_), np.arange(len(stations_m), len(nodes_m))])
    for old, station in enumerate(np.flatnonzero(open_).tolist()):
        lengths_m[station, new] = network.lengths_m[old]
        ahead = network.following[old]
        following[station, new] = np.where(ahead < 0, -1, new[ahead])
    return Roads(nodes_m, lengths_m, following, network.altitude_m)


class _Finder:
    """Finds what the ways home take."""

    def __init__(
        self, limits: Limits, wind: Wind, energy: Any, prisms: Prisms, lowest_m: float
    ) -> None:
        self.limits, self.wind, self.energy = limits, wind, energy
        self.prisms, self.lowest_m = prisms, lowest_m

    def ways(self, roads: Roads) -> Ways:
        """Return ways with what they take."""
        times_us = np.full(roads.lengths_m.shape, -1, np.int64)
        drains = times_us.copy()
        for station, lengths_m in enumerate(roads.lengths_m):
            landing = self._landing(roads, station)
            if landing is None:
                continue
            times_us[station, station], drains[station, station] = landing
            for node in np.argsort(lengths_m, kind="stable").tolist():
                ahead = int(roads.following[station, node])
                if ahead < 0 or times_us[station, ahead] < 0:
                    continue
                takes_us, drained = self._takes(_at(roads, node), _at(roads, ahead))
                times_us[station, node] = times_us[station, ahead] + takes_us
                drains[station, node] = drains[station, ahead] + drained
        return Ways(roads, times_us, drains)

    def _landing(self, roads: Roads, station: int) -> tuple[int, int] | None:
        """Return what the descent to a station takes; None if it is not free."""
        over = _at(roads, station)
        low = (over[0], over[1], self.lowest_m)
        if roads.lengths_m[station, station] != 0.0:
            return None
        if first_entry(self.prisms, over, low) != np.inf:
            return None
        return self._takes(over, low)

    def _takes(self, start: Point, stop: Point) -> tuple[int, int]:
        """Return the time of a leg in µs, and what it takes of the battery."""
        leg = leg_between(self.limits, self.wind, ANY_SPEED, start, stop)
        if leg.distance_m == 0.0:
            return 0, 0
        flight = flight_of(leg, self.wind)
        return flight.duration_us, int(self.energy.drain_of(flight, flight.duration_us))


def _at(ways: Roads, node: int) -> Point:
    x, y = ways.nodes_m[node].tolist()
    return x, y, ways.altitude_m
