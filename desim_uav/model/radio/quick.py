"""The search for classes with interference, which decides by curves what they can decide.

It finds what ``model.radio.search`` finds, bit for bit, or says that it cannot. Each decision holds
for all levels that differ from those of the curves (``model.radio.curves``) by no more than they
may. Levels are computed from the path loss only where a look is near a threshold, and where the
errors of the curves leave open in which microsecond a threshold is passed. docs/explanation/sinr.md
proves it.
"""

from __future__ import annotations

import numpy as np

from desim_uav.model.geometry.relative import rounded_us
from desim_uav.model.radio.bounds import bound_ratio, pull_of, turns_back
from desim_uav.model.radio.curve_looks import (
    NEAREST_M,
    SPARE,
    compare_quickly,
    copy_look,
    follow_slope,
    look_quickly,
    rate,
    see,
)
from desim_uav.model.radio.curves import curve_at, curves_at, gain_at, slopes_between
from desim_uav.model.radio.links import Air, Link, class_of, note, ratio_db
from desim_uav.model.radio.passing import ROOT_S
from desim_uav.model.radio.search import TOLERANCE_DB, stays
from desim_uav.rowcode.compiled_rows import array_at
from desim_uav.rowcode.kernels import apart, rule
from desim_uav.rowcode.rows import address

MOST_ERROR_DB = 0.5
"""Curves are of no use if levels may differ by more than this from theirs."""

SHORTEST_S = 1e-2
"""Intervals that are shorter than this are left to the other search."""

CLOSE_S = 2e-3
"""How far the last step of Newton's method may go: it ends so much closer than it has begun."""

NEAR_S = 2.0 * CLOSE_S
"""How far from where it has begun the threshold may be passed."""

SURELY = 1.0 + 3e-7
"""More than the ratio of two powers whose levels differ by ``ROUNDED_DB``."""

NOISE_DB = 1e-10
"""More than rounding changes a ratio."""

SURE_S = 1.25 * ROOT_S
"""A time is only sure if no microsecond ends so soon before or after it: the other search finds
times to ``ROOT_S``."""

TRIES = 12
"""The most steps to where a curve passes a threshold; four are enough for most."""

ratios_at = array_at(float)


@apart
def bound_quickly(air: Air, start_us: int) -> int:
    """Note which signals keep their class in a span, and return how many others are sought.

    The result is below 0 if there are no curves for all links. ``look_from`` must have been called
    before. A curve falls with the distance, but for its error.
    """
    if len(air.marks_at) > 0:
        return -1
    for k in range(air.used):
        if not _takes_curve(air.links[k]):
            return -1
    for k in range(air.used):
        link = air.links[k]
        curve = curve_at(link.curve)
        wider = _wider(curve.error_db)
        link.low_mw = link.mw * gain_at(curve, link.far_m) / wider
        link.high_mw = link.mw * gain_at(curve, link.near_m) * wider
    sought = 0
    for k in range(air.used):
        link = air.links[k]
        link.sought = int(link.out != 0)
        if link.sought:
            least = most = link.noise_mw
            for i in range(air.used):
                if i != k:
                    least += air.links[i].low_mw
                    most += air.links[i].high_mw
            state, ratios = 0, ratios_at(link.ratios, link.top - link.lowest)
            if SURELY * link.high_mw >= least * ratios[0]:
                state = class_of(SURELY * link.high_mw / least, ratios, 0, len(ratios))
            if state == 0 or _reaches(link, state, most):
                note(link, start_us, state)
                link.sought = 0
            else:
                sought += 1
    return sought


@rule
def _takes_curve(link: Link) -> bool:
    """Take the curve of a link's height, and return whether it is good for the whole span."""
    link.curve = 0
    curves = curves_at(link.curves, link.curve_count)
    for number in range(link.curve_count):
        curve = curves[number]
        if curve.height_m == link.z_m and link.far_m < curve.reach_m:
            link.curve = address(curve) if curve.error_db <= MOST_ERROR_DB else 0
    return link.curve != 0 and link.climbs_m == 0.0


@rule
def _wider(error_db: float) -> float:
    """Return more than the ratio of two powers whose levels differ by so little."""
    return 1.0 + 0.25 * error_db


