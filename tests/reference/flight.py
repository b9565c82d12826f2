"""Where drones of the fixed-step simulator can fly, how long it takes them, and what they are."""

from __future__ import annotations

import heapq
import math
from collections.abc import Sequence
from dataclasses import dataclass, field

from tests.reference.inputs import NEVER, US, Inputs, Node

HOPS = {
    "forward": (0, 1, 0),
    "backward": (0, -1, 0),
    "right": (1, 0, 0),
    "left": (-1, 0, 0),
    "up": (0, 0, 1),
    "down": (0, 0, -1),
}


@dataclass(frozen=True)
class Hop:
    """A rest-to-rest flight of ``distance_m``: ramp up, cruise at ``speed_mps``, ramp down."""

    distance_m: float
    speed_mps: float
    acceleration_mps2: float
    duration_s: float

    def flown_m(self, elapsed_s: float) -> float:
        ramp = self.speed_mps / self.acceleration_mps2
        left = self.duration_s - elapsed_s
        if left <= 0.0:
            return self.distance_m
        if elapsed_s < ramp:
            return 0.5 * self.acceleration_mps2 * elapsed_s**2
        if left < ramp:
            return self.distance_m - 0.5 * self.acceleration_mps2 * left**2
        return self.speed_mps * (elapsed_s - 0.5 * ramp)


def quickest(distance_m: float, v: float, a: float) -> Hop:
    if distance_m >= v * v / a:
        return Hop(distance_m, v, a, distance_m / v + v / a)
    peak = math.sqrt(a * distance_m)
    return Hop(distance_m, peak, a, 2.0 * peak / a)


def over_ground(wind: tuple[float, float], hop: Sequence[float], v: float) -> float:
    """The highest speed over the ground at which that through the air is at most ``v``.

    Vertical flights keep their limit.
    """
    if hop[2]:
        return v
    low, high = 0.0, v + math.hypot(*wind)
    for _ in range(200):
        middle = 0.5 * (low + high)
        if math.hypot(middle * hop[0] - wind[0], middle * hop[1] - wind[1]) <= v:
            low = middle
        else:
            high = middle
    return low


def filling(distance_m: float, duration_s: float, a: float) -> Hop:
    at = a * duration_s
    return Hop(distance_m, (at - math.sqrt(at * at - 4.0 * a * distance_m)) / 2.0, a, duration_s)


class Map:
    """Where drones can be, and how long the way home is from there."""

    def __init__(self, inputs: Inputs) -> None:
        self.inputs = inputs
        self.shape = inputs.height_m.shape
        v, a = inputs.max_speed_mps, inputs.max_acceleration_mps2
        lengths = (*inputs.cell_m, inputs.level_step_m)
        quick, filled = {}, {}
        for hop in HOPS.values():
            length = lengths[axis_of(hop)]
            quick[hop] = quickest(length, over_ground(inputs.wind_mps, hop, v), a)
            filled[hop] = filling(length, inputs.step_us / US, a)
        self.commanded = filled if inputs.fill_epoch else quick
        self.cruising = {
            speed: {
                hop: quickest(lengths[axis_of(hop)], over_ground(inputs.wind_mps, hop, speed), a)
                for hop in HOPS.values()
            }
            for speed in inputs.cruise
        }
        self.returning = filled if inputs.returns_fill_epoch else quick
        self.hop_us = {hop: round(way.duration_s * US) for hop, way in self.returning.items()}
        self.home_us = {levels: self._homes(levels) for levels in set(inputs.levels)}

    def free(self, node: Node, levels: int) -> bool:
        x, y, level = node
        if not (0 <= x < self.shape[0] and 0 <= y < self.shape[1] and 0 <= level < levels):
            return False
        height = self.inputs.height_m[x, y]
        return height <= 0.0 or self.inputs.levels_m[level] > height

    def neighbours(self, node: Node, levels: int) -> list[tuple[Node, Node, int]]:
        """(free neighbour, hop, time) of a node."""
        found = []
        for hop in HOPS.values():
            other = moved(node, hop)
            if self.free(other, levels):
                found.append((other, hop, self.hop_us[hop]))
        return found

    def _homes(self, levels: int) -> list[dict[Node, int]]:
        """The quickest time from each free node to each station, found from there backwards."""
        tables = []
        for x, y in self.inputs.stations:
            table = {(x, y, 0): 0}
            heap = [(0, (x, y, 0))]
            while heap:
                time, node = heapq.heappop(heap)
                if time > table[node]:
                    continue
                for other, hop, _ in self.neighbours(node, levels):
                    hop_us = self.hop_us[-hop[0], -hop[1], -hop[2]]
                    if time + hop_us < table.get(other, NEVER):
                        table[other] = time + hop_us
                        heapq.heappush(heap, (time + hop_us, other))
            tables.append(table)
        return tables

    def nearest(self, node: Node, levels: int) -> tuple[int, int]:
        """(time, station) of the quickest way home, which may begin inside a building."""
        best = (NEVER, -1)
        for station, table in enumerate(self.home_us[levels]):
            time = table.get(node, NEVER)
            if time == NEVER:
                ways = self.neighbours(node, levels)
                time = min((us + table.get(n, NEVER) for n, _, us in ways), default=NEVER)
            if time < best[0]:
                best = (time, station)
        return best

    def way_home(self, node: Node, levels: int) -> list[Node]:
        """The hops of a quickest way to the nearest station."""
        time, station = self.nearest(node, levels)
        assert time < NEVER
        goal = (*self.inputs.stations[station], 0)
        table = self.home_us[levels][station]
        if self.inputs.plan is not None:
            hops = [tuple(hop) for hop in self.inputs.plan(node, levels)]
            flown, at = 0, node
            for hop in hops:
                at = moved(at, hop)
                assert self.free(at, levels), f"{node}: planned through a building at {at}"
                flown += self.hop_us[hop]
            assert (flown, at) == (time, goal), f"{node}: {flown} us to {at}, not {time} to {goal}"
            return hops
        hops = []
        while node != goal:
            node, hop, _ = min(
                self.neighbours(node, levels), key=lambda way: way[2] + table.get(way[0], NEVER)
            )
            hops.append(hop)
        return hops


def axis_of(hop: Node) -> int:
    return next(axis for axis in range(3) if hop[axis])


def moved(node: Node, hop: Node) -> Node:
    return node[0] + hop[0], node[1] + hop[1], node[2] + hop[2]


@dataclass
class Drone:
    """``node`` is where it rests or was last; a flight goes on from there until ``until_us``.

    ``free_us``: when it is to be asked, if decisions are by event; ``asked_us``: when it was.
    """

    index: int
    levels: int
    node: Node
    charge: float
    mode: str = "flying"
    action: str = "hover"
    hop: Node | None = None
    flight: Hop | None = None
    since_us: int = 0
    until_us: int = 0
    path: list[Node] = field(default_factory=list)
    crashed_us: int = 0
    crash_position_m: tuple[float, float, float] = (0.0, 0.0, 0.0)
    respawns: int = 0
    free_us: int = 0
    asked_us: int = 0
    gained: float = 0.0
