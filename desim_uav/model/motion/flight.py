"""A step of free flight: the leg that a command asks for, cut short before obstacles."""

from __future__ import annotations

import numpy as np

from desim_uav.model.geometry.prisms import Prisms, first_entry
from desim_uav.model.motion.legs import (
    FreeLeg,
    LegBounds,
    along,
    commanded,
    direction,
    leg_between,
    speed_within,
)
from desim_uav.model.motion.limits import Limits, Wind, speed_along
from desim_uav.model.radio.tracks import Point
from desim_uav.rowcode.kernels import kernel, part


@kernel
def step_leg(
    limits: Limits,
    wind: Wind,
    cruise_mps: float,
    bounds: LegBounds,
    prisms: Prisms,
    lasts_s: float,
    at: Point,
    command: Point,
) -> tuple[FreeLeg, bool]:
    """Return the leg that a command asks for in a step, and whether an obstacle cuts it short.

    The leg takes at most ``lasts_s``; the drone hovers for what remains. If this is infinite, the
    command is any place on the map. A way that would enter a
    grown obstacle ends where it would: at least a margin before the obstacle itself.
    """
    target = commanded(limits, wind, cruise_mps, bounds, lasts_s, at, command)
    share = first_entry(prisms, at, target)
    blocked = share < np.inf
    if blocked:
        target = along(at, target, share)
    return leg_between(limits, wind, cruise_mps, at, target), blocked


@part
def no_faster(limits: Limits, level_mps: float) -> Limits:
    """Return limits with this highest level speed."""
    return Limits(
        level_mps, limits.level_mps2, limits.climb_mps, limits.descent_mps, limits.vertical_mps2
    )


@kernel
def chosen_mps(
    limits: Limits, wind: Wind, cruise_mps: float, lasts_s: float, leg: FreeLeg
) -> float:
    """Return the highest ground speed of a leg for which a cruise speed is chosen, in m/s.

    ``cruise_mps`` is a level speed through the air, which takes the place of ``limits.level_mps``
    and is not above it. If the leg would then last longer than ``lasts_s``, it is the lowest speed
    at which it does not. ``leg`` is the quickest one, which takes no longer than that; for a hover
    the speed is infinite.
    """
    if leg.duration_us <= 0:
        return np.inf
    x0, y0, z0, x1, y1, z1 = leg.route
    ahead, _ = direction((x0, y0, z0), (x1, y1, z1))
    least = speed_within(leg.distance_m, leg.acceleration_mps2, lasts_s)
    speed_mps = speed_along(no_faster(limits, cruise_mps), wind, ahead)
    return float(min(max(speed_mps, least), speed_along(limits, wind, ahead)))