@apart
def search_quickly(air: Air, begin: float, lasts: float) -> bool:
    """Write the changes of class of all signals that are sought in a stretch; False if it cannot.

    It does what ``search`` does. In the first stretch of a span, it also notes the classes there.
    """
    if not _look_at_ends(air, begin, lasts):
        return False
    left = 1
    while left > 0:
        since, until = air.looked_s[left], air.looked_s[left - 1]
        ranged, bounded, settled = False, False, True
        for k in range(air.used):
            link = air.links[k]
            if link.sought and link.settled_s <= since:
                if not ranged:
                    for i in range(air.used):
                        _bound_power(air.links[i], left, since, until)
                    ranged = True
                if not _keeps(air, k, left):
                    if not bounded:
                        for i in range(air.used):
                            _bound_slope(air.links[i])
                        bounded = True
                    if not _settles(air, k, left):
                        settled = False
                        continue
                link.settled_s = until
                if link.looks[left - 1].state != link.state:
                    if not _pass(air, k, left, begin):
                        return False
                    ranged = bounded = False
        if settled:
            left -= 1
            continue
        if until - since < SHORTEST_S or left + 1 >= SPARE or not _divide(air, left):
            return False
        left += 1
    return True


@rule
def _divide(air: Air, left: int) -> bool:
    """Look at the middle between two looks, for the signals that are not settled then."""
    since, until = air.looked_s[left], air.looked_s[left - 1]
    copy_look(air, left)
    seen = look_quickly(air, left, since + 0.5 * (until - since))
    for k in range(air.used):
        link = air.links[k]
        if link.sought and link.settled_s <= since:
            seen = seen and compare_quickly(air, left, k)
    return bool(seen)


@rule
def _look_at_ends(air: Air, begin: float, lasts: float) -> bool:
    """Look at the start and the end of a stretch; return False if it cannot."""
    seen = _begin(air) if begin == 0.0 else _go_on(air)
    seen = seen and look_quickly(air, 0, lasts)
    for k in range(air.used):
        if air.links[k].sought:
            air.links[k].settled_s = 0.0
            seen = seen and compare_quickly(air, 0, k)
    return bool(seen)


@rule
def _begin(air: Air) -> bool:
    """Look at the start of a span, and note the classes there; return False if it cannot."""
    if not look_quickly(air, 1, 0.0):
        return False
    for k in range(air.used):
        link = air.links[k]
        if link.sought:
            if not compare_quickly(air, 1, k):
                return False
            link.state = link.looks[1].state
            note(link, air.start_us, link.state)
    return True


@rule
def _go_on(air: Air) -> bool:
    """Take the last look for the start of a stretch, at which only velocities may have changed."""
    copy_look(air, 0)
    air.looked_s[1] = 0.0
    for k in range(air.used):
        link = air.links[k]
        entry = link.looks[1]
        along = link.x_m * link.vx_mps + link.y_m * link.vy_mps
        entry.away_mps = along / max(entry.distance_m, NEAREST_M)
    for k in range(air.used):
        if air.links[k].sought:
            follow_slope(air, 1, k)
    return True


@rule
def _bound_power(link: Link, left: int, since: float, until: float) -> None:
    """Write bounds of a power between two looks, and of the distance and how fast it grows."""
    one, other = link.looks[left], link.looks[left - 1]
    curve = curve_at(link.curve)
    wider = _wider(curve.error_db)
    link.least = link.most = 0.0
    link.low_mw = min(one.power_mw, other.power_mw) * (2.0 - wider)
    link.high_mw = max(one.power_mw, other.power_mw) * wider
    if one.away_mps == 0.0 and other.away_mps == 0.0 and not _moves(link):
        return
    near_m = min(one.distance_m, other.distance_m)
    far_m = max(one.distance_m, other.distance_m)
    ax, ay, width = link.ax_mps2, link.ay_mps2, until - since
    # Without acceleration, the distance is a convex function of time.
    least, most = one.away_mps, other.away_mps
    if ax != 0.0 or ay != 0.0:
        x = link.x_m + since * (link.vx_mps + 0.5 * since * ax)
        y = link.y_m + since * (link.vy_mps + 0.5 * since * ay)
        ux, uy = link.vx_mps + since * ax, link.vy_mps + since * ay
        wx, wy = link.vx_mps + until * ax, link.vy_mps + until * ay
        speed = np.sqrt(max(ux * ux + uy * uy, wx * wx + wy * wy))
        nearest = 0.5 * (near_m + far_m - speed * width)
        pull = width * pull_of(x, y, ux, uy, ax, ay, width, nearest)
        least, most = max(-speed, least + pull), min(speed, most - pull)
    if least < 0.0 < most:
        rise = other.distance_m - one.distance_m
        turns = max(turns_back(width, rise, least, most), 0.0)
        near_m, far_m = max(near_m - turns, link.near_m), min(far_m + turns, link.far_m)
        link.low_mw = link.mw * gain_at(curve, far_m) * (2.0 - wider)
        link.high_mw = link.mw * gain_at(curve, near_m) * wider
    link.from_m, link.to_m, link.least, link.most = near_m, far_m, least, most


