"""Distributions from which models of mobility draw, and the ranges from which they draw.

Functions that a logarithm or an exponential enters round to multiples of 2**-20, because their last
bits differ between platforms.
"""

from __future__ import annotations

import math
from typing import Annotated

import numpy as np
from annotated_types import Ge, Le

from desim_uav.model.random.streams import Stream, uniform
from desim_uav.registry import Checked
from desim_uav.rowcode.kernels import rule

SLOWEST_MPS = 0.01
"""The least speed of users who move."""


def ascending(values: tuple[float, float]) -> None:
    """Raise ValueError if two values are not a range."""
    low, high = values
    if low > high:
        raise ValueError(f"must be [low, high] with low <= high; {low:g} is above {high:g}")


def a_range_of_speeds(values: tuple[float, float]) -> None:
    """Raise ValueError, with the reason, for speeds that may be as low as 0."""
    ascending(values)
    if values[0] < SLOWEST_MPS:
        raise ValueError(
            f"the lowest speed must be at least {SLOWEST_MPS:g} m/s: if speeds near 0 are drawn, "
            "walks at such speeds never end, so the mean speed of users decays to 0 and there is "
            "no stationary distribution (Yoon, Liu and Noble 2003)"
        )


Speed = Annotated[float, Ge(0), Le(200)]
SpeedRange = Annotated[tuple[Speed, Speed], Checked(a_range_of_speeds)]


# ---- draws


@rule
def on_grid(value: float) -> float:
    """Return a number rounded to a multiple of 2**-20."""
    return float(np.rint(value * 1048576.0)) / 1048576.0


@rule
def between(stream: Stream, low: float, high: float) -> float:
    """Return a uniform number from ``low`` to ``high``."""
    return low + uniform(stream) * (high - low)


@rule
def power_law(stream: Stream, low: float, high: float, exponent: float) -> float:
    """Return a number from ``low`` > 0 to ``high`` whose density is in proportion to its power.

    The distribution function is inverted, in a form that holds near the exponent -1 too.
    """
    log_ratio, share, power = math.log(high / low), uniform(stream), exponent + 1.0
    if abs(power * log_ratio) > 1e-9:
        share = math.log1p(share * math.expm1(power * log_ratio)) / (power * log_ratio)
    return min(max(on_grid(low * math.exp(share * log_ratio)), low), high)


@rule
def longer_first(stream: Stream, low: float, high: float) -> float:
    """Return a number from ``low`` to ``high`` whose density is in proportion to itself.

    Of uniform times, it is that under way at a given moment.
    """
    return math.sqrt(low * low + uniform(stream) * (high * high - low * low))


@rule
def two_normals(stream: Stream) -> tuple[float, float]:
    """Return two independent standard normal numbers, by Marsaglia's polar method."""
    while True:
        x, y = between(stream, -1.0, 1.0), between(stream, -1.0, 1.0)
        squared = x * x + y * y
        if 0.0 < squared < 1.0:
            scale = math.sqrt(-2.0 * math.log(squared) / squared)
            return on_grid(x * scale), on_grid(y * scale)


@rule
def in_disc(stream: Stream) -> tuple[float, float]:
    """Return a point that is uniform in the disc of radius 1 around 0."""
    while True:
        x, y = between(stream, -1.0, 1.0), between(stream, -1.0, 1.0)
        if x * x + y * y <= 1.0:
            return x, y


# ---- means


@rule
def mean_distance(width: float, depth: float) -> float:
    """Return the mean distance of two uniform points in a rectangle.

    It is a known integral (Ghosh 1951), which is (2 + √2 + 5 ln(1 + √2)) / 15 in the unit square.
    In a very long rectangle it is a third of the length, to which the integral would be rounded.
    """
    a, b = max(width, depth), min(width, depth)
    if a > 1e4 * b:
        return a / 3.0
    d = math.sqrt(a * a + b * b)
    far = a * a * a / (b * b) + b * b * b / (a * a) + d * (3.0 - (a / b) ** 2 - (b / a) ** 2)
    near = b * b / a * math.log((a + d) / b) + a * a / b * math.log((b + d) / a)
    return far / 15.0 + near / 6.0


def mean_slowness(low: float, high: float) -> float:
    """Return the mean of 1 / v for a speed v that is uniform from ``low`` to ``high``."""
    if high - low <= 1e-9 * high:
        return 1.0 / high
    return math.log(high / low) / (high - low)


def mean_of_power_law(low: float, high: float, exponent: float) -> float:
    """Return the mean of numbers as ``power_law`` draws them."""
    log_ratio = math.log(high / low)
    return low * _integral(exponent + 2.0, log_ratio) / _integral(exponent + 1.0, log_ratio)


def _integral(power: float, log_ratio: float) -> float:
    """Return the integral of x^(power - 1) from 1 to exp(log_ratio), divided by log_ratio."""
    if abs(power * log_ratio) < 1e-9:
        return 1.0
    return math.expm1(power * log_ratio) / (power * log_ratio)
