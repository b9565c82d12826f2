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
    DroneLeg,
    Users,
    WalkLeg,
    heading_of,
    leg_near,
    walked,
)
from desim_uav.model.geometry.relative import (
    GRAZE_M,
    Change,
    Relative,
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
)
from desim_uav.model.motion.motion import PieceRow
from desim_uav.model.radio.passages import begin_passages, passed
from desim_uav.rowcode.kernels import part
from desim_uav.rowcode.rows import Table

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
    out: Table[Change],
    total: int,
) -> int:
    """Write when a user passes into another ring, in order of time; return the new total.

    The circles ``first`` … ``stop`` - 1, the widest first, may be crossed; the user stays within
    the wider ones and outside the narrower ones. The times are those of ``cross`` for each circle
    alone; for the rows see ``model.radio.passages``.
    """
    profile, legs, heading = leg.profile, users.legs, heading_of(leg)
    start_us, end_us = leg.span_us
    duration = (end_us - start_us) * 1e-6
    away = leg.route[0] - users.seen[AT_X, user], leg.route[1] - users.seen[AT_Y, user]
    circles = first, stop
    one = begin_passages(user, away, radii, circles, (start_us, leg.fresh), out, total)
    end_walk = users.offsets[user + 1]
    walk = begin_walk = users.offsets[user] + int(users.seen[LEG, user])
    phase = 0
    at = 0.0
    while at < duration:
        while phase + 1 < len(profile) and profile[phase + 1].start_s <= at:
            phase += 1
        if _keeps_away(profile, phase, users, user, radii, circles, one.now):
            at = _until(profile, phase, duration)
            continue
        while walk + 1 < end_walk and (legs[walk + 1].begin_us - start_us) * 1e-6 <= at:
            walk += 1
        end = _until(profile, phase, duration)
        if walk + 1 < end_walk:
            end = min(end, (legs[walk + 1].begin_us - start_us) * 1e-6)
        piece = relative_to(leg, heading, legs[walk], phase, at)
        if _stays(piece, end - at, radii, circles, one.now):
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
                x, y = _away_at_end(leg, legs, (begin_walk, end_walk), walk)
            else:
                x, y = place_at(piece, after)
            entered = left = False
            while True:
                # A circle that has just been passed is not passed back.
                enters = not left and _enters(x, y, radii, stop, one.now, graze)
                if not enters and (entered or not _leaves(x, y, radii, first, one.now, graze)):
                    break
                entered, left = enters, not enters
                ring = one.now if enters else one.now - 1
                root = root_of(piece, coast, radii[ring], before, after, enters)
                t_us = rounded_us(start_us, at + root)
                one = passed(one, ring + 1 if enters else ring, t_us, user, out)
            before = after
        at = end
    return one.total


@part
def _away_at_end(
    leg: DroneLeg, legs: Table[WalkLeg], own: tuple[int, int], walk: int
) -> tuple[float, float]:
    """Return how far a drone is from a user at the end of its leg, along x and y.

    The user's walks are ``own``, of which ``walk`` is the one before the end.
    """
    last, end_us = walk, leg.span_us[1]
    if walk + 1 < own[1] and legs[walk + 1].begin_us <= end_us:
        last = leg_near(legs, own[0], own[1], end_us, walk)
    x, y = walked(legs[last], end_us)
    return leg.route[2] - x, leg.route[3] - y


@part
def _until(profile: Table[PieceRow], phase: int, end: float) -> float:
    """Return when a phase of a profile ends, at most ``end``."""
    return min(end, profile[phase + 1].start_s) if phase + 1 < len(profile) else end


@part
def _keeps_away(
    profile: Table[PieceRow],
    phase: int,
    users: Users,
    user: int,
    radii: NDArray[np.float64],
    circles: tuple[int, int],
    now: int,
) -> bool:
    """Return whether a user crosses no circle while the drone speeds up or brakes, by bounds."""
    first, stop = circles
    if len(profile) <= MOST_REST or not (phase == 0 or phase == len(profile) - 2):
        return False
    near, far = (START_NEAR, START_FAR) if phase == 0 else (STOP_NEAR, STOP_FAR)
    stays_in = now == first or radii[now - 1] > users.seen[far, user]
    return bool(stays_in and (now == stop or radii[now] < users.seen[near, user]))


@part
def _stays(
    piece: Relative,
    span_s: float,
    radii: NDArray[np.float64],
    circles: tuple[int, int],
    now: int,
) -> bool:
    """Return whether a piece is too short for a user to reach one of the next circles."""
    moved, apart = moved_by(piece, span_s)
    stays_in = now == circles[0] or is_within(radii[now - 1], moved, apart)
    return stays_in and (now == circles[1] or is_beyond(radii[now], moved, apart))


@part
def _enters(
    x: float, y: float, radii: NDArray[np.float64], stop: int, now: int, graze: float
) -> bool:
    """Return whether a user is within the next narrower circle."""
    return now < stop and _passes(beyond(x, y, radii[now]), radii[now], graze, True)


@part
def _leaves(
    x: float, y: float, radii: NDArray[np.float64], first: int, now: int, graze: float
) -> bool:
    """Return whether a user is outside the narrowest circle that was around it."""
    return now > first and _passes(beyond(x, y, radii[now - 1]), radii[now - 1], graze, False)


@part
def _passes(excess: float, radius: float, graze: float, enters: bool) -> bool:
    """Return whether an excess is inside, or outside, and more than a touch of the circle."""
    return (excess <= 0.0) == enters and abs(excess) > graze * radius
