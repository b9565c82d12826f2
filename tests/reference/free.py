"""The fixed-step simulator for drones that fly freely: straight legs, obstacles, ways home.

A command has three numbers from -1 to 1 and one that asks for a charge if it is above 0. With
cruise speeds, a fifth one chooses between them; a leg that is then too slow fills the step. Limits
on level and on vertical flight become one along a direction. In wind, that on level flight is one
on the speed through the air, and the highest ground speed is found by bisection. Obstacles are
boxes along the axes, which are grown on all sides; a leg that would enter one ends at its wall.
Returns follow a shortest way over the boxes' corners at one altitude, by Dijkstra's algorithm, and
stop where it bends.
"""

from __future__ import annotations

import heapq
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from itertools import pairwise

from tests.reference.fixed_step import FixedStep
from tests.reference.flight import Drone, Hop, filling, over_ground, quickest
from tests.reference.inputs import US, Inputs, Result

Point = tuple[float, float, float]
Box = tuple[Point, Point]
"""The lowest and the highest corner."""

TOUCHES_M = 1e-6
"""A way that gets no deeper into a box only touches it."""


@dataclass(frozen=True)
class Space:
    """Limits of flight, the map and its obstacles, which are not grown yet.

    ``highest_m`` is the highest altitude of each drone. ``levels_m`` are the altitudes of ways.
    """

    level_mps: float
    level_mps2: float
    climb_mps: float
    descent_mps: float
    vertical_mps2: float
    size_m: tuple[float, float]
    levels_m: Sequence[float]
    highest_m: Sequence[float]
    boxes: Sequence[Box]
    margin_m: float
    wind_mps: tuple[float, float] = (0.0, 0.0)
    cruise_mps: tuple[float, float] | None = None

    def grown(self) -> list[Box]:
        """The boxes with the margin on all sides."""
        m = self.margin_m
        return [
            ((low[0] - m, low[1] - m, low[2] - m), (high[0] + m, high[1] + m, high[2] + m))
            for low, high in self.boxes
        ]

    def along(self, ahead: Point, *, calm: bool = False) -> tuple[float, float]:
        """The speed and the acceleration that no limit forbids in a direction of length 1.

        ``calm``: as if there were no wind.
        """
        level, up = math.hypot(ahead[0], ahead[1]), ahead[2]
        speeds = [self.level_mps / level] if level else []
        if level and not calm and self.wind_mps != (0.0, 0.0):
            flat = (ahead[0] / level, ahead[1] / level, 0)
            speeds = [over_ground(self.wind_mps, flat, self.level_mps) / level]
        accelerations = [self.level_mps2 / level] if level else []
        if up:
            speeds.append((self.climb_mps if up > 0 else self.descent_mps) / abs(up))
            accelerations.append(self.vertical_mps2 / abs(up))
        return min(speeds), min(accelerations)

    def leg(self, start: Point, stop: Point) -> Hop:
        """The quickest flight from rest to rest."""
        length_m = math.dist(start, stop)
        return quickest(length_m, *self.along(unit(start, stop)))

    def steered(self, start: Point, stop: Point, number: float, step_s: float) -> Hop:
        """The flight of a command whose ``number`` chooses a cruise speed, if there is a choice."""
        if self.cruise_mps is None:
            return self.leg(start, stop)
        low, high = self.cruise_mps
        chosen = low + (high - low) * (1.0 + max(-1.0, min(1.0, number))) / 2.0
        hop = replace(self, level_mps=chosen).leg(start, stop)
        quickest_hop = replace(self, level_mps=high).leg(start, stop)
        if hop.duration_s <= step_s or quickest_hop.duration_s >= step_s:
            return hop if hop.duration_s <= step_s else quickest_hop
        return filling(hop.distance_m, step_s, hop.acceleration_mps2)

    def furthest_m(self, ahead: Point, lasts_s: float, *, calm: bool = False) -> float:
        """The length of a flight from rest to rest that takes so long."""
        speed, acceleration = self.along(ahead, calm=calm)
        ramps_s = 2 * speed / acceleration
        if lasts_s >= ramps_s:
            return speed * (lasts_s - ramps_s / 2)
        return acceleration * (lasts_s / 2) ** 2

    def target(self, at: Point, command: Sequence[float], highest_m: float, step_s: float) -> Point:
        """The place that a command names."""
        if self.cruise_mps is not None and self.level_mps != self.cruise_mps[1]:
            highest = replace(self, level_mps=self.cruise_mps[1])
            return highest.target(at, command, highest_m, step_s)
        east, north, up = (max(-1.0, min(1.0, part)) for part in command[:3])
        level_m = self.furthest_m((1.0, 0.0, 0.0), step_s, calm=True)
        vertical_m = self.furthest_m((0.0, 0.0, math.copysign(1.0, up)), step_s)
        towards = (east * level_m, north * level_m, up * vertical_m)
        if towards == (0.0, 0.0, 0.0):
            return at
        ahead = unit((0.0, 0.0, 0.0), towards)
        share = min(1.0, max(math.hypot(east, north), abs(up)))
        length_m = share * self.furthest_m(ahead, step_s)
        limits = ((0.0, self.size_m[0]), (0.0, self.size_m[1]), (self.levels_m[0], highest_m))
        stop = tuple(
            max(low, min(high, here + length_m * part))
            for here, part, (low, high) in zip(at, ahead, limits, strict=True)
        )
        if math.dist(at, stop) == 0.0:
            return at
        most_m = self.furthest_m(unit(at, stop), step_s)
        return stop if math.dist(at, stop) <= most_m else part_of(at, stop, most_m)


