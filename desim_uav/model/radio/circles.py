"""When a user passes into another ring around a drone: crossings of nested circles.

Each circle is crossed as the footprint's edge is (``model.geometry.crossings``), and all of them
are looked at together: a user who is between two circles crosses one of these two next.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from desim_uav.model.geometry.coverage import (
    AT_X,
    AT_Y,
    LEG,
    START_FAR,
    START_NEAR,
    STOP_FAR,
    STOP_NEAR,
    T0_US,
    DroneLeg,
    Users,
    heading_of,
    leg_near,
    walked,
)
from desim_uav.model.geometry.relative import (
    GRAZE_M,
    beyond,
    coast_of,
    is_beyond,
    is_within,
    moved_by,
    place_at,
    relative_to,
    root_of,
    rounded_us,
    turning_points,
    write,
)
from desim_uav.model.motion.motion import START
from desim_uav.rowcode.kernels import part

MOST_REST = 2
"""A profile with more rows than this has at least two phases before the rest."""


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
    profile, legs, heading = leg.profile, users.legs, heading_of(leg)
    start_us, end_us = leg.span_us
    duration = (end_us - start_us) * 1e-6
    x, y = leg.route[0] - users.seen[AT_X, user], leg.route[1] - users.seen[AT_Y, user]
    now = first
    while now < stop and beyond(x, y, radii[now]) <= 0.0:
        now += 1
    held, latest, noted = now, start_us - 1, 0
    bounded = len(profile) > MOST_REST
    if leg.fresh:
        held, latest, noted = 0, start_us, int(now > 0)
        total = write(out, total, start_us, user, now) if noted else total
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
        piece = relative_to(leg, heading, legs, phase, walk, at)
        moved, apart = moved_by(piece, end - at)
        stays_in = now == first or is_within(radii[now - 1], moved, apart)
        if stays_in and (now == stop or is_beyond(radii[now], moved, apart)):
            at = end
            continue
        coast = coast_of(piece)
        turning, points = turning_points(piece, end - at)
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
                x, y = place_at(piece, after)
            entered = left = False
            while True:
                # A circle that has just been passed is not passed back.
                enters = (
                    not left
                    and now < stop
                    and _passes(beyond(x, y, radii[now]), radii[now], graze, True)
                )
                if not enters and (
                    entered
                    or now == first
                    or not _passes(beyond(x, y, radii[now - 1]), radii[now - 1], graze, False)
                ):
                    break
                entered, left = enters, not enters
                ring = now if enters else now - 1
                root = root_of(piece, coast, radii[ring], before, after, enters)
                t_us = rounded_us(start_us, at + root)
                if t_us > latest:
                    held, latest, noted = now, t_us, 0
                now = ring + 1 if enters else ring
                total -= noted
                noted = int(now != held)
                if noted:
                    total = write(out, total, latest, user, now if now > held else -now)
            before = after
        at = end
    return total


@part
def _passes(excess: float, radius: float, graze: float, enters: bool) -> bool:
    """Return whether an excess is inside, or outside, and more than a touch of the circle."""
    return (excess <= 0.0) == enters and abs(excess) > graze * radius
