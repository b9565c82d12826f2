"""The times at which buildings begin and cease to block the line between a user and a drone.

A building (``model.radio.buildings``) blocks the line if it contains a stretch of it; a line that
only touches a wall, an edge or a roof is clear.

Whether a building blocks the line can only change when, in plan, the line passes a corner of the
footprint, when it passes over a wall at just the height of the roof, or when the user or the drone
passes a wall or the level of the roof. All these times are roots of polynomials of degree three or
less, for the user walks straight and the drone keeps its acceleration. Between two of them the
state is decided once, at the time in the middle.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from desim_uav.model.geometry.polynomial import Coefficients, sign_changes
from desim_uav.model.geometry.relative import rounded_us
from desim_uav.model.radio.buildings import Buffers, Buildings, Corner, Stretch
from desim_uav.model.radio.tracks import (
    Point,
    Rows,
    TrackRow,
    Turn,
    next_s,
    note,
    place,
    pulled,
    row_at,
    velocity,
)
from desim_uav.rowcode.kernels import kernel, part
from desim_uav.rowcode.rows import Floats, Table

BLOCKED, CLEAR = 0, 1
"""The states of a line of sight."""

GAP_S = 1e-7
"""Stretches of time shorter than this, clear or blocked, are neglected, because they come from the
rounding of two equal times, as where a line passes from one building to the next."""


BESIDE_M = 1e-5
"""A building that is farther than this from all places of a line cannot block it."""


FARTHER = 1.0 + 1e-9
"""A polynomial whose first coefficient exceeds all its other terms by this factor has no root, also
if it is rounded."""

AROUND_M = 1e-6
"""By how much more than a line sweeps the buckets that are looked at are in its way."""

SHORT_M = 1e-3
"""Along an axis on which a line is shorter than this, all of it is looked at in each bucket."""

Place = tuple[float, float]

Swept = tuple[Place, Place, Place, Place, Place, Place]
"""Six places; what a line sweeps is within their convex hull."""


class Sweep(NamedTuple):
    """What a part of a line sweeps along an axis, in metres.

    The middle of the user's way is ``at``, and the part ``goes`` so far from there. The line is
    within ``near`` of this middle at the user and within ``far`` of it at the other end.
    """

    at: float
    goes: float
    near: float
    far: float


class Window(NamedTuple):
    """A time in which buildings may block a line, in seconds, and where the line is in it.

    The user goes from ``one`` place to the ``other``, and the drone from ``start`` to ``stop``.
    """

    since_s: float
    until_s: float
    one: Point
    other: Point
    start: Point
    stop: Point


class Line(NamedTuple):
    """A line of sight from a time on: position and motion of the user, and those of the drone."""

    user: Point
    walks: Point
    drone: Point
    flies: Point
    pull: Point


@kernel
def sight_changes(
    tracks: Table[TrackRow],
    user: Rows,
    drone: Rows,
    buildings: Buildings,
    buffers: Buffers,
    span_us: tuple[int, int],
    initial: int,
    out: Table[Turn],
) -> int:
    """Write when the line between a user and a drone becomes blocked or clear.

    ``user`` and ``drone`` are their tracks in ``tracks`` (not relative), of the same span; between
    two rows the drone flies straight on and does not turn back. Turns go into ``out``.
    ``initial`` is the state before the span: a row at its start says if it is another one there.
    States at both ends of the span depend on the places there only, and changes in one microsecond
    cancel.

    Returns the number of rows; if ``out`` is too short, it is larger than its length, and with that
    many rows it is long enough. If ``buffers.blocked`` is too short, returns minus the number of
    rows that it needs.
    """
    i, j = user[0], drone[0]
    rows = note(
        out, 0, initial, span_us[0], state_at(tracks[i], tracks[j], 0.0, buildings, buffers)
    )
    if _is_still(tracks, user) and _is_still(tracks, drone):
        return rows
    end = tracks[user[1] - 1].begin_s
    at, stretches = 0.0, 0
    while at < end:
        i = row_at(tracks, i, user[1], at)
        j = row_at(tracks, j, drone[1], at)
        until = next_s(tracks, j, drone[1], next_s(tracks, i, user[1], end))
        stretches = _look(_line(tracks[i], tracks[j], at), at, until, buildings, buffers, stretches)
        at = until
    if stretches > len(buffers.blocked):
        return -stretches
    blocked = buffers.blocked
    _sort(blocked, stretches)
    k, clear = 0, 0.0
    while k < stretches:
        since, until = blocked[k].since_s, blocked[k].until_s
        k += 1
        while k < stretches and blocked[k].since_s <= until + GAP_S:
            until = max(until, blocked[k].until_s)
            k += 1
        if until - since > GAP_S:
            if since - clear > GAP_S:
                rows = note(out, rows, initial, rounded_us(span_us[0], clear), CLEAR)
            rows = note(out, rows, initial, rounded_us(span_us[0], since), BLOCKED)
            clear = until
    if clear < end:
        rows = note(out, rows, initial, rounded_us(span_us[0], clear), CLEAR)
    last = state_at(tracks[user[1] - 1], tracks[drone[1] - 1], end, buildings, buffers)
    return note(out, rows, initial, span_us[1], last)


@part
def _is_still(tracks: Table[TrackRow], rows: Rows) -> bool:
    """Return whether a track keeps one place, of which no row differs by a rounding error."""
    first = tracks[rows[0]]
    for k in range(rows[0], rows[1]):
        one = tracks[k]
        if one.x_m != first.x_m or one.y_m != first.y_m or one.z_m != first.z_m:
            return False
        if velocity(one, one.begin_s) != (0.0, 0.0, 0.0) or pulled(one) != (0.0, 0.0, 0.0):
            return False
    return True


@kernel
def state_at(
    user: TrackRow, drone: TrackRow, t: float, buildings: Buildings, buffers: Buffers
) -> int:
    """Return the state of a line at a time, from rows of the tracks of the user and the drone."""
    line = _line(user, drone, t)
    return BLOCKED if _look(line, t, t, buildings, buffers, 0) > 0 else CLEAR


@part
def _line(user: TrackRow, drone: TrackRow, t: float) -> Line:
    return Line(
        place(user, t), velocity(user, t), place(drone, t), velocity(drone, t), pulled(drone)
    )


@part
def _ends(line: Line, s: float) -> tuple[Point, Point]:
    """Return where the user and the drone are s seconds on."""
    (ux, uy, uz), (wx, wy, wz), (px, py, pz), (vx, vy, vz), (ax, ay, az) = line
    h = 0.5 * s
    return (
        (ux + s * wx, uy + s * wy, uz + s * wz),
        (px + s * (vx + h * ax), py + s * (vy + h * ay), pz + s * (vz + h * az)),
    )


@kernel
def _look(
    line: Line, at: float, until: float, buildings: Buildings, buffers: Buffers, count: int
) -> int:
    """Add the stretches of time in which buildings block a line; return how many there are then.

    Looked at are the buildings in the buckets that the line sweeps, those near the user first, and
    none after one that blocks the line all the time. Only the part of the line below the tallest
    roof counts, and in each row of buckets only the buildings that are higher than the line is
    there. Rows that the buffers cannot hold are counted only.
    """
    (ux, uy, uz), (px, py, pz) = _ends(line, 0.0)
    (tx, ty, tz), (qx, qy, qz) = _ends(line, until - at)
    low, high, share = min(uz, tz), min(pz, qz), 1.0
    if low >= buildings.tallest_m:
        if high >= buildings.tallest_m:
            return count
    elif high > buildings.tallest_m:
        share = (buildings.tallest_m - low) / (high - low)
    window, begun = _window(line, 0.0, until - at), count
    stamp = buffers.visited[len(buffers.visited) - 1] + 1
    buffers.visited[len(buffers.visited) - 1] = stamp
    along, across = _sweep(ux, tx, px, qx, share), _sweep(uy, ty, py, qy, share)
    (count_along, count_across), (side, side_across) = buildings.shape, buildings.side_m
    stride, stride_across = count_across, 1
    if abs(across.goes) > abs(along.goes):
        along, across = across, along
        count_along, count_across = count_across, count_along
        side, side_across = side_across, side
        stride, stride_across = 1, stride
    first = _bucket(
        min(along.at - along.near, along.at + along.goes - along.far), side, count_along
    )
    last = _bucket(max(along.at + along.near, along.at + along.goes + along.far), side, count_along)
    step = 1
    if along.goes < 0.0:
        first, last, step = last, first, -1
    for i in range(first, last + step, step):
        begin, end = _shares(
            along,
            i * side if i > 0 else -np.inf,
            (i + 1) * side if i + 1 < count_along else np.inf,
        )
        if begin > end:
            continue
        over_m = low + (high - low) * share * (begin if high > low else end) - BESIDE_M
        (one, other), (width, far) = _range_at(across, begin), _range_at(across, end)
        south = _bucket(min(one, width), side_across, count_across)
        north = _bucket(max(other, far), side_across, count_across)
        for j in range(south, north + 1):
            bucket = i * stride + j * stride_across
            for k in range(buildings.heads[bucket], buildings.heads[bucket + 1]):
                b = buildings.members[k]
                if buildings.roofs_m[b] > over_m and buffers.visited[b] != stamp:
                    buffers.visited[b] = stamp
                    if _may_block(window, buildings, b):
                        if _keeps_blocking(window, buildings, b):
                            return _add_stretch(
                                buffers, count, at + window.since_s, at + window.until_s
                            )
                        had = count
                        count = _stretches(line, at, until, buildings, b, buffers, count)
                        if had < count <= len(buffers.blocked):
                            window, is_left = _rest(line, at, window, buffers.blocked, begun, count)
                            if not is_left:
                                return count
    return count


@part
def _sweep(user: float, later: float, drone: float, after: float, share: float) -> Sweep:
    """Return what the first part of a line, of this share, sweeps along an axis.

    The user goes from ``user`` to ``later``, and the drone from ``drone`` to ``after``.
    """
    middle, half = 0.5 * (user + later), 0.5 * abs(later - user)
    goes = share * (0.5 * (drone + after) - middle)
    far = (1.0 - share) * half + share * 0.5 * abs(after - drone)
    return Sweep(middle, goes, half + AROUND_M, far + AROUND_M)


@part
def _shares(sweep: Sweep, low: float, high: float) -> tuple[float, float]:
    """Return the first and the last share of what is swept that may be between two places."""
    if abs(sweep.goes) < SHORT_M:
        return 0.0, 1.0
    wide = max(sweep.near, sweep.far)
    one = (low - wide - sweep.at) / sweep.goes
    other = (high + wide - sweep.at) / sweep.goes
    return max(min(one, other), 0.0), min(max(one, other), 1.0)


@part
def _range_at(sweep: Sweep, share: float) -> tuple[float, float]:
    """Return between which places along an axis the line is at a share of what is swept."""
    middle, half = sweep.at + share * sweep.goes, sweep.near + share * (sweep.far - sweep.near)
    return middle - half, middle + half


@part
def _window(line: Line, since: float, until: float) -> Window:
    """Return where a line is at the two ends of a time."""
    (one, start), (other, stop) = _ends(line, since), _ends(line, until)
    return Window(since, until, one, other, start, stop)


@part
def _rest(
    line: Line, at: float, window: Window, blocked: Table[Stretch], first: int, count: int
) -> tuple[Window, bool]:
    """Return the window without the blocked stretches at its ends, and whether any of it is left.

    What is blocked already stays so, whatever the other buildings do.
    """
    since, until, goes_on = window.since_s, window.until_s, True
    while goes_on and since < until:
        goes_on = False
        for k in range(first, count):
            one = blocked[k]
            if one.since_s <= at + since and one.until_s > at + since:
                since, goes_on = one.until_s - at, True
            if one.until_s >= at + until and one.since_s < at + until:
                until, goes_on = one.since_s - at, True
    if not since < until:
        return window, False
    if since > window.since_s or until < window.until_s:
        return _window(line, since, until), True
    return window, True


@part
def _may_block(window: Window, buildings: Buildings, b: int) -> bool:
    """Return whether a building may block a line in a window of time.

    It cannot if what the line sweeps below the roof is all beyond a wall, or if the building is all
    on one side of what the line sweeps: both by more than ``BESIDE_M``.
    """
    _, _, (ax, ay, az), (bx, by, bz), (cx, cy, cz), (dx, dy, dz) = window
    share, low, high = 1.0, min(az, bz), min(cz, dz)
    if high > low:
        share = min(max((buildings.roofs_m[b] + BESIDE_M - low) / (high - low), 0.0), 1.0)
    rest = 1.0 - share
    swept = (
        (ax, ay),
        (bx, by),
        (rest * ax + share * cx, rest * ay + share * cy),
        (rest * bx + share * cx, rest * by + share * cy),
        (rest * ax + share * dx, rest * ay + share * dy),
        (rest * bx + share * dx, rest * by + share * dy),
    )
    first, last = buildings.offsets[b], buildings.offsets[b + 1]
    for k in range(first, last):
        x, y, ex, ey = _wall(buildings.corners, k, first, last)
        if _extent(swept, (x, y), ex, ey)[1] < -BESIDE_M * (abs(ex) + abs(ey)):
            return False
    return not (
        _is_beside(swept, (ax, ay), cx - ax, cy - ay, buildings, b)
        or _is_beside(swept, (bx, by), dx - bx, dy - by, buildings, b)
    )


@part
def _keeps_blocking(window: Window, buildings: Buildings, b: int) -> bool:
    """Return whether it is certain that a building blocks a line throughout a window of time.

    The places of one end from which a line to another place meets a convex building, its shadow,
    are convex. So all lines between two straight ways are blocked if those between their ends are.
    """
    one, other, start, stop = window.one, window.other, window.start, window.stop
    return (
        _contains(one, start, buildings, b, BESIDE_M)
        and _contains(other, stop, buildings, b, BESIDE_M)
        and _contains(one, stop, buildings, b, BESIDE_M)
        and _contains(other, start, buildings, b, BESIDE_M)
    )


@part
def _extent(swept: Swept, at: Place, ex: float, ey: float) -> tuple[float, float]:
    """Return how far places are to the left of a line at least and at most, times (ex, ey)."""
    least, most = np.inf, -np.inf
    for k in range(6):
        left = ex * (swept[k][1] - at[1]) - ey * (swept[k][0] - at[0])
        least, most = min(least, left), max(most, left)
    return least, most


@part
def _is_beside(swept: Swept, at: Place, ex: float, ey: float, buildings: Buildings, b: int) -> bool:
    """Return whether a building is all to the left or to the right of what a line sweeps.

    The line of sight that decides what is left goes through ``at`` along (ex, ey).
    """
    least, most = _extent(swept, at, ex, ey)
    south, north = np.inf, -np.inf
    for k in range(buildings.offsets[b], buildings.offsets[b + 1]):
        corner = buildings.corners[k]
        left = ex * (corner.y_m - at[1]) - ey * (corner.x_m - at[0])
        south, north = min(south, left), max(north, left)
    margin = BESIDE_M * (abs(ex) + abs(ey))
    return bool(south > most + margin or north < least - margin)


@part
def _bucket(at: float, side: float, count: int) -> int:
    return min(max(int(np.floor(at / side)), 0), count - 1)


@kernel
def _stretches(
    line: Line,
    at: float,
    until: float,
    buildings: Buildings,
    b: int,
    buffers: Buffers,
    number: int,
) -> int:
    """Add the stretches of time in which one building blocks a line."""
    times, end = buffers.times, until - at
    count = _times(line, end, buildings, b, times)
    for k in range(1, count):
        t, i = times[k], k
        while i > 0 and times[i - 1] > t:
            times[i] = times[i - 1]
            i -= 1
        times[i] = t
    since = -1.0
    for k in range(count + 1):
        low = times[k - 1] if k > 0 else 0.0
        high = times[k] if k < count else end
        if _blocks(line, 0.5 * (low + high), buildings, b):
            since = low if since < 0.0 else since
            if k < count:
                continue
            high = end
        elif since >= 0.0:
            high = low
        if since >= 0.0:
            number = _add_stretch(buffers, number, at + since, at + high)
            since = -1.0
    return number


@part
def _add_stretch(buffers: Buffers, number: int, since_s: float, until_s: float) -> int:
    """Write a stretch of time if there is room for it, and return the number of them then."""
    if number < len(buffers.blocked):
        stretch = buffers.blocked[number]
        stretch.since_s, stretch.until_s = since_s, until_s
    return number + 1


@kernel
def _times(line: Line, end: float, buildings: Buildings, b: int, times: Floats) -> int:
    """Write all times inside (0, ``end``) at which one building may change the state."""
    if not end > 0.0:
        return 0
    (ux, uy, uz), (wx, wy, wz), (px, py, pz), (vx, vy, vz), (ax, ay, az) = line
    ax, ay, az = 0.5 * ax, 0.5 * ay, 0.5 * az
    roof = buildings.roofs_m[b]
    # The user below the roof, and the drone above the user: polynomials of s.
    u = (uz - roof, wz)
    d = (pz - uz, vz - wz, az)
    count = _add((u[0], u[1], 0.0, 0.0, 0.0), end, times, 0)
    count = _add((u[0] + d[0], u[1] + d[1], d[2], 0.0, 0.0), end, times, count)
    first, last = buildings.offsets[b], buildings.offsets[b + 1]
    for k in range(first, last):
        x, y, ex, ey = _wall(buildings.corners, k, first, last)
        # The line passes a corner: (corner - user) x (drone - user) = 0.
        cx, cy = x - ux, y - uy
        gx, gy = px - ux, py - uy
        hx, hy = vx - wx, vy - wy
        corner = (
            cx * gy - cy * gx,
            cx * hy - cy * hx - (wx * gy - wy * gx),
            cx * ay - cy * ax - (wx * hy - wy * hx),
            -(wx * ay - wy * ax),
            0.0,
        )
        count = _add(corner, end, times, count)
        # It passes the wall's line at the share n / g of its length: there it is at the roof.
        n = (cx * ey - cy * ex, -(wx * ey - wy * ex))
        g = (gx * ey - gy * ex, hx * ey - hy * ex, ax * ey - ay * ex)
        over = (
            u[0] * g[0] + n[0] * d[0],
            u[0] * g[1] + u[1] * g[0] + n[0] * d[1] + n[1] * d[0],
            u[0] * g[2] + u[1] * g[1] + n[0] * d[2] + n[1] * d[1],
            u[1] * g[2] + n[1] * d[2],
            0.0,
        )
        count = _add(over, end, times, count)
        count = _add((n[0], n[1], 0.0, 0.0, 0.0), end, times, count)
        count = _add((n[0] - g[0], n[1] - g[1], -g[2], 0.0, 0.0), end, times, count)
    return count


@part
def _wall(
    corners: Table[Corner], k: int, first: int, last: int
) -> tuple[float, float, float, float]:
    """Return a corner of a footprint, and how far the next one is away along x and y."""
    corner, following = corners[k], corners[k + 1 if k + 1 < last else first]
    return corner.x_m, corner.y_m, following.x_m - corner.x_m, following.y_m - corner.y_m


@part
def _add(c: Coefficients, end: float, times: Floats, count: int) -> int:
    """Write where a polynomial changes its sign, and return the number of times then.

    It changes nowhere if it never comes as far as its first coefficient from there.
    """
    most = end * (abs(c[1]) + end * (abs(c[2]) + end * abs(c[3])))
    if abs(c[0]) > FARTHER * most:
        return count
    changes, roots = sign_changes(c, c[0] > 0.0, end, 0.0)
    for k in range(changes):
        times[count + k] = roots[k]
    return count + changes


@kernel
def _blocks(line: Line, s: float, buildings: Buildings, b: int) -> bool:
    """Return whether a building contains a stretch of a line, s seconds on."""
    user, drone = _ends(line, s)
    return _contains(user, drone, buildings, b, 0.0)


@part
def _contains(user: Point, drone: Point, buildings: Buildings, b: int, margin: float) -> bool:
    """Return whether a building contains a stretch of a line, a margin within its walls and roof.

    It is as many metres from walls, or a bit more, times what x and y change along a wall.
    """
    (ux, uy, uz), (px, py, pz) = user, drone
    begin, end = 0.0, 1.0
    first, last = buildings.offsets[b], buildings.offsets[b + 1]
    for k in range(first, last):
        x, y, ex, ey = _wall(buildings.corners, k, first, last)
        inwards = margin * (abs(ex) + abs(ey))
        near = ex * (uy - y) - ey * (ux - x) - inwards
        far = ex * (py - y) - ey * (px - x) - inwards
        if near <= 0.0 and far <= 0.0:
            return False
        if near < 0.0:
            begin = max(begin, near / (near - far))
        elif far < 0.0:
            end = min(end, near / (near - far))
    if not begin < end:
        return False
    lowest = min(uz + begin * (pz - uz), uz + end * (pz - uz))
    return bool(lowest < buildings.roofs_m[b] - margin)


@part
def _sort(stretches: Table[Stretch], count: int) -> None:
    """Sort the first stretches of a table by their beginnings."""
    for k in range(1, count):
        since, until, i = stretches[k].since_s, stretches[k].until_s, k
        while i > 0 and stretches[i - 1].since_s > since:
            before = stretches[i - 1]
            stretches[i].since_s, stretches[i].until_s = before.since_s, before.until_s
            i -= 1
        stretches[i].since_s, stretches[i].until_s = since, until
