"""Pass two: when users enter and leave a footprint, as roots of |drone(t) - user(t)| = R.

The roots are computed, by safeguarded methods, for the users whom pass one (``model.coverage``)
does not discard; nothing is sampled. A piece is a stretch of time in which drone and user both keep
their acceleration: the squared distance is quadratic there while the drone coasts and quartic while
it accelerates. The sign of (distance - R) is carried from piece to piece, so entries and exits
alternate whatever the rounding, and a tangent is never an entry without an exit.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from desim_uav.model.compiled_registers import either
from desim_uav.model.coverage import (
    AT_X,
    AT_Y,
    LEG,
    MARGIN_M,
    NEAR,
    START_FAR,
    START_NEAR,
    STOP_FAR,
    STOP_NEAR,
    T0_US,
    VX,
    VY,
    X0,
    Y0,
    Buckets,
    DroneLeg,
    Users,
    bucket_of,
    comes_near,
    leg_near,
    walked,
    ways_of,
)
from desim_uav.model.kernels import kernel, part
from desim_uav.model.motion import ACCELERATION, DISTANCE, SPEED, START

GRAZE_M = 1e-13
"""How close to the radius, in metres, an extremum of the distance touches it without a crossing."""

TIME_US, USER, ENTERS = range(3)
"""The columns of a table of crossings: time in µs, user, and 1 for an entry or 0 for an exit."""

MOST_REST = 2
"""A profile with more rows than this has at least two phases before the rest."""

Points = tuple[float, float, float]


class Relative(NamedTuple):
    """A drone relative to a user at the start of a piece: position, velocity and acceleration."""

    px: float
    py: float
    wx: float
    wy: float
    ax: float
    ay: float


@kernel
def crossings(leg: DroneLeg, users: Users, out: NDArray[np.int64]) -> int:
    """Write all entries and exits of one drone's leg, for all users, and return their number.

    ``look_around`` must have written ``users.seen`` for the leg's span. Rows (time, user, enters)
    are written into ``out`` (buffer, 3), user by user in order of time; rows that do not fit are
    counted but not written. An entry and an exit in the same microsecond cancel.
    """
    seen, fresh = users.seen, leg.fresh
    flight, stay = ways_of(leg)
    for user in range(len(users.offsets) - 1):  # a loop of its own, so that it can be vectorised
        seen[NEAR, user] = comes_near(flight, seen, user, fresh)
    if stay.end > stay.begin:
        for user in range(len(users.offsets) - 1):
            seen[NEAR, user] = max(seen[NEAR, user], comes_near(stay, seen, user, fresh))
    near = 0
    for user in range(len(users.offsets) - 1):  # without branches, which cannot be predicted
        is_near = int(seen[NEAR, user])
        seen[NEAR, near] = user
        near += is_near
    total = 0
    for k in range(near):
        total = cross(leg, users, int(seen[NEAR, k]), out, total)
    return total


@kernel
def crossings_near(
    leg: DroneLeg, users: Users, buckets: Buckets, far_m: float, out: NDArray[np.int64]
) -> int:
    """Write the same crossings as ``crossings``, but examine only users in buckets near the leg.

    ``far_m`` is the distance that ``sort_into_buckets`` has returned. Rows are in the order of the
    buckets.
    """
    x0, y0, x1, y1 = leg.route
    seen, fresh, shape, side = users.seen, leg.fresh, buckets.shape, buckets.side_m
    flight, stay = ways_of(leg)
    reach = leg.radius_m + far_m + MARGIN_M
    total = 0
    for i in range(
        bucket_of(min(x0, x1) - reach, side[0], shape[0]),
        bucket_of(max(x0, x1) + reach, side[0], shape[0]) + 1,
    ):
        for j in range(
            bucket_of(min(y0, y1) - reach, side[1], shape[1]),
            bucket_of(max(y0, y1) + reach, side[1], shape[1]) + 1,
        ):
            user = buckets.heads[i * shape[1] + j]
            while user >= 0:
                if comes_near(flight, seen, user, fresh) + comes_near(stay, seen, user, fresh):
                    total = cross(leg, users, user, out, total)
                user = buckets.following[user]
    return total


@part
def cross(leg: DroneLeg, users: Users, user: int, out: NDArray[np.int64], total: int) -> int:
    """Write the crossings of a user in order of time, and return the new total."""
    x, y = leg.route[0] - users.seen[AT_X, user], leg.route[1] - users.seen[AT_Y, user]
    inside = beyond(x, y, leg.radius_m) <= 0.0
    latest = -1
    if leg.fresh and inside:
        latest = leg.span_us[0]
        total = _write(out, total, latest, user, True)
    return _roots(leg, users, user, inside, latest, out, total)


@part
def _roots(
    leg: DroneLeg,
    users: Users,
    user: int,
    inside: bool,
    latest: int,
    out: NDArray[np.int64],
    total: int,
) -> int:
    """Write the crossings of a user who is ``inside`` at the start; return the new total.

    ``latest`` is the time of the last crossing that has been written, or -1 if there is none.
    """
    profile, legs, radius = leg.profile, users.legs, leg.radius_m
    start_us, end_us = leg.span_us
    duration = (end_us - start_us) * 1e-6
    stop = users.offsets[user + 1]
    walk = first = users.offsets[user] + int(users.seen[LEG, user])
    phase = 0
    at = 0.0
    while at < duration:
        while phase + 1 < len(profile) and profile[phase + 1, START] <= at:
            phase += 1
        while walk + 1 < stop and (legs[walk + 1, T0_US] - start_us) * 1e-6 <= at:
            walk += 1
        end = duration
        if phase + 1 < len(profile):
            end = min(end, profile[phase + 1, START])
        if walk + 1 < stop:
            end = min(end, (legs[walk + 1, T0_US] - start_us) * 1e-6)
        piece = _relative(leg, legs, phase, walk, at)
        if _stays_away(piece, radius, end - at):
            at = end
            continue
        turning, points = _turning_points(piece, end - at)
        before = 0.0
        for k in range(turning + 1):
            after = end - at
            if k < turning:
                after = points[k]
            if k == turning and end >= duration:
                last = walk
                if walk + 1 < stop and legs[walk + 1, T0_US] <= end_us:
                    last = leg_near(legs, first, stop, end_us, walk)
                now_inside = _is_inside(leg, legs, last)
            else:
                excess = _excess(piece, radius, after)
                grazes = k < turning and abs(excess) <= 2.0 * GRAZE_M * radius
                now_inside = inside if grazes else excess <= 0.0
            if now_inside != inside:
                root = _root(piece, radius, before, after, now_inside)
                t_us = _rounded_us(start_us, at + root)
                if t_us == latest:
                    total -= 1
                    latest = -1
                else:
                    total = _write(out, total, t_us, user, now_inside)
                    latest = t_us
                inside = now_inside
            before = after
        at = end
    return total


@part
def cross_rings(
    leg: DroneLeg,
    users: Users,
    user: int,
    radii: NDArray[np.float64],
    first: int,
    stop: int,
    out: NDArray[np.int64],
    total: int,
) -> int:
    """Write when a user passes into another ring, in order of time; return the new total.

    The circles ``first`` … ``stop`` - 1, the widest first, may be crossed; the user stays within
    the wider ones and outside the narrower ones. Rows are (time, user, change): the change is the
    number of circles around the user if it rises, and minus this number if it falls. The times are
    those of ``cross`` for each circle alone, and crossings in the same microsecond are one change,
    or cancel.
    """
    profile, legs = leg.profile, users.legs
    start_us, end_us = leg.span_us
    duration = (end_us - start_us) * 1e-6
    x, y = leg.route[0] - users.seen[AT_X, user], leg.route[1] - users.seen[AT_Y, user]
    now = min(max(wider(radii, np.sqrt(x * x + y * y)), first), stop)
    while now < stop and beyond(x, y, radii[now]) <= 0.0:
        now += 1
    while now > first and beyond(x, y, radii[now - 1]) > 0.0:
        now -= 1
    held, latest, noted = now, start_us - 1, 0
    bounded = len(profile) > MOST_REST
    if leg.fresh:
        held, latest, noted = 0, start_us, int(now > 0)
        total = _write(out, total, start_us, user, now) if noted else total
    end_walk = users.offsets[user + 1]
    walk = begin_walk = users.offsets[user] + int(users.seen[LEG, user])
    phase = 0
    at = 0.0
    while at < duration:
        while phase + 1 < len(profile) and profile[phase + 1, START] <= at:
            phase += 1
        if bounded and (phase == 0 or phase == len(profile) - 2):
            near, far = (START_NEAR, START_FAR) if phase == 0 else (STOP_NEAR, STOP_FAR)
            stays_in = now == first or radii[now - 1] > users.seen[far, user]
            if stays_in and (now == stop or radii[now] < users.seen[near, user]):
                at = min(profile[phase + 1, START], duration)
                continue
        while walk + 1 < end_walk and (legs[walk + 1, T0_US] - start_us) * 1e-6 <= at:
            walk += 1
        end = duration
        if phase + 1 < len(profile):
            end = min(end, profile[phase + 1, START])
        if walk + 1 < end_walk:
            end = min(end, (legs[walk + 1, T0_US] - start_us) * 1e-6)
        piece = _relative(leg, legs, phase, walk, at)
        moved, apart = _moved(piece, end - at)
        stays_in = now == first or _is_within(radii[now - 1], moved, apart)
        if stays_in and (now == stop or _is_beyond(radii[now], moved, apart)):
            at = end
            continue
        coast = _coast(piece)
        turning, points = _turning_points(piece, end - at)
        before = 0.0
        for j in range(turning + 1):
            after, graze = end - at, -1.0
            if j < turning:
                after, graze = points[j], 2.0 * GRAZE_M
            if j == turning and end >= duration:
                last = walk
                if walk + 1 < end_walk and legs[walk + 1, T0_US] <= end_us:
                    last = leg_near(legs, begin_walk, end_walk, end_us, walk)
                x, y = walked(legs, last, end_us)
                x, y = leg.route[2] - x, leg.route[3] - y
            else:
                x, y = _at(piece, after)
            while True:
                enters = now < stop and _passes(beyond(x, y, radii[now]), radii[now], graze, True)
                if not enters and (
                    now == first
                    or not _passes(beyond(x, y, radii[now - 1]), radii[now - 1], graze, False)
                ):
                    break
                ring = now if enters else now - 1
                root = _root_of(piece, coast, radii[ring], before, after, enters)
                t_us = _rounded_us(start_us, at + root)
                if t_us > latest:
                    held, latest, noted = now, t_us, 0
                now = ring + 1 if enters else ring
                total -= noted
                noted = int(now != held)
                if noted:
                    total = _write(out, total, latest, user, now if now > held else -now)
            before = after
        at = end
    return total


@part
def wider(radii_m: NDArray[np.float64], distance_m: float) -> int:
    """Return how many circles, the widest first, are wider than a distance.

    The code has no branches, which could not be predicted.
    """
    first, count = 0, len(radii_m)
    while count > 1:
        half = count >> 1
        first = either(radii_m[first + half - 1] > distance_m, first + half, first)
        count -= half
    return first + int(radii_m[first] > distance_m)


@part
def _passes(excess: float, radius: float, graze: float, enters: bool) -> bool:
    """Return whether an excess is inside, or outside, and more than a touch of the circle."""
    return (excess <= 0.0) == enters and abs(excess) > graze * radius


@part
def _rounded_us(start_us: int, since_s: float) -> int:
    """Return the time this many seconds after the start, in whole microseconds."""
    return start_us + int(np.rint(since_s * 1e6))


@kernel
def _write(out: NDArray[np.int64], total: int, t_us: int, user: int, enters: int) -> int:
    if total < len(out):
        out[total, TIME_US] = t_us
        out[total, USER] = user
        out[total, ENTERS] = enters
    return total + 1


@kernel
def _is_inside(leg: DroneLeg, legs: NDArray[np.float64], walk: int) -> bool:
    """Return whether a user is in the closed disc around the drone at the end of its leg.

    The same test applies at both ends of every leg.
    """
    x, y = walked(legs, walk, leg.span_us[1])
    return beyond(leg.route[2] - x, leg.route[3] - y, leg.radius_m) <= 0.0


@kernel
def beyond(x: float, y: float, radius: float) -> float:
    """Return x² + y² - R², without cancellation where the larger coordinate makes up the radius."""
    x, y = abs(x), abs(y)
    if x < y:
        x, y = y, x
    return (x - radius) * (x + radius) + y * y


@part
def _relative(
    leg: DroneLeg, legs: NDArray[np.float64], phase: int, walk: int, at: float
) -> Relative:
    """Return a drone in a phase of its transit relative to a user on a walk, at a time."""
    profile, (x0, y0, x1, y1) = leg.profile, leg.route
    ex, ey = _sign(x1 - x0), _sign(y1 - y0)
    since = at - profile[phase, START]
    acceleration = profile[phase, ACCELERATION]
    speed = profile[phase, SPEED] + acceleration * since
    along = profile[phase, DISTANCE] + 0.5 * (profile[phase, SPEED] + speed) * since
    since_walk = at - (legs[walk, T0_US] - leg.span_us[0]) * 1e-6
    if phase + 1 == len(profile):
        px, py = x1, y1
    else:
        px, py = x0 + ex * along, y0 + ey * along
    px -= legs[walk, X0] + legs[walk, VX] * since_walk
    py -= legs[walk, Y0] + legs[walk, VY] * since_walk
    wx, wy = ex * speed - legs[walk, VX], ey * speed - legs[walk, VY]
    return Relative(px, py, wx, wy, ex * acceleration, ey * acceleration)


@part
def _sign(x: float) -> float:
    if x > 0.0:
        return 1.0
    return -1.0 if x < 0.0 else 0.0


@part
def _stays_away(piece: Relative, radius: float, span_s: float) -> bool:
    """Return whether a piece is too short for the user to reach the edge of the footprint."""
    moved, apart = _moved(piece, span_s)
    return _is_beyond(radius, moved, apart) or _is_within(radius, moved, apart)


@part
def _moved(piece: Relative, span_s: float) -> tuple[float, float]:
    """Return how far drone and user move at most, and the square of how far apart they begin."""
    px, py, wx, wy, ax, ay = piece
    moved = (abs(wx) + abs(wy) + 0.5 * (abs(ax) + abs(ay)) * span_s) * span_s + MARGIN_M
    return moved, px * px + py * py


@part
def _is_beyond(radius: float, moved: float, apart: float) -> bool:
    """Return whether a user who is this far apart stays outside the circle."""
    return apart > (radius + moved) * (radius + moved)


@part
def _is_within(radius: float, moved: float, apart: float) -> bool:
    """Return whether a user who is this far apart stays inside the circle."""
    within = max(radius - moved, 0.0)
    return apart < within * within


@kernel
def _at(piece: Relative, t: float) -> tuple[float, float]:
    """Return the position t seconds into a piece."""
    x = piece.px + t * (piece.wx + 0.5 * piece.ax * t)
    y = piece.py + t * (piece.wy + 0.5 * piece.ay * t)
    return x, y


@kernel
def _excess(piece: Relative, radius: float, t: float) -> float:
    """Return the squared distance minus the squared radius, t seconds into a piece."""
    x, y = _at(piece, t)
    return beyond(x, y, radius)


@kernel
def _slope(piece: Relative, t: float) -> float:
    """Return half the derivative of the squared distance."""
    x, y = _at(piece, t)
    return x * (piece.wx + piece.ax * t) + y * (piece.wy + piece.ay * t)


@kernel
def _turning_points(piece: Relative, end: float) -> tuple[int, Points]:
    """Return the number of extrema of the distance inside (0, end), and their times in seconds."""
    px, py, wx, wy, ax, ay = piece
    slope = px * wx + py * wy
    ww = wx * wx + wy * wy
    if ax == 0.0 and ay == 0.0:
        if ww > 0.0 and slope < 0.0 and -slope < ww * end:
            return 1, (-slope / ww, end, end)
        return 0, (end, end, end)
    # The slope is a cubic; between the roots of its derivative it is monotone.
    a = 1.5 * (ax * ax + ay * ay)
    b = 3.0 * (ax * wx + ay * wy)
    c = ww + ax * px + ay * py
    splits = (end, end)
    discriminant = b * b - 4.0 * a * c
    if discriminant > 0.0:
        q = -0.5 * (b + np.sqrt(discriminant)) if b >= 0.0 else -0.5 * (b - np.sqrt(discriminant))
        r1 = q / a
        r2 = c / q if q != 0.0 else r1
        splits = (min(r1, r2), max(r1, r2))
    count = 0
    points = (end, end, end)
    low = 0.0
    low_slope = slope
    for k in range(3):
        high = splits[k] if k < 2 else end
        if high <= low or (k < 2 and high >= end):
            continue
        high_slope = _slope(piece, high)
        if low_slope * high_slope < 0.0:
            found = _slope_root(piece, low, high, low_slope < 0.0)
            points = (
                found if count == 0 else points[0],
                found if count == 1 else points[1],
                found if count == 2 else points[2],
            )
            count += 1
        low, low_slope = high, high_slope
    return count, points


@kernel
def _slope_root(piece: Relative, low: float, high: float, rising: bool) -> float:
    """Return the zero of the slope between two times where it is monotone.

    It is found by Newton's method, safeguarded by bisection.
    """
    t = 0.5 * (low + high)
    for _ in range(80):  # pragma: no branch (it has converged long before)
        value = _slope(piece, t)
        if (value < 0.0) == rising:
            low = t
        else:
            high = t
        vx, vy = piece.wx + piece.ax * t, piece.wy + piece.ay * t
        x, y = _at(piece, t)
        derivative = vx * vx + vy * vy + x * piece.ax + y * piece.ay
        step = t - value / derivative if derivative != 0.0 else low
        if not low < step < high:
            step = 0.5 * (low + high)
        if abs(step - t) <= 1e-13 * max(1.0, t) or step <= low or step >= high:
            return step
        t = step
    return t  # pragma: no cover


class Coast(NamedTuple):
    """Numbers of a piece without acceleration, of which the times of crossings are computed.

    Half the derivative of the squared distance at the start, the distance then, the square of the
    speed, the speed, and the cross product of position and velocity.
    """

    slope: float
    distance: float
    square: float
    speed: float
    cross: float


@part
def _coast(piece: Relative) -> Coast:
    px, py, wx, wy, _, _ = piece
    square = wx * wx + wy * wy
    return Coast(
        px * wx + py * wy,
        np.sqrt(px * px + py * py),
        square,
        np.sqrt(square),
        px * wy - py * wx,
    )


@kernel
def _root(piece: Relative, radius: float, low: float, high: float, enters: bool) -> float:
    """Return the time in [low, high] at which the distance, which is monotone there, is R."""
    return _root_of(piece, _coast(piece), radius, low, high, enters)


@part
def _root_of(
    piece: Relative, coast: Coast, radius: float, low: float, high: float, enters: bool
) -> float:
    """Return the same time as ``_root``."""
    if piece.ax == 0.0 and piece.ay == 0.0:
        # Quadratic: |w|² t² + 2 (p·w) t + |p|² - R² = 0, without cancellation in either term.
        b, distance, a, speed, cross = coast
        c = (distance - radius) * (distance + radius)
        discriminant = (speed * radius - cross) * (speed * radius + cross)
        if a == 0.0:
            return low
        root = np.sqrt(max(discriminant, 0.0))
        q = -b - root if b >= 0.0 else -b + root
        r1 = q / a
        r2 = c / q if q != 0.0 else r1
        t = min(r1, r2) if enters else max(r1, r2)
        return float(min(max(t, low), high))
    return _accelerated_root(piece, radius, low, high, enters)


@kernel
def _accelerated_root(
    piece: Relative, radius: float, low: float, high: float, enters: bool
) -> float:
    """Return the same time as ``_root``, by Newton's method that is safeguarded by bisection."""
    t = 0.5 * (low + high)
    for _ in range(80):
        value = _excess(piece, radius, t)
        if (value <= 0.0) != enters:
            low = t
        else:
            high = t
        derivative = 2.0 * _slope(piece, t)
        step = t - value / derivative if derivative != 0.0 else low
        if not low < step < high:
            step = 0.5 * (low + high)
        if abs(step - t) <= 1e-13 * max(1.0, t) or step <= low or step >= high:
            return step
        t = step
    return t
