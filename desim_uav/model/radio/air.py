"""Changes of links in a span of time: classes with interference, and which of two is stronger.

The kernels here are for all path losses, lines of sight and motions: drones climb, fly at an angle
and accelerate, and users walk. They need more time than rings (``model.radio.nested``), which hold
where a drone keeps its altitude and nothing interferes.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from desim_uav.model.geometry.coverage import T0_US, leg_at, walked
from desim_uav.model.geometry.coverage import VX as WALK_X
from desim_uav.model.geometry.coverage import VY as WALK_Y
from desim_uav.model.geometry.polynomial import Coefficients, sign_changes, square_of, value_at
from desim_uav.model.geometry.relative import rounded_us
from desim_uav.model.radio.bounds import bound_rates
from desim_uav.model.radio.levels import H_LEAST, H_MOST, R_LEAST, R_MOST
from desim_uav.model.radio.links import (
    AFTER,
    AX,
    AY,
    AZ,
    BASE_DBM,
    BOUND,
    BRANCH,
    FIRST,
    HELD,
    HIGH_DBM,
    HIGH_MW,
    LAST_MARK,
    LEVEL_DBM,
    LOOKED,
    LOOKED_COLUMNS,
    LOW_DBM,
    LOW_MW,
    LOWEST,
    MARK,
    NOISE_DBM,
    NOISE_MW,
    OTHER,
    OUT,
    POWER_MW,
    PX,
    PY,
    PZ,
    ROWS,
    SENDER,
    SIGNAL,
    SOUGHT,
    STATE,
    STEEP_H,
    STEEP_R,
    TOP,
    VX,
    VY,
    VZ,
    Links,
    are_a_pair,
    are_clear,
    begin_user,
    class_at,
    compare,
    level_dbm,
    look,
    note,
    ratio_db,
    sign,
)
from desim_uav.model.radio.passing import SOON_S
from desim_uav.model.radio.scene import (
    BAND,
    RADIO,
    SERVES,
    Air,
    begin_links,
    relate,
    take_first_rows,
    take_mark,
    take_rows,
    walk_ahead,
    write_to,
)
from desim_uav.model.radio.search import search
from desim_uav.model.radio.slopes import DB
from desim_uav.model.radio.tracks import AT, BEGIN, SPEED_AT, place
from desim_uav.rowcode.kernels import kernel, rule

GRAZE = 1e-14
"""How close to zero a difference of squared distances, relative to them, is taken to be zero; an
extremum that is so close touches zero without a change of sign."""

FOUND_AT, FOUND_ROOM, FOUND = range(3)
FOUND_COLUMNS = 3
"""The columns of a table of what is found, and their number: the address of a table of rows (time,
user, change), the number of its rows, and how many of them are written."""


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
    If ``out`` is too short, the number is larger than its length. That many rows may still be too
    few, because not all changes are counted for which there is no room: a caller asks again until
    all fit. If ``air.tracks`` is too short, minus the number of its rows is returned.

    Wherever a class is not the true one, the ratio is within ``TOLERANCE_DB`` of a threshold.
    """
    air.words[SIGNAL, SENDER], count = transmitter, OTHER
    for other in range(len(air.senders)):
        if other != transmitter and _interferes(air, other, air.senders[transmitter, BAND]):
            air.words[count, SENDER] = other
            count += 1
    end = begin_links(air, count, span_us)
    if end > len(air.tracks):
        return -end
    write_to(air, SIGNAL, out.ctypes.data, len(out), 3)
    links = Links(air.table, air.words, air.looks, count, air.thresholds_db, span_us[0])
    for user in range(len(air.heights_m)):
        begin_user(links, SIGNAL, 0 if fresh else held[user])
        _find_classes(air, links, span_us, user)
    return int(air.words[SIGNAL, ROWS])


