"""When the ratio of a signal to noise and interference passes thresholds, for one user.

A stretch is a time in which the user and all drones that it receives keep their accelerations, and
no line of sight changes. Within it, the levels have bounds for how fast they rise and fall
(``model.radio.levels``). Where these show that the ratio is monotone, it passes each threshold at
most once; elsewhere they show how far it can go. The search looks at shorter and shorter times
until one of the two settles the classes. docs/explanation/sinr.md proves it.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from desim_uav.model.compiled_rows import call, call_for_float
from desim_uav.model.kernels import kernel, part, rule
from desim_uav.model.radio.levels import H_LEAST, H_MOST, R_LEAST, R_MOST, RATES
from desim_uav.model.radio.slopes import DB
from desim_uav.model.radio.tracks import rounded_us

TOLERANCE_DB = 1e-4
"""Stays on the other side of a threshold that go less far than this beyond it may be missed."""

SHORTEST_S = 1e-7
"""The search looks at least so far ahead: what comes and goes in between lasts no microsecond."""

ROOT_S = 1e-9
"""How far a time may be from where the ratio passes a threshold, before it is rounded."""

PX, PY, PZ, VX, VY, VZ, AX, AY, AZ, CARRIER, BASE_DBM, HEARD_MW, LOOKED_MW, LEAST, MOST = range(15)
BOUND = 15
LINK_COLUMNS = BOUND + RATES
"""The columns of a table of links, and their number.

First, the place, velocity and acceleration of the drone relative to the user at the start of the
stretch, the carrier in GHz, and the level before the path loss in dBm. Then, the received power in
mW at the start of the time that is looked at and at the last look, the least and the most that the
level changes in dB/s, and a row of rates (see ``levels``)."""

LEVEL, RATES_AT, VALUES, BRANCH, FIRST, AFTER, ROW, MARK, LAST_MARK, MARKED, SENDER = range(11)
LINK_WORDS = 11
"""The columns of a table of whole numbers of links, and their number.

