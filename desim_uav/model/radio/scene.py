"""Transmitters and users in a span of time, and the links between them.

The kernels here make the tables of links (``model.radio.links``) of one user after another, which
hold as long as all those who take part keep their accelerations, and no line of sight changes.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from desim_uav.model.geometry.coverage import T0_US, leg_at
from desim_uav.model.geometry.coverage import VX as WALK_X
from desim_uav.model.geometry.coverage import VY as WALK_Y
from desim_uav.model.radio.links import (
    AFTER,
    AX,
    AY,
    AZ,
    BASE_DBM,
    BRANCH,
    CARRIER,
    FIRST,
    LAST_MARK,
    LEVEL,
    LINK_COLUMNS,
    LINK_WORDS,
    LOOKS,
    LOWEST,
    MARK,
    MARKED,
    NOISE_DBM,
    NOISE_MW,
    OUT,
    PX,
    PY,
    PZ,
    RATES_AT,
    ROOM,
    ROW,
    ROWS,
    SENDER,
    TOP,
    VALUES,
    VX,
    VY,
    VZ,
    WIDTH,
    Links,
    look_columns,
)
from desim_uav.model.radio.path_loss import MEAN
from desim_uav.model.radio.slopes import DB
from desim_uav.model.radio.tracks import (
    BEGIN,
    PULL_AT,
    TRACK_COLUMNS,
    Flight,
    fly,
    place,
    velocity,
)
from desim_uav.rowcode.kernels import kernel, rule

X0, Y0, Z0, X1, Y1, Z1, POWER_DBM = range(7)
PLACE_COLUMNS = 7
"""The columns of ``Air.places``, and their number: x, y and z of the start and of the destination
of a transmitter's flight in metres, and its power in dBm."""

BEGUN_US, TRANSIT, SERVES, BAND, RADIO, MARKED_US = range(6)
SENDER_COLUMNS = 6
"""The columns of ``Air.senders``, and their number: the time at which the flight began, the number
of its transit, whether the transmitter serves users (1) or not (0), the numbers of its band and of
its radio, and the time since which its marks count."""

CARRIER_GHZ, BAND_NOISE_DBM = range(2)
RADIO_COLUMNS = 2
"""The columns of ``Air.radios``, and their number: the carrier, and the noise in the band."""

LEVEL_AT, BOUNDS_AT, VALUES_AT = range(3)
LOSS_COLUMNS = 3
"""The columns of ``Air.losses``, and their number: the addresses of the path loss of a radio
(``levels.Loss``)."""

TIME_S, MARK_BRANCH, EXTRA_DB = range(3)
"""The columns of ``Air.marks``."""


NO_ROWS: Any = np.int64(0)
"""A number of rows; for a literal one, Numba would compile functions anew."""


class Air(NamedTuple):
    """All transmitters (drones and access points) and users, as they are from a time on.

    ``places`` (transmitters, PLACE_COLUMNS) and ``senders`` (transmitters, SENDER_COLUMNS) say
    where transmitters fly and how they transmit. ``pieces`` (rows, 4) are the profiles of all
    transits (see ``model.motion.motion``), of which transit k has ``pieces_at[k]:pieces_at[k +
    1]``.

    ``losses`` (radios, 3) and ``radios`` (radios, 2) describe radios, and radio r has the rising
    thresholds ``thresholds_db[thresholds_at[r]:thresholds_at[r + 1]]`` of its classes.

    ``legs`` and ``legs_at`` are the walks of users (``coverage.Users``), and ``heights_m`` (users,)
    their heights. ``marks`` has rows (seconds since MARKED_US, branch, dB): the branch of the path
    loss that holds from then on, and an additional loss. Those of transmitter i and user u are the
    rows from ``marks_at[k]`` to ``marks_at[k + 1]``, where k is ``i * (users + 1) + u``. A link
    without rows has the mean loss, and so do all if ``marks_at`` is empty.

    ``tracks`` (rows, TRACK_COLUMNS), ``table`` (transmitters, LINK_COLUMNS), ``words``
    (transmitters, LINK_WORDS), ``looks`` (LOOKS, look_columns(transmitters)) and ``bound_db`` (1,)
    are memory in which kernels work (``memory``).
    """

    places: NDArray[np.float64]
    senders: NDArray[np.int64]
    pieces: NDArray[np.float64]
    pieces_at: NDArray[np.int64]
    losses: NDArray[np.int64]
    radios: NDArray[np.float64]
    thresholds_db: NDArray[np.float64]
    thresholds_at: NDArray[np.int64]
    legs: NDArray[np.float64]
    legs_at: NDArray[np.int64]
    heights_m: NDArray[np.float64]
    marks: NDArray[np.float64]
    marks_at: NDArray[np.int64]
    tracks: NDArray[np.float64]
    table: NDArray[np.float64]
    words: NDArray[np.int64]
    looks: NDArray[np.float64]
    bound_db: NDArray[np.float64]


