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
state of the line of sight. All draws are functions of these numbers (``model.random.philox``), so
they do not depend on the order in which they are made, nor on other users and transmitters.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from desim_uav.model.geometry.grid import cell_index
from desim_uav.model.geometry.polynomial import Coefficients, sign_changes
from desim_uav.model.radio.draws import draws_of_link
from desim_uav.model.radio.path_loss import LOS, MEAN, NLOS, RowPathLoss
from desim_uav.model.radio.rings import check_sight
from desim_uav.model.radio.sight import (
    CLEAR,
    GAP_S,
    Buffers,
    Buildings,
    buffers_for,
    sight_changes,
)
from desim_uav.model.radio.slopes import DEGREES
from desim_uav.model.radio.tracks import (
    AT,
    BEGIN,
    PULL_AT,
    SPEED_AT,
    TRACK_COLUMNS,
    Flight,
    Rows,
    fly,
    place,
    row_at,
    velocity,
    walk,
)
from desim_uav.model.random.philox import as_normal
from desim_uav.rowcode.compiled_rows import call_for_float
from desim_uav.rowcode.components import Compiled, Function, compiled, ruled
from desim_uav.rowcode.kernels import kernel, part

MEAN_LOSS, DRAWN, BUILDINGS = range(3)
"""The kinds of line of sight."""

KINDS = {"mean": MEAN_LOSS, "drawn": DRAWN, "buildings": BUILDINGS}
"""The kinds of line of sight by their names in a scenario."""

TIME_S, MARK_BRANCH, EXTRA_DB = range(3)
MARK_COLUMNS = 3
"""The columns of a table of marks, and their number: when a mark begins, in seconds since the start
of the span, the branch of the path loss, and the additional loss in dB."""

FINEST_DEG = 1e-12
"""How exactly the elevation is found from which on a user sees a transmitter, in degrees."""

GRAZE = 1e-15
"""Where a link touches its cone to within this share of the squared height, it does not pass it."""

SINCE, CELL = range(2)
VISIT_COLUMNS, CHANGE_COLUMNS = 2, 2
"""The columns of ``Memory.visits``, and the numbers of columns there and in ``Memory.changes``."""


class Memory(NamedTuple):
    """The memory in which ``marks_of`` works (see ``memory_for``).

    ``tracks`` holds the tracks of the transmitter and of one user, ``borders_s`` the times at which
    the transmitter passes borders of cells, ``visits`` rows (seconds, cell), ``changes`` rows
    (time, state) of a line of sight, and ``buffers`` is for the buildings.
    """

    tracks: NDArray[np.float64]
    borders_s: NDArray[np.float64]
    visits: NDArray[np.float64]
    changes: NDArray[np.int64]
    buffers: Buffers


class Sight(NamedTuple):
    """What decides on the marks of all links to one transmitter.

    ``kind`` is one of MEAN_LOSS, DRAWN and BUILDINGS, and ``key`` (2,) that of the draws of the
    episode (``philox.key_of`` for ``Purpose.LINK``), or longer if the episode is imagined
    (``radio.draws``). ``shadow_db`` are the standard deviations of
    shadowing with and without line of sight in dB; with MEAN_LOSS they must be 0. ``cell_m`` and
    ``cells`` are the length and the number of the map's cells along x and y. ``legs``, ``legs_at``
    and ``heights_m`` (users,) are the walks and heights of the users (see ``coverage.Users``), and
    ``flight`` is that of the transmitter, which is above all users. ``p_los`` and ``values`` are
    the addresses of the probability of line of sight (``Chance``); only DRAWN needs them.
    """

    kind: int
    key: NDArray[np.uint64]
    shadow_db: tuple[float, float]
    cell_m: tuple[float, float]
    cells: tuple[int, int]
    legs: NDArray[np.float64]
    legs_at: NDArray[np.int64]
    heights_m: NDArray[np.float64]
    flight: Flight
    p_los: int
    values: int
    buildings: Buildings
    memory: Memory


