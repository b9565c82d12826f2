"""How fast a drone can fly in a direction: its limits, level and vertical, and constant wind.

The highest speed is a limit on the speed through the air, and accelerations are over the ground. A
direction is a vector of length 1. A straight leg keeps its direction, so all limits become one on
the speed and one on the acceleration along it, and the quickest leg under them is bang-coast-bang.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from desim_uav.model.motion.motion import ground_mps
from desim_uav.model.radio.tracks import Point
from desim_uav.rowcode.kernels import kernel, part

Wind = tuple[float, float]
"""The velocity of the air over the ground, along x and y, in m/s; it is the same everywhere."""

CALM: Wind = (0.0, 0.0)


class Limits(NamedTuple):
    """The limits of a drone, all above 0.

    ``level_mps`` bounds the horizontal speed through the air, ``climb_mps`` and ``descent_mps`` the
    vertical speed, ``level_mps2`` and ``vertical_mps2`` the accelerations.
    """

    level_mps: float
    level_mps2: float
    climb_mps: float
    descent_mps: float
    vertical_mps2: float


@kernel
def can_hold(limits: Limits, wind: Wind) -> bool:
    """Return whether a drone can hover, which takes an air speed as high as that of the wind.

    A wind as fast as the limit is refused, too: no leg against it would ever end.
    """
    return wind[0] * wind[0] + wind[1] * wind[1] < limits.level_mps * limits.level_mps


@part
def wind_along(wind: Wind, ahead: Point) -> tuple[float, float]:
    """Return the wind along the level direction of a way, and that across it, in m/s.

    The second one is at least 0. A vertical way, which has no level direction, has all across.
    """
    (wx, wy), (x, y, _) = wind, ahead
    level = np.sqrt(x * x + y * y)
    if level == 0.0:
        return 0.0, float(np.sqrt(wx * wx + wy * wy))
    return float((wx * x + wy * y) / level + 0.0), float(abs(wx * y - wy * x) / level)


@kernel
def speed_along(limits: Limits, wind: Wind, ahead: Point) -> float:
    """Return the highest ground speed in a direction, in m/s; 0 if the drone cannot hover.

    The square of the horizontal air speed is quadratic in the ground speed, below the limit at
    rest, and so below it up to the larger root.
    """
    if not can_hold(limits, wind):
        return 0.0
    x, y, z = ahead
    level, speed = np.sqrt(x * x + y * y), np.inf
    if level > 0.0:
        tail, side = wind_along(wind, ahead)
        speed = ground_mps(limits.level_mps, tail, side) / level
    if z > 0.0:
        speed = min(speed, limits.climb_mps / z)
    elif z < 0.0:
        speed = min(speed, limits.descent_mps / -z)
    return float(speed)


@kernel
def acceleration_along(limits: Limits, ahead: Point) -> float:
    """Return the highest acceleration in a direction, in m/s²."""
    x, y, z = ahead
    level, most = np.sqrt(x * x + y * y), np.inf
    if level > 0.0:
        most = limits.level_mps2 / level
    if z != 0.0:
        most = min(most, limits.vertical_mps2 / abs(z))
    return float(most)
