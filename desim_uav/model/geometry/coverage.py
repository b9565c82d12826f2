"""Pass one: where users are in a span of time, and which of them may cross a footprint's edge.

Users walk straight legs. ``look_around`` summarises, for all drones, how each user walks in a span.
For each leg of a drone, a fast classifier (``comes_near``) then discards the users who cannot cross
the edge of its footprint; on wide maps it is applied only to users in buckets near the drone. For
the other users, ``model.geometry.crossings`` computes the times of crossings.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from desim_uav.model.motion.motion import PieceRow
from desim_uav.rowcode.kernels import kernel, maker, part
from desim_uav.rowcode.rows import Ints, Row, Table, row

MARGIN_M = 1e-6
"""The distance in metres from a footprint's edge beyond which rounding makes no crossing."""

LEG, AT_X, AT_Y, TO_X, TO_Y, STRAY, NEAR, FAR = range(8)
START_NEAR, START_FAR, STOP_NEAR, STOP_FAR, SIFTED = range(8, 13)
SEEN_ROWS = 13
"""The rows of a table of users in a span, and their number: the leg on which a user begins the span
(LEG), its position then (AT_X, AT_Y) and at the end (TO_X, TO_Y), how far it strays from a straight
walk between them at an even speed (STRAY), all in metres, and whether it comes near the leg of the
drone for which crossings were computed last (NEAR); with rings, bounds of its distance from that
drone (NEAR, FAR), and those while the drone speeds up (START_NEAR, START_FAR) and brakes
(STOP_NEAR, STOP_FAR), and the users who may cross rings (SIFTED)."""

FEWEST_BUCKETS = 48
"""With fewer buckets than this, a drone reaches a good part of the map, and they save no time."""

MOST_BUCKETS = 128
"""With more buckets than this along an axis, emptying them takes more time than they save."""


@row
class WalkLeg(Row):
    """A straight walk of a user from a place, at a velocity, that begins at ``begin_us``.

    All fields are floats, so that a table of five columns is a table of legs, too.
    """

    begin_us: float
    x_m: float
    y_m: float
    vx_mps: float
    vy_mps: float


class DroneLeg(NamedTuple):
    """A leg of a drone that serves: a straight transit, then a hover until the leg ends.

    ``profile`` has the pieces of the transit, and ``route`` the x and y
    of its start and of its destination, in metres. ``span_us`` holds the times at which the leg
    begins and ends, and ``radius_m`` is the radius of the footprint. If ``fresh``, the drone begins
    to serve, so that users who are inside at the start enter then. ``climb_m`` is how much higher
    the destination is than the start; compiled code must give it, because it knows no defaults.
    """

    profile: Table[PieceRow]
    route: tuple[float, float, float, float]
    span_us: tuple[int, int]
    radius_m: float
    fresh: bool
    climb_m: float = 0.0


class Users(NamedTuple):
    """The walks of all users, and how they walk in a span.

    The legs of user u are ``legs[offsets[u]:offsets[u + 1]]``. ``seen`` (SEEN_ROWS, users) is what
    ``look_around`` writes.
    """

    legs: Table[WalkLeg]
    offsets: Ints
    seen: NDArray[np.float64]


class Buckets(NamedTuple):
    """The users by where they are at the start of a span, in a grid of buckets.

    ``shape`` is the number of buckets along x and y, and ``side_m`` their lengths. ``heads``
    (buckets,) holds the first user in each bucket, and ``following`` (users,) the next user in the
    same bucket; both are -1 where there is none.
    """

    shape: tuple[int, int]
    side_m: tuple[float, float]
    heads: Ints
    following: Ints


class Way(NamedTuple):
    """A part of a drone's leg as a straight way at an even speed.

    ``begin`` and ``end`` are the times at which it begins and ends, as shares of the span. A user
    who stays farther away than ``out_m``, or nearer than ``within_m``, does not cross the
    footprint's edge.
    """

    from_x_m: float
    from_y_m: float
    to_x_m: float
    to_y_m: float
    begin: float
    end: float
    out_m: float
    within_m: float


@kernel
def leg_at(legs: Table[WalkLeg], first: int, last: int, t_us: float) -> int:
    """Return the row of the last leg in ``first`` … ``last`` - 1 that has begun at ``t_us``."""
    low, high = first, last - 1
    while low < high:
        middle = (low + high + 1) // 2
        if legs[middle].begin_us <= t_us:
            low = middle
        else:
            high = middle - 1
    return low


@part
def leg_near(legs: Table[WalkLeg], first: int, last: int, t_us: float, guess: int) -> int:
    """Return the same row as ``leg_at``, which is searched for near a guess first."""
    leg = min(max(guess, first), last - 1)
    for _ in range(4):
        if leg > first and legs[leg].begin_us > t_us:
            leg -= 1
        elif leg + 1 < last and legs[leg + 1].begin_us <= t_us:
            leg += 1
        else:
            return leg
    return leg_at(legs, first, last, t_us)


@kernel
def walked(leg: WalkLeg, t_us: float) -> tuple[float, float]:
    """Return the position at ``t_us`` of a user on a leg: x and y in metres."""
    t = (t_us - leg.begin_us) * 1e-6
    return leg.x_m + leg.vx_mps * t, leg.y_m + leg.vy_mps * t


@maker
def all_walked(
    legs: Table[WalkLeg], offsets: NDArray[np.int64], t_us: float
) -> NDArray[np.float64]:
    """Return the positions of all users at ``t_us``: (users, 2), in metres."""
    places = np.empty((len(offsets) - 1, 2))
    for user in range(len(offsets) - 1):
        leg = leg_at(legs, offsets[user], offsets[user + 1], t_us)
        places[user] = walked(legs[leg], t_us)
    return places