@kernel
def class_changes_of_all(
    air: Air,
    span_us: tuple[int, int],
    held: NDArray[np.int64],
    found: NDArray[np.int64],
) -> int:
    """Write the changes of classes of links to all transmitters that serve, as above.

    ``held`` (transmitters, users) are the classes before the span. ``found`` (transmitters,
    FOUND_COLUMNS) says where to write the changes, and the numbers of them are written to it. Those
    of transmitters without a table (address 0) are not sought. If ``air.tracks`` is too short,
    minus the number of its rows is returned, and else 0.

    Transmitters of one band share the levels and the bounds that are computed for a user.
    """
    for one in range(len(air.senders)):
        band, count = air.senders[one, BAND], SIGNAL
        for other in range(len(air.senders)):
            if _interferes(air, other, band):
                air.words[count, SENDER] = other
                count += 1
        if count == 0 or air.words[SIGNAL, SENDER] != one:
            continue
        end = begin_links(air, count, span_us)
        if end > len(air.tracks):
            return -end
        links = Links(air.table, air.words, air.looks, count, air.thresholds_db, span_us[0])
        for k in range(count):
            own = found[air.words[k, SENDER]]
            write_to(air, k, own[FOUND_AT], own[FOUND_ROOM], 3)
        for user in range(len(air.heights_m)):
            for k in range(count):
                begin_user(links, k, held[air.words[k, SENDER], user])
            _find_classes(air, links, span_us, user)
        for k in range(count):
            found[air.words[k, SENDER], FOUND] = air.words[k, ROWS]
    return 0


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
    a row at its start says if it is another one there. It is not if the state is ``held`` a
    microsecond later, because times are rounded. Rows (time, state) go into ``out``; for the rest
    see ``class_changes_in_air``.

    If levels are equal where distances are, the times are roots of polynomials, and exact. Else,
    levels that rounding may have made different are equal (``EQUAL_DB``): where two drones part
    from one place, the state changes there if it does at all.
    """
    air.words[SIGNAL, SENDER], air.words[OTHER, SENDER] = one, other
    end = begin_links(air, OTHER + 1, span_us)
    if end > len(air.tracks):
        return -end
    air.table[SIGNAL, NOISE_DBM], air.bound_db[0] = -np.inf, threshold_db
    air.words[SIGNAL, LOWEST], air.words[SIGNAL, TOP] = 0, 1
    write_to(air, SIGNAL, out.ctypes.data, len(out), 2)
    links = Links(air.table, air.words, air.looks, OTHER + 1, air.bound_db, span_us[0])
    begin_user(links, SIGNAL, held)
    air.words[OTHER, SOUGHT] = 0
    if threshold_db == 0.0 and _are_alike(air, links, user):
        _follow(air, links, span_us, user, True)
    else:
        state = _stays_apart(air, links, span_us, user, threshold_db)
        if state >= 0:
            note(links, SIGNAL, span_us[0], state)
        else:
            _follow(air, links, span_us, user, False)
    return int(air.words[SIGNAL, ROWS])


@rule
def _interferes(air: Air, sender: int, band: int) -> bool:
    """Return whether a transmitter interferes with others in a band."""
    return bool(air.senders[sender, SERVES] and air.senders[sender, BAND] == band)


@kernel
def _find_classes(air: Air, links: Links, span_us: tuple[int, int], user: int) -> None:
    """Write all changes of a user's classes in a span."""
    words, sought = links.words, 0
    _bound_span(air, links, span_us, user)
    for k in range(links.used):
        if words[k, OUT] != 0:
            state = _stays_in(links, k)
            if state >= 0:
                note(links, k, span_us[0], state)
                words[k, SOUGHT] = 0
            sought += words[k, SOUGHT]
        else:
            words[k, SOUGHT] = 0
    if sought > 0:
        _follow(air, links, span_us, user, False)
    for k in range(links.used):
        if words[k, OUT] != 0:
            sign(links, k, user)


