"""Small-scale fading: how far the mean ratio must be above a threshold for a stated outage.

Fading changes within milliseconds, far below the time between two events, so no event follows it.
It raises the thresholds of the classes instead: a class holds where its own threshold is missed in
no more than the share ``outage`` of the fades. Rings are narrower, and remain rings.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Annotated, Protocol

import numpy as np
from annotated_types import Ge, Le
from numpy.typing import NDArray

from desim_uav.registry import register

Outage = Annotated[float, Ge(1e-6), Le(0.5)]

DEEPEST, HIGHEST = 1e-14, 1e3
"""The powers over their mean between which quantiles are sought."""


class Fading(Protocol):
    """A distribution of the received power, as the component ``fading`` of a radio."""

    def margin_db(self) -> float:
        """Return how far the mean ratio must be above a threshold, in dB.

        The median of the power may exceed its mean, so this can be below 0.
        """


@register("fading", "none")
@dataclass(frozen=True)
class NoFading:
    """No fading: the received power is always its mean."""

    def margin_db(self) -> float:
        """Return 0."""
        return 0.0


@register("fading", "rayleigh")
@dataclass(frozen=True)
class Rayleigh:
    """Has many paths of equal strength, and none in sight: the power is exponential."""

    outage: Outage = 0.1
    """The share of fades that miss the threshold of a class where it begins to hold."""

    def margin_db(self) -> float:
        """Return -10 log10(-ln(1 - outage))."""
        return _margin_db(-math.log1p(-self.outage))


@register("fading", "nakagami")
@dataclass(frozen=True)
class Nakagami:
    """Has a power that is gamma distributed, with the shape ``m`` (Nakagami 1960)."""

    m: Annotated[float, Ge(0.5), Le(100)]
    """The shape: 1 is Rayleigh fading, and there is less of it if it is larger."""
    outage: Outage = 0.1
    """The share of fades that miss the threshold of a class where it begins to hold."""

    def margin_db(self) -> float:
        """Return minus the quantile of the gamma distribution with mean 1."""
        return _margin_db(_quantile(lambda power: _gamma(self.m, self.m * power), self.outage))


@register("fading", "rician")
@dataclass(frozen=True)
class Rician:
    """Has one strong path beside many weak ones, K times as strong as they are together."""

    k_db: Annotated[float, Ge(-30), Le(30)]
    """The factor K, in dB; 3GPP TR 36.777 has 15 dB for drones."""
    outage: Outage = 0.1
    """The share of fades that miss the threshold of a class where it begins to hold."""

    def margin_db(self) -> float:
        """Return minus the quantile of 1 - Q1(sqrt(2 K), sqrt(2 (1 + K) power))."""
        factor = 10.0 ** (self.k_db / 10.0)
        return _margin_db(
            _quantile(lambda power: _below(factor, (1.0 + factor) * power), self.outage)
        )


def _margin_db(power: float) -> float:
    """Return minus a power in dB, in whole 1e-9 dB, which hides how platforms round."""
    return round(-10.0 * math.log10(power), 9)


def _quantile(share: Callable[[float], float], outage: float) -> float:
    """Return the power below which a share is ``outage``, by bisection of its logarithm."""
    low, high = math.log(DEEPEST), math.log(HIGHEST)
    while high - low > 1e-13:
        middle = 0.5 * (low + high)
        if middle in (low, high):
            break
        if share(math.exp(middle)) < outage:
            low = middle
        else:
            high = middle
    return math.exp(0.5 * (low + high))


def _gamma(shape: float, x: float) -> float:
    """Return the regularised lower incomplete gamma function, by its series."""
    if x > shape + 40.0 * math.sqrt(shape) + 200.0:
        return 1.0
    term = total = 1.0 / shape
    n = 0
    while term > 1e-17 * total:
        n += 1
        term *= x / (shape + n)
        total += term
    return min(1.0, total * math.exp(shape * math.log(x) - x - math.lgamma(shape)))


def _below(mean: float, x: float) -> float:
    """Return 1 - Q1(sqrt(2 mean), sqrt(2 x)).

    It is the probability that a Poisson number of mean x exceeds one of this mean.
    """
    spread = 12.0 * math.sqrt(max(mean, x)) + 60.0
    counts = np.arange(int(max(mean, x) + spread) + 1)
    fewer = np.cumsum(_poisson(mean, counts))
    return float(min(1.0, (_poisson(x, counts)[1:] * fewer[:-1]).sum()))


def _poisson(mean: float, counts: NDArray[np.int64]) -> NDArray[np.float64]:
    """Return the probabilities of numbers of a mean."""
    logs = np.concatenate([[0.0], np.cumsum(np.log(counts[1:]))])
    shares: NDArray[np.float64] = np.exp(counts * math.log(mean) - mean - logs)
    return shares
