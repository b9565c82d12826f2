"""The altitude from which a drone covers most, for Al-Hourani's path loss.

Al-Hourani, Kandeepan and Lardner, Optimal LAP altitude for maximum coverage, 2014. At a given
largest loss, the radius depends on the elevation of the drone as seen from the edge alone, and the
best elevation is the same for every largest loss.
"""

from __future__ import annotations

import math
from itertools import pairwise
from typing import Any, NamedTuple

from desim_uav.model.radio.functions import exp
from desim_uav.model.radio.path_loss import AlHourani, free_space_db, mean_of

STEPS_A_DEGREE = 50


class Coverage(NamedTuple):
    """A disc that a drone covers: its radius, and the drone's height and elevation at the edge."""

    radius_m: float
    height_m: float
    elevation_deg: float


def best_coverage(model: AlHourani, largest_db: float, carrier_ghz: float) -> Coverage:
    """Return the largest disc in which the mean loss is at most ``largest_db``."""
    return coverage_at(model, optimal_elevation_deg(model), largest_db, carrier_ghz)


def coverage_at(
    model: AlHourani, elevation: float, largest_db: float, carrier_ghz: float
) -> Coverage:
    """Return the disc at whose edge the drone has this elevation and the mean loss is largest."""
    in_air_db = largest_db - _excess_db(model, elevation)
    slant_m = 10.0 ** ((in_air_db - free_space_db(1.0, 0.0, carrier_ghz)) / 20.0)
    angle = math.radians(elevation)
    return Coverage(slant_m * math.cos(angle), slant_m * math.sin(angle), elevation)


def optimal_elevation_deg(model: AlHourani) -> float:
    """Return the elevation in degrees at which a covered disc is largest."""
    return max(
        stationary_elevations_deg(model),
        key=lambda elevation: coverage_at(model, elevation, 100.0, 2.0).radius_m,
    )


def stationary_elevations_deg(model: AlHourani) -> list[float]:
    """Return all elevations at which the loss at a fixed distance turns as the drone climbs.

    Among them is the best one. They are bracketed by a search in steps of 1/50 degree: there can be
    several (three in the environment high_rise), of which Newton's method would find any.
    """
    steps = [k / STEPS_A_DEGREE for k in range(1, 90 * STEPS_A_DEGREE)]
    return [
        _root(model, low, high)
        for low, high in pairwise(steps)
        if _slope(model, low) < 0.0 <= _slope(model, high)
        or _slope(model, low) >= 0.0 > _slope(model, high)
    ]


def _slope(model: Any, elevation: float) -> float:
    """Return the left side of equation 13, which is 0 where the loss is stationary."""
    blocked = model.a * exp(-model.b * (elevation - model.a))
    tangent = math.tan(math.radians(elevation))
    gain_db: float = (
        model.b * (model.eta_los_db - model.eta_nlos_db) * blocked / (blocked + 1.0) ** 2
    )
    return math.pi / (9.0 * math.log(10.0)) * tangent + gain_db


def _root(model: AlHourani, low: float, high: float) -> float:
    """Return the elevation between two others at which the slope changes its sign."""
    rises = _slope(model, low) < 0.0
    while low < (middle := 0.5 * (low + high)) < high:
        if (_slope(model, middle) < 0.0) is rises:
            low = middle
        else:
            high = middle
    return middle


def _excess_db(model: Any, elevation: float) -> float:
    """Return the mean loss beyond that of free space, in dB."""
    return mean_of(model.p_los(elevation), model.eta_los_db, model.eta_nlos_db)
