"""A step of free flight: the leg that a command asks for, cut short before obstacles."""

from __future__ import annotations

import numpy as np

from desim_uav.model.free.legs import Bounds, FreeLeg, along, commanded, leg_between
from desim_uav.model.free.limits import Limits, Wind
from desim_uav.model.free.prisms import Prisms, first_entry
from desim_uav.model.kernels import kernel
from desim_uav.model.radio.tracks import Point


@kernel
def step_leg(
    limits: Limits,
    wind: Wind,
    cruise_mps: float,
    bounds: Bounds,
    prisms: Prisms,
    lasts_s: float,
    at: Point,
    command: Point,
) -> tuple[FreeLeg, bool]:
    """Return the leg that a command asks for in a step, and whether an obstacle cuts it short.

    The leg takes at most ``lasts_s``; the drone hovers for what remains. A way that would enter a
    grown obstacle ends where it would: at least a margin before the obstacle itself.
    """
    target = commanded(limits, wind, cruise_mps, bounds, lasts_s, at, command)
    share = first_entry(prisms, at, target)
    blocked = share < np.inf
    if blocked:
        target = along(at, target, share)
    return leg_between(limits, wind, cruise_mps, at, target), blocked
