"""When users enter and leave a footprint: the roots of |drone(t) - user(t)| = R, never sampled.

Two passes for each leg of a drone: a cheap classifier discards the users who cannot cross, then
the rest get safeguarded roots, piece by piece. A piece is a stretch of time in which drone and user
both keep their acceleration: the squared distance is quadratic there while the drone coasts and
quartic while it accelerates. The sign of (distance - R) is carried from piece to piece, so entries
and exits alternate whatever the rounding, and a tangent is never an entry without an exit.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from desim_uav.model.kernels import kernel, maker, part
from desim_uav.model.motion import ACCELERATION, DISTANCE, SPEED, START

T0_US, X0, Y0, VX, VY = range(5)
"""Columns of a table of user legs: a straight walk from (X0, Y0) that begins at T0_US."""

MARGIN_M = 1e-6
"""What is farther than this from crossing does not, whatever the rounding."""

LEG, AT_X, AT_Y, TO_X, TO_Y, STRAY, NEAR = range(7)
SEEN_ROWS = 7
"""Rows of a table of users in a span: which of their legs they begin it on, their place then and
at its end, how far they stray from the straight way between at an even speed; and whether a drone's
leg comes near (NEAR, of the drone looked at last)."""

FEWEST_BUCKETS = 48
"""With fewer than these a drone's reach is a good part of the map, and buckets save nothing."""

MOST_BUCKETS = 128
"""With more along an axis, emptying them costs more than they save."""

GRAZE_M = 1e-13
"""A distance that turns this close to the radius touches it: that is no crossing."""

Route = tuple[float, float, float, float]
Span = tuple[int, int]
Points = tuple[float, float, float]
Part = tuple[float, float, float, float, float, float, float, float]

TIME_US, USER, ENTERS = range(3)
"""Columns of a table of crossings."""


@kernel
def leg_at(legs: NDArray[np.float64], first: int, last: int, t_us: float) -> int:
    """The row of the last leg in ``first`` … ``last``-1 that has begun at ``t_us``."""
    low, high = first, last - 1
    while low < high:
        middle = (low + high + 1) // 2
        if legs[middle, T0_US] <= t_us:
            low = middle
        else:
            high = middle - 1
    return low


@part
def leg_near(legs: NDArray[np.float64], first: int, last: int, t_us: float, guess: int) -> int:
    """``leg_at``, looked for beside a guess before anywhere else."""
    leg = min(max(guess, first), last - 1)
    for _ in range(4):
        if leg > first and legs[leg, T0_US] > t_us:
            leg -= 1
        elif leg + 1 < last and legs[leg + 1, T0_US] <= t_us:
            leg += 1
        else:
            return leg
    return leg_at(legs, first, last, t_us)


@kernel
def walked(legs: NDArray[np.float64], leg: int, t_us: float) -> tuple[float, float]:
    """Where the walk of row ``leg`` stands at ``t_us``, in metres."""
    t = (t_us - legs[leg, T0_US]) * 1e-6
    return legs[leg, X0] + legs[leg, VX] * t, legs[leg, Y0] + legs[leg, VY] * t


@maker
def all_walked(
    legs: NDArray[np.float64], offsets: NDArray[np.int64], t_us: float
) -> NDArray[np.float64]:
    """Where all walks stand at ``t_us``: (users, 2), in metres."""
    places = np.empty((len(offsets) - 1, 2))
    for user in range(len(offsets) - 1):
        leg = leg_at(legs, offsets[user], offsets[user + 1], t_us)
        places[user] = walked(legs, leg, t_us)
    return places


@kernel
def look_around(
    legs: NDArray[np.float64],
    offsets: NDArray[np.int64],
    start_us: int,
    end_us: int,
    seen: NDArray[np.float64],
) -> None:
    """Where each user is at the start of a span and at its end, and how straight it walks.

    Into ``seen`` (SEEN_ROWS, users), the same for all drones that fly then. What it says of the
    span before, if anything, tells where to look first.
    """
    for user in range(len(offsets) - 1):
        begin, stop = offsets[user], offsets[user + 1]
        first = leg_near(legs, begin, stop, start_us, begin + int(seen[LEG, user]))
        last = first
        while last + 1 < stop and legs[last + 1, T0_US] < end_us:
            last += 1
        x, y = walked(legs, first, start_us)
        to_x, to_y = walked(legs, last, end_us)
        stray = 0.0
        for leg in range(first + 1, last + 1):
            share = (legs[leg, T0_US] - start_us) / (end_us - start_us)
            aside_x = legs[leg, X0] - x - (to_x - x) * share
            aside_y = legs[leg, Y0] - y - (to_y - y) * share
            stray = max(stray, abs(aside_x) + abs(aside_y))
        seen[LEG, user], seen[AT_X, user], seen[AT_Y, user] = first - begin, x, y
        seen[TO_X, user], seen[TO_Y, user], seen[STRAY, user] = to_x, to_y, stray


