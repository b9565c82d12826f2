"""The energy of a piece of a leg in wind, for a power that depends on the speed through the air.

In a piece of constant acceleration, the part u of the velocity through the air along the leg is
linear in time, and the part s across it is constant: V² = u² + s². Without wind from the side the
integral of a power over V has a closed form for many powers; with it there is none. It is computed
by Gauss-Legendre with 10 nodes on pieces of u. For its error see ``speeding_in_wind_j``.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

from desim_uav.rowcode.kernels import rare_rule, rule

Power = Callable[[Any, float], float]
"""A rule that returns the power of a drone in watts, given its parameters and its air speed."""

NODES = (
    0.14887433898163122,
    0.4333953941292472,
    0.6794095682990244,
    0.8650633666889845,
    0.9739065285171717,
)
WEIGHTS = (
    0.29552422471475287,
    0.26926671930999635,
    0.21908636251598204,
    0.1494513491505806,
    0.06667134430868814,
)
"""The positive nodes of Gauss-Legendre of order 20 on [-1, 1], and their weights."""

LEAST_MPS = 1e-3
"""The shortest piece of u at u = 0: there a side wind that is weaker than this is not resolved."""


@rule
def speeding_in_wind_j(
    power: Power, own: Any, side: float, first: float, last: float, lasts_s: float, smooth: float
) -> float:
    """Return the energy of a piece in which u changes evenly from ``first`` to ``last``, in joules.

    ``power`` is a rule, of ``own`` and the air speed V in m/s; ``side`` is the part s across the
    leg. The power must be an analytic function of V, and have no singularity within ``smooth`` m/s
    of the real axis except, as a function of u, where V = 0. (For rotary wings after Zeng, Xu and
    Zhang, 2019, this is v0, the induced speed of a hover.)

    Pieces of u end at u = 0, are at most ``smooth`` long, and no longer than their distance from
    u = 0 or than s, whichever is the larger one. So all singularities are outside a Bernstein
    ellipse of ρ = 4.2, and the error of each piece is below 1.1e-12 of its length times the largest
    power on the ellipse (Trefethen, *Approximation Theory and Approximation Practice*, theorem
    19.3). Below LEAST_MPS the bound does not hold; a power without a term linear in V then deviates
    by less than 1e-9 of its curvature.
    """
    if first == last:
        return lasts_s * power(own, _length(first, side))
    low, high = min(first, last), max(first, last)
    total = 0.0
    if high > 0.0:
        total += _grown(power, own, side, max(low, 0.0), high, smooth)
    if low < 0.0:
        total += _grown(power, own, side, max(-high, 0.0), -low, smooth)
    return total * (lasts_s / (high - low))


@rare_rule
def _grown(power: Power, own: Any, side: float, low: float, high: float, smooth: float) -> float:
    """Return the integral of the power over u from ``low`` to ``high``, both at least 0."""
    total, begin = 0.0, low
    while begin < high:
        width = min(max(begin, side, LEAST_MPS), smooth)
        end = begin + width if begin + 1.001 * width < high else high
        total += _piece(power, own, side, begin, end)
        begin = end
    return total


@rule
def _piece(power: Power, own: Any, side: float, begin: float, end: float) -> float:
    """Return the integral of the power over a piece of u."""
    half, middle, total = 0.5 * (end - begin), 0.5 * (begin + end), 0.0
    for k in range(len(NODES)):
        one = power(own, _length(middle - half * NODES[k], side))
        other = power(own, _length(middle + half * NODES[k], side))
        total += WEIGHTS[k] * (one + other)
    return half * total


@rule
def _length(u: float, side: float) -> float:
    return math.sqrt(u * u + side * side)
