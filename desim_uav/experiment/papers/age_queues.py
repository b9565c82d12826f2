"""Kaul, Yates, Gruteser 2012, and Costa, Codreanu, Ephremides 2016: ages of updates in queues.

All times are in mean times of sending. Exponential sizes are a list of 1,000 values: the means of
the exponential law in its parts of equal probability.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from functools import cache
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq, minimize_scalar

from desim_uav.experiment.papers.row import FigureRow, evaluated
from desim_uav.experiment.papers.simulated import STANDARD_ERRORS, estimated, flown, scenario_of

if TYPE_CHECKING:
    from matplotlib.figure import Figure

SCENARIO = "age_queue.yaml"
EPISODES = 12
"""The episodes of a run; each begins anew and is a replication."""
WARMING_S = 500.0
"""The first part of an episode, which begins with an age of 0 and is not counted."""
FIRST_LOADS, SMALL_LOADS = (0.3, 0.4, 0.5, 0.6, 0.7, 0.8), (0.25, 0.5, 1.0, 2.0)
"""The loads. The best load is interpolated from the ages on the first ones."""

Law = Callable[[float], float]


def exponential_mbit(values: int = 1000) -> list[float]:
    """Return the means of the exponential law of mean 1 in parts of equal probability."""
    left = 1.0 - np.arange(values) / values
    above = np.append(left - left * np.log(left), 0.0)
    return [float(size) for size in np.round((above[:-1] - above[1:]) * values, 6)]


# ---- the laws of the papers


def m_m_1(load: float) -> float:
    """Return the age with Poisson updates and exponential times of sending."""
    return 1.0 + 1.0 / load + load**2 / (1.0 - load)


def m_d_1(load: float) -> float:
    """Return the age with Poisson updates and a fixed time of sending."""
    return 1.0 / (2.0 * (1.0 - load)) + 0.5 + (1.0 - load) * math.exp(load) / load


def d_m_1(load: float) -> float:
    """Return the age with updates at equal intervals and exponential times of sending."""
    beta = brentq(lambda b: b - math.exp(-(1.0 - b) / load), 0.0, 1.0 - 1e-6)
    return float(1.0 / (2.0 * load) + 1.0 / (1.0 - beta))


def m_m_1_1(load: float) -> float:
    """Return the age if what comes while another update is sent is dropped."""
    return 1.0 / load + 2.0 - 1.0 / (1.0 + load)


def m_m_1_2(load: float) -> float:
    """Return the age if one update may wait, and what comes then is dropped."""
    return 1.0 / load + 3.0 - 2.0 * (1.0 + load) / (1.0 + load + load**2)


def m_m_1_2_newest(load: float) -> float:
    """Return the age if one update may wait, and a newer one replaces it."""
    waits = load / (1.0 + load) ** 2 + 1.0 / (1.0 + load)
    return 1.0 / load + 2.0 + waits - 2.0 * (1.0 + load) / (1.0 + load + load**2)


# ---- the queues as scenarios


@dataclass(frozen=True)
class Queue:
    """A queue: the law of its age, its value at load 0.5, and what makes the scenario this one."""

    law: Law
    at_half: float
    """The age at a load of 0.5, evaluated apart."""
    periodic: bool = False
    fixed: bool = False
    buffer: int = 1000
    keeps: str = "newest"
    least: tuple[float, float] | None = None
    """The least age and the load at which it is reached, evaluated apart."""

    def changes(self, load: float) -> Mapping[str, Any]:
        """Return the changes of the scenario for a load."""
        every = {"kind": "periodic", "every_s": 1.0 / load}
        updates = every if self.periodic else {"kind": "poisson", "mean_s": 1.0 / load}
        return {
            "services.reading.updates": updates,
            "services.reading.size_mbit": [1.0] if self.fixed else exponential_mbit(),
            "services.reading.buffer": self.buffer,
            "services.reading.keeps": self.keeps,
        }


FIRST_COME = {
    "M/M/1": Queue(m_m_1, 3.5, least=(3.484435, 0.531010)),
    "M/D/1": Queue(m_d_1, 3.148721, fixed=True, least=(2.954064, 0.629076)),
    "D/M/1": Queue(d_m_1, 2.255001, periodic=True, least=(2.252621, 0.516885)),
}
SMALL_BUFFERS = {
    "M/M/1/1": Queue(m_m_1_1, 3.333333, buffer=1, keeps="oldest"),
    "M/M/1/2": Queue(m_m_1_2, 3.285714, buffer=2, keeps="oldest"),
    "M/M/1/2*": Queue(m_m_1_2_newest, 3.174603, buffer=2, keeps="newest"),
}
QUEUES = FIRST_COME | SMALL_BUFFERS


@cache
def ages_s(name: str, load: float) -> NDArray[np.float64]:
    """Return the mean age in each episode of a run, without its first part."""
    scenario = scenario_of(SCENARIO, QUEUES[name].changes(load))
    until_s = scenario.episode.steps * scenario.episode.step_s
    updates = flown(scenario, "hover", episodes=EPISODES).updates
    assert updates is not None
    come = updates[updates["t_delivered_s"].notna()]
    columns = ["t_generated_s", "t_delivered_s"]
    by_episode = (own[columns].to_numpy().T for _, own in come.groupby("episode"))
    return np.array([mean_age_s(times[0], times[1], until_s) for times in by_episode])


def mean_age_s(
    taken_s: NDArray[np.float64], delivered_s: NDArray[np.float64], until_s: float
) -> float:
    """Return the time average of the age from ``WARMING_S`` on, by exact trapezoids.

    ``taken_s`` and ``delivered_s`` are when each update was taken and delivered, in any order.
    """
    order = np.argsort(delivered_s, kind="stable")
    times, freshest = delivered_s[order], np.maximum.accumulate(taken_s[order])
    first = int(np.searchsorted(times, WARMING_S, side="right")) - 1
    freshest, edges = freshest[max(first, 0) :], times[max(first, 0) :].copy()
    edges[0] = max(edges[0], WARMING_S)
    ends = np.append(edges[1:], until_s)
    area = ((ends - freshest) ** 2 - (edges - freshest) ** 2) / 2.0
    return float(area.sum() / (until_s - edges[0]))


def least_of(law: Law) -> tuple[float, float]:
    """Return the least age of a law over all loads, and its load."""
    bounds, options = (0.05, 0.95), {"xatol": 1e-10}
    best = minimize_scalar(law, bounds=bounds, method="bounded", options=options)
    return float(best.fun), float(best.x)


def best_load(name: str) -> tuple[float, float]:
    """Return the load of the least simulated age, and its standard error over the episodes.

    The ages on the loads of ``FIRST_LOADS``, times load (1 - load), are interpolated by a cubic;
    the error is that of a jackknife.
    """
    loads = np.array(FIRST_LOADS)
    ages = np.array([ages_s(name, load) for load in FIRST_LOADS])
    weights = loads * (1.0 - loads)

    def minimum(means: NDArray[np.float64]) -> float:
        cubic = np.polynomial.Polynomial.fit(loads, means * weights, 3)
        return least_of(lambda load: float(cubic(load)) / (load * (1.0 - load)))[1]

    count = ages.shape[1]
    without = np.array([minimum(np.delete(ages, one, axis=1).mean(axis=1)) for one in range(count)])
    error = math.sqrt((count - 1) / count * float(((without - without.mean()) ** 2).sum()))
    return minimum(ages.mean(axis=1)), error


# ---- rows and figures


def first_come_rows() -> Iterator[FigureRow]:
    """Yield ages over the load, the least ages, and the best loads."""
    yield from _rows(FIRST_COME, FIRST_LOADS)
    for name, queue in FIRST_COME.items():
        least_s, load = queue.least or (math.nan, math.nan)
        formula_s, at = least_of(queue.law)
        how = "the paper's formula, evaluated apart"
        yield evaluated(f"{name}: least age, formula", how, least_s, formula_s, 6)
        yield evaluated(f"{name}: best load, formula", how, load, at, 5)
        ages = ages_s(name, load)
        yield estimated(f"{name}: age at the best load, runs", how, least_s, ages, 3)
        ours, error = best_load(name)
        limit = STANDARD_ERRORS * error
        yield FigureRow(f"{name}: best load, runs", how, load, ours, limit, 3)


def small_buffer_rows() -> Iterator[FigureRow]:
    """Yield ages over the load with small buffers."""
    yield from _rows(SMALL_BUFFERS, SMALL_LOADS)


def _rows(queues: Mapping[str, Queue], loads: tuple[float, ...]) -> Iterator[FigureRow]:
    """Yield the law of each queue at a load of 0.5, and ages in runs."""
    how = "the paper's formula"
    for name, queue in queues.items():
        what = f"{name}, load 0.5: age, formula"
        yield evaluated(what, f"{how}, evaluated apart", queue.at_half, queue.law(0.5), 6)
        for load in loads:
            what, theirs = f"{name}, load {load:g}: age, runs", queue.law(load)
            yield estimated(what, how, theirs, ages_s(name, load), 3)


def draw_first_come() -> Figure:
    """Draw the age over the load: the laws as lines, the runs as points."""
    return _drawn("Age with a buffer for all, first come, first served", FIRST_COME, FIRST_LOADS)


def draw_small_buffers() -> Figure:
    """Draw the age over the load with small buffers."""
    return _drawn("Age with room for one or two updates", SMALL_BUFFERS, SMALL_LOADS)


def _drawn(title: str, queues: Mapping[str, Queue], loads: tuple[float, ...]) -> Figure:
    from desim_uav.report.figures.papers import Series, lines_figure

    grid = np.linspace(loads[0], loads[-1], 61)
    series = []
    for name, queue in queues.items():
        runs = tuple((load, float(ages_s(name, load).mean())) for load in loads)
        series.append(
            Series(
                f"{name}, the paper's law", list(grid), [queue.law(x) for x in grid], points=runs
            )
        )
    return lines_figure(title, "load", "age, mean times of sending", series, "ours, runs")