@kernel
def _follow(air: Air, links: Links, span_us: tuple[int, int], user: int, exact: bool) -> None:
    """Write the changes of a user's classes in a span, of those signals that are sought.

    If ``exact``, the ratio is that of two levels, and passes 0 dB where distances are equal.
    """
    legs = air.legs
    start_us, end_us = span_us
    end = (end_us - start_us) * 1e-6
    after = air.legs_at[user + 1]
    leg = leg_at(legs, air.legs_at[user], after, start_us)
    t, now_us, begun = 0.0, float(start_us), False
    take_first_rows(air, links, user)
    while True:
        begins, marked = take_rows(air, links, t)
        if begun and t >= end and not marked and not exact and are_clear(links):
            return
        turn = np.inf if leg + 1 == after else (legs[leg + 1, T0_US] - start_us) * 1e-6
        x, y = walked(legs, leg, now_us)
        relate(air, links, t, (x, y, air.heights_m[user]), (legs[leg, WALK_X], legs[leg, WALK_Y]))
        if marked or not begun or t >= end:
            _note_classes(links, t, exact, are_a_pair(links) and end > SOON_S)
            begun = True
        if t >= end:
            return
        until = min(end, begins, turn)
        if until > t:
            if exact:
                _pass(links, (t, until - t))
            else:
                search(links, t, until - t)
        t, now_us = until, float(end_us) if until == end else start_us + until * 1e6
        if turn <= t:
            leg += 1
            if until != end:
                now_us = legs[leg, T0_US]


@kernel
def _note_classes(links: Links, t: float, exact: bool, soon: bool) -> None:
    """Look at the start of a stretch, and write the classes that have changed.

    If ``soon``, those at the start of the span count as changed if they are so soon after it, too.
    """
    words = links.words
    if not exact and t > 0.0:  # that at the start of the span is known (_reach_dbm)
        look(links, 0, 0.0)
    for k in range(links.used):
        if words[k, SOUGHT]:
            value = _closer(links, 0.0) if exact else compare(links, 0, k)
            state = class_at(links, k, value)
            if t == 0.0 and soon and state != words[k, HELD] and words[k, OUT] != 0:
                value = _closer(links, SOON_S) if exact else ratio_db(links, k, SOON_S)
                if class_at(links, k, value) == words[k, HELD]:
                    state = words[k, HELD]
            if state != words[k, STATE]:
                note(links, k, rounded_us(links.start_us, t), state)
            words[k, STATE] = state


# ---- bounds for a whole span


@rule
def _bound_span(air: Air, links: Links, span_us: tuple[int, int], user: int) -> None:
    """Write bounds of all levels in a span."""
    table, walks = links.table, _look_from(air, links, span_us, user)
    for k in range(links.used):
        table[k, LOW_DBM], table[k, HIGH_DBM] = _reach_dbm(air, links, k, walks)
        if links.used > 1:
            at = LOOKED + LOOKED_COLUMNS * k
            links.looks[0, at + POWER_MW] = np.exp(links.looks[0, at + LEVEL_DBM] / DB)
            table[k, LOW_MW] = np.exp(table[k, LOW_DBM] / DB)
            table[k, HIGH_MW] = np.exp(table[k, HIGH_DBM] / DB)


@rule
def _stays_in(links: Links, k: int) -> int:
    """Return the class of a signal if bounds show that it is always the same, or else -1."""
    table = links.table
    least = most = table[k, NOISE_MW]
    for i in range(links.used):
        if i != k:
            least += table[i, LOW_MW]
            most += table[i, HIGH_MW]
    state = class_at(links, k, table[k, HIGH_DBM] - DB * np.log(least))
    low = class_at(links, k, table[k, LOW_DBM] - DB * np.log(most))
    return state if low == state else -1


@kernel
def _stays_apart(
    air: Air, links: Links, span_us: tuple[int, int], user: int, threshold: float
) -> int:
    """Return the state of a pair if bounds show that it is always the same, or else -1."""
    walks = _look_from(air, links, span_us, user)
    low, high = _reach_dbm(air, links, SIGNAL, walks)
    lower, higher = _reach_dbm(air, links, OTHER, walks)
    if low - higher > threshold:
        return 1
    return 0 if high - lower < threshold else -1


