"""Straight legs of any direction, rest to rest, in closed form, and the commands that ask for them.

A command is a vector in [-1, 1]^3 (z is 0 on a map of two dimensions): a displacement as a share of
the longest flight in a step. The target is clipped to the map; the drone flies straight to it and
then hovers.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from desim_uav.model.motion.limits import Limits, Wind, acceleration_along, speed_along
from desim_uav.model.motion.motion import fastest
from desim_uav.model.radio.tracks import Point
from desim_uav.rowcode.kernels import kernel, part

SHORTEST_M = 1e-6
"""A way that is shorter than this is none: the drone hovers."""

Route = tuple[float, float, float, float, float, float]
"""The x, y and z of the start of a leg and of its destination, in metres."""


class FreeLeg(NamedTuple):
    """A straight leg, rest to rest, at a constant acceleration of ramps and a cruise speed.

    ``speed_mps`` is the highest speed that the leg reaches. A hover has a length and a duration of
    0. A leg that cannot be flown, because the wind is too strong, has a duration below 0.
    """

    route: Route
    distance_m: float
    speed_mps: float
    acceleration_mps2: float
    duration_s: float
    duration_us: int


class LegBounds(NamedTuple):
    """Where drones may be: x from 0 to ``width_m``, y from 0 to ``depth_m``, and z between."""

    width_m: float
    depth_m: float
    lowest_m: float
    highest_m: float


@part
def direction(start: Point, stop: Point) -> tuple[Point, float]:
    """Return the unit vector from one place to another, and their distance (both 0 if equal)."""
    dx, dy, dz = stop[0] - start[0], stop[1] - start[1], stop[2] - start[2]
    distance = np.sqrt(dx * dx + dy * dy + dz * dz)
    if distance == 0.0:
        return (0.0, 0.0, 0.0), 0.0
    return (dx / distance, dy / distance, dz / distance), distance


@kernel
def leg_between(
    limits: Limits, wind: Wind, cruise_mps: float, start: Point, stop: Point
) -> FreeLeg:
    """Return the quickest straight leg at a ground speed of at most ``cruise_mps`` (inf: any)."""
    ahead, distance = direction(start, stop)
    if distance < SHORTEST_M:
        return FreeLeg((*start, *start), 0.0, 0.0, 0.0, 0.0, 0)
    route = (*start, *stop)
    speed = min(speed_along(limits, wind, ahead), cruise_mps)
    if not speed > 0.0:
        return FreeLeg(route, distance, 0.0, 0.0, np.inf, -1)
    acceleration = acceleration_along(limits, ahead)
    speed_mps, duration = fastest(distance, speed, acceleration)
    return FreeLeg(route, distance, speed_mps, acceleration, duration, int(np.rint(duration * 1e6)))


@part
def speed_within(distance_m: float, acceleration_mps2: float, lasts_s: float) -> float:
    """Return the lowest cruise speed at which a leg takes at most a time (see ``cruise_speed``).

    Of a leg that takes longer even if it never cruises, it is the speed that it needs at most.
    """
    at = acceleration_mps2 * lasts_s
    root = np.sqrt(max(at * at - 4.0 * acceleration_mps2 * distance_m, 0.0))
    return float(2.0 * acceleration_mps2 * distance_m / (at + root))


@kernel
def reach_m(speed_mps: float, acceleration_mps2: float, lasts_s: float) -> float:
    """Return the furthest that a drone can fly rest to rest in a time, in metres."""
    ramp = speed_mps / acceleration_mps2
    if lasts_s >= 2.0 * ramp:
        return speed_mps * (lasts_s - ramp)
    return 0.25 * acceleration_mps2 * lasts_s * lasts_s


@kernel
def reach_along(
    limits: Limits, wind: Wind, cruise_mps: float, ahead: Point, lasts_s: float
) -> float:
    """Return the furthest that a drone can fly in a direction in a time, in metres."""
    speed = min(speed_along(limits, wind, ahead), cruise_mps)
    if not speed > 0.0:
        return 0.0
    return reach_m(speed, acceleration_along(limits, ahead), lasts_s)


@kernel
def commanded(
    limits: Limits,
    wind: Wind,
    cruise_mps: float,
    bounds: LegBounds,
    lasts_s: float,
    at: Point,
    command: Point,
) -> Point:
    """Return the target of a command: a place on the map that can be reached within a time.

    If the time is infinite, the numbers of the command are the place itself, from -1 at the lowest
    coordinate of the map to 1 at the highest one.

    Otherwise the direction is that of the command, after its horizontal and its vertical part are
    multiplied by the lengths of the longest level and vertical flights without wind. The length is
    a share of the longest flight in this direction (with wind): the larger one of the length of
    (x, y) and the size of z, and at most 1. So a command with the share 1 takes the whole time. A
    target off the map is moved to the nearest place on it. If this place cannot be reached in the
    time, because it is in another direction, the leg ends where the time ends.
    """
    x, y, z = (
        _clip(command[0], -1.0, 1.0),
        _clip(command[1], -1.0, 1.0),
        _clip(command[2], -1.0, 1.0),
    )
    if lasts_s == np.inf:
        target = _on_map(bounds, x, y, z)
        ahead, length = direction(at, target)
        most = reach_along(limits, wind, cruise_mps, ahead, lasts_s) if length > 0.0 else 0.0
        return target if length <= most else at
    level = reach_m(min(limits.level_mps, cruise_mps), limits.level_mps2, lasts_s)
    climb = limits.climb_mps if z > 0.0 else limits.descent_mps
    vertical = reach_m(min(climb, cruise_mps), limits.vertical_mps2, lasts_s)
    ahead, length = direction((0.0, 0.0, 0.0), (x * level, y * level, z * vertical))
    if length == 0.0:
        return at
    share = min(max(np.sqrt(x * x + y * y), abs(z)), 1.0)
    way = share * reach_along(limits, wind, cruise_mps, ahead, lasts_s)
    target = (
        _clip(at[0] + way * ahead[0], 0.0, bounds.width_m),
        _clip(at[1] + way * ahead[1], 0.0, bounds.depth_m),
        _clip(at[2] + way * ahead[2], bounds.lowest_m, bounds.highest_m),
    )
    ahead, length = direction(at, target)
    most = reach_along(limits, wind, cruise_mps, ahead, lasts_s) if length > 0.0 else 0.0
    return target if length <= most else along(at, target, most / length)


@part
def _on_map(bounds: LegBounds, x: float, y: float, z: float) -> Point:
    """Return the place of three numbers from -1 to 1."""
    return (
        0.5 * (x + 1.0) * bounds.width_m,
        0.5 * (y + 1.0) * bounds.depth_m,
        bounds.lowest_m + 0.5 * (z + 1.0) * (bounds.highest_m - bounds.lowest_m),
    )


@part
def _clip(value: float, low: float, high: float) -> float:
    return min(max(value, low), high)


@kernel
def along(start: Point, stop: Point, share: float) -> Point:
    """Return the place at a share of the straight way from one place to another."""
    return (
        start[0] + share * (stop[0] - start[0]),
        start[1] + share * (stop[1] - start[1]),
        start[2] + share * (stop[2] - start[2]),
    )
