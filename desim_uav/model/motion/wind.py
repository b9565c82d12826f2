"""Constant wind, and flights between cells in it: their limits on speed, and their air speeds.

The wind is the velocity of the air over the ground, along x and y, in m/s. The highest speed of a
motion is one through the air, on level flights; climbs and descents keep it as their own limit.
"""

from __future__ import annotations

import math

from desim_uav.model.motion.limits import CALM, Wind
from desim_uav.model.motion.motion import REST, Motion, Transit
from desim_uav.registry import kind_name

WindCourse = tuple[float, float, float]
"""The way of a flight along one axis, in cells or in metres: two of its parts are 0."""


def wind_along(wind: Wind, way: WindCourse) -> tuple[float, float]:
    """Return the wind along the level direction of a flight, and that across it, in m/s."""
    dx, dy, _ = way
    if dx != 0:
        return math.copysign(1.0, dx) * wind[0] + 0.0, abs(wind[1])
    if dy != 0:
        return math.copysign(1.0, dy) * wind[1] + 0.0, abs(wind[0])
    return 0.0, math.hypot(*wind)


def way_between(start: WindCourse, stop: WindCourse) -> WindCourse:
    """Return the way from one place to another along one axis, without errors of rounding."""
    dx, dy, dz = (b - a if abs(b - a) > 1e-6 else 0.0 for a, b in zip(start, stop, strict=True))
    return dx, dy, dz


def motion_in(motion: Motion, wind: Wind, way: WindCourse) -> Motion:
    """Return the motion of flights along this way in wind: the same one if there is none.

    Raises ValueError if the motion cannot be used in this wind.
    """
    if tuple(wind) == CALM:
        return motion
    in_wind = getattr(motion, "in_wind", None)
    if in_wind is None:
        kind = kind_name(motion)
        raise ValueError(f"{kind!r} has no method in_wind, so that it flies without wind only")
    flown: Motion = in_wind(*wind_along(wind, way))
    return motion if way[2] != 0 else flown


def flown_along(flight: Transit, wind: Wind, way: WindCourse) -> Transit:
    """Return a flight as one along this way, so that it may rise, and have wind."""
    rises = math.copysign(1.0, way[2]) if way[2] != 0 else flight.rises
    if rises == flight.rises and tuple(wind) == CALM:
        return flight
    tail_mps, side_mps = wind_along(wind, way)
    return flight._replace(rises=rises, tail_mps=tail_mps, side_mps=side_mps)


def rest_in(wind: Wind) -> Transit:
    """Return a hover in wind."""
    return flown_along(REST, wind, (0.0, 0.0, 0.0))
