"""Performance profiles: the share of a policy's runs that reach each score (Agarwal et al., 2021).

A policy whose curve is above another's everywhere reaches any score more often. The bands are
pointwise 95 % intervals from the same stratified bootstrap as those of the scores.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from desim_uav.errors import PolicyError
from desim_uav.experiment.bench.score import ENDS, Floats, resampled
from desim_uav.report.curves import Curve, Panel

if TYPE_CHECKING:
    from matplotlib.figure import Figure

LEAST, MOST, POINTS = -1.0, 1.0, 101
"""The scores of a curve; lower ones than the least count as not reached anywhere."""

RESAMPLES = 500
"""The resamples of a band: fewer than those of an interval, as a band has many points."""


def figure(tables: Sequence[dict[str, Any]]) -> Figure:
    """Draw the profiles of a leaderboard, a panel for each track.

    Raises PolicyError if no policy of it has a score.
    """
    from desim_uav.report.figures.profile import profile_figure

    curves = panels(tables)
    if not curves:
        raise PolicyError(
            "there is no profile, because no policy has a score; scores need references, which "
            "`python analysis/bench_references.py` or `desim-uav bench reveal` computes"
        )
    return profile_figure(curves)


def panels(tables: Sequence[dict[str, Any]]) -> list[Panel]:
    """Return the curves of each track, of the policies that have a score in all of its tasks."""
    pictures = []
    for track in dict.fromkeys(table["track"] for table in tables):
        table = [each for each in tables if each["track"] == track][-1]
        names = table.get("tasks") or [table["task"]]
        rows = [
            row
            for row in table["rows"]
            if row["score"] is not None and row.get("tasks", 1) == len(names)
        ]
        if rows:
            pictures.append(Panel(_title(track, names), list(map(_curve, rows))))
    return pictures


def shares(strata: Sequence[Floats], scores: Floats) -> Floats:
    """Return the share of runs that reach each score; each task counts the same."""
    shares_of = [(stratum[..., None, :] >= scores[:, None]).mean(axis=-1) for stratum in strata]
    return np.asarray(np.mean(shares_of, axis=0), dtype=float)


def _curve(row: dict[str, Any]) -> Curve:
    strata = row.get("strata") or [row["scores"]]
    arrays = [np.atleast_2d(np.asarray(stratum, dtype=float)) for stratum in strata]
    scores = np.linspace(LEAST, MOST, POINTS)
    low, high = np.quantile(shares(resampled(arrays, RESAMPLES), scores), ENDS, axis=0)
    middle = shares([array.ravel() for array in arrays], scores)
    name = row["policy"] + ("*" if row["knows_future"] else "")
    return Curve(name, scores, middle, low, high)


def _title(track: str, names: Sequence[str]) -> str:
    return f"Track {track}: " + (names[0] if len(names) == 1 else f"{len(names)} tasks")
