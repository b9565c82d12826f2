"""When users enter and leave a footprint, which is one circle around a drone.

It is computed (``model.radio.circles``) for the users whom ``model.geometry.coverage`` does not
discard.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from desim_uav.model.geometry.coverage import (
    MARGIN_M,
    NEAR,
    Buckets,
    DroneLeg,
    Users,
    bucket_of,
    comes_near,
    ways_of,
)
from desim_uav.model.radio.circles import cross_rings
from desim_uav.rowcode.kernels import kernel


@kernel
def crossings(leg: DroneLeg, users: Users, out: NDArray[np.int64]) -> int:
    """Write all entries and exits of one drone's leg, for all users, and return their number.

    ``look_around`` must have written ``users.seen`` for the leg's span. Rows (time, user, enters)
    are written into ``out`` (buffer, 3), user by user in order of time; rows that do not fit are
    counted but not written. An entry and an exit in the same microsecond cancel.
    """
    seen, fresh, radii = users.seen, leg.fresh, (leg.radius_m,)
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
        total = cross_rings(leg, users, int(seen[NEAR, k]), radii, 0, 1, False, out, total)
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
    reach, radii = leg.radius_m + far_m + MARGIN_M, (leg.radius_m,)
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
                    total = cross_rings(leg, users, user, radii, 0, 1, False, out, total)
                user = buckets.following[user]
    return total