@kernel
def crossings(
    profile: NDArray[np.float64],
    x0: float,
    y0: float,
    x1: float,
    y1: float,
    start_us: int,
    end_us: int,
    radius: float,
    legs: NDArray[np.float64],
    offsets: NDArray[np.int64],
    seen: NDArray[np.float64],
    fresh: bool,
    out: NDArray[np.int64],
) -> int:
    """All entries and exits of one drone's leg, for all users; their number.

    ``profile``: the drone's transit from (x0, y0) to (x1, y1), in metres and along one axis, then a
    hover until the leg ends; ``legs`` (rows: T0_US X0 Y0 VX VY) with the rows of user u
    at ``offsets[u]:offsets[u + 1]``; ``seen``: what ``look_around`` says of the same span;
    ``fresh``: the drone begins to serve, so that users inside at the start enter then. Rows (time,
    user, enters) go into ``out``, user by user in order of time; what does not fit is counted but
    not written. An entry and an exit in one microsecond cancel.
    """
    route = (x0, y0, x1, y1)
    span = (start_us, end_us)
    flight, stay = _parts(profile, route, span, radius)
    for user in range(len(offsets) - 1):  # by itself, for it is done for several users at once
        seen[NEAR, user] = _comes_near(flight, seen, user, fresh)
    if stay[END] > stay[BEGIN]:
        for user in range(len(offsets) - 1):
            seen[NEAR, user] = max(seen[NEAR, user], _comes_near(stay, seen, user, fresh))
    near = 0
    for user in range(len(offsets) - 1):  # without branches, too: nobody can foresee who is near
        is_near = int(seen[NEAR, user])
        seen[NEAR, near] = user
        near += is_near
    total = 0
    for k in range(near):
        pair = (int(seen[NEAR, k]), fresh)
        total = _cross(profile, route, span, radius, legs, offsets, seen, pair, out, total)
    return total


@kernel
def crossings_near(
    profile: NDArray[np.float64],
    x0: float,
    y0: float,
    x1: float,
    y1: float,
    start_us: int,
    end_us: int,
    radius: float,
    legs: NDArray[np.float64],
    offsets: NDArray[np.int64],
    seen: NDArray[np.float64],
    fresh: bool,
    out: NDArray[np.int64],
    shape: tuple[int, int],
    side: tuple[float, float],
    far: float,
    heads: NDArray[np.int64],
    following: NDArray[np.int64],
) -> int:
    """The same for users in buckets (see ``sort_into_buckets``): only those near by are looked at.

    Rows come bucket by bucket.
    """
    route = (x0, y0, x1, y1)
    span = (start_us, end_us)
    flight, stay = _parts(profile, route, span, radius)
    reach = radius + far + MARGIN_M
    total = 0
    for i in range(
        bucket_of(min(x0, x1) - reach, side[0], shape[0]),
        bucket_of(max(x0, x1) + reach, side[0], shape[0]) + 1,
    ):
        for j in range(
            bucket_of(min(y0, y1) - reach, side[1], shape[1]),
            bucket_of(max(y0, y1) + reach, side[1], shape[1]) + 1,
        ):
            user = heads[i * shape[1] + j]
            while user >= 0:
                if _comes_near(flight, seen, user, fresh) + _comes_near(stay, seen, user, fresh):
                    pair = (user, fresh)
                    total = _cross(
                        profile, route, span, radius, legs, offsets, seen, pair, out, total
                    )
                user = following[user]
    return total