def unit(start: Point, stop: Point) -> Point:
    """The direction from one place to another."""
    length_m = math.dist(start, stop)
    x, y, z = ((b - a) / length_m for a, b in zip(start, stop, strict=True))
    return x, y, z


def far(start: Point, stop: Point) -> bool:
    """Are two places so far apart that a drone flies from one to the other?"""
    return math.dist(start, stop) >= TOUCHES_M


def part_of(start: Point, stop: Point, length_m: float) -> Point:
    """The place so far on the way."""
    share = length_m / math.dist(start, stop)
    x, y, z = (a + share * (b - a) for a, b in zip(start, stop, strict=True))
    return x, y, z


def bends(way: Sequence[Point]) -> list[Point]:
    """A way without the places at which it goes straight on."""
    found = list(way[:1])
    for here, after in pairwise(way[1:]):
        if math.dist(found[-1], here) + math.dist(here, after) > math.dist(found[-1], after) + 1e-9:
            found.append(here)
    return [*found, way[-1]]


def inside(start: Point, stop: Point, box: Box, inset_m: float = 0.0) -> tuple[float, float]:
    """From which to which share of a way it is inside a box; nowhere if the first is not less."""
    enters, leaves = -math.inf, math.inf
    for a, b, lowest, highest in zip(start, stop, *box, strict=True):
        low, high = lowest + inset_m, highest - inset_m
        if a == b:
            if not low < a < high:
                return math.inf, -math.inf
            continue
        first, last = sorted(((low - a) / (b - a), (high - a) / (b - a)))
        enters, leaves = max(enters, first), min(leaves, last)
    return enters, leaves


def stopped_at(start: Point, stop: Point, boxes: Sequence[Box]) -> float:
    """The share of a way after which it would enter a box: infinity if it enters none."""
    found = math.inf
    for box in boxes:
        enters, leaves = inside(start, stop, box, TOUCHES_M)
        if max(enters, 0.0) < min(leaves, 1.0):
            found = min(found, max(0.0, inside(start, stop, box)[0]))
    return found


