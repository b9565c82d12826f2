"""The marks of links: when users see a transmitter, and what shadowing adds to the path loss.

A mark is a stretch of time in which a link has one branch of the path loss (its mean, or the loss
with or without line of sight) and one additional loss. Three kinds of line of sight are known:

- ``mean``: all links have the mean loss.
- ``drawn``: one uniform number for each user, transmitter and cell in which the transmitter is. The
  user sees the transmitter where that number is below the probability of line of sight. This
  probability rises with the elevation, so it is so from some elevation on: within a cone, whose
  tip is the user. The link passes the cone at roots of a polynomial of degree four or less.
- ``buildings``: the buildings of the map block the line, or do not (``model.radio.sight``).

Shadowing adds a normal number for each user, transmitter, cell in which the transmitter is, and
state of the line of sight (``model.radio.chances``). All draws are functions of these numbers
(``model.random.philox``), so they do not depend on the order in which they are made, nor on other
users and transmitters.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from desim_uav.model.geometry.polynomial import Coefficients, sign_changes
from desim_uav.model.radio.buildings import Buffers, Buildings, buffers_for
from desim_uav.model.radio.chances import Draw, Odds, draw
from desim_uav.model.radio.path_loss import LOS, MEAN, NLOS
from desim_uav.model.radio.sight import CLEAR, sight_changes
from desim_uav.model.radio.tracks import (
    Flight,
    Rows,
    TrackRow,
    Turn,
    Walkers,
    fly,
    next_s,
    place,
    pulled,
    row_at,
    velocity,
    walk,
)
from desim_uav.model.radio.visits import Cells, Visit, Visits, visit
from desim_uav.rowcode.kernels import kernel, part
from desim_uav.rowcode.rows import Floats, Ints, Row, Table, row
from desim_uav.rowcode.views import zeros

MEAN_LOSS, DRAWN, BUILDINGS = range(3)
"""The kinds of line of sight."""

KINDS = {"mean": MEAN_LOSS, "drawn": DRAWN, "buildings": BUILDINGS}
"""The kinds of line of sight by their names in a scenario."""

GRAZE = 1e-15
"""Where a link touches its cone to within this share of the squared height, it does not pass it."""


@row
class Mark(Row):
    """The branch of the path loss, and an additional loss, from ``begin_s`` on.

    The time is in seconds since the start of the span for which marks have been made.
    """

    begin_s: float
    branch: int
    extra_db: float


class Marks(NamedTuple):
    """The marks of the links of one transmitter to all users.

    Those of user u are the rows from ``begins[first + u]`` on, up to ``begins[first + u + 1]``.
    There is memory up to row ``end``.
    """

    rows: Table[Mark]
    begins: Ints
    first: int
    end: int


class Memory(NamedTuple):
    """The memory in which ``marks_of`` works (see ``memory_for``).

    ``tracks`` holds the tracks of the transmitter and of one user, ``borders_s`` the times at which
    the transmitter passes borders of cells, ``visits`` its cells, ``turns`` those of a line of
    sight, and ``buffers`` is for the buildings.
    """

    tracks: Table[TrackRow]
    borders_s: Floats
    visits: Table[Visit]
    turns: Table[Turn]
    buffers: Buffers


class Sight(NamedTuple):
    """What decides on the marks of all links to one transmitter.

    ``kind`` is one of MEAN_LOSS, DRAWN and BUILDINGS; with MEAN_LOSS nothing may be drawn.
    ``flight`` is that of the transmitter, which is above all users.
    """

    kind: int
    odds: Odds
    cells: Cells
    users: Walkers
    flight: Flight
    buildings: Buildings
    memory: Memory


def memory_for(
    longest_profile: int,
    most_legs: int,
    cells: tuple[int, int],
    buildings: Buildings,
    stretches: int = 64,
) -> Memory:
    """Return memory for profiles and users' walks of at most so many rows, and a map.

    ``stretches`` is how many stretches of time in which buildings block one line it has room for.
    """
    pieces, borders = longest_profile + 1, sum(cells)
    return Memory(
        zeros(TrackRow, pieces + most_legs + 2),
        np.zeros(borders),
        zeros(Visit, pieces + borders),
        zeros(Turn, 2 * stretches + 3),
        buffers_for(buildings.offsets, stretches),
    )


@kernel
def marks_of(sight: Sight, span_us: tuple[int, int], out: Marks) -> int:
    """Write the marks of the links of one transmitter to all users, and return where they end.

    ``out.begins`` is written except for the first user's entry, which says where to begin.

    The first mark of each user begins at 0.0. Others begin where one of the two numbers changes, at
    whole microseconds; what lasts no microsecond is no mark. Marks at both ends of the span depend
    on the places there only: a mark may begin at the end of the span.

    If the returned number is larger than ``out.end``, rows are missing, and with that many rows it
    is large enough. If it is negative, ``sight.memory`` must be made for that many stretches, and
    for all legs of each walk (``memory_for``).
    """
    memory, begins, users = sight.memory, out.begins, sight.users
    tracks = memory.tracks
    drone = (0, fly(sight.flight, span_us, tracks, 0))
    visits = Visits(0, 0, 0)
    if sight.kind != MEAN_LOSS:
        visits = visit(tracks, drone, sight.cells, memory.borders_s, memory.visits)
    rows, most = begins[out.first], 0
    for user in range(len(users.heights_m)):
        if sight.kind == MEAN_LOSS:
            rows = _note(out, rows, rows, 0.0, MEAN, 0.0)
        else:
            legs = (users.legs_at[user], users.legs_at[user + 1])
            end = walk(users.legs, legs, users.heights_m[user], span_us, tracks, drone[1])
            own = (drone[1], end)
            if end > len(tracks):
                most = max(most, len(memory.buffers.blocked))
            elif sight.kind == DRAWN:
                rows = _mark_drawn(sight, user, drone, own, visits, out, rows)
            else:
                count = sight_changes(
                    tracks, own, drone, sight.buildings, memory.buffers, span_us, -1, memory.turns
                )
                most = max(most, -count)
                if count > 0:
                    rows = _mark_seen(sight, user, span_us, count, visits, out, rows)
        begins[out.first + user + 1] = rows
    return -most if most > 0 else rows


@part
def _note(out: Marks, first: int, rows: int, t: float, branch: int, extra_db: float) -> int:
    """Write that a link has another mark from a time on, and return the number of rows.

    The user's rows begin at ``first``. Marks that begin in one microsecond become one. Rows for
    which there is no room are counted only, some of them more than once.
    """
    begin_s = np.rint(t * 1e6) * 1e-6
    if first < rows <= out.end:
        if out.rows[rows - 1].begin_s == begin_s:
            rows -= 1
        if rows > first:
            before = out.rows[rows - 1]
            if before.branch == branch and before.extra_db == extra_db:
                return rows
    if rows < out.end:
        mark = out.rows[rows]
        mark.begin_s, mark.branch, mark.extra_db = begin_s, branch, extra_db
    return rows + 1


# ---- line of sight by draws


@kernel
def _mark_drawn(
    sight: Sight, user: int, drone: Rows, own: Rows, visits: Visits, out: Marks, first: int
) -> int:
    """Write the marks of a user who sees the transmitter according to draws."""
    tracks, cells, odds = sight.memory.tracks, sight.memory.visits, sight.odds
    end = tracks[drone[1] - 1].begin_s
    link_draw = draw(odds, user, visits.first)
    rows = _note_at(tracks[drone[0]], tracks[own[0]], 0.0, link_draw, out, first, first)
    i, j = drone[0], own[0]
    for k in range(visits.stretches):
        t, until = cells[k].since_s, cells[k + 1].since_s if k + 1 < visits.stretches else end
        if cells[k].cell != link_draw.cell:
            link_draw = draw(odds, user, cells[k].cell)
        while t < until:
            i, j = row_at(tracks, i, drone[1], t), row_at(tracks, j, own[1], t)
            stop = next_s(tracks, j, own[1], next_s(tracks, i, drone[1], until))
            rows = _mark_piece(tracks[i], tracks[j], (t, stop), link_draw, out, first, rows)
            t = stop
    if visits.last != link_draw.cell:
        link_draw = draw(odds, user, visits.last)
    last, own_last = tracks[drone[1] - 1], tracks[own[1] - 1]
    return _note_at(last, own_last, end, link_draw, out, first, rows)


@part
def _beyond(drone: TrackRow, user: TrackRow, t: float, link_draw: Draw) -> Coefficients:
    """Return upright r² - along h² as a polynomial of the time from ``t`` on."""
    (x, y, z), (ux, uy, uz) = place(drone, t), place(user, t)
    (vx, vy, vz), (wx, wy, _) = velocity(drone, t), velocity(user, t)
    x, y, z, vx, vy = x - ux, y - uy, z - uz, vx - wx, vy - wy
    ax, ay, az = pulled(drone)
    ax, ay, az = 0.5 * ax, 0.5 * ay, 0.5 * az
    a, b = link_draw.upright, link_draw.along
    return (
        a * (x * x + y * y) - b * (z * z),
        2.0 * (a * (x * vx + y * vy) - b * (z * vz)),
        a * (vx * vx + vy * vy + 2.0 * (x * ax + y * ay)) - b * (vz * vz + 2.0 * z * az),
        2.0 * (a * (vx * ax + vy * ay) - b * (vz * az)),
        a * (ax * ax + ay * ay) - b * (az * az),
    )


@part
def _note_at(
    drone: TrackRow, user: TrackRow, t: float, link_draw: Draw, out: Marks, first: int, rows: int
) -> int:
    """Note the mark that a link has at a time, from the places then."""
    blocked = _beyond(drone, user, t, link_draw)[0] > 0.0
    return _note(out, first, rows, t, *_mark(link_draw, blocked))


@part
def _mark(link_draw: Draw, blocked: bool) -> tuple[int, float]:
    """Return the branch and the additional loss of a link."""
    return (NLOS, link_draw.nlos_db) if blocked else (LOS, link_draw.los_db)


@kernel
def _mark_piece(
    drone: TrackRow,
    user: TrackRow,
    stretch: tuple[float, float],
    link_draw: Draw,
    out: Marks,
    first: int,
    rows: int,
) -> int:
    """Note the marks in a stretch of time in which nobody turns, brakes or changes its cell."""
    t, until = stretch
    c = _beyond(drone, user, t, link_draw)
    blocked = c[0] > 0.0
    rows = _note(out, first, rows, t, *_mark(link_draw, blocked))
    if link_draw.upright > 0.0 and link_draw.along > 0.0:
        h = place(drone, t)[2] - place(user, t)[2]
        count, roots = sign_changes(c, blocked, until - t, GRAZE * link_draw.along * h * h)
        for k in range(count):
            blocked = not blocked
            rows = _note(out, first, rows, t + roots[k], *_mark(link_draw, blocked))
    return rows


# ---- line of sight past buildings


@kernel
def _mark_seen(
    sight: Sight,
    user: int,
    span_us: tuple[int, int],
    count: int,
    visits: Visits,
    out: Marks,
    first: int,
) -> int:
    """Write the marks of a user from the turns of its line of sight and of the cell."""
    turns, cells, lasts_us = sight.memory.turns, sight.memory.visits, span_us[1] - span_us[0]
    shadowed = sight.odds.shadow_db[0] > 0.0 or sight.odds.shadow_db[1] > 0.0
    link_draw = Draw(-1, 0.0, 0.0, 0.0, 0.0)
    cell, blocked, rows = visits.first, False, first
    turn, at, t_us = 0, 0, 0
    while t_us <= lasts_us:
        soon_us = lasts_us + 1
        while turn < count and turns[turn].t_us - span_us[0] <= t_us:
            blocked = turns[turn].state != CLEAR
            turn += 1
        if turn < count:
            soon_us = turns[turn].t_us - span_us[0]
        while at <= visits.stretches and _since_us(cells, visits, at, lasts_us) <= t_us:
            cell = visits.last if at == visits.stretches else cells[at].cell
            at += 1
        if at <= visits.stretches:
            soon_us = min(soon_us, _since_us(cells, visits, at, lasts_us))
        if shadowed and link_draw.cell != cell:
            link_draw = draw(sight.odds, user, cell)
        rows = _note(out, first, rows, 1e-6 * t_us, *_mark(link_draw, blocked))
        t_us = soon_us
    return rows


@part
def _since_us(cells: Table[Visit], visits: Visits, at: int, lasts_us: int) -> int:
    """Return when a visit begins; the one after all stretches is that at the end of the span."""
    if at == visits.stretches:
        return lasts_us
    return int(np.rint(cells[at].since_s * 1e6))
