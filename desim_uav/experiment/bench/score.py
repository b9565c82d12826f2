"""Scores, interquartile means, and their stratified bootstrap intervals.

A score is 0 for what the baseline reaches on the same seed, and 1 for the proven bound of QoE3. The
interquartile mean and the intervals are those of Agarwal et al., 2021, "Deep Reinforcement Learning
at the Edge of the Statistical Precipice": runs are drawn again with replacement within each task.
If several trainings of a policy have flown on the same seeds, both the trainings and the seeds are
drawn again, each by itself, and all runs of a drawn training on drawn seeds count (a pigeonhole
bootstrap: Owen, 2007, "The pigeonhole bootstrap").
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.stats import trim_mean

from desim_uav.experiment.statistics import LEVEL

RESAMPLES, SEED = 2000, 0
CUT = 0.25
"""The share of the values that an interquartile mean leaves out at each end."""

ENDS = ((1.0 - LEVEL) / 2.0, (1.0 + LEVEL) / 2.0)
"""The shares of resamples below the ends of an interval."""

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Interval:
    """An interquartile mean and its interval; ``low`` and ``high`` are None if there is none."""

    value: float
    low: float | None
    high: float | None


def score(qoe3: float, baseline: float, bound: float) -> float | None:
    """Return the score of a run; None if the baseline reaches the bound."""
    return None if bound <= baseline else (qoe3 - baseline) / (bound - baseline)


def interquartile_mean(strata: Sequence[ArrayLike]) -> Interval:
    """Return the interquartile mean of all values, which are given task by task.

    The values of a task are an array (trainings, seeds), or (seeds) of a single training. There is
    no interval if a task has fewer than two values.
    """
    arrays = [np.atleast_2d(np.asarray(stratum, dtype=float)) for stratum in strata]
    value = float(_iqm(np.concatenate([array.ravel() for array in arrays])))
    if min(array.size for array in arrays) < 2:
        return Interval(value, None, None)
    means = _iqm(np.concatenate(resampled(arrays), axis=1))
    low, high = np.quantile(means, ENDS)
    return Interval(value, float(low), float(high))


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
