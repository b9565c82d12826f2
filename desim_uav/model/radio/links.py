"""The links of a user: their motions, and what is seen of them when one looks.

A stretch is a time in which the user and all drones that it receives keep their accelerations, and
no line of sight changes. A look is what all links are at a time of it. All signals that are sought
for a user share the looks, because each of them is interference to the others.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from desim_uav.model.geometry.relative import Change
from desim_uav.model.radio.levels import RateRow
from desim_uav.model.radio.marks import Mark
from desim_uav.model.radio.slopes import DB
from desim_uav.model.radio.tracks import TrackRow
from desim_uav.rowcode.compiled_rows import call_for_float, entries_at
from desim_uav.rowcode.kernels import kernel, part, rule
from desim_uav.rowcode.rows import Row, Table, row

SIGNAL: Any = np.int64(0)
OTHER: Any = np.int64(1)
"""The numbers of the first two links; for literal ones, Numba would compile functions anew."""

LOOKS = 64
"""The most looks that are kept at a time: each is a half of the time to the next one."""

ROUNDED_DB = 1e-6
"""By how much less two ratios differ, for one place, because of rounding."""

EQUAL_DB = 1e-10
"""Levels that differ by no more than this from a threshold for their difference are taken to differ
by the threshold exactly: rounding alone makes levels of one place differ by about 1e-12 dB."""


@row
class Look(Row):
    """A link when one looks: its level, its power, and its ratio to noise and interference.

    Ratios are known of signals whose class was not settled before the look. The rest is known if
    one looks by curves (``model.radio.curve_looks``): the class (``state``), the distance and how
    fast it grows, by how much the level and the ratio may be wrong, how fast the power changes with
    the distance, and the ratio with time.
    """

    level_dbm: float
    power_mw: float
    ratio_db: float
    state: int
    distance_m: float
    away_mps: float
    error_db: float
    margin_db: float
    mw_per_m: float
    db_per_s: float


@row
class Link(Row):
    """The link of a user with a ``sender``, which has a ``radio`` of a number.

    First, what is called: the addresses of the path loss (``levels.Loss``), its carrier, and the
    branch. Then, the first row of the sender's track, the one after the last and the present one;
    the present mark and the last one, and since when their times count, in microseconds since the
    start of the span. ``base_dbm`` is the level before the path loss, and ``mw`` the power of the
    sender. If there are curves, so many are at the address ``curves``, and ``curve`` is the address
    of that for the present user, or 0. The place, the velocity and the acceleration of the sender
    are those relative to the user at the start of the stretch.

    Then, bounds: the least and the largest horizontal distance in the span, and those in the time
    that is looked at; how far the sender and the user move horizontally in the span, together, and
    how far the sender climbs or descends, in metres; the least and the most that the level changes
    in dB/s; the lowest and the highest level in the span; the lowest and the highest power in the
    span, or in the time that is looked at; the most that the level changes in the stretch, in dB/s;
    the ``rates`` near a place; and the most that the level changes in the span for a metre of
    horizontal distance and for one of height, which are below 0 until they are needed.

    For a signal, its thresholds are those from number ``lowest`` on, before number ``top``, and as
    ratios of powers they are at the address ``ratios``.
    ``sought`` says whether changes of its class are sought for the present user, whose class is
    ``state`` and was ``held`` before the span; the class is settled until ``settled_s`` seconds
    after the start of the stretch. Changes are written (``note``) to so much ``room`` at an address
    ``out``, which is 0 if the link only interferes; so many ``rows`` are written, of which those of
    the users before are ``began``.
    """

    sender: int
    radio: int
    level: int
    rates_of: int
    values: int
    carrier_ghz: float
    branch: int
    first: int
    after: int
    track: int
    mark: int
    last_mark: int
    marked_us: int
    power_dbm: float
    base_dbm: float
    noise_dbm: float
    noise_mw: float
    mw: float
    curves: int
    curve_count: int
    curve: int
    x_m: float
    y_m: float
    z_m: float
    vx_mps: float
    vy_mps: float
    vz_mps: float
    ax_mps2: float
    ay_mps2: float
    az_mps2: float
    near_m: float
    far_m: float
    from_m: float
    to_m: float
    moves_m: float
    climbs_m: float
    least: float
    most: float
    low_dbm: float
    high_dbm: float
    low_mw: float
    high_mw: float
    steep: float
    rates: RateRow
    steep_away: float
    steep_up: float
    lowest: int
    top: int
    ratios: int
    sought: int
    state: int
    held: int
    settled_s: float
    out: int
    room: int
    rows: int
    began: int
    looks: Table[Look]


@row
class Air(Row):
    """The links of a user, all in one band, in a span that begins at ``start_us``.

    So many of ``links`` are ``used``; their noise may be -inf dBm, for the ratio of the levels of
    two. ``looked_s`` are the times of the looks, in seconds since the start of the stretch, and
    ``thresholds_db`` the rising thresholds of all radios, and that of two levels at last.
    ``tracks`` are those of the senders. The marks of sender i and user u are those from
    ``marks_at[k]`` to ``marks_at[k + 1]``, where k is ``i * (users + 1) + u``. A link without marks
    has the mean loss, and so do all if ``marks_at`` is empty.
    """

    scratch = ("tracks",)
    used: int
    start_us: int
    links: Table[Link]
    looked_s: Table[float]
    thresholds_db: Table[float]
    tracks: Table[TrackRow]
    marks: Table[Mark]
    marks_at: Table[int]


changes_at = entries_at(Change)


@rule
def loss_db(link: Link, distance_m: float, height_m: float) -> float:
    """Return the path loss of a link, at a horizontal distance and a height of the sender."""
    place = link.values, link.carrier_ghz, link.branch, distance_m, height_m
    return call_for_float(link.level, place)


@kernel
def level_dbm(link: Link, t: float) -> float:
    """Return the level of a link, ``t`` seconds after the start of the stretch."""
    half = 0.5 * t
    x = link.x_m + t * (link.vx_mps + half * link.ax_mps2)
    y = link.y_m + t * (link.vy_mps + half * link.ay_mps2)
    z = link.z_m + t * (link.vz_mps + half * link.az_mps2)
    return link.base_dbm - loss_db(link, np.sqrt(x * x + y * y), z)


@rule
def are_a_pair(air: Air) -> bool:
    """Return whether the ratio is that of two levels."""
    return air.used == 2 and air.links[0].noise_dbm == -np.inf


@kernel
def look(air: Air, row: int, t: float) -> None:
    """Write a look: the levels and the powers of all links after ``t`` seconds."""
    air.looked_s[row] = t
    powers = air.used > 1 and not are_a_pair(air)
    for k in range(air.used):
        level, entry = level_dbm(air.links[k], t), air.links[k].looks[row]
        entry.level_dbm = level
        if powers:
            entry.power_mw = np.exp(level / DB)


@kernel
def compare(air: Air, row: int, k: int) -> float:
    """Write the ratio of a signal to noise and interference at a look, and return it, in dB.

    The difference of two levels is the threshold for it if rounding may be what makes it another.
    """
    link = air.links[k]
    level = link.looks[row].level_dbm
    if air.used == 1:
        ratio = level - link.noise_dbm
    elif are_a_pair(air):
        ratio = level - air.links[1 - k].looks[row].level_dbm
        threshold = air.thresholds_db[link.lowest]
        if abs(ratio - threshold) <= EQUAL_DB:
            ratio = threshold
    else:
        others = link.noise_mw
        for i in range(air.used):
            if i != k:
                others += air.links[i].looks[row].power_mw
        ratio = level - DB * np.log(others)
    link.looks[row].ratio_db = ratio
    return ratio


@kernel
def ratio_db(air: Air, k: int, t: float) -> float:
    """Return the ratio of a signal to noise and interference, after ``t`` seconds, in dB."""
    link = air.links[k]
    level = level_dbm(link, t)
    if air.used == 1:
        return level - link.noise_dbm
    if are_a_pair(air):
        return level - level_dbm(air.links[1 - k], t)
    others = link.noise_mw
    for i in range(air.used):
        if i != k:
            others += np.exp(level_dbm(air.links[i], t) / DB)
    return float(level - DB * np.log(others))


@part
def class_of(value: float, thresholds: Any, lowest: int, top: int) -> int:
    """Return how many thresholds, which rise from number ``lowest`` to ``top``, are reached."""
    low, high = lowest, top
    while low < high:
        middle = (low + high) // 2
        if value >= thresholds[middle]:
            low = middle + 1
        else:
            high = middle
    return low - lowest


@kernel
def class_at(air: Air, k: int, value: float) -> int:
    """Return the class of a signal at a ratio."""
    return class_of(value, air.thresholds_db, air.links[k].lowest, air.links[k].top)


@rule
def are_clear(air: Air) -> bool:
    """Return whether rounding cannot change the classes of the look in row 0, which are noted."""
    for k in range(air.used):
        link = air.links[k]
        if link.sought:
            value = link.looks[0].ratio_db
            if link.state != class_at(air, k, value - ROUNDED_DB):
                return False
            if link.state != class_at(air, k, value + ROUNDED_DB):
                return False
    return True


@rule
def begin_user(link: Link, before: int) -> None:
    """Begin with the next user, whose class was ``before`` until the span."""
    link.began, link.held, link.state = link.rows, before, -1
    link.sought = int(link.out != 0)


@rule
def begin_again(link: Link) -> None:
    """Forget the changes of a user."""
    link.rows, link.state = link.began, -1


@kernel
def note(link: Link, t_us: int, state: int) -> None:
    """Write that a user's class is another one from a time on.

    The user is written later (``sign``). Changes in one microsecond are one, or none if they
    cancel. Rows for which there is no room are counted only, some of them more than once and
    others, of changes back, not at all.
    """
    out, rows, began, before = changes_at(link.out, link.room), link.rows, link.began, link.held
    if began < rows <= link.room:
        before = abs(out[rows - 1].change)
        if out[rows - 1].t_us == t_us:
            rows -= 1
            before = abs(out[rows - 1].change) if rows > began else link.held
    if state != before:
        if rows < link.room:
            out[rows].t_us, out[rows].change = t_us, state if state > before else -state
        rows += 1
    link.rows = rows


@rule
def sign(link: Link, user: int) -> None:
    """Write the user into all rows that have been noted for it."""
    out = changes_at(link.out, link.room)
    for k in range(link.began, min(link.rows, link.room)):
        out[k].user = user