def track_rows(transmitters: int, longest: int) -> int:
    """Return the rows of ``Air.tracks`` if no transit's profile has more rows than ``longest``."""
    return transmitters * (longest + 1)


def memory(transmitters: int, longest: int) -> dict[str, NDArray[Any]]:
    """Return the fields of an Air in which kernels work, by name (see ``track_rows``)."""
    return {
        "tracks": np.zeros((track_rows(transmitters, longest), TRACK_COLUMNS)),
        "table": np.zeros((transmitters, LINK_COLUMNS)),
        "words": np.zeros((transmitters, LINK_WORDS), np.int64),
        "looks": np.zeros((LOOKS, look_columns(transmitters))),
        "bound_db": np.zeros(1),
    }


@kernel
def begin_links(air: Air, used: int, span_us: tuple[int, int]) -> int:
    """Begin the links whose transmitters are known, and return the number of rows of their tracks.

    It may exceed the length of ``air.tracks``; rows for which there is no room are counted only.
    """
    words, table, end = air.words, air.table, NO_ROWS
    for k in range(used):
        sender = words[k, SENDER]
        at, radio = air.places[sender], air.senders[sender, RADIO]
        transit = air.senders[sender, TRANSIT]
        flight = Flight(
            air.pieces[air.pieces_at[transit] : air.pieces_at[transit + 1]],
            (at[X0], at[Y0], at[Z0], at[X1], at[Y1], at[Z1]),
            air.senders[sender, BEGUN_US],
        )
        words[k, FIRST] = end
        end = fly(flight, span_us, air.tracks, end)
        words[k, AFTER] = end
        words[k, LEVEL], words[k, VALUES] = (
            air.losses[radio, LEVEL_AT],
            air.losses[radio, VALUES_AT],
        )
        words[k, RATES_AT] = air.losses[radio, BOUNDS_AT]
        words[k, MARKED] = air.senders[sender, MARKED_US] - span_us[0]
        words[k, LOWEST], words[k, TOP] = air.thresholds_at[radio], air.thresholds_at[radio + 1]
        words[k, OUT] = 0
        table[k, CARRIER] = air.radios[radio, CARRIER_GHZ]
        table[k, NOISE_DBM] = air.radios[radio, BAND_NOISE_DBM]
        table[k, NOISE_MW] = np.exp(table[k, NOISE_DBM] / DB)
    return int(end)


@rule
def write_to(air: Air, k: int, address: int, room: int, width: int) -> None:
    """Have the changes of a signal written to a table."""
    words = air.words
    words[k, OUT], words[k, ROOM], words[k, WIDTH] = address, room, width
    words[k, ROWS] = 0


@kernel
def take_first_rows(air: Air, links: Links, user: int) -> None:
    """Begin with the first row of each track, and with the mark of each link to a user then."""
    words, users = links.words, len(air.heights_m)
    for k in range(links.used):
        words[k, ROW], words[k, BRANCH] = words[k, FIRST], MEAN
        words[k, MARK] = words[k, LAST_MARK] = -1
        if len(air.marks_at) > 0:
            link = words[k, SENDER] * (users + 1) + user
            words[k, MARK], words[k, LAST_MARK] = air.marks_at[link], air.marks_at[link + 1] - 1
            words[k, MARK] = mark_at(air, links, k, 0.0)
        take_mark(air, links, k)