@rule
def _look_from(air: Air, links: Links, span_us: tuple[int, int], user: int) -> float:
    """Relate links to a user at the start of a span; return how far the user walks, in metres."""
    take_first_rows(air, links, user)
    walks, leg = walk_ahead(air, user, span_us)
    x, y = walked(air.legs, leg, float(span_us[0]))
    walk = (air.legs[leg, WALK_X], air.legs[leg, WALK_Y])
    relate(air, links, 0.0, (x, y, air.heights_m[user]), walk)
    return walks


@kernel
def _reach_dbm(air: Air, links: Links, k: int, walks: float) -> tuple[float, float]:
    """Return bounds of a link's level in a span, after ``_look_from``."""
    table, words, low, high = links.table, links.words, np.inf, -np.inf
    begun, at_start = False, LOOKED + LOOKED_COLUMNS * k
    table[k, STEEP_R] = table[k, STEEP_H] = 0.0
    first, last = place(air.tracks, words[k, FIRST], 0.0), words[k, AFTER] - 1
    at = place(air.tracks, last, air.tracks[last, BEGIN])
    level = walks + np.sqrt((at[0] - first[0]) ** 2 + (at[1] - first[1]) ** 2)
    climbs = abs(at[2] - first[2])
    apart = np.sqrt(table[k, PX] * table[k, PX] + table[k, PY] * table[k, PY])
    while True:
        now, most = level_dbm(links, k, 0.0), 0.0
        if not begun:
            links.looks[0, at_start + LEVEL_DBM] = now
            begun = True
        if level + climbs > 0.0:
            bound_rates(links, k, apart, table[k, PZ], level + climbs)
        if level > 0.0:
            steep = max(table[k, BOUND + R_MOST], -table[k, BOUND + R_LEAST])
            most += steep * level
            table[k, STEEP_R] = max(table[k, STEEP_R], steep)
        if climbs > 0.0:
            steep = max(table[k, BOUND + H_MOST], -table[k, BOUND + H_LEAST])
            most += steep * climbs
            table[k, STEEP_H] = max(table[k, STEEP_H], steep)
        low, high = min(low, now - most), max(high, now + most)
        words[k, MARK] += 1
        if words[k, MARK] > words[k, LAST_MARK]:
            return low, high
        take_mark(air, links, k)


# ---- pairs whose levels are equal where their distances are


@rule
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


@rule
def _closer(links: Links, t: float) -> float:
    """Return by how much the first of two transmitters is closer, in square metres.

    It is 0 if rounding may be what makes it another number.
    """
    near, far = value_at(_square(links.table, SIGNAL), t), value_at(_square(links.table, OTHER), t)
    return far - near if abs(far - near) > GRAZE * (near + far) else 0.0


@rule
def _square(table: NDArray[np.float64], k: int) -> Coefficients:
    """Return the squared distance as a polynomial of the time since the start of the stretch."""
    at = (table[k, PX], table[k, PY], table[k, PZ])
    speed = (table[k, VX], table[k, VY], table[k, VZ])
    return square_of(at, speed, (table[k, AX], table[k, AY], table[k, AZ]))


@kernel
def _pass(links: Links, stretch: tuple[float, float]) -> None:
    """Write when the first of two transmitters becomes or ceases to be the closer one."""
    begin, lasts = stretch
    near, far = _square(links.table, SIGNAL), _square(links.table, OTHER)
    c = (
        near[0] - far[0],
        near[1] - far[1],
        near[2] - far[2],
        near[3] - far[3],
        near[4] - far[4],
    )
    state = links.words[SIGNAL, STATE]
    count, roots = sign_changes(c, state == 0, lasts, GRAZE * (near[0] + far[0]))
    for i in range(count):
        state = 1 - state
        note(links, SIGNAL, rounded_us(links.start_us, begin + roots[i]), state)
    links.words[SIGNAL, STATE] = state