def _p_los(cls: Any, values_at: Any) -> Any:
    """Return the function ``p_los`` of a class of path losses (see ``Function.around``)."""
    p_los = ruled(cls.p_los)

    def chance(values: int, elevation: float) -> float:
        return float(p_los(values_at(values), elevation))

    return chance


P_LOS = Function("p_los", _p_los, (int, float))
"""The function of a path loss that returns the probability of line of sight.

Its arguments are the address of the values and the elevation in degrees."""


class Chance(NamedTuple):
    """A compiled probability of line of sight: the addresses of the function and of its values.

    The addresses hold in this process, and as long as ``kept`` exists.
    """

    p_los: int
    values: int
    kept: Compiled


def compiled_chance(path_loss: RowPathLoss) -> Chance:
    """Compile the probability of line of sight of a path loss.

    Raises ValueError if it does not rise with the elevation, and Numba's errors
    (``components.NOT_COMPILED``).
    """
    check_sight(path_loss)
    made = compiled((P_LOS,), path_loss, ())
    return Chance(made.functions["p_los"], made.values.ctypes.data, made)


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
        np.zeros((pieces + most_legs + 2, TRACK_COLUMNS)),
        np.zeros(borders),
        np.zeros((pieces + borders, VISIT_COLUMNS)),
        np.zeros((2 * stretches + 3, CHANGE_COLUMNS), np.int64),
        buffers_for(buildings.offsets, stretches),
    )


class _Draw(NamedTuple):
    """The draws of a link while the transmitter is in a cell.

    With the horizontal distance r and the height difference h, the user sees the transmitter where
    ``upright`` r² <= ``along`` h². The additional losses with and without line of sight are in dB.
    """

    cell: int
    upright: float
    along: float
    los_db: float
    nlos_db: float


class _Visits(NamedTuple):
    """The cells in which a transmitter is: at the start, in stretches, and at the end."""

    first: int
    stretches: int
    last: int


@kernel
def marks_of(
    sight: Sight,
    transmitter: int,
    span_us: tuple[int, int],
    out: NDArray[np.float64],
    out_at: NDArray[np.int64],
) -> int:
    """Write the marks of the links of one transmitter to all users, and return where they end.

    ``transmitter`` is the number in the draws: that of a drone, or -1 - k for access point k, so
    that one more drone does not change the draws of access points. The rows (MARK_COLUMNS) of user
    u are written from ``out[out_at[u]]`` on, up to ``out_at[u + 1]``. ``out_at`` (users + 1,) is
    written except for its first entry, which says where to begin.

    The first mark of each user begins at 0.0. Others begin where one of the two numbers changes, at
    whole microseconds; what lasts no microsecond is no mark. Marks at both ends of the span depend
    on the places there only: a mark may begin at the end of the span.

    If the returned number is larger than the length of ``out``, rows are missing, and with that
    many rows it is long enough. If it is negative, ``sight.memory`` must be made for that many
    stretches, and for all legs of each walk (``memory_for``).
    """
    memory = sight.memory
    after = fly(sight.flight, span_us, memory.tracks, 0)
    visits = _visit(sight, (0, after))
    rows, most = int(out_at[0]), 0
    for user in range(len(sight.heights_m)):
        if sight.kind == MEAN_LOSS:
            rows = _note(out, rows, rows, 0.0, MEAN, 0.0)
        else:
            own = (sight.legs_at[user], sight.legs_at[user + 1])
            end = walk(sight.legs, own, sight.heights_m[user], span_us, memory.tracks, after)
            mine = (after, end)
            if end > len(memory.tracks):
                most = max(most, len(memory.buffers.blocked))
            elif sight.kind == DRAWN:
                rows = _mark_drawn(sight, transmitter, user, (0, after), mine, visits, out, rows)
            else:
                count = sight_changes(
                    memory.tracks,
                    mine,
                    (0, after),
                    sight.buildings,
                    memory.buffers,
                    span_us,
                    -1,
                    memory.changes,
                )
                most = max(most, -count)
                if count > 0:
                    rows = _mark_seen(sight, transmitter, user, span_us, count, visits, out, rows)
        out_at[user + 1] = rows
    return -most if most > 0 else rows


