"""How fast a level can change from one place to another: bounds in dB per metre.

A search for thresholds (``model.radio.search``) is only as good as these bounds. They must hold at
all places at most ``within_m`` away from the place where the drone is ``distance_m`` away from the
user horizontally and ``height_m`` above it, and are infinite where there is none.
docs/explanation/sinr.md proves those below.
"""

from __future__ import annotations

import numpy as np

from desim_uav.rowcode.kernels import kernel, part

DB = 10.0 / np.log(10.0)
"""A change of a power by a small share is so many decibels times the share."""

DEGREES = 180.0 / np.pi


@kernel
def logistic_rates(
    exponent: float,
    fall_db: float,
    a: float,
    b: float,
    distance_m: float,
    height_m: float,
    within_m: float,
) -> tuple[float, float, float, float]:
    """Return the least and the most that a level changes over the mean loss of Al-Hourani et al.

    The loss is 10 ``exponent`` log10(d) over the distance in space, and a mean excess. The excess
    falls by ``fall_db``, that without line of sight less that with it, as the probability of line
    of sight 1 / (1 + a exp(-b (elevation - a))) rises from 0 to 1.

    Two numbers are for each metre of horizontal distance, and two for each metre of height. Unlike
    bounds of the size, they say where a level is monotone.
    """
    far = np.sqrt(distance_m * distance_m + height_m * height_m)
    if far <= within_m:
        return -np.inf, np.inf, -np.inf, np.inf
    per_m, nearer_per_m, farther_per_m = 1.0 / far, 1.0 / (far - within_m), 1.0 / (far + within_m)
    share = within_m * per_m
    rest = np.sqrt((1.0 - share) * (1.0 + share))
    level, upright = distance_m * per_m, height_m * per_m
    # The cosines and sines of the lowest and the highest elevation, which differ by twice asin
    # (share). Behind the zenith and the nadir the drone is seen at a smaller elevation again.
    level_low, level_high = level * rest + upright * share, level * rest - upright * share
    low = upright * rest - level * share if level_low > 0.0 else -1.0
    high = upright * rest + level * share if level_high > 0.0 else 1.0
    least, most = max(min(level_low, level_high), 0.0), min(max(level_low, level_high), 1.0)
    if low <= 0.0 <= high:
        most = 1.0
    along, across_low, across_high = DB * exponent, 0.0, 0.0
    if fall_db > 0.0:
        apart = share + 0.571 * share * share * share  # no less than asin(share)
        # The probability rises as fast at odds as at their inverse, and fastest at odds of 1.
        odds = a * np.exp(-b * (np.arctan2(height_m, distance_m) * DEGREES - a))
        odds, away = min(odds, 1.0 / odds), least_share(b * DEGREES * apart)
        most_db = fall_db * DEGREES * b
        across_low = most_db * _rise(odds * away)
        across_high = most_db * _rise(min(odds / away, 1.0))
    # With the distance the level falls by (along cos + across sin) / d, and with the height it
    # rises by (across cos - along sin) / d.
    falls_least = along * least + (across_low if low > 0.0 else across_high) * low
    falls_most = along * most + (across_high if high > 0.0 else across_low) * high
    rises_least, rises_most = across_low * least - along * high, across_high * most - along * low
    return (
        -_times(falls_most, nearer_per_m, farther_per_m),
        -_times(falls_least, farther_per_m, nearer_per_m),
        _times(rises_least, farther_per_m, nearer_per_m),
        _times(rises_most, nearer_per_m, farther_per_m),
    )


@part
def least_share(x: float) -> float:
    """Return a number slightly below exp(-x), or equal to it; x is at least 0.

    A partial sum of the alternating series, which ends with an odd power, is below it.
    """
    if x < 0.5:
        return 1.0 - x * (1.0 - x * (0.5 - x * (1.0 / 6.0)))
    return float(np.exp(-x))


@part
def _rise(odds: float) -> float:
    """Return the rise of a probability with the logarithm of its odds."""
    return odds / ((1.0 + odds) * (1.0 + odds))


@part
def _times(number: float, by: float, otherwise: float) -> float:
    """Return a number times one of two factors, depending on its sign."""
    return number * by if number > 0.0 else number * otherwise
