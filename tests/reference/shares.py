"""How a band is shared: textbook allocations as fractions, and the whole numbers of the model.

``band_hz`` is shared by links of ``efficiencies`` in millionths of a bit/s/Hz, each above 0. The
fluid allocations below are in bit/s, as exact fractions:

- ``equal``: each has the same bandwidth.
- ``max_min``: the lowest rate is as high as it can be. All rates are then equal: a link with more
  could give some of its bandwidth to the lowest. So r sum(1 / e) = B (Bertsekas and Gallager, Data
  Networks, 1992, section 6.5.2).
- ``proportional_fair``: the sum of log rates is as large as it can be. Its derivative by bandwidth,
  1 / b, must be the same for all: equal bandwidth again, which is equal airtime of the whole band
  (Kelly 1997).
- ``max_rate``: the sum of rates is as large as it can be: everything goes to the best link.

The model's rates are whole bit/s and its bandwidths whole Hz: ``whole`` has its rules.
"""

from __future__ import annotations

from collections.abc import Sequence
from fractions import Fraction

MICRO = 1_000_000


def equal(band_hz: int, efficiencies: Sequence[int]) -> list[Fraction]:
    """Return the rates of equal bandwidths."""
    return [Fraction(band_hz * e, MICRO * len(efficiencies)) for e in efficiencies]


def proportional_fair(band_hz: int, efficiencies: Sequence[int]) -> list[Fraction]:
    """Return the rates with the largest sum of logarithms."""
    return equal(band_hz, efficiencies)


def max_min(band_hz: int, efficiencies: Sequence[int]) -> list[Fraction]:
    """Return the rates of which the lowest is highest."""
    hz_per_bps = sum(Fraction(MICRO, e) for e in efficiencies)
    return [band_hz / hz_per_bps] * len(efficiencies)


def max_rate(band_hz: int, efficiencies: Sequence[int]) -> list[Fraction]:
    """Return the rates with the largest sum; of equally good links the first has everything."""
    best = efficiencies.index(max(efficiencies))
    rates = [Fraction(0)] * len(efficiencies)
    rates[best] = Fraction(band_hz * efficiencies[best], MICRO)
    return rates


FLUID = {
    "equal": equal,
    "max_min": max_min,
    "proportional_fair": proportional_fair,
    "max_rate": max_rate,
}


def whole(sharing: str, band_hz: int, efficiencies: Sequence[int]) -> list[int]:
    """Return the whole bit/s of elastic requests, in order of request time, that share ``band_hz``.

    ``equal`` gives whole Hz and rounds down the rates in them; ``proportional_fair`` rounds down
    the rates of equal airtimes; ``max_min`` is the largest whole rate whose bandwidths, each
    rounded up to whole Hz, fit.
    """
    n = len(efficiencies)
    if n == 0:
        return []
    if sharing == "equal":
        return [(band_hz // n) * e // MICRO for e in efficiencies]
    if sharing == "max_min":
        return [_largest_rate(band_hz, efficiencies)] * n
    return [int(rate) for rate in FLUID[sharing](band_hz, efficiencies)]


def hz_for(rate_bps: int, efficiency: int) -> int:
    """Return the whole Hz that a rate needs: rounded up."""
    return -(-rate_bps * MICRO // efficiency)


def _largest_rate(band_hz: int, efficiencies: Sequence[int]) -> int:
    """Bisect for the largest whole rate at which the bandwidths of all fit."""
    fits, too_much = 0, band_hz * max(efficiencies) // MICRO + 1
    while too_much - fits > 1:
        rate = (fits + too_much) // 2
        if sum(hz_for(rate, e) for e in efficiencies) <= band_hz:
            fits = rate
        else:
            too_much = rate
    return fits