@part
def _note(
    out: NDArray[np.float64], first: int, rows: int, t: float, branch: int, extra_db: float
) -> int:
    """Write that a link has another mark from a time on, and return the number of rows.

    The user's rows begin at ``first``. Marks that begin in one microsecond become one. Rows for
    which there is no room are counted only, some of them more than once.
    """
    time_s = np.rint(t * 1e6) * 1e-6
    if first < rows <= len(out):
        if out[rows - 1, TIME_S] == time_s:
            rows -= 1
        if (
            rows > first
            and out[rows - 1, MARK_BRANCH] == branch
            and out[rows - 1, EXTRA_DB] == extra_db
        ):
            return rows
    if rows < len(out):
        out[rows, TIME_S], out[rows, MARK_BRANCH], out[rows, EXTRA_DB] = time_s, branch, extra_db
    return rows + 1


# ---- the cells of the transmitter


@kernel
def _visit(sight: Sight, drone: Rows) -> _Visits:
    """Write in which cells a transmitter is, and from when on, into ``sight.memory.visits``."""
    tracks, visits = sight.memory.tracks, sight.memory.visits
    first = _cell(sight, drone[0], 0.0)
    if sight.kind == MEAN_LOSS:
        return _Visits(first, 0, first)
    borders, count = sight.memory.borders_s, 0
    for row in range(drone[0], drone[1] - 1):
        begin, end = tracks[row, BEGIN], tracks[row + 1, BEGIN]
        passed = _pass(sight, row, 0, end - begin, 0)
        passed = _pass(sight, row, 1, end - begin, passed)
        low = 0.0
        for k in range(passed + 1):
            high = borders[k] if k < passed else end - begin
            if high - low > GAP_S:
                cell = _cell(sight, row, begin + 0.5 * (low + high))
                if count == 0 or visits[count - 1, CELL] != cell:
                    visits[count, SINCE] = begin + low if count > 0 else 0.0
                    visits[count, CELL] = cell
                    count += 1
            low = high
    return _Visits(first, count, _cell(sight, drone[1] - 1, tracks[drone[1] - 1, BEGIN]))


@part
def _cell(sight: Sight, row: int, t: float) -> int:
    """Return the number of the cell in which the transmitter is at a time."""
    x, y, _ = place(sight.memory.tracks, row, t)
    (nx, ny), (dx, dy) = sight.cells, sight.cell_m
    return cell_index(x, dx, nx) * ny + cell_index(y, dy, ny)


@part
def _pass(sight: Sight, row: int, axis: int, lasts: float, count: int) -> int:
    """Add the times, in order, at which a transmitter passes borders of cells along an axis.

    They are in seconds since the start of the row of its track, in which it does not turn back.
    """
    tracks, times = sight.memory.tracks, sight.memory.borders_s
    side, cells = sight.cell_m[axis], sight.cells[axis]
    at, speed, pull = (
        tracks[row, AT + axis],
        tracks[row, SPEED_AT + axis],
        tracks[row, PULL_AT + axis],
    )
    to = at + lasts * (speed + 0.5 * lasts * pull)
    low, high = min(at, to), max(at, to)
    for k in range(max(cell_index(low, side, cells), 1), cell_index(high, side, cells) + 1):
        border = k * side
        if low < border < high:
            # The root of a polynomial of degree two: both terms below have the sign of the flight.
            root = np.sqrt(max(speed * speed + 2.0 * pull * (border - at), 0.0))
            t = min(max(2.0 * (border - at) / (speed + (root if to > at else -root)), 0.0), lasts)
            i = count
            while i > 0 and times[i - 1] > t:
                times[i] = times[i - 1]
                i -= 1
            times[i] = t
            count += 1
    return count


# ---- draws


