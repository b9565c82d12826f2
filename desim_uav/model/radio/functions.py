"""Elementary functions that give the same bits in Python and in compiled code.

Python and Numba agree on +, -, *, /, ``math.sqrt``, ``min`` and ``max``. The logarithm, the
exponential function and the arctangent may come from different libraries; those below are compiled
kernels, which Python calls too.
"""

from __future__ import annotations

import math

from desim_uav.rowcode.kernels import kernel, rule


@kernel
def log10(x: float) -> float:
    """Return the decimal logarithm; -inf of 0."""
    return math.log10(x)


@kernel
def exp(x: float) -> float:
    """Return the exponential function."""
    return math.exp(x)


@kernel
def elevation_deg(distance_m: float, height_m: float) -> float:
    """Return the angle above the horizon, in degrees, at which a user sees a drone."""
    return math.atan2(height_m, distance_m) * (180.0 / math.pi)


@rule
def slant_range_m(distance_m: float, height_m: float) -> float:
    """Return the distance in space in metres, from horizontal distance and height difference."""
    return math.sqrt(distance_m * distance_m + height_m * height_m)