First, what is called: the addresses of the path loss (``levels.Loss``) and the branch. Then, the
first row of the drone's track, the row after the last one and the present one; the present mark and
the last one, and since when their times count, in microseconds since the start of the span; and the
number of the drone."""


SIGNAL: Any = np.int64(0)
OTHER: Any = np.int64(1)
"""The numbers of the first two links; for literal ones, Numba would compile functions anew."""


class Links(NamedTuple):
    """The links of a user: the first one is the signal, and the others interfere.

    ``table`` (links, LINK_COLUMNS) and ``words`` (links, LINK_WORDS) may have spare rows behind
    ``used``. The noise is in the receiver's band; it may be -inf dBm, for the ratio of two levels.
    """

    table: NDArray[np.float64]
    words: NDArray[np.int64]
    used: int
    noise_dbm: float


class Record(NamedTuple):
    """Where the changes of a user are written: in ``out`` from row ``first`` on.

    ``held`` is the class before the span, which begins at ``start_us``. With three columns, a row
    is (time, user, change): the new class if the link rises to it, or minus the new class if it
    falls to it. With two columns, a row is (time, class).
    """

    out: NDArray[np.int64]
    first: int
    user: int
    held: int
    start_us: int


@rule
def note(record: Record, rows: int, t_us: int, state: int) -> int:
    """Write that a user's class is another one from a time on, and return the number of rows.

    Changes in one microsecond are one, or none if they cancel. Rows for which there is no room are
    counted only, some of them more than once.
    """
    out, first = record.out, record.first
    last = out.shape[1] - 1
    before = record.held
    if first < rows <= len(out):
        before = abs(out[rows - 1, last])
        if out[rows - 1, 0] == t_us:
            rows -= 1
            before = abs(out[rows - 1, last]) if rows > first else record.held
    if state == before:
        return rows
    if rows < len(out):
        out[rows, 0] = t_us
        out[rows, last] = state
        if last > 1:
            out[rows, 1] = record.user
            out[rows, last] = state if state > before else -state
    return rows + 1


@kernel
def level_dbm(links: Links, k: int, t: float) -> float:
    """Return the level of a link, ``t`` seconds after the start of the stretch."""
    table, words = links.table, links.words
    half = 0.5 * t
    x = table[k, PX] + t * (table[k, VX] + half * table[k, AX])
    y = table[k, PY] + t * (table[k, VY] + half * table[k, AY])
    z = table[k, PZ] + t * (table[k, VZ] + half * table[k, AZ])
    loss = call_for_float(
        words[k, LEVEL],
        (words[k, VALUES], table[k, CARRIER], words[k, BRANCH], np.sqrt(x * x + y * y), z),
    )
    return float(table[k, BASE_DBM] - loss)


@kernel
def ratio_db(links: Links, t: float) -> float:
    """Return the ratio of the signal to noise and interference, after ``t`` seconds, in dB.

    The received powers in mW are written to the column LOOKED_MW.
    """
    signal = level_dbm(links, SIGNAL, t)
    if links.used == 1:
        return float(signal - links.noise_dbm)
    if links.used == 2 and links.noise_dbm == -np.inf:
        return float(signal - level_dbm(links, OTHER, t))
    total = np.exp(links.noise_dbm / DB)
    for k in range(1, links.used):
        power = np.exp(level_dbm(links, k, t) / DB)
        links.table[k, LOOKED_MW] = power
        total += power
    return float(signal - DB * np.log(total))


@rule
def keep_look(links: Links) -> None:
    """Take the powers at the last look for those at the start of the time that is looked at."""
    for k in range(1, links.used):
        links.table[k, HEARD_MW] = links.table[k, LOOKED_MW]


@rule
def bound_rates(links: Links, k: int, distance_m: float, height_m: float, within_m: float) -> None:
    """Write the row of rates of a link, for all places near one (see ``levels.BOUNDS``)."""
    words = links.words
    row = links.table.ctypes.data + 8 * (k * LINK_COLUMNS + BOUND)
    values = (words[k, VALUES], words[k, BRANCH], distance_m, height_m, within_m, row)
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
def bound_ratio(links: Links, since: float, until: float) -> tuple[float, float]:
    """Return the least and the most that the ratio changes between two times, in dB/s.

    The interference in dB changes by a mean of its levels' changes, weighted with their shares of
    the sum of all powers and the noise. If no level changes by more than a number of decibels, then
    no share is multiplied or divided by more than twice that.
    """
    table = links.table
    for k in range(links.used):
        bound_level(links, k, since, until)
    if links.used == 1:
        return float(table[0, LEAST]), float(table[0, MOST])
    if links.used == 2 and links.noise_dbm == -np.inf:
        return float(table[0, LEAST] - table[1, MOST]), float(table[0, MOST] - table[1, LEAST])
    total, largest = np.exp(links.noise_dbm / DB), 0.0
    lowest = highest = 0.0
    for k in range(1, links.used):
        total += table[k, HEARD_MW]
        largest = max(largest, -table[k, LEAST], table[k, MOST])
        lowest, highest = min(lowest, table[k, LEAST]), max(highest, table[k, MOST])
    least, most = lowest, highest
    if largest < np.inf:
        factor = np.exp(min(2.0 * largest * (until - since) / DB, 700.0))
        falls = rises = 0.0
        for k in range(1, links.used):
            share = table[k, HEARD_MW] / total
            low, high = share / factor, min(share * factor, 1.0)
            falls += table[k, LEAST] * (low if table[k, LEAST] > 0.0 else high)
            rises += table[k, MOST] * (high if table[k, MOST] > 0.0 else low)
        least, most = max(least, falls), min(most, rises)
    return float(table[0, LEAST] - most), float(table[0, MOST] - least)


@kernel
def passing(
    links: Links, threshold: float, low: float, before: float, high: float, after: float
) -> float:
    """Return when the ratio passes a threshold, ``ROOT_S`` after a time at which it has not.

    At ``low`` the ratio is ``before``, and at ``high`` it is ``after``, beyond the threshold. It is
    Chandrupatla's method (Advances in Engineering Software 28, 1997): bisection, and inverse
    quadratic interpolation where that is safe.
    """
    rises = after >= threshold
    a, fa, b, fb = high, after - threshold, low, before - threshold
    c, fc = b, fb
    share = fa / (fa - fb) if fa != fb else 0.5
    while abs(b - a) > ROOT_S:
        step = 0.25 * ROOT_S / abs(b - a)
        t = a + min(max(share, step), 1.0 - step) * (b - a)
        if not min(a, b) < t < max(a, b):
            break
        value = ratio_db(links, t) - threshold
        c, fc = b, fb
        if (value >= 0.0) == (fa >= 0.0):
            c, fc = a, fa
        else:
            b, fb = a, fa
        a, fa = t, value
        share = 0.5
        if b != c and fc not in (fa, fb):
            xi, phi = (a - b) / (c - b), (fa - fb) / (fc - fb)
            if phi * phi < xi and (1.0 - phi) * (1.0 - phi) < 1.0 - xi:
                share = fa / (fb - fa) * fc / (fb - fc)
                share += (c - a) / (b - a) * fa / (fc - fa) * fb / (fc - fb)
    return float(a if (fa >= 0.0) == rises else b)


@part
def class_of(value: float, thresholds: NDArray[np.float64]) -> int:
    """Return how many thresholds, which rise, a value has reached."""
    low, high = 0, len(thresholds)
    while low < high:
        middle = (low + high) // 2
        if value >= thresholds[middle]:
            low = middle + 1
        else:
            high = middle
    return low


@rule
def settles(
    width: float,
    before: float,
    after: float,
    least: float,
    most: float,
    thresholds: NDArray[np.float64],
) -> bool:
    """Return whether bounds show which thresholds the ratio passes in a time.

    They do if it is monotone, if it can turn back by no more than half the tolerance, or if
    whatever it reaches is in one class.
    """
    if least >= 0.0 or most <= 0.0:
        return True
    if least == -np.inf or most == np.inf:
        return False
    rise = after - before
    # It falls by most if it first rises, or last, for as short a time as possible.
    turns = -least * (most * width - rise) / (most - least)
    if rise < 0.0:
        turns = most * (rise - least * width) / (most - least)
    if turns <= 0.5 * TOLERANCE_DB:
        return True
    beyond = turns - 0.5 * TOLERANCE_DB
    low, high = min(before, after) - beyond, max(before, after) + beyond
    return class_of(low, thresholds) == class_of(high, thresholds)


@kernel
def search(
    links: Links,
    thresholds: NDArray[np.float64],
    stretch: tuple[float, float],
    value: float,
    record: Record,
    rows: int,
) -> tuple[int, int, float]:
    """Write the changes of class in a stretch; return the number of rows, and class and ratio.

    ``stretch`` holds its beginning in the span and its length, in seconds. ``value`` is the ratio
    at its beginning, the class of which has been noted, and what is returned is that at its end.
    The received powers at these times are in the column HEARD_MW.
    """
    begin, end = stretch
    t, width, state = 0.0, end, class_of(value, thresholds)
    while t < end:
        ahead = t + width
        if ahead >= end:
            ahead, width = end, end - t
        least, most = bound_ratio(links, t, ahead)
        if least == 0.0 and most == 0.0:
            t = ahead
            continue
        after = ratio_db(links, ahead)
        settled = settles(width, value, after, least, most, thresholds)
        if not settled and width > SHORTEST_S:
            width *= 0.5
            continue
        keep_look(links)
        reached, low, start = class_of(after, thresholds), t, value
        while state != reached:
            rises = reached > state
            threshold = thresholds[state if rises else state - 1]
            low = passing(links, threshold, low, start, ahead, after)
            start = threshold
            state += 1 if rises else -1
            rows = note(record, rows, rounded_us(record.start_us, begin + low), state)
        t, value, width = ahead, after, 2.0 * width
    return rows, state, value