@kernel
def _draw(sight: Sight, transmitter: int, user: int, cell: int) -> _Draw:
    """Return the draws of a link while the transmitter is in a cell."""
    uniform, los_word, nlos_word = draws_of_link(
        sight.key, len(sight.heights_m), transmitter, user, cell
    )
    upright = along = 0.0
    if sight.kind == DRAWN:
        least = least_elevation(sight.p_los, sight.values, uniform)
        if least > 90.0:
            upright, along = 1.0, -1.0
        elif least <= 0.0:
            upright, along = 0.0, 1.0
        else:
            upright = np.sin(least / DEGREES) ** 2
            along = np.cos(least / DEGREES) ** 2
    los_db, nlos_db = sight.shadow_db
    return _Draw(cell, upright, along, _shadow(los_db, los_word), _shadow(nlos_db, nlos_word))


@part
def _shadow(deviation_db: float, word: np.uint64) -> float:
    """Return a normal loss in whole 1e-9 dB; this hides how platforms differ in logarithms."""
    if deviation_db == 0.0:
        return 0.0
    return float(np.rint(deviation_db * as_normal(word) * 1e9) * 1e-9)


@kernel
def least_elevation(p_los: int, values: int, uniform: float) -> float:
    """Return from which elevation on a draw is below the probability of line of sight, in degrees.

    It is 0 if it is so everywhere, and inf if it is so nowhere. ``p_los`` and ``values`` are the
    addresses of a ``Chance``.
    """
    low, high = 0.0, 90.0
    if uniform < call_for_float(p_los, (values, low)):
        return 0.0
    if not uniform < call_for_float(p_los, (values, high)):
        return float(np.inf)
    while high - low > FINEST_DEG:
        middle = 0.5 * (low + high)
        if uniform < call_for_float(p_los, (values, middle)):
            high = middle
        else:
            low = middle
    return high


# ---- line of sight by draws


@kernel
def _mark_drawn(
    sight: Sight,
    transmitter: int,
    user: int,
    drone: Rows,
    own: Rows,
    visits: _Visits,
    out: NDArray[np.float64],
    first: int,
) -> int:
    """Write the marks of a user who sees the transmitter according to draws."""
    tracks, cells = sight.memory.tracks, sight.memory.visits
    end = tracks[drone[1] - 1, BEGIN]
    draw = _draw(sight, transmitter, user, visits.first)
    rows = _note_at(sight, drone[0], own[0], 0.0, draw, out, first, first)
    i, j = drone[0], own[0]
    for k in range(visits.stretches):
        t, until = cells[k, SINCE], cells[k + 1, SINCE] if k + 1 < visits.stretches else end
        cell = int(cells[k, CELL])
        if cell != draw.cell:
            draw = _draw(sight, transmitter, user, cell)
        while t < until:
            i, j = row_at(tracks, i, drone[1], t), row_at(tracks, j, own[1], t)
            stop = until
            if i + 1 < drone[1]:
                stop = min(stop, tracks[i + 1, BEGIN])
            if j + 1 < own[1]:
                stop = min(stop, tracks[j + 1, BEGIN])
            rows = _mark_piece(sight, i, j, (t, stop), draw, out, first, rows)
            t = stop
    if visits.last != draw.cell:
        draw = _draw(sight, transmitter, user, visits.last)
    return _note_at(sight, drone[1] - 1, own[1] - 1, end, draw, out, first, rows)


@part
def _beyond(sight: Sight, i: int, j: int, t: float, draw: _Draw) -> Coefficients:
    """Return upright r² - along h² as a polynomial of the time from ``t`` on."""
    tracks = sight.memory.tracks
    (x, y, z), (ux, uy, uz) = place(tracks, i, t), place(tracks, j, t)
    (vx, vy, vz), (wx, wy, _) = velocity(tracks, i, t), velocity(tracks, j, t)
    x, y, z, vx, vy = x - ux, y - uy, z - uz, vx - wx, vy - wy
    ax, ay, az = (
        0.5 * tracks[i, PULL_AT],
        0.5 * tracks[i, PULL_AT + 1],
        0.5 * tracks[i, PULL_AT + 2],
    )
    a, b = draw.upright, draw.along
    return (
        a * (x * x + y * y) - b * (z * z),
        2.0 * (a * (x * vx + y * vy) - b * (z * vz)),
        a * (vx * vx + vy * vy + 2.0 * (x * ax + y * ay)) - b * (vz * vz + 2.0 * z * az),
        2.0 * (a * (vx * ax + vy * ay) - b * (vz * az)),
        a * (ax * ax + ay * ay) - b * (az * az),
    )