class Homes:
    """Shortest ways to stations at one altitude."""

    def __init__(self, space: Space, stations: Sequence[Point], altitude_m: float) -> None:
        self.space, self.altitude_m = space, altitude_m
        self.boxes = space.grown()
        self.stations = [(x, y, altitude_m) for x, y, _ in stations]
        corners = [
            (x, y, altitude_m)
            for low, high in self.boxes
            if low[2] < altitude_m < high[2]
            for x in (low[0], high[0])
            for y in (low[1], high[1])
        ]
        on_map = [
            at
            for at in corners
            if all(0 <= part <= size for part, size in zip(at[:2], space.size_m, strict=True))
        ]
        self.nodes = [*self.stations, *(at for at in on_map if self.is_open(at))]
        self.open = [self.is_open(at) for at in self.stations]
        self.trees = [self._tree(number) for number in range(len(self.stations))]

    def is_open(self, at: Point) -> bool:
        return not any(
            all(
                low + TOUCHES_M < part < high - TOUCHES_M
                for part, low, high in zip(at, *box, strict=True)
            )
            for box in self.boxes
        )

    def sees(self, one: Point, other: Point) -> bool:
        return stopped_at(one, other, self.boxes) == math.inf

    def _tree(self, station: int) -> dict[int, tuple[float, int]]:
        """The length from each node, and the node that follows."""
        tree: dict[int, tuple[float, int]] = {}
        heap = [(0.0, station, -1)] if self.open[station] else []
        while heap:
            length_m, node, following = heapq.heappop(heap)
            if node in tree:
                continue
            tree[node] = length_m, following
            for other, at in enumerate(self.nodes):
                if other not in tree and self.sees(self.nodes[node], at):
                    heapq.heappush(heap, (length_m + math.dist(self.nodes[node], at), other, node))
        return tree

    def way(self, at: Point) -> tuple[int, list[Point]] | None:
        """The time and the places of the way home from a place of this altitude."""
        best = None
        for station, tree in enumerate(self.trees):
            seen = [
                (math.dist(at, self.nodes[node]) + tree[node][0], node)
                for node in tree
                if self.sees(at, self.nodes[node])
            ]
            if not seen:
                continue
            _, node = min(seen)
            places = []
            while node >= 0:
                places.append(self.nodes[node])
                node = tree[node][1]
            landing = (*self.stations[station][:2], self.space.levels_m[0])
            way = [*bends([at, *places]), landing]
            time_us = self.takes_us(way)
            if self.clear(landing) and (best is None or time_us < best[0]):
                best = time_us, way[1:]
        return best

    def clear(self, landing: Point) -> bool:
        """Can a drone descend to the station?"""
        return self.sees((*landing[:2], self.altitude_m), landing)

    def takes_us(self, way: Sequence[Point]) -> int:
        legs = [(a, b) for a, b in pairwise(way) if far(a, b)]
        return sum(round(self.space.leg(a, b).duration_s * US) for a, b in legs)


