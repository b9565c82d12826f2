"""Mozaffari, Saad, Bennis and Debbah 2015: drone small cells, one and two."""

from __future__ import annotations

import math
from collections.abc import Iterator
from functools import cache
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from desim_uav.experiment.papers.best_altitude import optimal_elevation_deg
from desim_uav.experiment.papers.row import FigureRow
from desim_uav.model.radio.path_loss import AlHourani

if TYPE_CHECKING:
    from matplotlib.figure import Figure

CARRIER_GHZ, NOISE_DBM, THRESHOLD_DB = 2.0, -120.0, 10.0
MODEL = AlHourani(a=9.6, b=0.28, eta_los_db=1.0, eta_nlos_db=20.0)
READ_DBM = {500.0: -15.0, 1000.0: -8.0, 1500.0: -5.5}
TWO_HEIGHT_M, TWO_WIDTH_M, TOUCHING_M = 300.0, 700.0, 450.0
READ_SEPARATION_M = {1800.0: 1000.0, 2000.0: 1100.0, 2400.0: 1350.0}
STEP_M = 5.0

Array = NDArray[np.float64]


def least_power_dbm(radius_m: float, height_m: float) -> float:
    """Return the power with which a drone at this height just covers a radius."""
    return MODEL.mean_db(radius_m, height_m, CARRIER_GHZ) + NOISE_DBM + THRESHOLD_DB


def best_height_m(radius_m: float) -> float:
    """Return the height from which a radius needs the least power."""
    return radius_m * math.tan(math.radians(optimal_elevation_deg(MODEL)))


def rows() -> Iterator[FigureRow]:
    """Yield the best altitude and powers of one drone, and the best separations of two."""
    altitude = best_height_m(500.0)
    yield FigureRow("500 m: best altitude, m", "printed, to 10 m", 310.0, altitude, 5.0, 2)
    for radius, power in READ_DBM.items():
        ours = least_power_dbm(radius, best_height_m(radius))
        yield FigureRow(
            f"{radius:.0f} m: least power, dBm", "read off figure 4", power, ours, 1.0, 2
        )
    how = "figures 6 and 7; the power is not known to us"
    alone, _ = best_separation(2000.0, interference=False)
    yield FigureRow("2000 m by 700 m, no interference: separation, m", how, 900.0, alone, None, 0)
    for length, separation in READ_SEPARATION_M.items():
        ours, share = best_separation(length, interference=True)
        what = f"{length:.0f} m by 700 m, interference"
        yield FigureRow(f"{what}: separation, m", how, separation, ours, None, 0)
        if length == 2000.0:
            yield FigureRow(f"{what}: share covered", how, 0.78, share, None, 2)


@cache
def best_separation(length_m: float, *, interference: bool) -> tuple[float, float]:
    """Return the smallest separation at which two drones cover most of a rectangle, and the share.

    Each just covers 450 m on its own: two discs of this radius touch at the printed 900 m.
    """
    tried = np.arange(400.0, 1800.0, 10.0)
    shares = [covered_share(d, length_m, interference=interference) for d in tried.tolist()]
    best = max(range(len(shares)), key=lambda k: (round(shares[k], 9), -k))
    return float(tried[best]), shares[best]


def covered_share(separation_m: float, length_m: float, *, interference: bool) -> float:
    """Return the share of a rectangle in which the stronger drone is received well enough."""
    x = np.arange(STEP_M / 2.0, length_m / 2.0, STEP_M)
    y = np.arange(STEP_M / 2.0, TWO_WIDTH_M / 2.0, STEP_M)[:, np.newaxis]
    near = _received_mw(np.hypot(x - separation_m / 2.0, y))
    far = _received_mw(np.hypot(x + separation_m / 2.0, y)) if interference else 0.0
    ratio = near / (far + 10.0 ** (NOISE_DBM / 10.0))
    return float(np.mean(ratio >= 10.0 ** (THRESHOLD_DB / 10.0)))


def _received_mw(distances_m: Array) -> Array:
    """Return the power received at distances from a drone, between distances 1 m apart."""
    return 10.0 ** (np.interp(distances_m, np.arange(len(_levels_dbm())), _levels_dbm()) / 10.0)


@cache
def _levels_dbm() -> list[float]:
    """Return the power received at each metre from a drone."""
    power = least_power_dbm(TOUCHING_M, TWO_HEIGHT_M)
    return [power - MODEL.mean_db(float(metre), TWO_HEIGHT_M, CARRIER_GHZ) for metre in range(3000)]


def draw() -> Figure:
    """Draw the power over the altitude, for three radii; the paper's at our best altitude."""
    from desim_uav.report.figures.papers import Series, lines_figure

    heights = [20.0 * k for k in range(1, 101)]
    series = []
    for radius, read in READ_DBM.items():
        curve = [least_power_dbm(radius, height) for height in heights]
        series.append(
            Series(f"{radius:.0f} m", heights, curve, points=((best_height_m(radius), read),))
        )
    return lines_figure(
        "Least power with which one drone covers a radius",
        "altitude, m",
        "power, dBm",
        series,
        "lowest power, read off figure 4",
    )