@kernel
def look_around(users: Users, start_us: int, end_us: int) -> None:
    """Write where each user is at the start and at the end of a span, and how straight it walks.

    The numbers are written into ``users.seen`` and hold for all drones. Its row LEG of the previous
    span, or zeros, is the first guess at each user's leg.
    """
    legs, offsets, seen = users
    for user in range(len(offsets) - 1):
        begin, stop = offsets[user], offsets[user + 1]
        first = leg_near(legs, begin, stop, start_us, begin + int(seen[LEG, user]))
        last = first
        while last + 1 < stop and legs[last + 1].begin_us < end_us:
            last += 1
        x, y = walked(legs[first], start_us)
        to_x, to_y = walked(legs[last], end_us)
        stray = 0.0
        for leg in range(first + 1, last + 1):
            share = (legs[leg].begin_us - start_us) / (end_us - start_us)
            aside_x = legs[leg].x_m - x - (to_x - x) * share
            aside_y = legs[leg].y_m - y - (to_y - y) * share
            stray = max(stray, abs(aside_x) + abs(aside_y))
        seen[LEG, user], seen[AT_X, user], seen[AT_Y, user] = first - begin, x, y
        seen[TO_X, user], seen[TO_Y, user], seen[STRAY, user] = to_x, to_y, stray


@part
def heading_of(leg: DroneLeg) -> tuple[float, float]:
    """Return how many metres along x and along y a drone flies for each metre of its transit.

    For a level leg along an axis, these are exactly 0, 1 or -1.
    """
    x0, y0, x1, y1 = leg.route
    dx, dy, dz = x1 - x0, y1 - y0, leg.climb_m
    length = np.sqrt(dx * dx + dy * dy + dz * dz)
    if length == 0.0:
        return 0.0, 0.0
    return dx / length, dy / length


@kernel
def ways_of(leg: DroneLeg) -> tuple[Way, Way]:
    """Return a drone's leg as two straight ways at an even speed: its flight, then its hover."""
    x0, y0, x1, y1 = leg.route
    profile, radius = leg.profile, leg.radius_m
    duration = (leg.span_us[1] - leg.span_us[0]) * 1e-6
    last = len(profile) - 1
    arrival, length = profile[last].start_s, profile[last].from_m
    aside = bow = 0.0
    even = length / arrival if last > 0 else 0.0
    for k in range(last):
        lasts = profile[k + 1].start_s - profile[k].start_s
        aside = max(aside, abs(profile[k].from_m - even * profile[k].start_s))
        bow = max(bow, abs(profile[k].acceleration_mps2) * lasts * lasts / 8.0)
    stray = aside + bow + MARGIN_M
    landed = min(arrival / duration, 1.0) if last > 0 else 1.0
    flight = Way(x0, y0, x1, y1, 0.0, landed, radius + stray, radius - stray)
    return flight, Way(x1, y1, x1, y1, landed, 1.0, radius + MARGIN_M, radius - MARGIN_M)


@kernel
def ways_of_ends(leg: DroneLeg) -> tuple[Way, Way]:
    """Return the first and the last phase of a drone's flight as straight ways (see ``ways_of``).

    The flight must have at least two phases. The distances of the ways are for no radius.
    """
    first = _way_of(leg, 0)
    return first, _way_of(leg, len(leg.profile) - 2)


@part
def _way_of(leg: DroneLeg, phase: int) -> Way:
    """Return a phase of a drone's flight as a straight way at an even speed, for no radius."""
    x0, y0, x1, y1 = leg.route
    profile, last = leg.profile, len(leg.profile) - 1
    duration, length = (leg.span_us[1] - leg.span_us[0]) * 1e-6, profile[last].from_m
    piece, after = profile[phase], profile[phase + 1]
    begins, ends = piece.start_s, after.start_s
    one, other = piece.from_m / length, after.from_m / length
    bow = abs(piece.acceleration_mps2) * (ends - begins) * (ends - begins) / 8.0 + MARGIN_M
    return Way(
        x0 + one * (x1 - x0),
        y0 + one * (y1 - y0),
        x0 + other * (x1 - x0),
        y0 + other * (y1 - y0),
        min(begins / duration, 1.0),
        min(ends / duration, 1.0),
        bow,
        -bow,
    )


@kernel
def comes_near(way: Way, seen: NDArray[np.float64], user: int, fresh: bool) -> float:
    """Return 0.0 if a user stays outside the footprint, or inside, all the way, and 1.0 otherwise.

    The user is taken to walk straight; the margins of ``way`` and STRAY account for the deviations
    of drone and user. A user who stays inside has no crossing, unless the drone begins to serve
    (``fresh``), because the user enters then. The code has no branches, so that a processor handles
    several users at once.
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


@kernel
def sort_into_buckets(seen: NDArray[np.float64], buckets: Buckets) -> float:
    """Put users into buckets; return a bound in metres on their moves along an axis in the span."""
    shape, side, heads, following = buckets
    far = 0.0
    for k in range(len(heads)):
        heads[k] = -1
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
    """Return the index of the bucket, of ``count`` along an axis, that contains a place."""
    return min(max(int(np.floor(place / side)), 0), count - 1)


def bucket_grid(width_m: float, depth_m: float, radius_m: float) -> tuple[int, int]:
    """Return the number of buckets of a map along x and y; (0, 0) if it is too small for buckets.

    Each is at least a radius wide, and there are at most ``MOST_BUCKETS`` along an axis.
    """
    shape = (
        min(int(width_m // radius_m), MOST_BUCKETS),
        min(int(depth_m // radius_m), MOST_BUCKETS),
    )
    return shape if shape[0] * shape[1] >= FEWEST_BUCKETS else (0, 0)
