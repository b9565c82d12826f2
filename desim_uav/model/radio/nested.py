"""When a user passes from one class of a link to another while the drone keeps its altitude.

At one altitude each class holds within a circle around the drone, so a class changes where the user
crosses a circle. Each circle is crossed as the footprint's edge is (``model.geometry.crossings``).
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from desim_uav.model.geometry.coverage import (
    AT_X,
    AT_Y,
    FAR,
    MARGIN_M,
    NEAR,
    SIFTED,
    START_FAR,
    START_NEAR,
    STOP_FAR,
    STOP_NEAR,
    STRAY,
    TO_X,
    TO_Y,
    DroneLeg,
    Users,
    Way,
    ways_of,
    ways_of_ends,
)
from desim_uav.model.geometry.crossings import crossings
from desim_uav.model.geometry.relative import Change
from desim_uav.model.radio.circles import MOST_REST, cross_rings
from desim_uav.rowcode.compiled_registers import either
from desim_uav.rowcode.kernels import kernel, part
from desim_uav.rowcode.rows import Ints, Table
from desim_uav.rowcode.views import zeros

CIRCLES = 256
"""There are fewer circles around a drone than this."""


@kernel
def class_changes(
    leg: DroneLeg,
    users: Users,
    radii_m: NDArray[np.float64],
    groups: Ints,
    out: Table[Change],
) -> int:
    """Write all changes of class in one drone's leg, for all users, and return their number.

    ``radii_m`` (groups, classes) are the radii around the drone within which classes hold for each
    group of users, the widest first, and ``groups`` (users,) the users' groups. A class with a
    negative radius holds nowhere. ``leg.radius_m`` is not used. ``look_around`` must have written
    ``users.seen`` for the leg's span.

    Changes go into ``out``, user by user in order of time. Several circles that are crossed in one
    microsecond are one change to the class thereafter, or none if that is the class before. So the
    order of circles in an instant does not matter, and each user has at most one row an instant: a
    fall or a rise. With one class, the rows
    are those of ``crossings``. If ``out`` is too short, the number is larger than its length, and
    with that many rows it is long enough.
    """
    flight, stay = ways_of(DroneLeg(leg.profile, leg.route, leg.span_us, 0.0, leg.fresh, 0.0))
    seen = users.seen
    for user in range(len(users.offsets) - 1):  # a loop of its own, so that it can be vectorised
        seen[NEAR, user], seen[FAR, user] = bounds_of(flight, seen, user)
    if stay.end > stay.begin:
        for user in range(len(users.offsets) - 1):
            near, far = bounds_of(stay, seen, user)
            seen[NEAR, user] = min(seen[NEAR, user], near)
            seen[FAR, user] = max(seen[FAR, user], far)
    if len(leg.profile) > MOST_REST:
        start, halt = ways_of_ends(leg)
        for user in range(len(users.offsets) - 1):
            seen[START_NEAR, user], seen[START_FAR, user] = bounds_of(start, seen, user)
        for user in range(len(users.offsets) - 1):
            seen[STOP_NEAR, user], seen[STOP_FAR, user] = bounds_of(halt, seen, user)
    total = 0
    for k in range(sift(users, radii_m, radii_m, groups, leg.fresh)):
        user, first, stop = sifted(seen, k)
        total = cross_rings(leg, users, user, radii_m[groups[user]], first, stop, out, total)
    return total


def changes_on(
    leg: DroneLeg, users: Users, radii_m: NDArray[np.float64], groups: NDArray[np.int64]
) -> Any:
    """Return the rows of ``class_changes``, which are those of ``crossings`` for one circle."""
    room = 2 * len(groups) * radii_m.shape[1] + 16
    alone = radii_m.size == 1 and radii_m[0, 0] >= 0.0
    while True:
        out = zeros(Change, room)
        if alone:
            count = crossings(leg._replace(radius_m=float(radii_m[0, 0])), users, out)
        else:
            count = class_changes(leg, users, radii_m, groups, out)
        if count <= room:
            return out[:count]
        room = 2 * count


@part
def sift(
    users: Users,
    least_m: NDArray[np.float64],
    most_m: NDArray[np.float64],
    groups: Ints,
    fresh: bool,
) -> int:
    """Find the users who may cross circles, and return their number (see ``sifted``).

    ``least_m`` and ``most_m`` (groups, classes) are bounds of the radii; those of distances are in
    ``users.seen`` (NEAR, FAR). There are no branches, which could not be predicted.
    """
    seen, near, count = users.seen, 0, 0
    for user in range(len(users.offsets) - 1):
        seen[SIFTED, near] = user
        near += int(most_m[groups[user], 0] > seen[NEAR, user])
    for k in range(near):
        user = int(seen[SIFTED, k])
        least, most = least_m[groups[user]], most_m[groups[user]]
        first = 0 if fresh else wider(least, seen[FAR, user])
        stop = wider(most, max(seen[NEAR, user], 0.0))
        seen[SIFTED, count] = (user * (CIRCLES + 0.0) + first) * CIRCLES + stop
        count += int(first < stop)
    return count


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
def sifted(seen: NDArray[np.float64], k: int) -> tuple[int, int, int]:
    """Return the k-th user found by ``sift``, and the circles that the user may cross.

    These are the number of the first one and of the one after the last one.
    """
    code = int(seen[SIFTED, k])
    return code // CIRCLES**2, code // CIRCLES % CIRCLES, code % CIRCLES


@part
def bounds_of(way: Way, seen: NDArray[np.float64], user: int) -> tuple[float, float]:
    """Return two distances, beyond which a user's distance from the drone does not get.

    ``way`` is that of a circle of no radius (see ``coverage.comes_near``).
    """
    x, y = seen[AT_X, user], seen[AT_Y, user]
    walk_x, walk_y = seen[TO_X, user] - x, seen[TO_Y, user] - y
    px, py = way.from_x_m - x - walk_x * way.begin, way.from_y_m - y - walk_y * way.begin
    qx, qy = way.to_x_m - x - walk_x * way.end, way.to_y_m - y - walk_y * way.end
    wx, wy = qx - px, qy - py
    first, last = px * px + py * py, qx * qx + qy * qy
    along, way_2 = -(px * wx + py * wy), wx * wx + wy * wy
    passes = (along > 0.0) & (along < way_2)  # then the nearest point is on the way
    dip = max(first - along * along / way_2, 0.0)
    nearest = dip if passes else min(first, last)
    slack = way.out_m + seen[STRAY, user] + MARGIN_M
    return np.sqrt(nearest) - slack, np.sqrt(max(first, last)) + slack
