"""The altitude from which a drone covers most, for Al-Hourani's path loss.

Al-Hourani, Kandeepan and Lardner, Optimal LAP altitude for maximum coverage, 2014. At a given
largest loss, the radius depends on the elevation of the drone as seen from the edge alone, and the
best elevation is the same for every largest loss.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from desim_uav.experiment.papers.stationary import stationary_elevations
from desim_uav.model.radio.path_loss import AlHourani, free_space_db, mean_of

MOST_TURNS = 8
"""The size of the buffer for stationary elevations; the towns of the paper have one or three."""


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


def stationary_elevations_deg(model: Any) -> list[float]:
    """Return all elevations at which the loss at a fixed distance turns as the drone climbs.

    Among them is the best one. There can be several: three in the environment high_rise.
    """
    buffer, fall_db = np.empty(MOST_TURNS), model.eta_nlos_db - model.eta_los_db
    count = stationary_elevations(float(fall_db), float(model.a), float(model.b), buffer)
    assert count <= MOST_TURNS
    turns: list[float] = buffer[:count].tolist()
    return turns


def _excess_db(model: Any, elevation: float) -> float:
    """Return the mean loss beyond that of free space, in dB."""
    return mean_of(model.p_los(elevation), model.eta_los_db, model.eta_nlos_db)