@kernel
def sort_into_buckets(
    seen: NDArray[np.float64],
    shape: tuple[int, int],
    side: tuple[float, float],
    heads: NDArray[np.int64],
    following: NDArray[np.int64],
) -> float:
    """Put users into the buckets of a grid; how far any of them goes along an axis in the span.

    ``heads`` (buckets,) is the first user of each, -1 where there is none, ``following`` (users,)
    the next one in the same.
    """
    far = 0.0
    heads[:] = -1
    for user in range(len(following) - 1, -1, -1):
        x, y = seen[AT_X, user], seen[AT_Y, user]
        walk = max(abs(seen[TO_X, user] - x), abs(seen[TO_Y, user] - y))
        far = max(far, walk + seen[STRAY, user])
        at = bucket_of(x, side[0], shape[0]) * shape[1] + bucket_of(y, side[1], shape[1])
        following[user] = heads[at]
        heads[at] = user
    return far


@kernel
def bucket_of(place: float, side: float, count: int) -> int:
    """Which of ``count`` buckets along an axis a place falls into."""
    return min(max(int(np.floor(place / side)), 0), count - 1)


def bucket_grid(width_m: float, depth_m: float, radius_m: float) -> tuple[int, int]:
    """How many buckets a map is worth along x and y; (0, 0) if it is small.

    Each is about a radius wide, but there are at most ``MOST_BUCKETS`` along an axis.
    """
    shape = (
        min(int(width_m // radius_m), MOST_BUCKETS),
        min(int(depth_m // radius_m), MOST_BUCKETS),
    )
    return shape if shape[0] * shape[1] >= FEWEST_BUCKETS else (0, 0)


@kernel
def _write(out: NDArray[np.int64], total: int, t_us: int, user: int, enters: bool) -> int:
    if total < len(out):
        out[total, TIME_US] = t_us
        out[total, USER] = user
        out[total, ENTERS] = enters
    return total + 1


@kernel
def _is_inside(
    x: float, y: float, radius: float, legs: NDArray[np.float64], leg: int, t_us: float
) -> bool:
    """Is the user in the closed disc around (x, y)? The one test at both ends of every leg."""
    ux, uy = walked(legs, leg, t_us)
    return _beyond(x - ux, y - uy, radius) <= 0.0


@kernel
def _beyond(x: float, y: float, radius: float) -> float:
    """x² + y² - R², without cancellation where the larger coordinate alone makes up the radius."""
    x, y = abs(x), abs(y)
    if x < y:
        x, y = y, x
    return (x - radius) * (x + radius) + y * y


FROM_X, FROM_Y, ONTO_X, ONTO_Y, BEGIN, END, OUT, WITHIN = range(8)
"""Of a part of a drone's leg: its ends, and when it has them, as shares of the span; how near a
user has to come, and how far to be off, to cross the footprint's edge."""


@kernel
def _parts(
    profile: NDArray[np.float64], route: Route, span: Span, radius: float
) -> tuple[Part, Part]:
    """A drone's leg as two straight ways at an even speed: its flight, and its hover after that."""
    x0, y0, x1, y1 = route
    duration = (span[1] - span[0]) * 1e-6
    last = len(profile) - 1
    arrival, length = profile[last, START], profile[last, DISTANCE]
    aside = bow = 0.0
    even = length / arrival if last > 0 else 0.0
    for k in range(last):
        lasts = profile[k + 1, START] - profile[k, START]
        aside = max(aside, abs(profile[k, DISTANCE] - even * profile[k, START]))
        bow = max(bow, abs(profile[k, ACCELERATION]) * lasts * lasts / 8.0)
    stray = aside + bow + MARGIN_M
    landed = min(arrival / duration, 1.0) if last > 0 else 1.0
    flight = (x0, y0, x1, y1, 0.0, landed, radius + stray, radius - stray)
    return flight, (x1, y1, x1, y1, landed, 1.0, radius + MARGIN_M, radius - MARGIN_M)


@kernel
def _comes_near(way: Part, seen: NDArray[np.float64], user: int, fresh: bool) -> float:
    """Pass one: 0.0 where a user who walked straight on would stay out of the footprint or in it.

    By more than it and the drone stray. One who stays in it has no crossing, but is entered by a
    drone that begins to serve (``fresh``). Without branches, so that a processor does several at
    once.
    """
    x0, y0, x1, y1, begin, end, out, within = way
    x, y = seen[AT_X, user], seen[AT_Y, user]
    walk_x, walk_y = seen[TO_X, user] - x, seen[TO_Y, user] - y
    px, py = x0 - x - walk_x * begin, y0 - y - walk_y * begin
    qx, qy = x1 - x - walk_x * end, y1 - y - walk_y * end
    wx, wy = qx - px, qy - py
    out, within = out + seen[STRAY, user], max(within - seen[STRAY, user], 0.0)
    first, last = px * px + py * py, qx * qx + qy * qy
    along, way_2 = -(px * wx + py * wy), wx * wx + wy * wy
    nearest = min(first, last)
    passes = (along > 0.0) & (along < way_2)  # then the nearest point is on the way
    out_of_passing = first * way_2 - along * along > out * out * way_2
    stays_out = (nearest > out * out) & (out_of_passing | (not passes))
    stays_in = (max(first, last) < within * within) & (not fresh)
    return 0.0 if stays_out | stays_in else 1.0


@part
def _cross(
    profile: NDArray[np.float64],
    route: Route,
    span: Span,
    radius: float,
    legs: NDArray[np.float64],
    offsets: NDArray[np.int64],
    seen: NDArray[np.float64],
    pair: tuple[int, bool],
    out: NDArray[np.int64],
    total: int,
) -> int:
    """Write the crossings of a user; ``pair``: who, and does the drone begin to serve?"""
    user, fresh = pair
    inside = _beyond(route[0] - seen[AT_X, user], route[1] - seen[AT_Y, user], radius) <= 0.0
    entered = fresh and inside
    if entered:
        total = _write(out, total, span[0], user, True)
    state = (user, inside, entered)
    first, stop = offsets[user] + int(seen[LEG, user]), offsets[user + 1]
    return _roots(profile, route, span, radius, legs, first, stop, state, out, total)


@part
def _roots(
    profile: NDArray[np.float64],
    route: Route,
    span: Span,
    radius: float,
    legs: NDArray[np.float64],
    first: int,
    stop: int,
    state: tuple[int, bool, bool],
    out: NDArray[np.int64],
    total: int,
) -> int:
    """Pass two: write the crossings of one pair in order; the new total.

    ``state``: the user, is it inside at the start, and is an entry at the start written already?
    """
    user, inside, entered = state
    ex, ey = _sign(route[2] - route[0]), _sign(route[3] - route[1])
    duration = (span[1] - span[0]) * 1e-6
    latest = span[0] if entered else -1
    phase = 0
    leg = first
    at = 0.0
    while at < duration:
        while phase + 1 < len(profile) and profile[phase + 1, START] <= at:
            phase += 1
        while leg + 1 < stop and (legs[leg + 1, T0_US] - span[0]) * 1e-6 <= at:
            leg += 1
        end = duration
        if phase + 1 < len(profile):
            end = min(end, profile[phase + 1, START])
        if leg + 1 < stop:
            end = min(end, (legs[leg + 1, T0_US] - span[0]) * 1e-6)

        # The drone relative to the user at the piece's start: position p, velocity w.
        since = at - profile[phase, START]
        acceleration = profile[phase, ACCELERATION]
        speed = profile[phase, SPEED] + acceleration * since
        along = profile[phase, DISTANCE] + 0.5 * (profile[phase, SPEED] + speed) * since
        since_walk = at - (legs[leg, T0_US] - span[0]) * 1e-6
        if phase + 1 == len(profile):
            px, py = route[2], route[3]
        else:
            px, py = route[0] + ex * along, route[1] + ey * along
        px -= legs[leg, X0] + legs[leg, VX] * since_walk
        py -= legs[leg, Y0] + legs[leg, VY] * since_walk
        wx = ex * speed - legs[leg, VX]
        wy = ey * speed - legs[leg, VY]
        ax, ay = ex * acceleration, ey * acceleration

        span_s = end - at
        moved = (abs(wx) + abs(wy) + 0.5 * abs(acceleration) * span_s) * span_s + MARGIN_M
        apart = px * px + py * py
        within = max(radius - moved, 0.0)
        if apart > (radius + moved) * (radius + moved) or apart < within * within:
            at = end
            continue

        turning, points = _turning_points(px, py, wx, wy, ax, ay, end - at)
        before = 0.0
        for k in range(turning + 1):
            after = end - at
            if k < turning:
                after = points[k]
            if k == turning and end >= duration:
                last = leg
                if leg + 1 < stop and legs[leg + 1, T0_US] <= span[1]:
                    last = leg_near(legs, first, stop, span[1], leg)
                now_inside = _is_inside(route[2], route[3], radius, legs, last, span[1])
            else:
                excess = _excess(px, py, wx, wy, ax, ay, radius, after)
                grazes = k < turning and abs(excess) <= 2.0 * GRAZE_M * radius
                now_inside = inside if grazes else excess <= 0.0
            if now_inside != inside:
                root = _root(px, py, wx, wy, ax, ay, radius, before, after, now_inside)
                t_us = span[0] + int(np.rint((at + root) * 1e6))
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
def _sign(x: float) -> float:
    if x > 0.0:
        return 1.0
    return -1.0 if x < 0.0 else 0.0


@kernel
def _excess(
    px: float, py: float, wx: float, wy: float, ax: float, ay: float, radius: float, t: float
) -> float:
    """Squared distance minus squared radius, t seconds into the piece."""
    x = px + t * (wx + 0.5 * ax * t)
    y = py + t * (wy + 0.5 * ay * t)
    return _beyond(x, y, radius)


@kernel
def _slope(px: float, py: float, wx: float, wy: float, ax: float, ay: float, t: float) -> float:
    """Half the derivative of the squared distance."""
    x = px + t * (wx + 0.5 * ax * t)
    y = py + t * (wy + 0.5 * ay * t)
    return x * (wx + ax * t) + y * (wy + ay * t)


@kernel
def _turning_points(
    px: float,
    py: float,
    wx: float,
    wy: float,
    ax: float,
    ay: float,
    end: float,
) -> tuple[int, Points]:
    """Where the distance stops growing or shrinking inside (0, end), ascending: how many, where."""
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
        high_slope = _slope(px, py, wx, wy, ax, ay, high)
        if low_slope * high_slope < 0.0:
            found = _slope_root(px, py, wx, wy, ax, ay, low, high, low_slope < 0.0)
            points = (
                found if count == 0 else points[0],
                found if count == 1 else points[1],
                found if count == 2 else points[2],
            )
            count += 1
        low, low_slope = high, high_slope
    return count, points


@kernel
def _slope_root(
    px: float,
    py: float,
    wx: float,
    wy: float,
    ax: float,
    ay: float,
    low: float,
    high: float,
    rising: bool,
) -> float:
    """The zero of the slope in a stretch where it is monotone, by bisection-safeguarded Newton."""
    t = 0.5 * (low + high)
    for _ in range(80):  # pragma: no branch (it has converged long before)
        value = _slope(px, py, wx, wy, ax, ay, t)
        if (value < 0.0) == rising:
            low = t
        else:
            high = t
        vx, vy = wx + ax * t, wy + ay * t
        x = px + t * (wx + 0.5 * ax * t)
        y = py + t * (wy + 0.5 * ay * t)
        derivative = vx * vx + vy * vy + x * ax + y * ay
        step = t - value / derivative if derivative != 0.0 else low
        if not low < step < high:
            step = 0.5 * (low + high)
        if abs(step - t) <= 1e-13 * max(1.0, t) or step <= low or step >= high:
            return step
        t = step
    return t  # pragma: no cover


@kernel
def _root(
    px: float,
    py: float,
    wx: float,
    wy: float,
    ax: float,
    ay: float,
    radius: float,
    low: float,
    high: float,
    enters: bool,
) -> float:
    """The crossing in [low, high], where the distance is monotone and passes the radius."""
    if ax == 0.0 and ay == 0.0:
        # Quadratic: |w|² t² + 2 (p·w) t + |p|² - R² = 0, without cancellation in either term.
        a = wx * wx + wy * wy
        b = px * wx + py * wy
        distance = np.sqrt(px * px + py * py)
        c = (distance - radius) * (distance + radius)
        cross = px * wy - py * wx
        speed = np.sqrt(a)
        discriminant = (speed * radius - cross) * (speed * radius + cross)
        if a == 0.0:
            return low
        root = np.sqrt(max(discriminant, 0.0))
        q = -b - root if b >= 0.0 else -b + root
        r1 = q / a
        r2 = c / q if q != 0.0 else r1
        t = min(r1, r2) if enters else max(r1, r2)
        return float(min(max(t, low), high))
    t = 0.5 * (low + high)
    for _ in range(80):
        value = _excess(px, py, wx, wy, ax, ay, radius, t)
        if (value <= 0.0) != enters:
            low = t
        else:
            high = t
        derivative = 2.0 * _slope(px, py, wx, wy, ax, ay, t)
        step = t - value / derivative if derivative != 0.0 else low
        if not low < step < high:
            step = 0.5 * (low + high)
        if abs(step - t) <= 1e-13 * max(1.0, t) or step <= low or step >= high:
            return step
        t = step
    return t
