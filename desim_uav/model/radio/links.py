"""The links of a user: tables of their motions, and of what is seen of them when one looks.

A stretch is a time in which the user and all drones that it receives keep their accelerations, and
no line of sight changes. A look is what all links are at a time of it. All signals that are sought
for a user share the looks, because each of them is interference to the others.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from desim_uav.model.radio.levels import RATES
from desim_uav.model.radio.slopes import DB
from desim_uav.rowcode.compiled_rows import call_for_float, entries_at
from desim_uav.rowcode.kernels import kernel, part, rule

PX, PY, PZ, VX, VY, VZ, AX, AY, AZ, CARRIER, BASE_DBM, NOISE_DBM, NOISE_MW = range(13)
LEAST, MOST, LOW_DBM, HIGH_DBM, LOW_MW, HIGH_MW, SETTLED_S, STEEP, BOUND = range(13, 22)
STEEP_R, STEEP_H = range(BOUND + RATES, BOUND + RATES + 2)
LINK_COLUMNS = STEEP_H + 1
"""The columns of a table of links, and their number.

First, the place, velocity and acceleration of the drone relative to the user at the start of the
stretch, the carrier in GHz, the level before the path loss in dBm, and the noise in dBm and in mW.
Then, the least and the most that the level changes in dB/s; the lowest and the highest level in the
span in dBm; the lowest and the highest power in the span, or in the time that is looked at, in mW;
until when the class of a signal is settled, in seconds since the start of the stretch; the most
that the level changes in the stretch, in dB/s; a row of rates (see ``levels``); and the most that
the level changes in the span for a metre of horizontal distance and for a metre of height."""

LEVEL, RATES_AT, VALUES, BRANCH, FIRST, AFTER, ROW, MARK, LAST_MARK, MARKED, SENDER = range(11)
LOWEST, TOP, SOUGHT, STATE, OUT, ROOM, WIDTH, ROWS, BEGAN, HELD = range(11, 21)
LINK_WORDS = 21
"""The columns of a table of whole numbers of links, and their number.

First, what is called: the addresses of the path loss (``levels.Loss``) and the branch. Then, the
first row of the drone's track, the row after the last one and the present one; the present mark and
the last one, and since when their times count, in microseconds since the start of the span; and the
number of the drone.

