"""Al-Hourani, Kandeepan and Lardner 2014: the altitude from which a drone covers most."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

from scipy.optimize import minimize_scalar

from desim_uav.experiment.papers.best_altitude import best_coverage, optimal_elevation_deg
from desim_uav.experiment.papers.row import FigureRow, evaluated
from desim_uav.model.radio.path_loss import ENVIRONMENTS, AlHourani
from desim_uav.model.radio.rings import ring_m

if TYPE_CHECKING:
    from matplotlib.figure import Figure

CARRIER_GHZ, LARGEST_DB = 2.0, 100.0
PRINTED_DEG = {"suburban": 20.34, "urban": 42.44, "dense_urban": 54.62, "high_rise": 75.52}
EVALUATED_M = {
    "suburban": (1089.0506, 403.6887),
    "urban": (706.5488, 646.0401),
    "dense_urban": (448.0749, 630.9491),
    "high_rise": (60.6681, 234.9035),
}
"""Radius and height at 100 dB and 2 GHz, from the paper's formulas."""


def radius_m(model: AlHourani, height_m: float) -> float:
    """Return the radius within which the mean loss from this height is at most 100 dB."""
    return ring_m(lambda r: model.mean_db(r, height_m, CARRIER_GHZ), LARGEST_DB)


def rows() -> Iterator[FigureRow]:
    """Yield the best elevations, and the tops of the curves of radius over height."""
    for name in ENVIRONMENTS:
        angle = optimal_elevation_deg(AlHourani(name))
        what = f"{name}: best elevation, degrees"
        yield evaluated(what, "printed, 2 decimals", PRINTED_DEG[name], angle, 2)
    for name in ENVIRONMENTS:
        model = AlHourani(name)
        top = best_coverage(model, LARGEST_DB, CARRIER_GHZ)
        searched = minimize_scalar(
            lambda h, model=model: -radius_m(model, h),
            bounds=(0.8 * top.height_m, 1.2 * top.height_m),
            method="bounded",
            options={"xatol": 1e-6},
        )
        radius, height = EVALUATED_M[name]
        how = "the paper's formulas, evaluated apart"
        yield evaluated(f"{name}, 100 dB: radius, m", how, radius, -searched.fun, 4)
        yield evaluated(f"{name}, 100 dB: height, m", how, height, top.height_m, 4)


def draw() -> Figure:
    """Draw the radius over the height in each environment, with the largest one known."""
    from desim_uav.report.figures.papers import Series, lines_figure

    heights = [10.0 * k for k in range(1, 131)]
    series = []
    for name in ENVIRONMENTS:
        model = AlHourani(name)
        radius, height = EVALUATED_M[name]
        curve = [radius_m(model, height) for height in heights]
        series.append(Series(name, heights, curve, points=((height, radius),)))
    return lines_figure(
        "Radius in which the mean loss is at most 100 dB, 2 GHz",
        "height, m",
        "radius, m",
        series,
        "the paper's formulas, apart",
    )
