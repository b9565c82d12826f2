"""Where users are in a span of time, and who of them may enter or leave a footprint: pass one.

Users walk straight legs. ``look_around`` sums up, for all drones, how each user walks in a span.
For each leg of a drone a cheap classifier then discards the users who cannot cross the edge of its
footprint; on wide maps only users in buckets near the drone are looked at. For the other users
``model.crossings`` finds the times.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from desim_uav.model.kernels import kernel, maker, part
from desim_uav.model.motion import ACCELERATION, DISTANCE, START

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


class DroneLeg(NamedTuple):
    """A leg of a drone that serves: a transit along one axis, then a hover until the leg ends.

    ``profile``: the transit (see ``model.motion``). ``route``: x and y of its start and of its
    destination, in metres. ``span_us``: when the leg begins and ends. ``radius_m``: of the
    footprint. ``fresh``: the drone begins to serve, so that users inside at the start enter then.
    """

    profile: NDArray[np.float64]
    route: tuple[float, float, float, float]
    span_us: tuple[int, int]
    radius_m: float
    fresh: bool


class Users(NamedTuple):
    """The walks of all users, and how they walk in a span.

    ``legs`` has rows of T0_US X0 Y0 VX VY, of which those of user u are
    ``offsets[u]:offsets[u + 1]``. ``seen`` (SEEN_ROWS, users) is what ``look_around`` writes.
    """

    legs: NDArray[np.float64]
    offsets: NDArray[np.int64]
    seen: NDArray[np.float64]


class Buckets(NamedTuple):
    """The users by where they are at the start of a span, in a grid of buckets.

    ``shape``: how many buckets there are along x and y, and ``side_m`` how long they are. ``heads``
    (buckets,) is the first user of each, -1 where there is none, ``following`` (users,) the next
    one in the same.
    """

    shape: tuple[int, int]
    side_m: tuple[float, float]
    heads: NDArray[np.int64]
    following: NDArray[np.int64]


class Way(NamedTuple):
    """A part of a drone's leg as a straight way at an even speed.

    ``begin`` and ``end``: when it is there, as shares of the span. ``out_m`` and ``within_m``: how
    near a user has to come, and how far to be off, to cross the footprint's edge.
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
def look_around(users: Users, start_us: int, end_us: int) -> None:
    """Write where each user is at the start of a span and at its end, and how straight it walks.

    It goes into ``users.seen``, the same for all drones that fly then. What this says of the span
    before, if anything, tells where to look first.
    """
    legs, offsets, seen = users
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
def ways_of(leg: DroneLeg) -> tuple[Way, Way]:
    """Return a drone's leg as two straight ways at an even speed: its flight, then its hover."""
    x0, y0, x1, y1 = leg.route
    profile, radius = leg.profile, leg.radius_m
    duration = (leg.span_us[1] - leg.span_us[0]) * 1e-6
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
    flight = Way(x0, y0, x1, y1, 0.0, landed, radius + stray, radius - stray)
    return flight, Way(x1, y1, x1, y1, landed, 1.0, radius + MARGIN_M, radius - MARGIN_M)


@kernel
def comes_near(way: Way, seen: NDArray[np.float64], user: int, fresh: bool) -> float:
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


@kernel
def sort_into_buckets(seen: NDArray[np.float64], buckets: Buckets) -> float:
    """Put users into buckets; return how far any of them goes along an axis in the span."""
    shape, side, heads, following = buckets
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
