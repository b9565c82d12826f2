"""How fast a level can change from one place to another: bounds in dB per metre.

A search for thresholds (``model.radio.sinr``) is only as good as these bounds. There are two: for
each metre of horizontal distance between drone and user, and for each metre of height. They must
hold at all places at most ``within_m`` away from the place where the drone is ``distance_m`` away
from the user horizontally and ``height_m`` above it. A bound is inf where there is none.
docs/explanation/sinr.md proves those below.
"""

from __future__ import annotations

import numpy as np

from desim_uav.model.kernels import kernel

DB = 10.0 / np.log(10.0)
"""A change of a power by a small share is so many decibels times the share."""

DEGREES = 180.0 / np.pi


@kernel
def log_distance_slope(
    exponent: float, distance_m: float, height_m: float, within_m: float
) -> tuple[float, float]:
    """Return the bounds for a loss of 10 ``exponent`` log10(d) over the distance in space."""
    return logistic_slope(exponent, 0.0, 1.0, 1.0, distance_m, height_m, within_m)


@kernel
def logistic_slope(
    exponent: float,
    fall_db: float,
    a: float,
    b: float,
    distance_m: float,
    height_m: float,
    within_m: float,
) -> tuple[float, float]:
    """Return the bounds for such a loss and the mean excess loss of Al-Hourani et al. 2014.

    The mean excess falls by ``fall_db``, that without line of sight less that with it, as the
    probability of line of sight 1 / (1 + a exp(-b (elevation - a))) rises from 0 to 1.
    """
    far = np.sqrt(distance_m * distance_m + height_m * height_m)
    nearest = far - within_m
    if nearest <= 0.0:
        return np.inf, np.inf
    elevation, apart = np.arctan2(height_m, distance_m), np.arcsin(within_m / far)
    # The probability rises the faster, the nearer it is to one half.
    off = max(abs(elevation - (a + np.log(a) / b) / DEGREES) - apart, 0.0)
    odds = np.exp(-b * off * DEGREES)
    rise = b * odds / ((1.0 + odds) * (1.0 + odds))
    along, across = DB * exponent / nearest, fall_db * rise * DEGREES / nearest
    level = np.cos(max(abs(elevation) - apart, 0.0))
    upright = np.sin(min(abs(elevation) + apart, 0.5 * np.pi))
    # With distance the level falls on both counts; with height, on one only if above the user.
    over = max(along * upright, across * level)
    if elevation < apart:
        over = along * upright + across * level
    return along * level + across * upright, over
