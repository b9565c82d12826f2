"""Scores of runs, and their interquartile means, paired differences and bootstrap intervals.

The score of a run is the mean, over the measures of its task, of (value - reference) / (bound -
reference), less a price for each crash (``score``). The interquartile mean and the intervals are
those of Agarwal et al., 2021, "Deep Reinforcement Learning at the Edge of the Statistical
Precipice": runs are drawn again with replacement within each task. Of several tasks the mean of
their interquartile means is taken, so each has the same weight, however many runs it has. If
several trainings of a policy have flown on the same seeds, both the trainings and the seeds are
drawn again, each by itself, and all runs of a drawn training on drawn seeds count (a pigeonhole
bootstrap: Owen, 2007, "The pigeonhole bootstrap").
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.stats import trim_mean

from desim_uav.experiment.bench.tasks import FAMILIES, Task
from desim_uav.experiment.statistics import LEVEL

RESAMPLES, SEED = 2000, 0
CUT = 0.25
"""The share of the values that an interquartile mean leaves out at each end."""

ENDS = ((1.0 - LEVEL) / 2.0, (1.0 + LEVEL) / 2.0)
"""The shares of resamples below the ends of an interval."""

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Interval:
    """A value and its interval; ``low`` and ``high`` are None if there is none."""

    value: float
    low: float | None
    high: float | None


@dataclass(frozen=True)
class Scored:
    """A measure that counts in the score, and the best value that it can have in any run.

    The best value stands for the bound where none is proven. It is the lowest value if lower ones
    are better.
    """

    name: str
    best: float


QOE = (Scored("qoe1_percent", 100.0), Scored("qoe3_percent", 100.0))
SCORED: Mapping[str, Sequence[Scored]] = dict.fromkeys(FAMILIES, QOE) | {
    "edge": (Scored("deadlines_met_percent", 100.0),),
    "harvest": (Scored("age_s", 0.0),),
    "handover": (*QOE, Scored("outage_s", 0.0)),
    "dispatch": (*QOE, Scored("qoe2_iterations", 0.0)),
}
"""The measures that count in the score of a task, by family; each has the same weight."""

CRASHES, PRICE = "crashes_per_drone_episode", 1.0
"""What one crash per drone and episode costs: as much as lies between reference and bound."""


def measures_of(task: Task) -> Sequence[Scored]:
    """Return the measures that count in the score of a task."""
    return SCORED[task.family]


def score(
    measures: Sequence[Scored],
    row: Mapping[str, Any],
    reference: Mapping[str, float],
    bound: Mapping[str, float],
) -> float | None:
    """Return the score of a run; None without a reference, or if that reaches every bound.

    ``row`` has the measures of the run and its crashes.
    """
    parts: list[float] = []
    for one in measures:
        zero, most = reference.get(one.name), bound.get(one.name, one.best)
        if zero is None:
            return None
        if zero != most:
            parts.append((row[one.name] - zero) / (most - zero))
    if not parts:
        return None
    return sum(parts) / len(parts) - PRICE * float(row[CRASHES])


def interquartile_mean(strata: Sequence[ArrayLike]) -> Interval:
    """Return the mean of the interquartile means of some tasks.

    The values of a task are an array (trainings, seeds), or (seeds) of a single training. There is
    no interval if a task has fewer than two values.
    """
    arrays = [np.atleast_2d(np.asarray(stratum, dtype=float)) for stratum in strata]
    value = float(np.mean([_iqm(array.ravel()) for array in arrays]))
    if min(array.size for array in arrays) < 2:
        return Interval(value, None, None)
    means = np.mean([_iqm(drawn) for drawn in resampled(arrays)], axis=0)
    low, high = np.quantile(means, ENDS)
    return Interval(value, float(low), float(high))


@dataclass(frozen=True)
class Pairing:
    """How two policies compare on the same seeds.

    ``difference`` is that of their mean scores, and ``improvement`` the probability that a run of
    the first has the higher score on the same seed; an equal score counts as one half.
    """

    difference: Interval
    improvement: Interval


def paired(one: ArrayLike, other: ArrayLike) -> Pairing:
    """Compare the scores of two policies, arrays (trainings, seeds) of the same seeds.

    The bootstrap draws the same seeds for both, and the trainings of each by itself.
    """
    a, b = (np.atleast_2d(np.asarray(each, dtype=float)) for each in (one, other))
    apart = a[:, None, :] - b[None, :, :]
    better = (np.sign(apart) + 1.0) / 2.0
    rng = np.random.default_rng(SEED)
    seeds, of_a, of_b = (
        rng.multinomial(many, np.full(many, 1.0 / many), size=RESAMPLES) / many
        for many in (a.shape[1], *map(len, (a, b)))
    )
    few = a.shape[1] < 2
    both = []
    for values in (apart, better):
        value = float(values.mean())
        drawn = np.einsum("abs,ra,rb,rs->r", values, of_a, of_b, seeds, optimize=True)
        ends = (None, None) if few else map(float, np.quantile(drawn, ENDS))
        both.append(Interval(value, *ends))
    return Pairing(*both)


def resampled(arrays: Sequence[Floats], resamples: int = RESAMPLES) -> list[Floats]:
    """Return values drawn again of each task's array (trainings, seeds): (resamples, values)."""
    rng = np.random.default_rng(SEED)
    samples = []
    for array in arrays:
        trainings, seeds = (
            rng.integers(many, size=(resamples, many)) if many > 1 else np.zeros((1, 1), int)
            for many in array.shape
        )
        runs = array[trainings[:, :, None], seeds[:, None, :]]
        samples.append(np.broadcast_to(runs, (resamples, *array.shape)).reshape(resamples, -1))
    return samples


def _iqm(values: Floats) -> Any:
    return trim_mean(values, CUT, axis=-1)
