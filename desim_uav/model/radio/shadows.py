"""The stretches of time in which one building blocks the line between a user and a drone.

The times at which this may change (``model.radio.sight``) are roots of polynomials of degree three
or less, for the user walks straight and the drone keeps its acceleration. Between two of them the
state is decided once, at the time in the middle.
"""

from __future__ import annotations

from desim_uav.model.geometry.polynomial import APART, Coefficients, near_changes, sign_changes
from desim_uav.model.radio.buildings import Buffers, Buildings
from desim_uav.model.radio.sweeps import BESIDE_M, Line, contains, ends, wall
from desim_uav.rowcode.kernels import kernel, part
from desim_uav.rowcode.rows import Floats

FARTHER = 1.0 + 1e-9
"""A polynomial whose first coefficient exceeds all its other terms by this factor has no root, also
if it is rounded."""

MOST_ROOTS = 4
"""More than the most roots of a polynomial of a building."""


@kernel
def stretches_of(
    line: Line,
    at: float,
    until: float,
    buildings: Buildings,
    b: int,
    buffers: Buffers,
    number: int,
) -> int:
    """Add the stretches of time in which one building blocks a line.

    Most of the times at which it may begin or cease to block the line are those at which it does
    not. So the times are first found nearly, which shows between which of them it does, if they are
    far enough from each other, and the line from what it would only touch. Then only the times at
    which the state changes have to be exact.
    """
    end, times = until - at, buffers.times
    count = _times(line, end, buildings, b, times, True)
    after = _add_stretches(line, at, until, buildings, b, buffers, number, count, True)
    if after >= 0:
        return after
    count = _times(line, end, buildings, b, times, False)
    return _add_stretches(line, at, until, buildings, b, buffers, number, count, False)


@kernel
def _add_stretches(
    line: Line,
    at: float,
    until: float,
    buildings: Buildings,
    b: int,
    buffers: Buffers,
    number: int,
    count: int,
    nearly: bool,
) -> int:
    """Add the stretches of a building from so many times; return how many stretches there are then.

    If the times are ``nearly`` right, those that matter are found exactly, or -1 is returned.
    """
    times, end, since = buffers.times, until - at, -1.0
    for k in range(count + 1):
        low = times[k - 1] if k > 0 else 0.0
        high = times[k] if k < count else end
        if nearly and count > 0 and high - low < APART:
            return -1
        blocks = _blocks(line, 0.5 * (low + high), buildings, b, BESIDE_M if nearly else 0.0)
        if nearly and not blocks and _blocks(line, 0.5 * (low + high), buildings, b, -BESIDE_M):
            return -1
        if blocks:
            if since < 0.0:
                since = _exactly(line, end, buildings, b, times, k - 1) if nearly and k > 0 else low
            if k < count:
                continue
            high = end
        elif since >= 0.0:
            high = _exactly(line, end, buildings, b, times, k - 1) if nearly else low
        if since >= 0.0:
            number = add_stretch(buffers, number, at + since, at + high)
            since = -1.0
    return number


@part
def add_stretch(buffers: Buffers, number: int, since_s: float, until_s: float) -> int:
    """Write a stretch of time if there is room for it, and return the number of them then."""
    if number < len(buffers.blocked):
        stretch = buffers.blocked[number]
        stretch.since_s, stretch.until_s = since_s, until_s
    return number + 1


@kernel
def _blocks(line: Line, s: float, buildings: Buildings, b: int, margin: float) -> bool:
    """Return whether a building contains a stretch of a line, s seconds on (see ``contains``)."""
    user, drone = ends(line, s)
    return contains(user, drone, buildings, b, margin)


@kernel
def _times(
    line: Line, end: float, buildings: Buildings, b: int, times: Floats, nearly: bool
) -> int:
    """Write all times inside (0, ``end``) at which one building may change the state, in order.

    The second half of ``times`` says of which polynomial they are, and the how-many-th time it is.
    """
    if not end > 0.0:
        return 0
    count, half = 0, len(times) // 2
    polynomials = 2 + 4 * (buildings.offsets[b + 1] - buildings.offsets[b])
    for number in range(polynomials):
        c = _polynomial(line, buildings, b, number)
        # It changes nowhere if it never comes as far as its first coefficient from there.
        most = end * (abs(c[1]) + end * (abs(c[2]) + end * abs(c[3])))
        if abs(c[0]) > FARTHER * most:
            continue
        if nearly:
            changes, roots = near_changes(c, c[0] > 0.0, end)
        else:
            changes, roots = sign_changes(c, c[0] > 0.0, end, 0.0)
        for k in range(changes):
            i = count
            while i > 0 and times[i - 1] > roots[k]:
                times[i], times[half + i] = times[i - 1], times[half + i - 1]
                i -= 1
            times[i], times[half + i] = roots[k], MOST_ROOTS * number + k
            count += 1
    return count


@kernel
def _exactly(
    line: Line, end: float, buildings: Buildings, b: int, times: Floats, which: int
) -> float:
    """Return exactly one of the times that are nearly right."""
    number, k = divmod(int(times[len(times) // 2 + which]), MOST_ROOTS)
    c = _polynomial(line, buildings, b, number)
    return sign_changes(c, c[0] > 0.0, end, 0.0)[1][k]


@part
def _polynomial(line: Line, buildings: Buildings, b: int, number: int) -> Coefficients:
    """Return a polynomial of the time that changes its sign where a building may change the state.

    There are two of the roof, and four of each wall and its first corner.
    """
    (ux, uy, uz), (wx, wy, wz), (px, py, pz), (vx, vy, vz), (ax, ay, az) = line
    ax, ay, az = 0.5 * ax, 0.5 * ay, 0.5 * az
    roof = buildings.roofs_m[b]
    # The user below the roof, and the drone above the user: polynomials of s.
    u = (uz - roof, wz)
    d = (pz - uz, vz - wz, az)
    if number == 0:
        return u[0], u[1], 0.0, 0.0, 0.0
    if number == 1:
        return u[0] + d[0], u[1] + d[1], d[2], 0.0, 0.0
    first, last = buildings.offsets[b], buildings.offsets[b + 1]
    kind = (number - 2) % 4
    x, y, ex, ey = wall(buildings.corners, first + (number - 2) // 4, first, last)
    cx, cy = x - ux, y - uy
    gx, gy = px - ux, py - uy
    hx, hy = vx - wx, vy - wy
    if kind == 0:  # The line passes a corner: (corner - user) x (drone - user) = 0.
        return (
            cx * gy - cy * gx,
            cx * hy - cy * hx - (wx * gy - wy * gx),
            cx * ay - cy * ax - (wx * hy - wy * hx),
            -(wx * ay - wy * ax),
            0.0,
        )
    # It passes the wall's line at the share n / g of its length: there it is at the roof.
    n = (cx * ey - cy * ex, -(wx * ey - wy * ex))
    g = (gx * ey - gy * ex, hx * ey - hy * ex, ax * ey - ay * ex)
    if kind == 1:
        return (
            u[0] * g[0] + n[0] * d[0],
            u[0] * g[1] + u[1] * g[0] + n[0] * d[1] + n[1] * d[0],
            u[0] * g[2] + u[1] * g[1] + n[0] * d[2] + n[1] * d[1],
            u[1] * g[2] + n[1] * d[2],
            0.0,
        )
    if kind == 2:
        return n[0], n[1], 0.0, 0.0, 0.0
    return n[0] - g[0], n[1] - g[1], -g[2], 0.0, 0.0