@rule
def _bound_slope(link: Link) -> None:
    """Write bounds of how fast a level changes, after those of ``_bound_power``."""
    if link.least != 0.0 or link.most != 0.0:
        falls, rises = slopes_between(curve_at(link.curve), link.from_m, link.to_m)
        _take_range(link, falls, rises, link.least, link.most)


@rule
def _keeps(air: Air, k: int, left: int) -> bool:
    """Return whether the powers between two looks show that a signal keeps its class."""
    link = air.links[k]
    if link.looks[left - 1].state != link.state:
        return False
    least = most = link.noise_mw
    for i in range(air.used):
        if i != k:
            least += air.links[i].low_mw
            most += air.links[i].high_mw
    if link.state > 0 and not _reaches(link, link.state, most):
        return False
    ratios = ratios_at(link.ratios, link.top - link.lowest)
    return bool(link.state == len(ratios) or SURELY * link.high_mw < least * ratios[link.state])


@rule
def _reaches(link: Link, state: int, others_mw: float) -> bool:
    """Return whether the least power of a signal is surely enough for a class."""
    threshold = ratios_at(link.ratios, link.top - link.lowest)[state - 1]
    return bool(link.low_mw >= SURELY * others_mw * threshold)


@rule
def _moves(link: Link) -> bool:
    """Return whether a sender moves relative to the user."""
    moves = link.vx_mps != 0.0 or link.vy_mps != 0.0
    return bool(moves or link.ax_mps2 != 0.0 or link.ay_mps2 != 0.0)


@rule
def _take_range(link: Link, falls: float, rises: float, least: float, most: float) -> None:
    """Write the range of the products of two ranges as that in which a level changes in dB/s."""
    a, b, c, d = falls * least, falls * most, rises * least, rises * most
    link.least, link.most = min(a, b, c, d), max(a, b, c, d)


@rule
def _settles(air: Air, k: int, left: int) -> bool:
    """Return whether bounds show what the changes of a signal's class are between two looks.

    Either the ratio is monotone, or it stays in its class, and farther than a tolerance from all
    others: the other search may miss what goes less far.
    """
    link = air.links[k]
    least, most = bound_ratio(air, k)
    if least >= 0.0 or most <= 0.0:
        return True
    before, after = link.looks[left], link.looks[left - 1]
    if before.state != after.state:
        return False
    one, other = before.ratio_db, after.ratio_db
    width = air.looked_s[left - 1] - air.looked_s[left]
    beyond = max(turns_back(width, other - one, least, most), 0.0)
    beyond += 2.0 * (before.margin_db + after.margin_db) + TOLERANCE_DB
    return stays(air, link, min(one, other) - beyond, max(one, other) + beyond)


@rule
def _pass(air: Air, k: int, left: int, begin: float) -> bool:
    """Write when a signal passes all thresholds between its classes at two looks.

    Its ratio is monotone between them. Return False if a microsecond is not sure.
    """
    link = air.links[k]
    reached, rises = link.looks[left - 1].state, link.looks[left - 1].state > link.state
    low = air.looked_s[left]
    while link.state != reached:
        above = link.lowest + link.state
        threshold = air.thresholds_db[above if rises else above - 1]
        t_us, low = _pass_us(air, k, left, begin, threshold, low)
        if t_us < 0:
            return False
        link.state += 1 if rises else -1
        note(link, t_us, link.state)
    return True


