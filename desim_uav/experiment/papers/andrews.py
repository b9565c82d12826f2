"""Andrews, Baccelli and Ganti 2011: coverage in a cellular network of random stations."""

from __future__ import annotations

import math
from collections.abc import Iterator
from functools import cache
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from desim_uav.experiment.papers.row import FigureRow

if TYPE_CHECKING:
    from matplotlib.figure import Figure

DROPS, STATIONS, SEED = 100_000, 60, 2011
EVALUATED = {-10.0: 0.911699, 0.0: 0.560099, 10.0: 0.200050}
"""The share covered by threshold in dB, from the closed form, evaluated apart."""


def rows() -> Iterator[FigureRow]:
    """Yield the share of users whose signal-to-interference ratio passes a threshold."""
    ratios = simulated_db()
    for threshold, share in EVALUATED.items():
        is_covered = ratios > threshold
        ours = float(is_covered.mean())
        error = math.sqrt(ours * (1.0 - ours) / len(ratios))
        what = f"{threshold:g} dB: share covered ({DROPS:,} drops)"
        yield FigureRow(what, "closed form for exponent 4, no noise", share, ours, 4.0 * error, 6)


@cache
def simulated_db() -> NDArray[np.float64]:
    """Return the ratio of signal to interference of one user in each of many random networks.

    Stations are a Poisson process; all send with the same power and all fade (Rayleigh), the loss
    has exponent 4, and the user is served by the nearest. The stations beyond the 60 nearest are
    replaced by their mean.
    """
    random = np.random.default_rng(SEED)
    # With 1/pi stations per area, squared distances are the times of a Poisson process of rate 1.
    squared = np.cumsum(random.exponential(size=(DROPS, STATIONS)), axis=1)
    received = random.exponential(size=(DROPS, STATIONS)) * squared**-2.0
    interference = received[:, 1:].sum(axis=1) + 1.0 / squared[:, -1]
    ratios: NDArray[np.float64] = 10.0 * np.log10(received[:, 0] / interference)
    return ratios


def closed_form(threshold_db: float) -> float:
    """Return the share of users above a threshold: 1 / (1 + sqrt(T) (pi/2 - atan(1/sqrt(T))))."""
    root = math.sqrt(10.0 ** (threshold_db / 10.0))
    return 1.0 / (1.0 + root * (math.pi / 2.0 - math.atan(1.0 / root)))


def draw() -> Figure:
    """Draw the share covered over the threshold, by the closed form and as simulated."""
    from desim_uav.report.figures.papers import Series, lines_figure

    thresholds = [0.5 * k for k in range(-30, 41)]
    ratios = np.sort(simulated_db())
    shares = 1.0 - np.searchsorted(ratios, thresholds) / len(ratios)
    return lines_figure(
        "Share of users above a signal-to-interference ratio",
        "threshold, dB",
        "share covered",
        [
            Series("closed form", thresholds, [closed_form(t) for t in thresholds]),
            Series("simulated", thresholds, shares.tolist()),
        ],
    )
