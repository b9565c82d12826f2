"""The elevations at which a level is stationary while a drone climbs above a user who stands still.

The horizontal distance then stays the same, and the level depends on the height alone. For
Al-Hourani's mean loss there may be several such elevations: three in the environment high_rise.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from desim_uav.model.radio.slopes import DEGREES
from desim_uav.rowcode.kernels import kernel, part

FINEST_DEG = 1e-9
"""Elevations that are closer together than this are taken for one."""


STEEPEST = 1.0 / (6.0 * np.sqrt(3.0))
"""The largest value of p (1 - p) (1 - 2 p), at p = 1/2 - 1/(2 sqrt 3)."""

TANGENT = np.pi / (9.0 * np.log(10.0))
"""The factor of the tangent in the slope of the free-space loss, in dB per degree."""


@kernel
def stationary_elevations(fall_db: float, a: float, b: float, out: NDArray[np.float64]) -> int:
    """Write the elevations at which Al-Hourani's mean loss at a fixed distance is stationary.

    They are the roots of equation 13 of Al-Hourani et al. 2014, in degrees and in order. Returns
    their number; those for which there is no room are counted only. For the parameters see
    ``slopes.logistic_slope``.

    None is missed: each stretch of elevations is left only when bounds of the equation's two terms
    exclude a root there, or when bounds of their derivatives show that there is at most one.
    """
    low, width, count = 0.0, 1.0, 0
    while low < 90.0:
        high = min(low + width, 90.0)
        falls, bends = _logistic_bounds(a, b, low, high)
        most = TANGENT * np.tan(high / DEGREES) - fall_db * falls[0]
        least = TANGENT * np.tan(low / DEGREES) - fall_db * falls[1]
        secant, tilt = 1.0 / np.cos(low / DEGREES), 1.0 / np.cos(high / DEGREES)
        rises = TANGENT / DEGREES * secant * secant > fall_db * bends[1]
        sinks = TANGENT / DEGREES * tilt * tilt < fall_db * bends[0]
        if least <= 0.0 <= most and not (rises or sinks) and high - low > FINEST_DEG:
            width = 0.5 * (high - low)
            continue
        if least <= 0.0 <= most:
            begins = _steepness(fall_db, a, b, low) > 0.0
            if (_steepness(fall_db, a, b, high) > 0.0) != begins:
                if count < len(out):
                    out[count] = _stationary(fall_db, a, b, low, high)
                count += 1
        low, width = high, 2.0 * width
    return count


@part
def _logistic(a: float, b: float, elevation: float) -> tuple[float, float]:
    """Return the derivatives of first and second order of the probability of line of sight."""
    p = 1.0 / (1.0 + a * np.exp(-b * (elevation - a)))
    return b * p * (1.0 - p), b * b * p * (1.0 - p) * (1.0 - 2.0 * p)


@part
def _logistic_bounds(
    a: float, b: float, low: float, high: float
) -> tuple[tuple[float, float], tuple[float, float]]:
    """Return the least and the largest derivatives of both orders between two elevations."""
    steepest, off = a + np.log(a) / b, np.log(2.0 + np.sqrt(3.0)) / b
    (one, bend), (other, last) = _logistic(a, b, low), _logistic(a, b, high)
    most = 0.25 * b if low <= steepest <= high else max(one, other)
    least_bend, most_bend = min(bend, last), max(bend, last)
    if low <= steepest - off <= high:
        most_bend = STEEPEST * b * b
    if low <= steepest + off <= high:
        least_bend = -STEEPEST * b * b
    return (min(one, other), most), (least_bend, most_bend)


@part
def _steepness(fall_db: float, a: float, b: float, elevation: float) -> float:
    return float(TANGENT * np.tan(elevation / DEGREES) - fall_db * _logistic(a, b, elevation)[0])


@kernel
def _stationary(fall_db: float, a: float, b: float, low: float, high: float) -> float:
    """Return the root between two elevations at which the slope has different signs."""
    begins = _steepness(fall_db, a, b, low) > 0.0
    while True:
        middle = 0.5 * (low + high)
        if not low < middle < high:
            return float(middle)
        if (_steepness(fall_db, a, b, middle) > 0.0) == begins:
            low = middle
        else:
            high = middle
