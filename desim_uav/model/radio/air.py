"""Changes of links in a span of time: classes with interference, and which of two is stronger.

The kernels here are for all path losses, lines of sight and motions: drones climb, fly at an angle
and accelerate, and users walk. They need more time than rings (``model.radio.nested``), which hold
where a drone keeps its altitude and nothing interferes.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from desim_uav.model.coverage import T0_US, leg_at, walked
from desim_uav.model.coverage import VX as WALK_X
from desim_uav.model.coverage import VY as WALK_Y
from desim_uav.model.kernels import kernel, part
from desim_uav.model.radio.compare import GRAZE
from desim_uav.model.radio.levels import H_LEAST, H_MOST, R_LEAST
from desim_uav.model.radio.polynomial import Coefficients, sign_changes
from desim_uav.model.radio.scene import (
    BAND,
    NOISE_DBM,
    RADIO,
    SERVES,
    Air,
    begin_link,
    relate,
    take_first_rows,
    take_mark,
    take_rows,
    walk_ahead,
)
from desim_uav.model.radio.search import (
    AFTER,
    AX,
    AY,
    AZ,
    BASE_DBM,
    BOUND,
    BRANCH,
    FIRST,
    LAST_MARK,
    MARK,
    PX,
    PY,
    PZ,
    SENDER,
    VX,
    VY,
    VZ,
    Links,
    Record,
    bound_rates,
    note,
    ratio_db,
    search,
)
from desim_uav.model.radio.sinr import class_of
from desim_uav.model.radio.tracks import AT, BEGIN, SPEED_AT, place, rounded_us


@kernel
def class_changes_in_air(
    air: Air,
    transmitter: int,
    span_us: tuple[int, int],
    held: NDArray[np.int64],
    fresh: bool,
    out: NDArray[np.int64],
) -> int:
    """Write all changes of the classes of links to a transmitter, and return their number.

    The class of a user is how many of the radio's thresholds the ratio of the signal to noise and
    interference has reached. All other transmitters of the same band that serve interfere, from the
    start of the span to its end. ``held`` (users,) are the classes before the span; if ``fresh``,
    they are all 0.

    Rows (time, user, change) go into ``out``, user by user in order of time. The change is the new
    class if the link rises to it, and minus the new class if it falls to it. Classes at both ends
    of the span depend on the places there only, and changes in one microsecond are one, or cancel.
    If ``out`` is too short, the number is larger than its length, and with that many rows it is
    long enough. If ``air.tracks`` is too short, minus the number of its rows is returned.

    Wherever a class is not the true one, the ratio is within ``sinr.TOLERANCE_DB`` of a threshold.
    """
    band, radio = air.senders[transmitter, BAND], air.senders[transmitter, RADIO]
    end = begin_link(air, transmitter, 0, 0, span_us)
    count = 1
    for other in range(len(air.senders)):
        if other != transmitter and air.senders[other, SERVES] and air.senders[other, BAND] == band:
            end = begin_link(air, other, count, end, span_us)
            count += 1
    if end > len(air.tracks):
        return -end
    links = Links(air.table, air.words, count, air.radios[radio, NOISE_DBM])
    thresholds = air.thresholds_db[air.thresholds_at[radio] : air.thresholds_at[radio + 1]]
    rows = 0
    for user in range(len(air.heights_m)):
        before = 0 if fresh else held[user]
        record = Record(out, rows, user, before, span_us[0])
        if before != 0 or not _stays_below(air, links, span_us, user, thresholds[0]):
            rows = _follow(air, links, span_us, thresholds, False, record)
    return rows


@kernel
def pair_changes(
    air: Air,
    user: int,
    one: int,
    other: int,
    threshold_db: float,
    span_us: tuple[int, int],
    held: int,
    out: NDArray[np.int64],
) -> int:
    """Write when a user receives one transmitter stronger than another one by a threshold.

    The state is 1 where the level of ``one`` exceeds that of ``other`` by ``threshold_db`` or more,
    and else 0; noise and interference do not matter. ``held`` is the state before the span, or -1:
    a row at its start says if it is another one there. Rows (time, state) go into ``out``; for the
    rest see ``class_changes_in_air``.

    If levels are equal where distances are, the times are roots of polynomials, and exact.
    """
    end = begin_link(air, other, 1, begin_link(air, one, 0, 0, span_us), span_us)
    if end > len(air.tracks):
        return -end
    links = Links(air.table, air.words, 2, -np.inf)
    exact = threshold_db == 0.0 and _are_alike(air, links, user)
    air.bound_db[0] = threshold_db
    return _follow(air, links, span_us, air.bound_db, exact, Record(out, 0, user, held, span_us[0]))


@kernel
def _follow(
    air: Air,
    links: Links,
    span_us: tuple[int, int],
    thresholds: NDArray[np.float64],
    exact: bool,
    record: Record,
) -> int:
    """Write the changes of a user's class in a span, and return the number of rows.

    If ``exact``, the ratio is that of two levels, and passes 0 dB where distances are equal.
    """
    user, legs = record.user, air.legs
    start_us, end_us = span_us
    end = (end_us - start_us) * 1e-6
    after = air.legs_at[user + 1]
    leg = leg_at(legs, air.legs_at[user], after, start_us)
    t, now_us, rows, state = 0.0, float(start_us), record.first, -1
    take_first_rows(air, links, user)
    while True:
        until = min(end, take_rows(air, links, t))
        turn = np.inf if leg + 1 == after else (legs[leg + 1, T0_US] - start_us) * 1e-6
        x, y = walked(legs, leg, now_us)
        relate(air, links, t, (x, y, air.heights_m[user]), (legs[leg, WALK_X], legs[leg, WALK_Y]))
        value = _closer(links) if exact else ratio_db(links, 0.0)
        reached = class_of(value, thresholds)
        if reached != state:
            state = reached
            rows = note(record, rows, rounded_us(start_us, t), state)
        if t >= end:
            return rows
        until = min(until, turn)
        if until > t and exact:
            rows, state = _pass(links, (t, until - t), state, record, rows)
        elif until > t:
            rows, state = search(links, thresholds, (t, until - t), value, record, rows)
        t, now_us = until, float(end_us) if until == end else start_us + until * 1e6
        if turn <= t:
            leg += 1
            if until != end:
                now_us = legs[leg, T0_US]


@kernel
def _stays_below(
    air: Air, links: Links, span_us: tuple[int, int], user: int, threshold: float
) -> bool:
    """Return whether bounds show that the signal never reaches a threshold above the noise."""
    own = Links(links.table, links.words, 1, links.noise_dbm)
    table, words = own.table, own.words
    take_first_rows(air, own, user)
    walks, leg = walk_ahead(air, user, span_us)
    x, y = walked(air.legs, leg, span_us[0])
    relate(air, own, 0.0, (x, y, air.heights_m[user]), (0.0, 0.0))
    first, last = place(air.tracks, words[0, FIRST], 0.0), words[0, AFTER] - 1
    at = place(air.tracks, last, air.tracks[last, BEGIN])
    level = walks + np.sqrt((at[0] - first[0]) ** 2 + (at[1] - first[1]) ** 2)
    climbs = abs(at[2] - first[2])
    apart = np.sqrt(table[0, PX] * table[0, PX] + table[0, PY] * table[0, PY])
    while True:
        most = ratio_db(own, 0.0)
        if level + climbs > 0.0:
            bound_rates(own, 0, apart, table[0, PZ], level + climbs)
        if level > 0.0:
            most -= table[0, BOUND + R_LEAST] * level
        if climbs > 0.0:
            most += max(table[0, BOUND + H_MOST], -table[0, BOUND + H_LEAST]) * climbs
        if not most < threshold:
            return False
        words[0, MARK] += 1
        if words[0, MARK] > words[0, LAST_MARK]:
            return True
        take_mark(air, own, 0)


# ---- pairs whose levels are equal where their distances are


@part
def _are_alike(air: Air, links: Links, user: int) -> bool:
    """Return whether two links have the same power and loss, and both drones keep one height."""
    words, table = links.words, links.table
    take_first_rows(air, links, user)
    one, other = words[0, SENDER], words[1, SENDER]
    alike = air.senders[one, RADIO] == air.senders[other, RADIO]
    alike &= words[0, BRANCH] == words[1, BRANCH] and table[0, BASE_DBM] == table[1, BASE_DBM]
    for k in range(2):
        alike &= words[k, MARK] >= words[k, LAST_MARK]
        for row in range(words[k, FIRST], words[k, AFTER]):
            alike &= air.tracks[row, AT + 2] == air.tracks[words[0, FIRST], AT + 2]
            alike &= air.tracks[row, SPEED_AT + 2] == 0.0
    return bool(alike)


@part
def _closer(links: Links) -> float:
    """Return by how much the first of two transmitters is closer, in square metres."""
    return _square(links.table, 1)[0] - _square(links.table, 0)[0]


@part
def _square(table: NDArray[np.float64], k: int) -> Coefficients:
    """Return the squared distance as a polynomial of the time since the start of the stretch."""
    px, py, pz = table[k, PX], table[k, PY], table[k, PZ]
    vx, vy, vz = table[k, VX], table[k, VY], table[k, VZ]
    ax, ay, az = table[k, AX], table[k, AY], table[k, AZ]
    return (
        px * px + py * py + pz * pz,
        2.0 * (px * vx + py * vy + pz * vz),
        vx * vx + vy * vy + vz * vz + px * ax + py * ay + pz * az,
        vx * ax + vy * ay + vz * az,
        0.25 * (ax * ax + ay * ay + az * az),
    )


@kernel
def _pass(
    links: Links, stretch: tuple[float, float], state: int, record: Record, rows: int
) -> tuple[int, int]:
    """Write when the first of two transmitters becomes or ceases to be the closer one."""
    begin, lasts = stretch
    near, far = _square(links.table, 0), _square(links.table, 1)
    c = (
        near[0] - far[0],
        near[1] - far[1],
        near[2] - far[2],
        near[3] - far[3],
        near[4] - far[4],
    )
    count, roots = sign_changes(c, state == 0, lasts, GRAZE * (near[0] + far[0]))
    for i in range(count):
        state = 1 - state
        rows = note(record, rows, rounded_us(record.start_us, begin + roots[i]), state)
    return rows, state
