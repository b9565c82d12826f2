"""The legs of free flight whose energy is drawn, and what they take by the rules of the engines.

All of them begin at the origin and lead along x, and the wind is turned accordingly: what a leg
takes depends on its direction relative to the wind only.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

from desim_uav.drone_type import DroneType
from desim_uav.model.energy.battery import Energy
from desim_uav.model.motion.flight import chosen_mps, no_faster
from desim_uav.model.motion.legs import FreeLeg, LegBounds, commanded, direction, leg_between
from desim_uav.model.motion.limits import CALM, Limits, Wind
from desim_uav.model.motion.motion import Transit, fastest
from desim_uav.model.motion.space import ANY_SPEED, NO_CHOICE, flight_of
from desim_uav.model.radio.tracks import Point
from desim_uav.model.rules import US

ORIGIN: Point = (0.0, 0.0, 0.0)

UNBOUNDED = LegBounds(1e9, 1e9, -1e9, 1e9)
"""A map on which no leg from the origin along x ends at an edge."""


LONGEST_S = 1e6
"""A time in which a drone reaches any place on a map."""


class Way(NamedTuple):
    """A direction of legs: its unit vector, the wind, and the longest leg of a step in metres."""

    name: str
    ahead: Point
    wind: Wind
    longest_m: float

    @property
    def level(self) -> bool:
        """Whether all legs in this direction are level."""
        return self.ahead[2] == 0.0


class LegEntry(NamedTuple):
    """A way and the cruise speed that is chosen on it; it is infinite for the highest speed."""

    name: str
    way: Way
    cruise_mps: float


@dataclass(frozen=True)
class FreeLegs:
    """The legs of a type of drones that flies freely."""

    own: DroneType

    # ---- ways

    @cached_property
    def ways(self) -> tuple[Way, ...]:
        """The ways of commands: level, in wind with it, against it and across; in 3D oblique too.

        An oblique way is that of the command [1, 0, 1] or [1, 0, -1]. In wind it leads across it.
        """
        return tuple(way for way in self._level_ways + self._oblique_ways if way.longest_m > 0.0)

    @cached_property
    def vertical_ways(self) -> tuple[Way, ...]:
        """The ways straight up and straight down; none in two dimensions."""
        wind = (0.0, self._wind_mps)
        ways = [("up", (0.0, 0.0, 1.0)), ("down", (0.0, 0.0, -1.0))]
        vertical = [self._way(name, command, wind) for name, command in ways]
        return tuple(way for way in vertical if way.longest_m > 0.0)

    @cached_property
    def _level_ways(self) -> tuple[Way, ...]:
        wind_mps, ahead = self._wind_mps, (1.0, 0.0, 0.0)
        if wind_mps == 0.0:
            return (self._way("level", ahead, CALM),)
        winds = {
            "tailwind": (wind_mps, 0.0),
            "headwind": (-wind_mps, 0.0),
            "crosswind": (0.0, wind_mps),
        }
        return tuple(self._way(name, ahead, wind) for name, wind in winds.items())

    @cached_property
    def _oblique_ways(self) -> tuple[Way, ...]:
        wind = (0.0, self._wind_mps)
        climb = self._way("climb", (1.0, 0.0, 1.0), wind)
        return climb, self._way("descent", (1.0, 0.0, -1.0), wind)

    def _way(self, name: str, command: Point, wind: Wind) -> Way:
        """Return the way of a command, with the longest leg that a step and the map allow."""
        limits, step_s = self.limits, self.own.scenario.episode.step_s
        if self.own.space.whole_map:
            step_s = LONGEST_S
        target = commanded(limits, wind, ANY_SPEED, UNBOUNDED, step_s, ORIGIN, command)
        ahead, reach_m = direction(ORIGIN, target)
        level, rise = math.hypot(*ahead[:2]), abs(ahead[2])
        grid = self.own.grid
        if level > 0.0:
            reach_m = min(reach_m, self._diagonal_m / level)
        if rise > 0.0:
            rises_m = grid.levels_m[-1] - grid.levels_m[0] if self.own.scenario.three_d else 0.0
            reach_m = min(reach_m, rises_m / rise)
        if level > 0.0 and rise > 0.0:
            name += f" at {math.degrees(math.atan2(rise, level)):.0f}°"
        return Way(name, ahead, wind, reach_m)

    @cached_property
    def shown(self) -> tuple[LegEntry, ...]:
        """The ways at the highest speed of commands, and a level one at the lowest, if chosen."""
        ways = [LegEntry(way.name, way, ANY_SPEED) for way in self.ways]
        if self.choice is not None:
            way = self._level_ways[-1]  # without wind, or across it
            ways.append(LegEntry(f"{way.name}, lowest speed", way, self.choice[0]))
        return tuple(ways)

    # ---- limits

    @cached_property
    def limits(self) -> Limits:
        """The limits of commands."""
        return self.own.space.commanded

    @cached_property
    def choice(self) -> tuple[float, float] | None:
        """The lowest and the highest speed that commands can choose; None if they choose none."""
        speeds_mps = self.own.space.cruise_mps
        return None if speeds_mps == NO_CHOICE else speeds_mps

    @cached_property
    def cruises_mps(self) -> list[float]:
        """The level speeds through the air at which long legs cruise, ascending.

        The highest one is that of returns and, without a choice, of commands. None is above the
        highest speed that a drone can reach between two corners of the map.
        """
        limits = self.own.space.limits
        speeds = {limits.level_mps, *(self.choice or ())}
        return sorted({fastest(self._diagonal_m, v, limits.level_mps2)[0] for v in speeds})

    @property
    def _diagonal_m(self) -> float:
        return math.hypot(self.own.grid.width_m, self.own.grid.depth_m)

    @property
    def _wind_mps(self) -> float:
        return math.hypot(*self.own.scenario.wind_mps)

    # ---- legs

    @cached_property
    def typical_m(self) -> float:
        """The length of a typical leg: half the longest level one of a step, to two digits.

        In wind it is the way on which the longest leg is shortest.
        """
        return float(f"{min(way.longest_m for way in self.ways if way.level) / 2.0:.2g}")

    def leg(self, way: Way, length_m: float, cruise_mps: float = ANY_SPEED) -> FreeLeg:
        """Return the leg of a command, at a cruise speed if commands choose one.

        It is that of ``rules.free_flight.steer``: even at a low speed it ends within a step.
        """
        leg = leg_between(self.limits, way.wind, ANY_SPEED, ORIGIN, _end(way, length_m))
        if self.choice is None or cruise_mps == ANY_SPEED:
            return leg
        step_s = self.own.space.most_s(self.own.scenario.episode.step_s)
        limit_mps = chosen_mps(self.limits, way.wind, cruise_mps, step_s, leg)
        return leg_between(self.limits, way.wind, limit_mps, ORIGIN, _end(way, length_m))

    def leg_at(self, way: Way, length_m: float, level_mps: float) -> FreeLeg:
        """Return the quickest leg whose level speed through the air is at most ``level_mps``."""
        limits = no_faster(self.own.space.limits, level_mps)
        return leg_between(limits, way.wind, ANY_SPEED, ORIGIN, _end(way, length_m))

    def flight(self, way: Way, leg: FreeLeg) -> Transit:
        """Return a leg as a transit."""
        return flight_of(leg, way.wind)

    # ---- energy

    @property
    def battery(self) -> Energy:
        """The energy model."""
        battery = self.own.drones.battery
        assert battery is not None
        return battery

    def energy_j(self, way: Way, leg: FreeLeg) -> float:
        """Return what a leg takes, in joules; NaN if it cannot be flown."""
        if leg.duration_us < 0:
            return math.nan
        return self.battery.drain_of(self.flight(way, leg), leg.duration_us) / 1e6

    def step_j(self, way: Way, length_m: float) -> float:
        """Return what a step takes that begins with a leg and ends with a hover, in joules."""
        leg = self.leg(way, length_m)
        return self.energy_j(way, leg) + self._hover_j(max(0, self._step_us - leg.duration_us))

    def steps_j(self) -> dict[str, float]:
        """Return what steps take in joules, by name: a hover, and commands with their lengths."""
        energies_j = {"hover": self._hover_j(self._step_us)}
        for way in self.ways + self.vertical_ways:
            lengths_m = [way.longest_m, self.typical_m] if way.level else [way.longest_m]
            for metres in lengths_m:
                energies_j[f"{way.name}, {_in_metres(metres)}"] = self.step_j(way, metres)
        return energies_j

    def _hover_j(self, lasts_us: int) -> float:
        return self.battery.drain_of(self.own.rest, lasts_us) / 1e6

    @property
    def _step_us(self) -> int:
        return round(self.own.scenario.episode.step_s * US)


def _end(way: Way, length_m: float) -> Point:
    """Return the end of a leg."""
    x, y, z = way.ahead
    return x * length_m, y * length_m, z * length_m


def _in_metres(length_m: float) -> str:
    return f"{length_m:.0f} m" if length_m >= 10.0 else f"{length_m:.3g} m"
