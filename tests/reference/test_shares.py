"""The textbook allocations of a band, held against what defines each of them.

A fluid allocation is optimal if no other that fits is better. Each instance compares with random
allocations that use the whole band, in fractions, so that nothing is rounded.
"""

from __future__ import annotations

from fractions import Fraction

import numpy as np
import pytest

from tests.reference.shares import FLUID, MICRO, equal, hz_for, max_min, max_rate, whole

INSTANCES = 500


def instance(seed: int) -> tuple[int, list[int], list[Fraction]]:
    """A band, efficiencies, and the rates of a random division of the band."""
    rng = np.random.default_rng([11, seed])
    band_hz = int(rng.integers(1, 10 ** int(rng.integers(1, 9))))
    ladder = rng.integers(100_000, 6_000_000, size=4)
    efficiencies = rng.choice(ladder, size=rng.integers(1, 9)).tolist()
    parts = [Fraction(int(part)) for part in rng.integers(1, 1000, size=len(efficiencies))]
    rates = [
        band_hz * part / sum(parts) * e / MICRO for part, e in zip(parts, efficiencies, strict=True)
    ]
    return band_hz, efficiencies, rates


def used_hz(rates: list[Fraction], efficiencies: list[int]) -> Fraction:
    """The bandwidth that rates take."""
    return sum(rate * MICRO / e for rate, e in zip(rates, efficiencies, strict=True))


@pytest.mark.parametrize("sharing", FLUID)
def test_fluid_shares_use_the_whole_band(sharing: str) -> None:
    for seed in range(INSTANCES):
        band_hz, efficiencies, _ = instance(seed)
        assert used_hz(FLUID[sharing](band_hz, efficiencies), efficiencies) == band_hz


def test_no_division_has_a_higher_lowest_rate_than_max_min() -> None:
    for seed in range(INSTANCES):
        band_hz, efficiencies, others = instance(seed)
        assert min(max_min(band_hz, efficiencies)) >= min(others)


def test_no_division_is_proportionally_fairer() -> None:
    """Kelly 1997: the relative changes of all rates together are nowhere a gain."""
    for seed in range(INSTANCES):
        band_hz, efficiencies, others = instance(seed)
        rates = FLUID["proportional_fair"](band_hz, efficiencies)
        changes = [(one - rate) / rate for one, rate in zip(others, rates, strict=True)]
        assert sum(changes) <= 0


def test_no_division_has_a_larger_sum_than_max_rate() -> None:
    for seed in range(INSTANCES):
        band_hz, efficiencies, others = instance(seed)
        assert sum(max_rate(band_hz, efficiencies)) >= sum(others)


@pytest.mark.parametrize("sharing", FLUID)
def test_whole_rates_fit_and_are_within_their_rounding_of_the_fluid_ones(sharing: str) -> None:
    """Rounding takes less than 1 bit/s, and beside it what rounded bandwidths lose.

    ``equal`` loses less than 1 Hz of each link. ``max_min`` loses less than 1 Hz a link in all,
    which the lowest rate could use.
    """
    for seed in range(INSTANCES):
        band_hz, efficiencies, _ = instance(seed)
        fluid = FLUID[sharing](band_hz, efficiencies)
        rates = whole(sharing, band_hz, efficiencies)
        n, hz_per_bps = len(efficiencies), sum(Fraction(MICRO, e) for e in efficiencies)
        for one, rate, e in zip(rates, fluid, efficiencies, strict=True):
            lost = {"equal": Fraction(e, MICRO), "max_min": n / hz_per_bps}.get(sharing, 0)
            assert rate - 1 - lost < one <= rate
        needs_hz = [hz_for(rate, e) for rate, e in zip(rates, efficiencies, strict=True)]
        if sharing != "proportional_fair":
            assert sum(needs_hz) <= band_hz
        if sharing == "max_min":
            more = [hz_for(rate + 1, e) for rate, e in zip(rates, efficiencies, strict=True)]
            assert sum(more) > band_hz


def test_a_hand_worked_band() -> None:
    """1 MHz for links of 1 and 2 bit/s/Hz."""
    links = [1_000_000, 2_000_000]
    assert equal(1_000_000, links) == [500_000, 1_000_000]
    assert max_min(1_000_000, links) == [Fraction(2_000_000, 3)] * 2
    assert whole("max_min", 1_000_000, links) == [666_666, 666_666]
    assert whole("max_rate", 1_000_000, links) == [0, 2_000_000]
    assert whole("max_rate", 1_000_000, [3, 3, 1]) == [3, 0, 0]
    assert whole("equal", 999_999, links) == [499_999, 999_998]
    assert whole("proportional_fair", 999_999, links) == [499_999, 999_999]
    assert whole("equal", 10, []) == []
