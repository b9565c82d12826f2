"""3GPP TR 36.777: line of sight and path loss of aerial users."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

from desim_uav.experiment.papers.row import FigureRow, evaluated
from desim_uav.model.radio.three_gpp import Aerial, share_in_sight

if TYPE_CHECKING:
    from matplotlib.figure import Figure

SCENARIOS = {"RMa-AV": Aerial("rma"), "UMa-AV": Aerial("uma"), "UMi-AV": Aerial("umi")}
"""The scenarios of the report by name."""

SIGHT = (
    *(("RMa-AV", 30.0, 1000.0, 0.908744), ("RMa-AV", 40.0, 2000.0, 0.841166)),
    *(("UMa-AV", 50.0, 1000.0, 0.772052), ("UMa-AV", 100.0, 4000.0, 0.465695)),
    *(("UMi-AV", 50.0, 200.0, 0.735896), ("UMi-AV", 300.0, 1000.0, 0.420591)),
)
"""Scenario, height, distance and the probability of line of sight."""

LOSSES = (
    *(("RMa-AV", 30.0, 1000.0, 102.186033, 107.976292),),
    *(("UMa-AV", 50.0, 500.0, 93.409868, 113.035201),),
    *(("UMi-AV", 100.0, 500.0, 94.420847, 114.185632),),
)
"""Scenario, height, distance and the losses at 2 GHz with and without line of sight."""


def rows() -> Iterator[FigureRow]:
    """Yield probabilities of line of sight, and losses at 2 GHz."""
    for name, height, distance, share in SIGHT:
        what = f"{name}, {height:.0f} m up, {distance:.0f} m away: line of sight"
        ours = share_in_sight(SCENARIOS[name], distance, height)
        yield evaluated(what, "table B-1, evaluated apart", share, ours, 6)
    for name, height, distance, *losses in LOSSES:
        model = SCENARIOS[name]
        for loss, losing, state in zip(
            losses, (model.los_db, model.nlos_db), ("in sight", "not in sight"), strict=True
        ):
            what = f"{name}, {height:.0f} m up, {distance:.0f} m away: loss {state}, dB"
            ours = losing(distance, height, 2.0)
            yield evaluated(what, "table B-2, evaluated apart", loss, ours, 6)


def draw() -> Figure:
    """Draw the probability of line of sight of each scenario over the distance, at 30 m."""
    from desim_uav.report.figures.papers import Series, lines_figure

    distances = [20.0 * k for k in range(201)]
    series = [
        Series(
            name,
            distances,
            [share_in_sight(model, away, 30.0) for away in distances],
            tuple((away, share) for of, up, away, share in SIGHT if (of, up) == (name, 30.0)),
        )
        for name, model in SCENARIOS.items()
    ]
    return lines_figure(
        "Line of sight of aerial users 30 m up, TR 36.777",
        "distance, m",
        "probability",
        series,
        "table B-1, apart",
    )