For a signal, then the first of its thresholds and the one after the last; whether changes of its
class are sought for the present user, and the class; and where they are written (``note``): the
address of a table, 0 if the link only interferes, the numbers of its rows and of its columns, the
rows that are written, how many of them are of the users before, and the class before the span."""

SIGNAL: Any = np.int64(0)
OTHER: Any = np.int64(1)
"""The numbers of the first two links; for literal ones, Numba would compile functions anew."""

TIME_S, LOOKED = range(2)
LEVEL_DBM, POWER_MW, RATIO_DB = range(3)
LOOKED_COLUMNS = 3
"""The columns of a look: the seconds since the start of the stretch and, from LOOKED on, for each
link its level, its power, and its ratio to noise and interference. Ratios are known of signals
whose class was not settled before the look."""

LOOKS = 64
"""The most looks that are kept at a time: each is a half of the time to the next one."""

ROUNDED_DB = 1e-6
"""By how much less two ratios differ, for one place, because of rounding."""

EQUAL_DB = 1e-10
"""Levels that differ by no more than this from a threshold for their difference are taken to differ
by the threshold exactly: rounding alone makes levels of one place differ by about 1e-12 dB."""

ints_at = entries_at(int)


class Links(NamedTuple):
    """The links of a user, all in one band, in a span that begins at ``start_us``.

    ``table`` (links, LINK_COLUMNS) and ``words`` (links, LINK_WORDS) may have spare rows behind
    ``used``, and ``looks`` (LOOKS, look_columns(links)) spare columns. The noise of two links may
    be -inf dBm, for the ratio of their levels.
    """

    table: NDArray[np.float64]
    words: NDArray[np.int64]
    looks: NDArray[np.float64]
    used: int
    thresholds_db: NDArray[np.float64]
    start_us: int


def look_columns(links: int) -> int:
    """Return the number of columns of a table of looks."""
    return LOOKED + LOOKED_COLUMNS * links


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


@rule
def are_a_pair(links: Links) -> bool:
    """Return whether the ratio is that of two levels."""
    return bool(links.used == 2 and links.table[0, NOISE_DBM] == -np.inf)


@kernel
def look(links: Links, row: int, t: float) -> None:
    """Write a look: the levels and the powers of all links after ``t`` seconds."""
    looks = links.looks
    looks[row, TIME_S] = t
    powers = links.used > 1 and not are_a_pair(links)
    for k in range(links.used):
        at, level = LOOKED + LOOKED_COLUMNS * k, level_dbm(links, k, t)
        looks[row, at + LEVEL_DBM] = level
        if powers:
            looks[row, at + POWER_MW] = np.exp(level / DB)


@kernel
def compare(links: Links, row: int, k: int) -> float:
    """Write the ratio of a signal to noise and interference at a look, and return it, in dB.

    The difference of two levels is the threshold for it if rounding may be what makes it another.
    """
    looks, at = links.looks, LOOKED + LOOKED_COLUMNS * k
    level = looks[row, at + LEVEL_DBM]
    if links.used == 1:
        ratio = level - links.table[k, NOISE_DBM]
    elif are_a_pair(links):
        ratio = level - looks[row, LOOKED + LOOKED_COLUMNS * (1 - k) + LEVEL_DBM]
        threshold = links.thresholds_db[links.words[k, LOWEST]]
        if abs(ratio - threshold) <= EQUAL_DB:
            ratio = threshold
    else:
        others = links.table[k, NOISE_MW]
        for i in range(links.used):
            if i != k:
                others += looks[row, LOOKED + LOOKED_COLUMNS * i + POWER_MW]
        ratio = level - DB * np.log(others)
    looks[row, at + RATIO_DB] = ratio
    return float(ratio)


@kernel
def ratio_db(links: Links, k: int, t: float) -> float:
    """Return the ratio of a signal to noise and interference, after ``t`` seconds, in dB."""
    level = level_dbm(links, k, t)
    if links.used == 1:
        return float(level - links.table[k, NOISE_DBM])
    if are_a_pair(links):
        return float(level - level_dbm(links, 1 - k, t))
    others = links.table[k, NOISE_MW]
    for i in range(links.used):
        if i != k:
            others += np.exp(level_dbm(links, i, t) / DB)
    return float(level - DB * np.log(others))


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


@kernel
def class_at(links: Links, k: int, value: float) -> int:
    """Return the class of a signal at a ratio."""
    words = links.words
    return class_of(value, links.thresholds_db[words[k, LOWEST] : words[k, TOP]])


@rule
def are_clear(links: Links) -> bool:
    """Return whether rounding cannot change the classes of the look in row 0, which are noted."""
    words, looks = links.words, links.looks
    for k in range(links.used):
        if words[k, SOUGHT]:
            value = looks[0, LOOKED + LOOKED_COLUMNS * k + RATIO_DB]
            state = words[k, STATE]
            if state != class_at(links, k, value - ROUNDED_DB):
                return False
            if state != class_at(links, k, value + ROUNDED_DB):
                return False
    return True


@rule
def begin_user(links: Links, k: int, held: int) -> None:
    """Begin with the next user, whose class has been ``held`` before the span."""
    words = links.words
    words[k, BEGAN], words[k, HELD], words[k, STATE] = words[k, ROWS], held, -1
    words[k, SOUGHT] = int(words[k, OUT] != 0)


@kernel
def note(links: Links, k: int, t_us: int, state: int) -> None:
    """Write that a user's class is another one from a time on.

    With three columns, a row is (time, user, change): the new class if the link rises to it, or
    minus the new class if it falls to it. The user is written later (``sign``). With two columns, a
    row is (time, class).

    Changes in one microsecond are one, or none if they cancel. Rows for which there is no room are
    counted only, some of them more than once and others, of changes back, not at all.
    """
    words = links.words
    room, wide, rows, began = words[k, ROOM], words[k, WIDTH], words[k, ROWS], words[k, BEGAN]
    out = ints_at(words[k, OUT], room * wide)
    before, last = words[k, HELD], rows * wide - 1
    if began < rows <= room:
        before = abs(out[last])
        if out[last + 1 - wide] == t_us:
            rows -= 1
            last -= wide
            before = abs(out[last]) if rows > began else words[k, HELD]
    if state != before:
        if rows < room:
            out[last + 1] = t_us
            out[last + wide] = state if wide == 2 or state > before else -state
        rows += 1
    words[k, ROWS] = rows


@rule
def sign(links: Links, k: int, user: int) -> None:
    """Write the user into all rows that have been noted for it."""
    words = links.words
    room, wide = words[k, ROOM], words[k, WIDTH]
    out = ints_at(words[k, OUT], room * wide)
    for row in range(words[k, BEGAN], min(words[k, ROWS], room)):
        out[row * wide + 1] = user