@part
def _note_at(
    sight: Sight,
    i: int,
    j: int,
    t: float,
    draw: _Draw,
    out: NDArray[np.float64],
    first: int,
    rows: int,
) -> int:
    """Note the mark that a link has at a time, from the places then."""
    blocked = _beyond(sight, i, j, t, draw)[0] > 0.0
    return _note(out, first, rows, t, *_mark(draw, blocked))


@part
def _mark(draw: _Draw, blocked: bool) -> tuple[int, float]:
    """Return the branch and the additional loss of a link."""
    return (NLOS, draw.nlos_db) if blocked else (LOS, draw.los_db)


@kernel
def _mark_piece(
    sight: Sight,
    i: int,
    j: int,
    stretch: tuple[float, float],
    draw: _Draw,
    out: NDArray[np.float64],
    first: int,
    rows: int,
) -> int:
    """Note the marks in a stretch of time in which nobody turns, brakes or changes its cell."""
    t, until = stretch
    c = _beyond(sight, i, j, t, draw)
    blocked = c[0] > 0.0
    rows = _note(out, first, rows, t, *_mark(draw, blocked))
    if draw.upright > 0.0 and draw.along > 0.0:
        h = place(sight.memory.tracks, i, t)[2] - place(sight.memory.tracks, j, t)[2]
        count, roots = sign_changes(c, blocked, until - t, GRAZE * draw.along * h * h)
        for k in range(count):
            blocked = not blocked
            rows = _note(out, first, rows, t + roots[k], *_mark(draw, blocked))
    return rows


# ---- line of sight past buildings


@kernel
def _mark_seen(
    sight: Sight,
    transmitter: int,
    user: int,
    span_us: tuple[int, int],
    count: int,
    visits: _Visits,
    out: NDArray[np.float64],
    first: int,
) -> int:
    """Write the marks of a user from the changes of its line of sight and of the cell."""
    changes, lasts_us = sight.memory.changes, span_us[1] - span_us[0]
    shadowed = sight.shadow_db[0] > 0.0 or sight.shadow_db[1] > 0.0
    draw = _Draw(-1, 0.0, 0.0, 0.0, 0.0)
    cell, blocked, rows = visits.first, False, first
    seen, visit, t_us = 0, 0, 0
    while t_us <= lasts_us:
        soon_us = lasts_us + 1
        while seen < count and changes[seen, 0] - span_us[0] <= t_us:
            blocked = changes[seen, 1] != CLEAR
            seen += 1
        if seen < count:
            soon_us = changes[seen, 0] - span_us[0]
        while visit <= visits.stretches and _visit_us(sight, visits, visit, lasts_us) <= t_us:
            at_end = visit == visits.stretches
            cell = visits.last if at_end else int(sight.memory.visits[visit, CELL])
            visit += 1
        if visit <= visits.stretches:
            soon_us = min(soon_us, _visit_us(sight, visits, visit, lasts_us))
        if shadowed and draw.cell != cell:
            draw = _draw(sight, transmitter, user, cell)
        rows = _note(out, first, rows, 1e-6 * t_us, *_mark(draw, blocked))
        t_us = soon_us
    return rows


@part
def _visit_us(sight: Sight, visits: _Visits, visit: int, lasts_us: int) -> int:
    """Return when a visit begins; the one after all stretches is that at the end of the span."""
    if visit == visits.stretches:
        return lasts_us
    return int(np.rint(sight.memory.visits[visit, SINCE] * 1e6))
