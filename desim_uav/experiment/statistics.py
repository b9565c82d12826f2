"""Means and confidence intervals over independent replications.

A replication is a seed. Episodes of one seed share its world, and under carry-over their drones,
so they are averaged first and never counted as observations of their own.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

LEVEL = 0.95
"""The confidence level of every interval."""


@dataclass(frozen=True)
class Estimate:
    """A mean over ``n`` replications and the half-width of its interval.

    ``mean`` is None if there is no replication, ``half_width`` if there are fewer than two.
    """

    n: int
    mean: float | None
    half_width: float | None

    @property
    def low(self) -> float | None:
        """The lower end of the interval."""
        return self._at(-1)

    @property
    def high(self) -> float | None:
        """The upper end of the interval."""
        return self._at(1)

    def values(self) -> dict[str, int | float | None]:
        """Return the estimate as plain values, with the ends of its interval."""
        names = ("n", "mean", "half_width", "low", "high")
        return {name: getattr(self, name) for name in names}

    @property
    def excludes_zero(self) -> bool | None:
        """Whether zero lies outside the interval; None if there is no interval."""
        if self.low is None or self.high is None:
            return None
        return not self.low <= 0.0 <= self.high

    def __format__(self, form: str) -> str:
        """Return ``mean ± half_width``, or ``mean``, or "-", with numbers in the given format."""
        if self.mean is None:
            return "-"
        mean = format(self.mean, form)
        return mean if self.half_width is None else f"{mean} ± {self.half_width:{form}}"

    def _at(self, side: int) -> float | None:
        if self.mean is None or self.half_width is None:
            return None
        return self.mean + side * self.half_width


def estimate(values: Iterable[float | None]) -> Estimate:
    """Return the mean and the t-interval of one value per replication, without None and NaN."""
    listed = np.array([value for value in values if value is not None], dtype=float)
    there = listed[~np.isnan(listed)]
    if len(there) == 0:
        return Estimate(0, None, None)
    mean = float(there.mean())
    if len(there) == 1:
        return Estimate(1, mean, None)
    from scipy.stats import t

    error = float(there.std(ddof=1)) / math.sqrt(len(there))
    return Estimate(len(there), mean, float(t.ppf((1 + LEVEL) / 2, len(there) - 1)) * error)


def paired(values: Sequence[float | None], reference: Sequence[float | None]) -> Estimate:
    """Return the mean of the paired differences ``values`` minus ``reference``, and its interval.

    Both have the same replications in the same order. Common randomness cancels, so the interval is
    usually narrower than that of two separate means. Pairs that lack a value are left out.
    """
    pairs = zip(values, reference, strict=True)
    return estimate(None if a is None or b is None else a - b for a, b in pairs)
