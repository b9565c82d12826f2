"""Bounds of the change of a level that are computed from samples, for a loss without its own.

They take about a hundred times as long as formulas (``model.radio.slopes``), and cannot be proven.
"""

from __future__ import annotations

import math
from itertools import product
from typing import Any

import numpy as np

from desim_uav.rowcode.kernels import rule

SAFETY = 2.0
"""Bounds are so many times the fastest change at the sampled places."""

STEP = 1e-4
"""The step of a numerical derivative, as a share of the distance in space."""

LEAST_SHARE = 1e-3
"""The least height of a sample above the user, as a share of the height of their centre."""

PLACES = tuple(
    (share * math.cos(math.radians(degrees)), share * math.sin(math.radians(degrees)))
    for share, degrees in product((1 / 3, 2 / 3, 1.0), range(0, 360, 45))
)
"""Where samples are: as shares of the distance within which bounds must hold. Another one is at the
centre, and one at the place that is nearest to the user, where losses change fastest."""

_ALONG = tuple(along for along, _ in PLACES)
_UP = tuple(up for _, up in PLACES)


def sampled_rates(loss_db: Any) -> Any:
    """Return a rule that computes ``rates`` of a path loss at a carrier.

    ``loss_db`` is a rule of the path loss, the carrier in GHz, the branch, the distance and the
    height.
    """

    @rule
    def steep(own: Any, carrier_ghz: float, branch: int, distance_m: float, height_m: float) -> Any:
        """Return how fast a loss changes at a place with the distance, and with the height."""
        step_m = STEP * math.sqrt(distance_m * distance_m + height_m * height_m)
        near_m, low_m = max(distance_m - step_m, 0.0), max(height_m - step_m, 0.5 * height_m)
        far_m, high_m = distance_m + step_m, height_m + step_m
        away_db = loss_db(own, carrier_ghz, branch, far_m, height_m)
        away_db -= loss_db(own, carrier_ghz, branch, near_m, height_m)
        over_db = loss_db(own, carrier_ghz, branch, distance_m, high_m)
        over_db -= loss_db(own, carrier_ghz, branch, distance_m, low_m)
        return abs(away_db) / (far_m - near_m), abs(over_db) / (high_m - low_m)

    @rule
    def rates_of(
        own: Any,
        carrier_ghz: float,
        branch: int,
        distance_m: float,
        height_m: float,
        within_m: float,
    ) -> Any:
        slant_m = math.sqrt(distance_m * distance_m + height_m * height_m)
        if slant_m <= within_m:
            return -np.inf, 0.0, -np.inf, np.inf
        away_db, over_db = steep(own, carrier_ghz, branch, distance_m, height_m)
        nearest = 1.0 - within_m / slant_m
        away, over = steep(own, carrier_ghz, branch, nearest * distance_m, nearest * height_m)
        away_db, over_db = max(away_db, away), max(over_db, over)
        for k in range(len(_ALONG)):
            x_m = abs(distance_m + within_m * _ALONG[k])
            z_m = max(height_m + within_m * _UP[k], LEAST_SHARE * height_m)
            away, over = steep(own, carrier_ghz, branch, x_m, z_m)
            away_db, over_db = max(away_db, away), max(over_db, over)
        return -SAFETY * away_db, 0.0, -SAFETY * over_db, SAFETY * over_db

    return rates_of
