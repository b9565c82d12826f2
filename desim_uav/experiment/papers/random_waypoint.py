"""Random waypoint: the mean speed of users decays, unless they begin as in the long run."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from functools import cache
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from desim_uav.experiment.papers.row import FigureRow
from desim_uav.model.geometry.coverage import all_walked
from desim_uav.model.mobility.random_waypoint import RandomWaypoint
from desim_uav.model.mobility.walking import Start
from desim_uav.model.mobility.walks import Area, Walks
from desim_uav.model.random.streams import Purpose, Streams
from desim_uav.model.rules import US

if TYPE_CHECKING:
    from matplotlib.figure import Figure

USERS, SEED, SIDE_M = 10_000, 2003, 1000.0
LAST_S = 3000.0
"""By then, what users did at the start no longer matters: no leg takes longer than 1414 s."""

EVALUATED = {(1.0, 19.0): 6.113219, (1.0, 20.0): 6.342356}
"""The mean speed in the long run, (v2 - v1) / ln(v2 / v1), by the range of speeds."""

MEAN_WAY_M, ON_A_LINE = 521.405433, 0.05
PAUSES_S = (0.0, 120.0)

Floats = NDArray[np.float64]


def decay_rows() -> Iterator[FigureRow]:
    """Yield mean speeds of users who begin at uniform places with a walk, at first and at last."""
    for speeds, mean in EVALUATED.items():
        walks = walked(speeds, (0.0, 0.0), "home")
        first, last = speeds_at(walks, 0.0), speeds_at(walks, LAST_S)
        what = f"[{speeds[0]:g}, {speeds[1]:g}] m/s, begun with a walk: speed"
        yield _row(f"{what} at 0 s", "mean of the range", 0.5 * sum(speeds), first)
        yield _row(f"{what} at {LAST_S:g} s", "closed form, evaluated apart", mean, last)


def cure_rows() -> Iterator[FigureRow]:
    """Yield what is known of users who begin as in the long run, at first and later."""
    for speeds, mean in EVALUATED.items():
        walks = walked(speeds, (0.0, 0.0), "stationary")
        for t_s in (0.0, 60.0, LAST_S):
            what = f"[{speeds[0]:g}, {speeds[1]:g}] m/s: speed at {t_s:g} s"
            yield _row(what, "closed form, evaluated apart", mean, speeds_at(walks, t_s))
    paused, walks_s = 0.5 * sum(PAUSES_S), MEAN_WAY_M / EVALUATED[1.0, 19.0]
    walks = walked((1.0, 19.0), PAUSES_S, "stationary")
    for t_s in (0.0, LAST_S):
        what = f"[1, 19] m/s, pauses of 0 to 120 s: share that pauses at {t_s:g} s"
        share = paused / (paused + walks_s)
        yield _row(what, "closed form, evaluated apart", share, speeds_at(walks, t_s) == 0.0)
    yield _row(
        "square of 1000 m: length of a way, m",
        "known integral, evaluated apart",
        MEAN_WAY_M,
        lengths_of_ways(),
    )
    line = walked((5.0, 9.0), (0.0, 0.0), "stationary", depth_m=0.01)
    for t_s in (0.0, LAST_S):
        away = all_walked(*line, round(t_s * US))[:, 0] / SIDE_M - 0.5
        what = f"line of length 1: squared distance to the middle at {t_s:g} s"
        yield _row(what, "density 6 x (1 - x)", ON_A_LINE, away * away)


def _row(figure: str, where: str, theirs: float, values: NDArray[np.generic]) -> FigureRow:
    """Return a row of a mean over users, which are independent of each other."""
    sample = np.asarray(values, float)
    error = float(sample.std(ddof=1)) / math.sqrt(len(sample))
    return FigureRow(figure, where, theirs, float(sample.mean()), 4.0 * error, 4)


@cache
def walked(
    speeds: tuple[float, float],
    pauses: tuple[float, float],
    start: Start,
    depth_m: float = SIDE_M,
) -> Walks:
    """Return the walks of many users from homes that are uniform on the map."""
    area = Area(SIDE_M, depth_m)
    homes = np.random.default_rng(SEED).uniform((0.0, 0.0), area, (USERS, 2))
    streams = Streams(SEED, Purpose.MOBILITY)
    model = RandomWaypoint(speeds, pauses, start)
    return model.walks(homes, streams, area, round((LAST_S + 1.0) * US))


def speeds_at(walks: Walks, t_s: float) -> Floats:
    """Return how fast each user is at a time."""
    legs, offsets = walks
    users = np.repeat(np.arange(len(offsets) - 1), np.diff(offsets))
    underway = legs["begin_us"] <= t_s * US
    now = np.bincount(users[underway], minlength=len(offsets) - 1) + offsets[:-1] - 1
    speeds_mps: Floats = np.hypot(legs["vx_mps"], legs["vy_mps"])[now]
    return speeds_mps


def lengths_of_ways() -> Floats:
    """Return the length of each user's second way, which is the first between random places."""
    legs, offsets = walked((1.0, 19.0), (0.0, 0.0), "home")
    second = offsets[:-1] + 1
    lasts_s = (legs["begin_us"][second + 1] - legs["begin_us"][second]) / US
    lengths_m: Floats = np.hypot(legs["vx_mps"], legs["vy_mps"])[second] * lasts_s
    return lengths_m


def draw() -> Figure:
    """Draw the mean speed over time with both starts, and what is known at first and at last."""
    from desim_uav.report.figures.papers import Series, lines_figure

    times: Sequence[float] = [10.0 * k for k in range(121)]
    starts: dict[Start, str] = {"home": "begun with a walk", "stationary": "stationary start"}
    mean, series = EVALUATED[1.0, 19.0], []
    known = {"home": ((0.0, 10.0), (times[-1], mean)), "stationary": ((0.0, mean),)}
    for start, name in starts.items():
        walks = walked((1.0, 19.0), (0.0, 0.0), start)
        ours = [float(speeds_at(walks, t).mean()) for t in times]
        series.append(Series(name, times, ours, known[start]))
    return lines_figure(
        "Random waypoint, 1 to 19 m/s, square of 1000 m",
        "time, s",
        "mean speed, m/s",
        series,
        "closed forms, the last of the long run",
    )
