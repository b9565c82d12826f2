"""How fast the level of a link, and a ratio of levels, can change in a time.

docs/explanation/sinr.md proves it.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from desim_uav.model.radio.levels import H_LEAST, H_MOST, R_LEAST, R_MOST
from desim_uav.model.radio.links import (
    AX,
    AY,
    AZ,
    BOUND,
    BRANCH,
    CARRIER,
    HIGH_MW,
    LEAST,
    LEVEL_DBM,
    LINK_COLUMNS,
    LOOKED,
    LOOKED_COLUMNS,
    LOW_MW,
    MOST,
    NOISE_MW,
    POWER_MW,
    PX,
    PY,
    PZ,
    RATES_AT,
    STEEP,
    STEEP_H,
    STEEP_R,
    TIME_S,
    VALUES,
    VX,
    VY,
    VZ,
    Links,
    are_a_pair,
)
from desim_uav.model.radio.slopes import DB, least_share
from desim_uav.rowcode.compiled_rows import call
from desim_uav.rowcode.kernels import kernel, rule


@rule
def bound_rates(links: Links, k: int, distance_m: float, height_m: float, within_m: float) -> None:
    """Write the row of rates of a link, for all places near one (see ``levels.BOUNDS``)."""
    words, carrier_ghz = links.words, links.table[k, CARRIER]
    row = links.table.ctypes.data + 8 * (k * LINK_COLUMNS + BOUND)
    values = (words[k, VALUES], carrier_ghz, words[k, BRANCH], distance_m, height_m, within_m, row)
    call(words[k, RATES_AT], values)


@kernel
def bound_level(links: Links, k: int, since: float, until: float) -> None:
    """Write the least and the most that a level changes between two times, in dB/s.

    The horizontal distance r changes by r' = p v / r, and r'' is at least p a / r.
    """
    table = links.table
    table[k, LEAST] = table[k, MOST] = 0.0
    ax, ay, az = table[k, AX], table[k, AY], table[k, AZ]
    ux, uy, uz = (
        table[k, VX] + since * ax,
        table[k, VY] + since * ay,
        table[k, VZ] + since * az,
    )
    wx, wy, wz = (
        table[k, VX] + until * ax,
        table[k, VY] + until * ay,
        table[k, VZ] + until * az,
    )
    level_speed = np.sqrt(max(ux * ux + uy * uy, wx * wx + wy * wy))
    speed = np.sqrt(max(ux * ux + uy * uy + uz * uz, wx * wx + wy * wy + wz * wz))
    if speed == 0.0:
        return
    lasts, half = until - since, 0.5 * (until - since)
    middle = since + half
    x = table[k, PX] + middle * (table[k, VX] + 0.5 * middle * ax)
    y = table[k, PY] + middle * (table[k, VY] + 0.5 * middle * ay)
    z = table[k, PZ] + middle * (table[k, VZ] + 0.5 * middle * az)
    bound_rates(links, k, np.sqrt(x * x + y * y), z, speed * half)
    if level_speed > 0.0:
        px = table[k, PX] + since * (table[k, VX] + 0.5 * since * ax)
        py = table[k, PY] + since * (table[k, VY] + 0.5 * since * ay)
        qx = table[k, PX] + until * (table[k, VX] + 0.5 * until * ax)
        qy = table[k, PY] + until * (table[k, VY] + 0.5 * until * ay)
        near, far = np.sqrt(px * px + py * py), np.sqrt(qx * qx + qy * qy)
        least, most = -level_speed, level_speed
        pull = _pull(px, py, ux, uy, ax, ay, lasts, np.sqrt(x * x + y * y) - level_speed * half)
        if near > 0.0:
            least = max(least, (px * ux + py * uy) / near + pull * lasts)
        if far > 0.0:
            most = min(most, (qx * wx + qy * wy) / far - pull * lasts)
        _add(table, k, table[k, BOUND + R_LEAST], table[k, BOUND + R_MOST], least, most)
    _add(table, k, table[k, BOUND + H_LEAST], table[k, BOUND + H_MOST], min(uz, wz), max(uz, wz))


@rule
def _pull(
    px: float,
    py: float,
    ux: float,
    uy: float,
    ax: float,
    ay: float,
    lasts: float,
    nearest: float,
) -> float:
    """Return a bound, at most 0, that r'' does not fall short of, with r'' >= p a / r."""
    square = ax * ax + ay * ay
    if square == 0.0:
        return 0.0
    # p a is a convex quadratic function of time.
    begins, rises = px * ax + py * ay, ux * ax + uy * ay
    t = min(max(-rises / square, 0.0), lasts)
    least = begins + t * (rises + 0.5 * t * square)
    if least >= 0.0:
        return 0.0
    steepest = -np.sqrt(square)
    return float(max(steepest, least / nearest) if nearest > 0.0 else steepest)


@rule
def _add(
    table: NDArray[np.float64], k: int, low: float, high: float, least: float, most: float
) -> None:
    """Add the product of two ranges to the range in which a level changes."""
    if least != 0.0:
        one, other = low * least, high * least
        down, up = min(one, other), max(one, other)
    else:
        down = up = 0.0
    if most != 0.0:
        one, other = low * most, high * most
        down, up = min(down, one, other), max(up, one, other)
    elif least != 0.0:
        down, up = min(down, 0.0), max(up, 0.0)
    table[k, LEAST] += down
    table[k, MOST] += up


@kernel
def bound_stretch(links: Links, lasts: float) -> None:
    """Write the most that each level changes in a stretch in dB/s, by the bounds of the span."""
    table = links.table
    for k in range(links.used):
        ux, uy, uz = table[k, VX], table[k, VY], table[k, VZ]
        wx, wy, wz = (
            ux + lasts * table[k, AX],
            uy + lasts * table[k, AY],
            uz + lasts * table[k, AZ],
        )
        steep, climb = 0.0, max(abs(uz), abs(wz))
        square = max(ux * ux + uy * uy, wx * wx + wy * wy)
        if square > 0.0:
            steep += table[k, STEEP_R] * np.sqrt(square)
        if climb > 0.0:
            steep += table[k, STEEP_H] * climb
        table[k, STEEP] = steep


@kernel
def bound_levels(links: Links, left: int) -> None:
    """Write bounds of all levels for the time from a look to the one in the row before it.

    They are the least and the most that a level changes in dB/s and, if there is interference, the
    least and the most power.
    """
    table, looks = links.table, links.looks
    since, until = looks[left, TIME_S], looks[left - 1, TIME_S]
    powers = links.used > 1 and not are_a_pair(links)
    for k in range(links.used):
        bound_level(links, k, since, until)
        if powers:
            at = LOOKED + LOOKED_COLUMNS * k
            one, other = looks[left, at + POWER_MW], looks[left - 1, at + POWER_MW]
            table[k, LOW_MW], table[k, HIGH_MW] = min(one, other), max(one, other)
            least, most = table[k, LEAST], table[k, MOST]
            if least < 0.0 < most:
                rise = looks[left - 1, at + LEVEL_DBM] - looks[left, at + LEVEL_DBM]
                turns = max(turns_back(until - since, rise, least, most), 0.0)
                share = least_share(turns / DB)
                table[k, LOW_MW] *= share
                table[k, HIGH_MW] /= share


@rule
def turns_back(width: float, rise: float, least: float, most: float) -> float:
    """Return the most by which a level or a ratio turns back in a time.

    It rises by ``rise`` in all, and changes by at least ``least`` < 0 and at most ``most`` > 0, in
    dB/s.
    """
    if least == -np.inf or most == np.inf:
        return np.inf
    # It falls by most if it first rises, or last, for as short a time as possible.
    if rise < 0.0:
        return most * (rise - least * width) / (most - least)
    return -least * (most * width - rise) / (most - least)


@kernel
def bound_ratio(links: Links, k: int) -> tuple[float, float]:
    """Return the least and the most that a signal's ratio changes in a time, in dB/s.

    The bounds of all levels are known for it (``bound_levels``). The interference in dB changes by
    a mean of its levels' changes, weighted with their shares of the sum of all powers and the
    noise. A share is between what it is if its own power is least and all others are most, and what
    it is if its own power is most and all others are least.
    """
    table, used = links.table, links.used
    if used == 1:
        return float(table[0, LEAST]), float(table[0, MOST])
    if are_a_pair(links):
        one, other = table[k], table[1 - k]
        return float(one[LEAST] - other[MOST]), float(one[MOST] - other[LEAST])
    least = most = 0.0
    low = high = table[k, NOISE_MW]
    for i in range(used):
        if i != k:
            least, most = min(least, table[i, LEAST]), max(most, table[i, MOST])
            low += table[i, LOW_MW]
            high += table[i, HIGH_MW]
    if high < np.inf and -least < np.inf and most < np.inf:
        falls = rises = 0.0
        for i in range(used):
            if i != k:
                own_low, own_high = table[i, LOW_MW], table[i, HIGH_MW]
                share_low = own_low / (own_low + (high - own_high))
                share_high = own_high / (own_high + (low - own_low))
                falls += table[i, LEAST] * (share_low if table[i, LEAST] > 0.0 else share_high)
                rises += table[i, MOST] * (share_high if table[i, MOST] > 0.0 else share_low)
        least, most = max(least, falls), min(most, rises)
    return float(table[k, LEAST] - most), float(table[k, MOST] - least)
