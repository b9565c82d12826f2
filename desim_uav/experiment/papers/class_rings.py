"""Rings of classes: where a link has which rate, from Al-Hourani's urban path loss."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

from desim_uav.experiment.papers.row import FigureRow, evaluated
from desim_uav.model.radio.link import LinkBudget, LinkClass
from desim_uav.model.radio.path_loss import AlHourani
from desim_uav.model.radio.rings import rings

if TYPE_CHECKING:
    from matplotlib.figure import Figure

BUDGET, CARRIER_GHZ, HEIGHT_M = LinkBudget(30.0, 1.0, 7.0), 2.0, 100.0
EVALUATED_M = {0.65: 8264.301, 4.49: 5328.230, 10.03: 2839.666, 14.94: 1638.773, 18.97: 1056.927}
"""The radius of the mean loss by threshold in dB: 30 dBm, 1 MHz, a noise figure of 7 dB."""


def radii_m(height_m: float) -> tuple[float, ...]:
    """Return the radius of each threshold at a height."""
    classes = [LinkClass(snr_db, float(k + 1)) for k, snr_db in enumerate(EVALUATED_M)]
    return rings(AlHourani("urban"), CARRIER_GHZ, height_m, BUDGET, classes).mean_m


def rows() -> Iterator[FigureRow]:
    """Yield the radius of each threshold, 100 m up."""
    how = "the paper's formulas, root found apart"
    for (snr_db, radius), ours in zip(EVALUATED_M.items(), radii_m(HEIGHT_M), strict=True):
        yield evaluated(f"urban, {snr_db:g} dB: radius, m", how, radius, ours, 3)


def draw() -> Figure:
    """Draw the radius of each threshold over the height."""
    from desim_uav.report.figures.papers import Series, lines_figure

    heights = [50.0 * k for k in range(1, 61)]
    by_height = [radii_m(height) for height in heights]
    series = [
        Series(f"{snr_db:g} dB", heights, [radii[k] for radii in by_height], ((HEIGHT_M, apart),))
        for k, (snr_db, apart) in enumerate(EVALUATED_M.items())
    ]
    return lines_figure(
        "Rings of classes: urban, 2 GHz, 30 dBm, 1 MHz",
        "height, m",
        "radius, m",
        series,
        "roots found apart",
    )
