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
    roof counts. Rows that the buffers cannot hold are counted only.
    """
    (ux, uy, uz), (px, py, pz) = _ends(line, 0.0)
    (tx, ty, tz), (qx, qy, qz) = _ends(line, until - at)
    low, high, share = min(uz, tz), min(pz, qz), 1.0
    if low >= buildings.tallest_m:
        if high >= buildings.tallest_m:
            return count
    elif high > buildings.tallest_m:
        share = (buildings.tallest_m - low) / (high - low)
    rest = 1.0 - share
    xs = (
        ux,
        tx,
        rest * ux + share * px,
        rest * tx + share * px,
        rest * ux + share * qx,
        rest * tx + share * qx,
    )
    ys = (
        uy,
        ty,
        rest * uy + share * py,
        rest * ty + share * py,
        rest * uy + share * qy,
        rest * ty + share * qy,
    )
    stamp = buffers.visited[len(buffers.visited) - 1] + 1
    buffers.visited[len(buffers.visited) - 1] = stamp
    (nx, ny), (dx, dy) = buildings.shape, buildings.side_m
    first, last, step = _bucket(min(xs), dx, nx), _bucket(max(xs), dx, nx), 1
    if 2 * _bucket(ux, dx, nx) > first + last:
        first, last, step = last, first, -1
    for ix in range(first, last + step, step):
        south, north = _slab(xs, ys, ix * dx, (ix + 1) * dx)
        if south > north:
            continue
        for iy in range(_bucket(south, dy, ny), _bucket(north, dy, ny) + 1):
            bucket = ix * ny + iy
            for k in range(buildings.heads[bucket], buildings.heads[bucket + 1]):
                b = buildings.members[k]
                if buffers.visited[b] != stamp:
                    buffers.visited[b] = stamp
                    if min(low, high) < buildings.roofs_m[b] and _may_block(
                        (ux, uy), (tx, ty), (px, py), (qx, qy), low, high, buildings, b
                    ):
                        count = _stretches(line, at, until, buildings, b, buffers, count)
                        if _always(buffers.blocked, count, at, until):
                            return count
    return count


@part
def _always(blocked: Table[Stretch], count: int, at: float, until: float) -> bool:
    """Return whether the last stretch that was written is the whole time."""
    if count == 0 or count > len(blocked):
        return False
    last = blocked[count - 1]
    return bool(last.since_s <= at and last.until_s >= until)


@part
def _may_block(
    one: tuple[float, float],
    other: tuple[float, float],
    start: tuple[float, float],
    stop: tuple[float, float],
    low: float,
    high: float,
    buildings: Buildings,
    b: int,
) -> bool:
    """Return whether a building may block a line whose user goes from one place to another.

    The drone flies from ``start`` to ``stop``; ``low`` and ``high`` are the least altitudes of the
    two. The building cannot if it is beside the strip that the line sweeps, or if the line is
    above its roof wherever it can be over it: both by more than ``BESIDE_M``.
    """
    ax, ay = start[0] - one[0], start[1] - one[1]
    bx, by = stop[0] - other[0], stop[1] - other[1]
    length = np.sqrt(ax * ax + ay * ay)
    if length <= BESIDE_M:
        return True
    ax, ay = ax / length, ay / length
    far = np.sqrt(bx * bx + by * by)
    bx, by = (bx / far, by / far) if far > BESIDE_M else (ax, ay)
    # Where the corners are along the line, and to its left, at the start and at the end.
    nearest, west, east, south, north = np.inf, np.inf, -np.inf, np.inf, -np.inf
    for k in range(buildings.offsets[b], buildings.offsets[b + 1]):
        corner = buildings.corners[k]
        x, y = corner.x_m - one[0], corner.y_m - one[1]
        nearest = min(nearest, ax * x + ay * y)
        left = ax * y - ay * x
        west, east = min(west, left), max(east, left)
        left = bx * y - by * x
        south, north = min(south, left), max(north, left)
    x1, y1 = other[0] - one[0], other[1] - one[1]
    x2, y2, x3, y3 = start[0] - one[0], start[1] - one[1], stop[0] - one[0], stop[1] - one[1]
    p1, p2, p3 = ax * y1 - ay * x1, ax * y2 - ay * x2, ax * y3 - ay * x3
    if west > max(0.0, p1, p2, p3) + BESIDE_M or east < min(0.0, p1, p2, p3) - BESIDE_M:
        return False
    p1, p2, p3 = bx * y1 - by * x1, bx * y2 - by * x2, bx * y3 - by * x3
    if south > max(0.0, p1, p2, p3) + BESIDE_M or north < min(0.0, p1, p2, p3) - BESIDE_M:
        return False
    begin = max(0.0, ax * x1 + ay * y1)
    end = max(ax * x2 + ay * y2, ax * x3 + ay * y3)
    if high <= low or nearest <= begin or end <= begin:
        return True
    if nearest > end + BESIDE_M:
        return False
    over_m = low + (high - low) * min((nearest - begin) / (end - begin), 1.0)
    return bool(over_m <= buildings.roofs_m[b] + BESIDE_M)


@part
def _bucket(at: float, side: float, count: int) -> int:
    return min(max(int(np.floor(at / side)), 0), count - 1)


@part
def _slab(
    xs: tuple[float, float, float, float, float, float],
    ys: tuple[float, float, float, float, float, float],
    west: float,
    east: float,
) -> tuple[float, float]:
    """Return the range of y, within a slab of x, of the convex hull of six points, and a bit more.

    It is that of the straight ways between any two of them.
    """
    west, east = west - 1e-6, east + 1e-6
    south, north = np.inf, -np.inf
    for i in range(6):
        for j in range(i, 6):
            x0, y0, x1, y1 = xs[i], ys[i], xs[j], ys[j]
            if x0 > x1:
                x0, y0, x1, y1 = x1, y1, x0, y0
            if x1 < west or x0 > east:
                continue
            first = y0 if x0 >= west else y0 + (y1 - y0) * ((west - x0) / (x1 - x0))
            last = y1 if x1 <= east else y0 + (y1 - y0) * ((east - x0) / (x1 - x0))
            south = min(south, first, last)
            north = max(north, first, last)
    return south - 1e-6, north + 1e-6


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
            if number < len(buffers.blocked):
                stretch = buffers.blocked[number]
                stretch.since_s, stretch.until_s = at + since, at + high
            number += 1
            since = -1.0
    return number


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
    """Write where a polynomial changes its sign, and return the number of times then."""
    changes, roots = sign_changes(c, c[0] > 0.0, end, 0.0)
    for k in range(changes):
        times[count + k] = roots[k]
    return count + changes


@kernel
def _blocks(line: Line, s: float, buildings: Buildings, b: int) -> bool:
    """Return whether a building contains a stretch of a line, s seconds on."""
    (ux, uy, uz), (px, py, pz) = _ends(line, s)
    begin, end = 0.0, 1.0
    first, last = buildings.offsets[b], buildings.offsets[b + 1]
    for k in range(first, last):
        x, y, ex, ey = _wall(buildings.corners, k, first, last)
        near = ex * (uy - y) - ey * (ux - x)
        far = ex * (py - y) - ey * (px - x)
        if near <= 0.0 and far <= 0.0:
            return False
        if near < 0.0:
            begin = max(begin, near / (near - far))
        elif far < 0.0:
            end = min(end, near / (near - far))
    if not begin < end:
        return False
    lowest = min(uz + begin * (pz - uz), uz + end * (pz - uz))
    return bool(lowest < buildings.roofs_m[b])


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
