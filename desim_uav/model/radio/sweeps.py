"""Lines of sight in a window of time, and which buildings may block them at all.

What is said here is on the safe side, for it saves the search for exact times
(``model.radio.sight``): a building that may block a line need not.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from desim_uav.model.radio.buildings import Buildings, Corner
from desim_uav.model.radio.tracks import Point, TrackRow, place, pulled, velocity
from desim_uav.rowcode.kernels import part
from desim_uav.rowcode.rows import Table

BESIDE_M = 1e-5
"""A building that is farther than this from all places of a line cannot block it."""

AROUND_M = 1e-6
"""By how much more than a line sweeps the buckets that are looked at are in its way."""

SHORT_M = 1e-3
"""Along an axis on which a line is shorter than this, all of it is looked at in each bucket."""

Place = tuple[float, float]


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


@part
def line_at(user: TrackRow, drone: TrackRow, t: float) -> Line:
    """Return the line of sight at a time, from rows of the tracks of the user and the drone."""
    return Line(
        place(user, t), velocity(user, t), place(drone, t), velocity(drone, t), pulled(drone)
    )


@part
def ends(line: Line, s: float) -> tuple[Point, Point]:
    """Return where the user and the drone are s seconds on."""
    (ux, uy, uz), (wx, wy, wz), (px, py, pz), (vx, vy, vz), (ax, ay, az) = line
    h = 0.5 * s
    return (
        (ux + s * wx, uy + s * wy, uz + s * wz),
        (px + s * (vx + h * ax), py + s * (vy + h * ay), pz + s * (vz + h * az)),
    )


@part
def window_of(line: Line, since: float, until: float) -> Window:
    """Return where a line is at the two ends of a time."""
    (one, start), (other, stop) = ends(line, since), ends(line, until)
    return Window(since, until, one, other, start, stop)


@part
def may_block(window: Window, buildings: Buildings, b: int) -> bool:
    """Return whether a building may block a line in a window of time.

    It cannot if what the line sweeps below the roof is all beyond a wall, or if the building is all
    on one side of what the line sweeps: both by more than ``BESIDE_M``.
    """
    one, other, start, stop = window.one, window.other, window.start, window.stop
    share, low, high = 1.0, min(one[2], other[2]), min(start[2], stop[2])
    if high > low:
        share = min(max((buildings.roofs_m[b] + BESIDE_M - low) / (high - low), 0.0), 1.0)
    first, last = buildings.offsets[b], buildings.offsets[b + 1]
    if _is_beside(window, share, one, start, buildings, b):
        return False
    for k in range(first, last):
        x, y, ex, ey = wall(buildings.corners, k, first, last)
        if _extent(window, share, (x, y), ex, ey)[1] < -BESIDE_M * (abs(ex) + abs(ey)):
            return False
    return not _is_beside(window, share, other, stop, buildings, b)


@part
def keeps_blocking(window: Window, buildings: Buildings, b: int) -> bool:
    """Return whether it is certain that a building blocks a line throughout a window of time.

    The places of one end from which a line to another place meets a convex building, its shadow,
    are convex. So all lines between two straight ways are blocked if those between their ends are.
    """
    one, other, start, stop = window.one, window.other, window.start, window.stop
    return (
        contains(one, start, buildings, b, BESIDE_M)
        and contains(other, stop, buildings, b, BESIDE_M)
        and contains(one, stop, buildings, b, BESIDE_M)
        and contains(other, start, buildings, b, BESIDE_M)
    )


@part
def _extent(window: Window, share: float, at: Place, ex: float, ey: float) -> tuple[float, float]:
    """Return how far a part of a line is to the left of another line, at least and at most.

    It is the first part of the line, of this ``share``, in a window of time. The other line goes
    through ``at`` along (ex, ey), by whose length the numbers are multiplied.
    """
    one, other = _left(window.one, at, ex, ey), _left(window.other, at, ex, ey)
    start, stop = _left(window.start, at, ex, ey), _left(window.stop, at, ex, ey)
    least, most, rest = min(one, other), max(one, other), 1.0 - share
    return (
        min(least, rest * least + share * min(start, stop)),
        max(most, rest * most + share * max(start, stop)),
    )


@part
def _left(point: Point, at: Place, ex: float, ey: float) -> float:
    return ex * (point[1] - at[1]) - ey * (point[0] - at[0])


@part
def _is_beside(
    window: Window, share: float, user: Point, drone: Point, buildings: Buildings, b: int
) -> bool:
    """Return whether a building is all to the left or to the right of what a line sweeps.

    The line of sight that decides what is left is the one between ``user`` and ``drone``.
    """
    at, ex, ey = (user[0], user[1]), drone[0] - user[0], drone[1] - user[1]
    least, most = _extent(window, share, at, ex, ey)
    south, north = np.inf, -np.inf
    for k in range(buildings.offsets[b], buildings.offsets[b + 1]):
        corner = buildings.corners[k]
        left = ex * (corner.y_m - at[1]) - ey * (corner.x_m - at[0])
        south, north = min(south, left), max(north, left)
    margin = BESIDE_M * (abs(ex) + abs(ey))
    return bool(south > most + margin or north < least - margin)


@part
def contains(user: Point, drone: Point, buildings: Buildings, b: int, margin: float) -> bool:
    """Return whether a building contains a stretch of a line, a margin within its walls and roof.

    It is as many metres from walls, or a bit more, times what x and y change along a wall.
    """
    (ux, uy, uz), (px, py, pz) = user, drone
    begin, end = 0.0, 1.0
    first, last = buildings.offsets[b], buildings.offsets[b + 1]
    for k in range(first, last):
        x, y, ex, ey = wall(buildings.corners, k, first, last)
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
def wall(
    corners: Table[Corner], k: int, first: int, last: int
) -> tuple[float, float, float, float]:
    """Return a corner of a footprint, and how far the next one is away along x and y."""
    corner, following = corners[k], corners[k + 1 if k + 1 < last else first]
    return corner.x_m, corner.y_m, following.x_m - corner.x_m, following.y_m - corner.y_m


@part
def sweep_of(user: float, later: float, drone: float, after: float, share: float) -> Sweep:
    """Return what the first part of a line, of this share, sweeps along an axis.

    The user goes from ``user`` to ``later``, and the drone from ``drone`` to ``after``.
    """
    middle, half = 0.5 * (user + later), 0.5 * abs(later - user)
    goes = share * (0.5 * (drone + after) - middle)
    far = (1.0 - share) * half + share * 0.5 * abs(after - drone)
    return Sweep(middle, goes, half + AROUND_M, far + AROUND_M)


@part
def share_below(low: float, high: float, tallest_m: float) -> float:
    """Return the share of a line, from the user on, that is below the tallest roof, or -1 if none.

    ``low`` and ``high`` are the least altitudes of the user and of the drone.
    """
    if low >= tallest_m:
        return -1.0 if high >= tallest_m else 1.0
    return (tallest_m - low) / (high - low) if high > tallest_m else 1.0


@part
def rows_of(sweep: Sweep, side: float, count: int) -> tuple[int, int, int]:
    """Return the first and the last row of buckets that are swept, and the step between rows."""
    to = sweep.at + sweep.goes
    low = bucket_of(min(sweep.at - sweep.near, to - sweep.far), side, count)
    high = bucket_of(max(sweep.at + sweep.near, to + sweep.far), side, count)
    return (high, low, -1) if sweep.goes < 0.0 else (low, high, 1)


@part
def shares(sweep: Sweep, row: int, side: float, count: int) -> tuple[float, float]:
    """Return the first and the last share of what is swept that may be in a row of buckets."""
    if abs(sweep.goes) < SHORT_M:
        return 0.0, 1.0
    low = row * side if row > 0 else -np.inf
    high = (row + 1) * side if row + 1 < count else np.inf
    wide = max(sweep.near, sweep.far)
    one = (low - wide - sweep.at) / sweep.goes
    other = (high + wide - sweep.at) / sweep.goes
    return max(min(one, other), 0.0), min(max(one, other), 1.0)


@part
def range_at(sweep: Sweep, share: float) -> tuple[float, float]:
    """Return between which places along an axis the line is at a share of what is swept."""
    middle, half = sweep.at + share * sweep.goes, sweep.near + share * (sweep.far - sweep.near)
    return middle - half, middle + half


@part
def bucket_of(at: float, side: float, count: int) -> int:
    """Return the row of buckets of a place along an axis: the nearest one if it is off the map."""
    return min(max(int(np.floor(at / side)), 0), count - 1)
