"""3GPP event A3: where a user who leaves one station for another is handed over."""

from __future__ import annotations

from collections.abc import Iterator

from desim_uav.experiment.papers.row import FigureRow, evaluated
from desim_uav.model.radio.path_loss import LogDistance
from desim_uav.model.radio.rings import last_m

LINE_M = 500.0
EVALUATED_M = {(3.0, 3.76): 272.9002, (3.0, 2.0): 292.7493, (2.0, 2.0): 278.6558}
"""The place on a line of 500 m by margin in dB and exponent, from the circle of Apollonius."""


def rows() -> Iterator[FigureRow]:
    """Yield the place on the line between two stations at which the entering condition begins."""
    for (margin_db, exponent), place in EVALUATED_M.items():
        what = f"{margin_db:g} dB, exponent {exponent:g}: place on a line of 500 m, m"
        how = "TS 38.331, 5.5.4.4; circle of Apollonius"
        yield evaluated(what, how, place, handover_m(margin_db, exponent), 4)


def handover_m(margin_db: float, exponent: float) -> float:
    """Return how far the user has come when the next station exceeds the last by the margin."""
    model = LogDistance(exponent, 0.0)

    def stays(place_m: float) -> bool:
        serving_db = -model.los_db(place_m, 0.0, 2.0)
        return -model.los_db(LINE_M - place_m, 0.0, 2.0) <= serving_db + margin_db

    return last_m(stays, LINE_M)
