"""Scores, interquartile means, and their stratified bootstrap intervals.

A score is 0 for what the baseline reaches on the same seed, and 1 for the proven bound of QoE3. The
interquartile mean and the intervals are those of Agarwal et al., 2021, "Deep Reinforcement Learning
at the Edge of the Statistical Precipice": seeds are drawn again with replacement within each task.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.stats import bootstrap, trim_mean  # type: ignore[import-untyped]

from desim_uav.experiment.statistics import LEVEL

RESAMPLES, SEED = 2000, 0
CUT = 0.25
"""The share of the values that an interquartile mean leaves out at each end."""


@dataclass(frozen=True)
class Interval:
    """An interquartile mean and its interval; ``low`` and ``high`` are None if there is none."""

    value: float
    low: float | None
    high: float | None


def score(qoe3: float, baseline: float, bound: float) -> float | None:
    """Return the score of a run; None if the baseline reaches the bound."""
    return None if bound <= baseline else (qoe3 - baseline) / (bound - baseline)


def interquartile_mean(strata: Sequence[Sequence[float]]) -> Interval:
    """Return the interquartile mean of all values, which are given task by task.

    There is no interval if a task has fewer than two values.
    """
    samples = [np.asarray(stratum, dtype=float) for stratum in strata]
    value = float(_iqm(*samples))
    if min(map(len, samples)) < 2:
        return Interval(value, None, None)
    found = bootstrap(
        samples,
        _iqm,
        n_resamples=RESAMPLES,
        vectorized=True,
        confidence_level=LEVEL,
        method="percentile",
        rng=np.random.default_rng(SEED),
    ).confidence_interval
    return Interval(value, float(found.low), float(found.high))


def _iqm(*samples: NDArray[np.float64], axis: int = -1) -> Any:
    return trim_mean(np.concatenate(samples, axis=axis), CUT, axis=axis)