class Freely(FixedStep):
    """One episode, tick by tick; ``commands[step][drone]`` are four numbers, or five."""

    def __init__(self, inputs: Inputs, space: Space, dt_us: int) -> None:
        super().__init__(inputs, dt_us)
        self.space, self.boxes = space, space.grown()
        self.at = [self._over(start) for start in inputs.starts]
        self.to: list[Point | None] = [None] * len(self.at)
        self.ways: list[list[Point]] = [[] for _ in self.at]
        self.stations_m = [self._over(cell) for cell in inputs.stations]
        self.homes = [Homes(space, self.stations_m, z) for z in space.levels_m]
        for drone in self.drones:
            self._rest(drone)

    def _over(self, cell: tuple[int, int]) -> Point:
        (dx, dy), (x, y) = self.inputs.cell_m, cell
        return (x + 0.5) * dx, (y + 0.5) * dy, self.space.levels_m[0]

    # ---- legs

    def _rest(self, drone: Drone) -> None:
        """Let a drone stay where it is; its node is the station under it, or no cell."""
        here, drone.hop, drone.node = self.at[drone.index], None, (-1, -1, -1)
        for cell, at in zip(self.inputs.stations, self.stations_m, strict=True):
            if not far(here, at):
                drone.node = (*cell, 0)

    def _set_out(self, drone: Drone, stop: Point, since_us: int, flight: Hop | None = None) -> None:
        self.to[drone.index] = stop
        flight = flight or self.space.leg(self.at[drone.index], stop)
        self._take_hop(drone, (0, 0, 0), since_us, flight)

    def _arrive(self, drone: Drone, t_us: int) -> None:
        while drone.hop is not None and t_us >= drone.until_us:
            self.at[drone.index] = self.to[drone.index]
            self._rest(drone)
            if drone.mode == "returning":
                self._fly_on(drone, drone.until_us)

    def _fly_on(self, drone: Drone, since_us: int) -> None:
        way = self.ways[drone.index]
        while way and not far(self.at[drone.index], way[0]):
            self.at[drone.index] = way.pop(0)
        if way:
            self._set_out(drone, way.pop(0), since_us)
        else:
            self._rest(drone)
            self._land(drone)

    def _position(self, drone: Drone, t_us: int) -> Point:
        if drone.mode == "crashed":
            return drone.crash_position_m
        here = self.at[drone.index]
        if drone.hop is None:
            return here
        return part_of(
            here, self.to[drone.index], drone.flight.flown_m((t_us - drone.since_us) / US)
        )

    # ---- decisions

    def _home(self, drone: Drone) -> list[Point] | None:
        """The places of the way home over the nearest altitude from which there is one."""
        here = self.at[drone.index]
        levels = [
            home for home in self.homes if home.altitude_m <= self.space.highest_m[drone.index]
        ]
        for home in sorted(levels, key=lambda home: abs(home.altitude_m - here[2])):
            over = (*here[:2], home.altitude_m)
            if not home.sees(here, over):
                continue
            found = home.way(over)
            if found is not None:
                _, places = found
                return [over, *places]
        return None

    def _return(self, drone: Drone, epoch: int) -> float | None:
        if self.inputs.capacity is None or drone.hop is not None or drone.mode == "crashed":
            return None
        places = self._home(drone)
        if places is None:
            return math.inf
        legs = [(a, b) for a, b in pairwise([self.at[drone.index], *places]) if far(a, b)]
        return sum(self._takes(self.space.leg(a, b), unit(a, b)) for a, b in legs)

    def _allowed(self, drone: Drone, epoch: int, charge: float) -> set[str]:
        alone = {"returning": "goto_charging_station", "queued": "charge", "charging": "charge"}
        alone["crashed"] = "hover"
        if drone.mode in alone:
            return {alone[drone.mode]}
        allowed, capacity = {"fly", "hover"}, self.inputs.capacity
        if capacity is None:
            return allowed
        low = Fraction(str(self.inputs.return_below)) * capacity
        if charge <= low and self._home(drone) is not None:
            allowed.add("goto_charging_station")
        if self._station(drone.node) is not None and charge < self._full():
            allowed.add("charge")
        return allowed

    def _taken(self, command: Sequence[float], allowed: set[str]) -> str:
        if len(allowed) == 1:
            return next(iter(allowed))
        wished = [action for action in ("charge", "goto_charging_station") if action in allowed]
        return wished[0] if wished and command[3] > 0 else "fly"

    def _obey(self, drone: Drone, t_us: int, epoch: int, command: Sequence[float]) -> None:
        drone.mode = "flying"
        if drone.action == "charge":
            self._land(drone)
        elif drone.action == "goto_charging_station":
            drone.mode = "returning"
            self.ways[drone.index] = self._home(drone)
            self._fly_on(drone, t_us)
        else:
            here, highest_m = self.at[drone.index], self.space.highest_m[drone.index]
            stop = self.space.target(here, command, highest_m, self.inputs.step_us / US)
            if math.dist(here, stop) > 0.0:
                share = stopped_at(here, stop, self.boxes)
                if share < math.inf:
                    stop = part_of(here, stop, share * math.dist(here, stop))
            if far(here, stop):
                step_s = self.inputs.step_us / US
                flight = self.space.steered(here, stop, command[-1], step_s)
                self._set_out(drone, stop, t_us, flight)

    def _respawn(self, t_us: int) -> None:
        crashed = [drone for drone in self.drones if drone.mode == "crashed"]
        super()._respawn(t_us)
        for drone in crashed:
            if drone.mode == "flying":
                self.at[drone.index] = self._over(drone.node[:2])


def simulate(
    inputs: Inputs, space: Space, commands: Sequence[Sequence[Sequence[float]]], dt_s: float
) -> Result:
    """Run one episode in steps of ``dt_s``; ``commands[step][drone]`` are four numbers.

    They are five if the space has cruise speeds.
    """
    return Freely(inputs, space, round(dt_s * US)).run(commands)
