"""Pass two: when users enter and leave a footprint, as roots of |drone(t) - user(t)| = R.

The roots are computed, by safeguarded methods, for the users whom pass one
(``model.geometry.coverage``) does not discard; nothing is sampled. A piece is a stretch of time in
which drone and user both keep their acceleration (``model.geometry.relative``). The sign of
(distance - R) is carried from piece to piece, so entries and exits alternate whatever the rounding,
and a tangent is never an entry without an exit.
"""

from __future__ import annotations

from desim_uav.model.geometry.coverage import (
    AT_X,
    AT_Y,
    LEG,
    MARGIN_M,
    NEAR,
    Buckets,
    DroneLeg,
    Users,
    WalkLeg,
    bucket_of,
    comes_near,
    heading_of,
    leg_near,
    walked,
    ways_of,
)
from desim_uav.model.geometry.relative import (
    GRAZE_M,
    Change,
    Relative,
    beyond,
    excess_at,
    is_beyond,
    is_within,
    moved_by,
    relative_to,
    root_at,
    rounded_us,
    turning_points,
    write,
)
from desim_uav.rowcode.kernels import kernel, part
from desim_uav.rowcode.rows import Table


@kernel
def crossings(leg: DroneLeg, users: Users, out: Table[Change]) -> int:
    """Write all entries and exits of one drone's leg, for all users, and return their number.

    ``look_around`` must have written ``users.seen`` for the leg's span. These
    are written into ``out``, user by user in order of time; those that do not fit are counted but
    not written. An entry and an exit in the same microsecond cancel.
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
    leg: DroneLeg, users: Users, buckets: Buckets, far_m: float, out: Table[Change]
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
def cross(leg: DroneLeg, users: Users, user: int, out: Table[Change], total: int) -> int:
    """Write the crossings of a user in order of time, and return the new total."""
    x, y = leg.route[0] - users.seen[AT_X, user], leg.route[1] - users.seen[AT_Y, user]
    inside = beyond(x, y, leg.radius_m) <= 0.0
    latest = -1
    if leg.fresh and inside:
        latest = leg.span_us[0]
        total = write(out, total, latest, user, True)
    return _roots(leg, users, user, inside, latest, out, total)


@part
def _roots(
    leg: DroneLeg,
    users: Users,
    user: int,
    inside: bool,
    latest: int,
    out: Table[Change],
    total: int,
) -> int:
    """Write the crossings of a user who is ``inside`` at the start; return the new total.

    ``latest`` is the time of the last crossing that has been written, or -1 if there is none.
    """
    profile, legs, radius, heading = leg.profile, users.legs, leg.radius_m, heading_of(leg)
    start_us, end_us = leg.span_us
    duration = (end_us - start_us) * 1e-6
    stop = users.offsets[user + 1]
    walk = first = users.offsets[user] + int(users.seen[LEG, user])
    phase = 0
    at = 0.0
    while at < duration:
        while phase + 1 < len(profile) and profile[phase + 1].start_s <= at:
            phase += 1
        while walk + 1 < stop and (legs[walk + 1].begin_us - start_us) * 1e-6 <= at:
            walk += 1
        end = duration
        if phase + 1 < len(profile):
            end = min(end, profile[phase + 1].start_s)
        if walk + 1 < stop:
            end = min(end, (legs[walk + 1].begin_us - start_us) * 1e-6)
        piece = relative_to(leg, heading, legs[walk], phase, at)
        if _stays_away(piece, radius, end - at):
            at = end
            continue
        turning, points = turning_points(piece, end - at)
        before = 0.0
        for k in range(turning + 1):
            after = end - at
            if k < turning:
                after = points[k]
            if k == turning and end >= duration:
                last = walk
                if walk + 1 < stop and legs[walk + 1].begin_us <= end_us:
                    last = leg_near(legs, first, stop, end_us, walk)
                now_inside = _is_inside(leg, legs[last])
            else:
                excess = excess_at(piece, radius, after)
                grazes = k < turning and abs(excess) <= 2.0 * GRAZE_M * radius
                now_inside = inside if grazes else excess <= 0.0
            if now_inside != inside:
                root = root_at(piece, radius, before, after, now_inside)
                t_us = rounded_us(start_us, at + root)
                if t_us == latest:
                    total -= 1
                    latest = -1
                else:
                    total = write(out, total, t_us, user, now_inside)
                    latest = t_us
                inside = now_inside
            before = after
        at = end
    return total


@kernel
def _is_inside(leg: DroneLeg, walk: WalkLeg) -> bool:
    """Return whether a user is in the closed disc around the drone at the end of its leg.

    The same test applies at both ends of every leg.
    """
    x, y = walked(walk, leg.span_us[1])
    return beyond(leg.route[2] - x, leg.route[3] - y, leg.radius_m) <= 0.0


@part
def _stays_away(piece: Relative, radius: float, span_s: float) -> bool:
    """Return whether a piece is too short for the user to reach the edge of the footprint."""
    moved, apart = moved_by(piece, span_s)
    return is_beyond(radius, moved, apart) or is_within(radius, moved, apart)
