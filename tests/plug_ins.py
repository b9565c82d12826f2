"""Mobility and demand models of a user's own, which scenarios of tests name."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from desim_uav.model.demand.asking import NOTHING, RowDemand, ask_for, ask_for_mix
from desim_uav.model.mobility.walking import RowMobility, go_on, go_to, stay
from desim_uav.model.random.streams import exponential_us, heading, uniform


@dataclass(frozen=True)
class Waypoints(RowMobility):
    """Users walk to random places, and pause there (random waypoint)."""

    speed_mps: float = 5.0
    pause_s: float = 20.0
    remembers: ClassVar = {"pauses": int}

    def next_leg(self, walker: Any, stream: Any, area: Any) -> None:
        if walker.pauses:
            stay(walker, walker.t_us + int(self.pause_s * 1e6))
        else:
            x_m, y_m = uniform(stream) * area.width_m, uniform(stream) * area.depth_m
            go_to(walker, x_m, y_m, self.speed_mps)
        walker.pauses = 1 - walker.pauses


@dataclass(frozen=True)
class GaussMarkov(RowMobility):
    """Users change their velocity a little every few seconds."""

    mean_mps: float = 1.4
    alpha: float = 0.8
    every_s: float = 5.0
    remembers: ClassVar = {"turn_us": int, "east": float, "north": float}

    def next_leg(self, walker: Any, stream: Any, area: Any) -> None:
        if walker.t_us == walker.turn_us:
            x, y = heading(stream)
            rest = (1.0 - self.alpha) * 2.0 * self.mean_mps * uniform(stream)
            walker.east = self.alpha * walker.east + rest * x
            walker.north = self.alpha * walker.north + rest * y
            walker.vx_mps, walker.vy_mps = walker.east, walker.north
            walker.turn_us += int(self.every_s * 1e6)
        go_on(walker, area, walker.turn_us)


@dataclass(frozen=True)
class WalkAgain(RowMobility):
    """The random walk once more."""

    speed_mps: float = 1.4
    leg_s: float = 60.0
    remembers: ClassVar = {"turn_us": int}

    def next_leg(self, walker: Any, stream: Any, area: Any) -> None:
        if walker.t_us == walker.turn_us:
            x, y = heading(stream)
            walker.vx_mps, walker.vy_mps = self.speed_mps * x, self.speed_mps * y
            walker.turn_us += int(np.rint(self.leg_s * 1e6))
        go_on(walker, area, walker.turn_us)


@dataclass(frozen=True)
class WordyWalk(WalkAgain):
    """The same with what compiled code cannot do."""

    def next_leg(self, walker: Any, stream: Any, area: Any) -> None:
        if walker.t_us == walker.turn_us:
            x, y = heading(stream)
            speed_mps = {"walk": self.speed_mps}[f"wal{'k'}"]
            walker.vx_mps, walker.vy_mps = speed_mps * x, speed_mps * y
            walker.turn_us += int(np.rint(self.leg_s * 1e6))
        go_on(walker, area, walker.turn_us)


@dataclass(frozen=True)
class Straying(RowMobility):
    """Users walk east for good."""

    def next_leg(self, walker: Any, stream: Any, area: Any) -> None:
        go_to(walker, walker.x_m + 100.0, walker.y_m, 1.0)


@dataclass(frozen=True)
class Stuck(RowMobility):
    """No time passes after the first leg."""

    stays_on_map = True

    def next_leg(self, walker: Any, stream: Any, area: Any) -> None:
        if walker.t_us == 0:
            stay(walker, 90_000_000)


@dataclass(frozen=True)
class Crooked(RowMobility):
    """The velocity says nothing of where a leg ends."""

    def next_leg(self, walker: Any, stream: Any, area: Any) -> None:
        stay(walker, walker.t_us + 60_000_000)
        walker.vx_mps = 1.0


@dataclass(frozen=True)
class Nowhere(RowMobility):
    """Places are no numbers."""

    def next_leg(self, walker: Any, stream: Any, area: Any) -> None:
        stay(walker, walker.t_us + 60_000_000)
        walker.x_m = math.nan


@dataclass(frozen=True)
class Bursts(RowDemand):
    """Users ask several times in a row, and then for nothing for a while (on and off)."""

    most: int = 4
    on_s: float = 20.0
    off_s: float = 400.0
    remembers: ClassVar = {"left": int}

    def next_request(self, asker: Any, stream: Any, services: Any) -> None:
        mean_s = self.on_s
        if asker.left == 0:
            asker.left = 1 + int(uniform(stream) * self.most)
            mean_s = self.off_s
        asker.left -= 1
        asker.wait_us = exponential_us(stream, mean_s)
        ask_for_mix(asker, stream, services, 0.0)


@dataclass(frozen=True)
class Arriving(RowDemand):
    """Arrivals at fixed intervals, for one service after the other."""

    every_s: float = 100.0
    after_previous = False
    remembers: ClassVar = {"next": int}

    def next_request(self, asker: Any, stream: Any, services: Any) -> None:
        asker.wait_us = int(self.every_s * 1e6)
        ask_for(asker, stream, services, asker.next)
        asker.next = (asker.next + 1) % len(services.shares)


@dataclass(frozen=True)
class DynamicAgain(RowDemand):
    """The demand `dynamic` once more."""

    think_time_s: float = 300.0

    def next_request(self, asker: Any, stream: Any, services: Any) -> None:
        asker.wait_us = 0
        if asker.draws > 0:
            asker.wait_us = exponential_us(stream, self.think_time_s)
        ask_for_mix(asker, stream, services, 0.0)


@dataclass(frozen=True)
class WordyDemand(DynamicAgain):
    """The same with what compiled code cannot do."""

    def next_request(self, asker: Any, stream: Any, services: Any) -> None:
        asker.wait_us = {"first": 0}.get(f"fir{'st'}", 0)
        if asker.draws > 0:
            asker.wait_us = exponential_us(stream, self.think_time_s)
        ask_for_mix(asker, stream, services, 0.0)


@dataclass(frozen=True)
class Endless(RowDemand):
    """Users ask for nothing again and again, at the same time."""

    def next_request(self, asker: Any, stream: Any, services: Any) -> None:
        asker.wait_us, asker.service = 0, NOTHING


@dataclass(frozen=True)
class Unknown(RowDemand):
    """Users ask for a service that does not exist."""

    service: int = 3
    required_us: int = 1

    def next_request(self, asker: Any, stream: Any, services: Any) -> None:
        asker.wait_us, asker.service, asker.required_us = 5, self.service, self.required_us


@dataclass(frozen=True)
class Backwards(RowDemand):
    """Users ask before they have asked."""

    def next_request(self, asker: Any, stream: Any, services: Any) -> None:
        ask_for(asker, stream, services, 0)
        asker.wait_us = -1
