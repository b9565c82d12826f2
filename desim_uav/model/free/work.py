"""The energy of a piece of a leg in wind, for a power that depends on the speed through the air.

In a piece of constant acceleration, the part u of the velocity through the air along the leg is
linear in time, and the part s across it is constant: V² = u² + s². Without wind from the side the
integral of a power over V has a closed form for many powers; with it there is none. It is computed
by Gauss-Legendre with 10 nodes on pieces of u, whose error has a bound (see ``energy_j``).
"""

from __future__ import annotations

import numpy as np

from desim_uav.model.compiled_rows import call_for_float
from desim_uav.model.free.limits import Wind
from desim_uav.model.kernels import kernel, part
from desim_uav.model.radio.tracks import Point

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


@kernel
def energy_j(
    power: int,
    values: int,
    wind: Wind,
    ahead: Point,
    speeds_mps: tuple[float, float],
    lasts_s: float,
    smooth_mps: float,
) -> float:
    """Return the energy of a piece in which the ground speed changes evenly, in joules.

    ``power`` is the address of a kernel that returns the power in watts, given ``values`` (the
    address of its parameters) and the air speed V in m/s (``compiled_rows.call_for_float``).
    ``speeds_mps`` are the ground speeds at the start and at the end. The power must be an analytic
    function of V, and have no singularity within ``smooth_mps`` of the real axis except, as a
    function of u, where V = 0. (For rotary wings after Zeng, Xu and Zhang, 2019, this is v0, the
    induced speed of a hover.)

    Pieces of u end at u = 0, are at most ``smooth_mps`` long, and no longer than their distance
    from u = 0 or than s, whichever is the larger one. So all singularities are outside a Bernstein
    ellipse of ρ = 4.2, and the error of each piece is below 1.1e-12 of its length times the largest
    power on the ellipse (Trefethen, *Approximation Theory and Approximation Practice*, theorem
    19.3). Below LEAST_MPS the bound does not hold; a power without a term linear in V then deviates
    by less than 1e-9 of its curvature.
    """
    level = np.sqrt(ahead[0] * ahead[0] + ahead[1] * ahead[1])
    tail, side = 0.0, np.sqrt(wind[0] * wind[0] + wind[1] * wind[1])
    if level > 0.0:
        tail = (wind[0] * ahead[0] + wind[1] * ahead[1]) / level
        side = abs(wind[0] * ahead[1] - wind[1] * ahead[0]) / level
    first, last = level * speeds_mps[0] - tail, level * speeds_mps[1] - tail
    if first == last:
        return float(lasts_s * call_for_float(power, (values, _length(first, side))))
    low, high = min(first, last), max(first, last)
    total = 0.0
    if high > 0.0:
        total += _grown(power, values, side, max(low, 0.0), high, smooth_mps)
    if low < 0.0:
        total += _grown(power, values, side, max(-high, 0.0), -low, smooth_mps)
    return float(total * (lasts_s / (high - low)))


@kernel
def _grown(
    power: int, values: int, side: float, low: float, high: float, smooth_mps: float
) -> float:
    """Return the integral of the power over u from ``low`` to ``high``, both at least 0."""
    total, begin = 0.0, low
    while begin < high:
        width = min(max(begin, side, LEAST_MPS), smooth_mps)
        end = begin + width if begin + 1.001 * width < high else high
        total += _piece(power, values, side, begin, end)
        begin = end
    return total


@kernel
def _piece(power: int, values: int, side: float, begin: float, end: float) -> float:
    """Return the integral of the power over a piece of u."""
    half, middle, total = 0.5 * (end - begin), 0.5 * (begin + end), 0.0
    for k in range(len(NODES)):
        one = call_for_float(power, (values, _length(middle - half * NODES[k], side)))
        other = call_for_float(power, (values, _length(middle + half * NODES[k], side)))
        total += WEIGHTS[k] * (one + other)
    return half * total


@part
def _length(u: float, side: float) -> float:
    return float(np.sqrt(u * u + side * side))
