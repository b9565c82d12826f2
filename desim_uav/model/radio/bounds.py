"""How fast the level of a link, and a ratio of levels, can change in a time.

docs/explanation/sinr.md proves it.
"""

from __future__ import annotations

import numpy as np

from desim_uav.model.radio.links import Air, Link, are_a_pair
from desim_uav.model.radio.slopes import DB, least_share
from desim_uav.rowcode.compiled_rows import call
from desim_uav.rowcode.kernels import kernel, rule
from desim_uav.rowcode.rows import address


@rule
def bound_rates(link: Link, distance_m: float, height_m: float, within_m: float) -> None:
    """Write the rates of a link, for all places near one (see ``levels.BOUNDS``)."""
    place = link.values, link.carrier_ghz, link.branch, distance_m, height_m
    call(link.rates_of, (*place, within_m, address(link.rates)))


@kernel
def bound_level(link: Link, since: float, until: float) -> None:
    """Write the least and the most that a level changes between two times, in dB/s.

    The horizontal distance r changes by r' = p v / r, and r'' is at least p a / r.
    """
    link.least = link.most = 0.0
    ax, ay, az = link.ax_mps2, link.ay_mps2, link.az_mps2
    ux, uy, uz = link.vx_mps + since * ax, link.vy_mps + since * ay, link.vz_mps + since * az
    wx, wy, wz = link.vx_mps + until * ax, link.vy_mps + until * ay, link.vz_mps + until * az
    level_speed = np.sqrt(max(ux * ux + uy * uy, wx * wx + wy * wy))
    speed = np.sqrt(max(ux * ux + uy * uy + uz * uz, wx * wx + wy * wy + wz * wz))
    if speed == 0.0:
        return
    lasts, half = until - since, 0.5 * (until - since)
    middle = since + half
    x, y = _level_at(link, middle)
    z = link.z_m + middle * (link.vz_mps + 0.5 * middle * az)
    bound_rates(link, np.sqrt(x * x + y * y), z, speed * half)
    rates = link.rates
    if level_speed > 0.0:
        (px, py), (qx, qy) = _level_at(link, since), _level_at(link, until)
        near, far = np.sqrt(px * px + py * py), np.sqrt(qx * qx + qy * qy)
        least, most = -level_speed, level_speed
        pull = pull_of(px, py, ux, uy, ax, ay, lasts, np.sqrt(x * x + y * y) - level_speed * half)
        if near > 0.0:
            least = max(least, (px * ux + py * uy) / near + pull * lasts)
        if far > 0.0:
            most = min(most, (qx * wx + qy * wy) / far - pull * lasts)
        _add(link, rates.least_away, rates.most_away, least, most)
    _add(link, rates.least_up, rates.most_up, min(uz, wz), max(uz, wz))


@rule
def _level_at(link: Link, t: float) -> tuple[float, float]:
    """Return the horizontal place relative to the user, t seconds into the stretch."""
    x = link.x_m + t * (link.vx_mps + 0.5 * t * link.ax_mps2)
    return x, link.y_m + t * (link.vy_mps + 0.5 * t * link.ay_mps2)


@rule
def pull_of(
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
def _add(link: Link, low: float, high: float, least: float, most: float) -> None:
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
    link.least += down
    link.most += up


@kernel
def bound_stretch(air: Air, lasts: float) -> None:
    """Write the most that each level changes in a stretch in dB/s, by the bounds of the span."""
    for k in range(air.used):
        link = air.links[k]
        ux, uy, uz = link.vx_mps, link.vy_mps, link.vz_mps
        wx, wy = ux + lasts * link.ax_mps2, uy + lasts * link.ay_mps2
        wz = uz + lasts * link.az_mps2
        steep, climb = 0.0, max(abs(uz), abs(wz))
        square = max(ux * ux + uy * uy, wx * wx + wy * wy)
        if square > 0.0:
            steep += link.steep_away * np.sqrt(square)
        if climb > 0.0:
            steep += link.steep_up * climb
        link.steep = steep


@kernel
def bound_levels(air: Air, left: int) -> None:
    """Write bounds of all levels for the time from a look to the one in the row before it.

    They are the least and the most that a level changes in dB/s and, if there is interference, the
    least and the most power.
    """
    since, until = air.looked_s[left], air.looked_s[left - 1]
    powers = air.used > 1 and not are_a_pair(air)
    for k in range(air.used):
        link = air.links[k]
        bound_level(link, since, until)
        if powers:
            one, other = link.looks[left], link.looks[left - 1]
            link.low_mw = min(one.power_mw, other.power_mw)
            link.high_mw = max(one.power_mw, other.power_mw)
            if link.least < 0.0 < link.most:
                rise = other.level_dbm - one.level_dbm
                turns = max(turns_back(until - since, rise, link.least, link.most), 0.0)
                share = least_share(turns / DB)
                link.low_mw *= share
                link.high_mw /= share


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
def bound_ratio(air: Air, k: int) -> tuple[float, float]:
    """Return the least and the most that a signal's ratio changes in a time, in dB/s.

    The bounds of all levels are known for it (``bound_levels``). The interference in dB changes by
    a mean of its levels' changes, weighted with their shares of the sum of all powers and the
    noise. A share is between what it is if its own power is least and all others are most, and what
    it is if its own power is most and all others are least.
    """
    link, used = air.links[k], air.used
    if used == 1:
        return link.least, link.most
    if are_a_pair(air):
        second = air.links[1 - k]
        return link.least - second.most, link.most - second.least
    least = most = 0.0
    low = high = link.noise_mw
    for i in range(used):
        if i != k:
            other = air.links[i]
            least, most = min(least, other.least), max(most, other.most)
            low += other.low_mw
            high += other.high_mw
    if high < np.inf and -least < np.inf and most < np.inf:
        falls = rises = 0.0
        for i in range(used):
            if i != k:
                other = air.links[i]
                share_low = other.low_mw / (other.low_mw + (high - other.high_mw))
                share_high = other.high_mw / (other.high_mw + (low - other.low_mw))
                falls += other.least * (share_low if other.least > 0.0 else share_high)
                rises += other.most * (share_high if other.most > 0.0 else share_low)
        least, most = max(least, falls), min(most, rises)
    return link.least - most, link.most - least