@rule
def take_mark(air: Air, links: Links, k: int) -> None:
    """Take the branch and the level before the path loss from a link's present mark."""
    table, words = links.table, links.words
    mark = words[k, MARK]
    table[k, BASE_DBM] = air.places[words[k, SENDER], POWER_DBM]
    if mark <= words[k, LAST_MARK] and mark >= 0:
        words[k, BRANCH] = int(air.marks[mark, MARK_BRANCH])
        table[k, BASE_DBM] -= air.marks[mark, EXTRA_DB]


@rule
def mark_at(air: Air, links: Links, k: int, t: float) -> int:
    """Return the mark of a link at a time, which is its present one or a later one."""
    words, mark = links.words, links.words[k, MARK]
    while mark < words[k, LAST_MARK] and begins_at(air, links, k, mark + 1) <= t:
        mark += 1
    return int(mark)


@rule
def begins_at(air: Air, links: Links, k: int, mark: int) -> float:
    """Return when a mark of a link begins, in seconds since the start of the span."""
    return float((links.words[k, MARKED] + np.rint(air.marks[mark, TIME_S] * 1e6)) * 1e-6)


@kernel
def take_rows(air: Air, links: Links, t: float) -> tuple[float, bool]:
    """Take the rows of tracks and the marks that hold at a time.

    Returns when the next one begins, inf if there is none, and whether a mark is another one now.
    """
    words, until, marked = links.words, np.inf, False
    for k in range(links.used):
        row, mark = words[k, ROW], mark_at(air, links, k, t)
        while row + 1 < words[k, AFTER] and air.tracks[row + 1, BEGIN] <= t:
            row += 1
        if row + 1 < words[k, AFTER]:
            until = min(until, air.tracks[row + 1, BEGIN])
        if mark < words[k, LAST_MARK]:
            until = min(until, begins_at(air, links, k, mark + 1))
        words[k, ROW] = row
        if mark != words[k, MARK]:
            words[k, MARK] = mark
            take_mark(air, links, k)
            marked = True
    return until, marked


@kernel
def relate(
    air: Air,
    links: Links,
    t: float,
    user: tuple[float, float, float],
    walk: tuple[float, float],
) -> None:
    """Write the motions of transmitters relative to a user at a place, from a time on."""
    table, tracks = links.table, air.tracks
    for k in range(links.used):
        row = links.words[k, ROW]
        x, y, z = place(tracks, row, t)
        vx, vy, vz = velocity(tracks, row, t)
        table[k, PX], table[k, PY], table[k, PZ] = x - user[0], y - user[1], z - user[2]
        table[k, VX], table[k, VY], table[k, VZ] = vx - walk[0], vy - walk[1], vz
        table[k, AX], table[k, AY] = tracks[row, PULL_AT], tracks[row, PULL_AT + 1]
        table[k, AZ] = tracks[row, PULL_AT + 2]


@rule
def walk_ahead(air: Air, user: int, span_us: tuple[int, int]) -> tuple[float, int]:
    """Return how far a user walks in a span, in metres, and its leg at the start."""
    legs, after, far, from_us = air.legs, air.legs_at[user + 1], 0.0, float(span_us[0])
    first = leg_at(legs, air.legs_at[user], after, span_us[0])
    leg = first
    while True:
        ends = leg + 1 == after or legs[leg + 1, T0_US] >= span_us[1]
        until_us = float(span_us[1]) if ends else legs[leg + 1, T0_US]
        vx, vy = legs[leg, WALK_X], legs[leg, WALK_Y]
        far += np.sqrt(vx * vx + vy * vy) * (until_us - from_us) * 1e-6
        if ends:
            return far, first
        from_us = until_us
        leg += 1
