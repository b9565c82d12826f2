"""What is seen of the links of a user when one looks by curves (``model.radio.curves``).

A level differs from that of a curve by no more than the curve's error. A ratio differs by no more
than the error of its signal and ``SHARED`` times the mean of those of its interferers, weighted
with their shares of noise and interference. docs/explanation/sinr.md proves it.
"""

from __future__ import annotations

import numpy as np

from desim_uav.model.radio.curves import curve_at
from desim_uav.model.radio.links import LOOKS, ROUNDED_DB, Air, Link, class_at, ratio_db
from desim_uav.model.radio.slopes import DB
from desim_uav.rowcode.kernels import rule

NEAREST_M = 0.1
"""Links that are shorter than this on the ground are left to the other search."""

SHARED = 1.1
"""By how much more than their mean errors of interferers may change a ratio, in dB."""

SPARE = LOOKS - 1
"""The row of looks for places where a curve is tried."""


@rule
def see(link: Link, row: int, t: float) -> float:
    """Write a link as curves show it to a look, and return the horizontal distance in metres."""
    half, entry, curve = 0.5 * t, link.looks[row], curve_at(link.curve)
    x = link.x_m + t * (link.vx_mps + half * link.ax_mps2)
    y = link.y_m + t * (link.vy_mps + half * link.ay_mps2)
    ux, uy = link.vx_mps + t * link.ax_mps2, link.vy_mps + t * link.ay_mps2
    distance_m = np.sqrt(x * x + y * y)
    away_mps = (x * ux + y * uy) / max(distance_m, NEAREST_M)
    at = distance_m * curve.per_m
    i = int(at)
    cell, s = curve.cells[i], at - i
    entry.distance_m, entry.away_mps, entry.error_db = distance_m, away_mps, cell.error_db
    entry.power_mw = link.mw * (cell.c0 + s * (cell.c1 + s * (cell.c2 + s * cell.c3)))
    per_cell = cell.c1 + s * (2.0 * cell.c2 + s * 3.0 * cell.c3)
    entry.mw_per_m = link.mw * per_cell * curve.per_m
    return float(distance_m)


@rule
def look_quickly(air: Air, row: int, t: float) -> bool:
    """Write a look by curves; return False if a sender is too near."""
    air.looked_s[row] = t
    nearest_m = np.inf
    for k in range(air.used):
        nearest_m = min(nearest_m, see(air.links[k], row, t))
    return bool(nearest_m >= NEAREST_M)


@rule
def copy_look(air: Air, row: int) -> None:
    """Copy a look into the next row."""
    air.looked_s[row + 1] = air.looked_s[row]
    for k in range(air.used):
        had, gets = air.links[k].looks[row], air.links[k].looks[row + 1]
        gets.power_mw, gets.ratio_db, gets.state = had.power_mw, had.ratio_db, had.state
        gets.distance_m, gets.away_mps = had.distance_m, had.away_mps
        gets.margin_db, gets.db_per_s, gets.mw_per_m = had.margin_db, had.db_per_s, had.mw_per_m


@rule
def rate(air: Air, row: int, k: int) -> None:
    """Write the ratio of a signal by the curves, its derivative and a bound of its error."""
    entry, errors = air.links[k].looks[row], 0.0
    for i in range(air.used):
        if i != k:
            other = air.links[i].looks[row]
            errors += other.power_mw * other.error_db
    others_mw = follow_slope(air, row, k)
    entry.ratio_db = DB * np.log(entry.power_mw / others_mw)
    entry.margin_db = entry.error_db + SHARED * errors / others_mw


@rule
def follow_slope(air: Air, row: int, k: int) -> float:
    """Write the derivative of a ratio by the curves; return noise and interference in mW."""
    link = air.links[k]
    entry, others, rises = link.looks[row], link.noise_mw, 0.0
    for i in range(air.used):
        if i != k:
            other = air.links[i].looks[row]
            others += other.power_mw
            rises += other.mw_per_m * other.away_mps
    goes = entry.mw_per_m * entry.away_mps
    entry.db_per_s = DB * (goes / entry.power_mw - rises / others)
    return float(others)


@rule
def compare_quickly(air: Air, row: int, k: int) -> bool:
    """Write the ratio and the class of a signal at a look; return False if rounding decides it."""
    link = air.links[k]
    entry = link.looks[row]
    rate(air, row, k)
    entry.margin_db = max(entry.margin_db, ROUNDED_DB)
    entry.state = class_at(air, k, entry.ratio_db)
    if _is_clear(air, link, entry.state, entry.ratio_db, entry.margin_db):
        return True
    entry.margin_db = ROUNDED_DB
    entry.ratio_db = ratio_db(air, k, air.looked_s[row])
    entry.state = class_at(air, k, entry.ratio_db)
    return _is_clear(air, link, entry.state, entry.ratio_db, ROUNDED_DB)


@rule
def _is_clear(air: Air, link: Link, state: int, ratio: float, margin_db: float) -> bool:
    """Return whether a ratio is in a class, and farther than a margin from its thresholds."""
    above = link.lowest + state
    if state > 0 and ratio - margin_db <= air.thresholds_db[above - 1]:
        return False
    return bool(above == link.top or ratio + margin_db < air.thresholds_db[above])