@rule
def _pass_us(
    air: Air, k: int, left: int, begin: float, threshold: float, low: float
) -> tuple[int, float]:
    """Return the microsecond in which a ratio passes a threshold, and about when in seconds.

    The microsecond is below 0 if it is not sure. Newton's method shows about when the curves pass
    the threshold, which is not before ``low``. Bounds of the ratio's slope then say between which
    two times it passes the threshold, by the ratio of the curves with its error. If this leaves two
    microseconds, the ratio is computed from the path loss.
    """
    link, high = air.links[k], air.looked_s[left - 1]
    entry, t, at = link.looks[SPARE], _guess(air, k, left, threshold), low
    rises = link.looks[left - 1].state > link.state
    for _ in range(TRIES):
        at = min(max(t, low), high)
        _try(air, k, at)
        if (entry.ratio_db >= threshold) == rises:
            high = at
        else:
            low = at
        t = 0.5 * (low + high)
        if entry.db_per_s != 0.0:
            by_slope = at + (threshold - entry.ratio_db) / entry.db_per_s
            t = by_slope if low - CLOSE_S <= by_slope <= high + CLOSE_S else t
        if abs(t - at) < CLOSE_S:
            break
    for i in range(air.used):
        _bound_near(air.links[i], at)
    least, most = bound_ratio(air, k)
    flattest = min(abs(least), abs(most))
    if not (least > 0.0 or most < 0.0) or not flattest > 0.0:
        return -1, t
    t = min(max(t, low), high)
    _try(air, k, t)
    ratio, error_db = entry.ratio_db, entry.margin_db
    for _ in range(4):
        sure = SURE_S + (NOISE_DB + error_db) / flattest
        one, other = t + (threshold - ratio) / least, t + (threshold - ratio) / most
        first, last = min(one, other) - sure, max(one, other) + sure
        if first < at - NEAR_S or last > at + NEAR_S:
            break
        t_us = rounded_us(air.start_us, begin + first)
        if t_us == rounded_us(air.start_us, begin + last):
            return t_us, t
        if error_db == 0.0 and last - first < 3.0 * sure:
            break
        t = 0.5 * (one + other)
        ratio, error_db = ratio_db(air, k, t), 0.0
    return -1, t


@rule
def _try(air: Air, k: int, t: float) -> None:
    """Look by curves at a time for the ratio of a signal, into the spare row."""
    for i in range(air.used):
        see(air.links[i], SPARE, t)
    rate(air, SPARE, k)


@rule
def _guess(air: Air, k: int, left: int, threshold: float) -> float:
    """Return about when a ratio passes a threshold between two looks, by inverse interpolation.

    The time is a cubic function of the ratio, by the ratios and their derivatives at both looks.
    """
    one, other = air.links[k].looks[left], air.links[k].looks[left - 1]
    since, width = air.looked_s[left], air.looked_s[left - 1] - air.looked_s[left]
    goes = other.ratio_db - one.ratio_db
    if goes == 0.0:
        return since + 0.5 * width
    share = (threshold - one.ratio_db) / goes
    mean = goes / width
    if min(one.db_per_s / mean, other.db_per_s / mean) > 0.25:
        rest, first, last = 1.0 - share, mean / one.db_per_s, mean / other.db_per_s
        share += share * rest * (rest * (first - 1.0) - share * (last - 1.0))
    return since + share * width


@rule
def _bound_near(link: Link, t: float) -> None:
    """Write bounds of a level and a power for all times that are ``NEAR_S`` or less from a look."""
    curve, entry = curve_at(link.curve), link.looks[SPARE]
    ux, uy = link.vx_mps + t * link.ax_mps2, link.vy_mps + t * link.ay_mps2
    pull = np.sqrt(link.ax_mps2 * link.ax_mps2 + link.ay_mps2 * link.ay_mps2)
    speed = np.sqrt(ux * ux + uy * uy) + NEAR_S * pull
    near_m, far_m = entry.distance_m - NEAR_S * speed, entry.distance_m + NEAR_S * speed
    if entry.distance_m < NEAREST_M or near_m <= 0.0:
        link.least, link.most, link.low_mw, link.high_mw = -np.inf, np.inf, 0.0, np.inf
        return
    goes = NEAR_S * (speed * speed / near_m + pull)
    near_m, far_m = max(near_m, link.near_m), min(far_m, link.far_m)
    falls, rises = slopes_between(curve, near_m, far_m)
    _take_range(link, falls, rises, entry.away_mps - goes, entry.away_mps + goes)
    wider = _wider(entry.error_db + NEAR_S * max(abs(link.least), abs(link.most)))
    link.low_mw, link.high_mw = entry.power_mw / wider, entry.power_mw * wider
