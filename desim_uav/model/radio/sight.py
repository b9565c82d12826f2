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

from desim_uav.model.geometry.polynomial import Coefficients, sign_changes
from desim_uav.model.geometry.relative import rounded_us
from desim_uav.model.radio.buildings import Buffers, Buildings, Stretch
from desim_uav.model.radio.sweeps import (
    BESIDE_M,
    Line,
    Window,
    bucket_of,
    contains,
    ends,
    keeps_blocking,
    line_at,
    may_block,
    range_at,
    rows_of,
    share_below,
    shares,
    sweep_of,
    wall,
    window_of,
)
from desim_uav.model.radio.tracks import (
    Rows,
    TrackRow,
    Turn,
    next_s,
    note,
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


FARTHER = 1.0 + 1e-9
"""A polynomial whose first coefficient exceeds all its other terms by this factor has no root, also
if it is rounded."""

FEW = 2
"""If no more buildings than this may block a line in a window of time, it is not halved."""

HALVINGS = 4
"""How often a window of time is halved at most."""


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
        stretches = _look(
            line_at(tracks[i], tracks[j], at), at, until, buildings, buffers, stretches
        )
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
    line = line_at(user, drone, t)
    return BLOCKED if _look(line, t, t, buildings, buffers, 0) > 0 else CLEAR


@kernel
def _look(
    line: Line, at: float, until: float, buildings: Buildings, buffers: Buffers, count: int
) -> int:
    """Add the stretches of time in which buildings block a line; return how many there are then.

    Only the times that matter are computed: those of buildings that may block the line in a window
    of time in which no single building blocks it throughout. Windows with more than ``FEW`` such
    buildings are halved, ``HALVINGS`` times at most. Rows that the buffers cannot hold are counted
    only.
    """
    end = until - at
    if not end > 0.0:
        return _look_in(line, at, until, window_of(line, 0.0, 0.0), True, buildings, buffers, count)
    since, width, least = 0.0, end, end * 0.5**HALVINGS
    while since < end:
        stop = since + width if since + width < end - 0.5 * least else end
        window, leaf = window_of(line, since, stop), width <= least
        after = _look_in(line, at, until, window, leaf, buildings, buffers, count)
        if after >= 0:
            count, since, width = after, stop, 2.0 * width
        else:
            width *= 0.5
    return count


@kernel
def _look_in(
    line: Line,
    at: float,
    until: float,
    window: Window,
    leaf: bool,
    buildings: Buildings,
    buffers: Buffers,
    count: int,
) -> int:
    """Add the stretches of buildings that matter in a window; return how many there are then.

    Returns -1, and adds none, if the window is to be halved, but never if it is a ``leaf``. Looked
    at are the buildings in the buckets that the line sweeps, those near the user first. Only the
    part of the line below the tallest roof counts, and in each row of buckets only the buildings
    that are higher than the line is there.
    """
    (ux, uy, uz), (tx, ty, tz), (px, py, pz), (qx, qy, qz) = (
        window.one,
        window.other,
        window.start,
        window.stop,
    )
    low, high = min(uz, tz), min(pz, qz)
    share = share_below(low, high, buildings.tallest_m)
    if share < 0.0:
        return count
    begun, partly, others = count, 0, (-1, -1, -1)
    stamp = buffers.visited[len(buffers.visited) - 1] + 1
    buffers.visited[len(buffers.visited) - 1] = stamp
    along, across = sweep_of(ux, tx, px, qx, share), sweep_of(uy, ty, py, qy, share)
    (count_along, count_across), (side, side_across) = buildings.shape, buildings.side_m
    stride, stride_across = count_across, 1
    if abs(across.goes) > abs(along.goes):
        along, across = across, along
        count_along, count_across = count_across, count_along
        side, side_across = side_across, side
        stride, stride_across = 1, stride
    first, last, step = rows_of(along, side, count_along)
    for i in range(first, last + step, step):
        begin, end = shares(along, i, side, count_along)
        if begin > end:
            continue
        over_m = low + (high - low) * share * (begin if high > low else end) - BESIDE_M
        (one, other), (width, far) = range_at(across, begin), range_at(across, end)
        south = bucket_of(min(one, width), side_across, count_across)
        north = bucket_of(max(other, far), side_across, count_across)
        for j in range(south, north + 1):
            bucket = i * stride + j * stride_across
            for k in range(buildings.heads[bucket], buildings.heads[bucket + 1]):
                b = buildings.members[k]
                if buildings.roofs_m[b] > over_m and buffers.visited[b] != stamp:
                    buffers.visited[b] = stamp
                    if may_block(window, buildings, b):
                        if keeps_blocking(window, buildings, b):
                            return _add_stretch(
                                buffers, begun, at + window.since_s, at + window.until_s
                            )
                        if leaf:
                            count = _stretches(line, at, until, buildings, b, buffers, count)
                        others = (b, others[0], others[1])
                        partly += 1
    if not leaf:
        if partly > FEW:
            return -1
        for k in range(partly):
            count = _stretches(line, at, until, buildings, others[k], buffers, count)
    return count


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
        x, y, ex, ey = wall(buildings.corners, k, first, last)
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
    user, drone = ends(line, s)
    return contains(user, drone, buildings, b, 0.0)


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
