"""When a user passes from one class of a link to another while the drone keeps its altitude.

At one altitude each class holds within a circle around the drone, so a class changes where the user
crosses a circle. Each circle is crossed as the footprint's edge is (``model.crossings``).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from desim_uav.model.coverage import AT_X, AT_Y, DroneLeg, Users, Way, comes_near, ways_of
from desim_uav.model.crossings import ENTERS, TIME_US, USER, _beyond, _cross
from desim_uav.model.kernels import kernel, part

CLASS = ENTERS
"""The third column of a table of changes: the class from that time on, 0 for no link."""


@kernel
def class_changes(
    leg: DroneLeg, users: Users, radii_m: NDArray[np.float64], out: NDArray[np.int64]
) -> int:
    """Write all changes of class in one drone's leg, for all users, and return their number.

    ``radii_m`` (users, classes) are the radii around the drone within which classes hold, the
    widest first. A class with a negative radius holds nowhere. ``leg.radius_m`` is not used.
    ``look_around`` must have written ``users.seen`` for the leg's span.

    Rows (time, user, class) go into ``out``, user by user in order of time. Several circles that
    are crossed in one microsecond are one change to the class thereafter, or none if that is the
    class before. So the order of circles in an instant does not matter, and each user has at most
    one row an instant: a fall or a rise. With one class, the rows are those of ``crossings``.
    If ``out`` is too short, the number is larger than its length, and with that many rows it is
    long enough.
    """
    x0, y0 = leg.route[0], leg.route[1]
    flight, stay = ways_of(DroneLeg(leg.profile, leg.route, leg.span_us, 0.0, leg.fresh))
    kept = most = 0
    for user in range(len(users.offsets) - 1):
        x, y = x0 - users.seen[AT_X, user], y0 - users.seen[AT_Y, user]
        held, total = 0, kept
        for k in range(radii_m.shape[1]):
            radius = radii_m[user, k]
            if radius < 0.0:
                break
            if not leg.fresh and _beyond(x, y, radius) <= 0.0:
                held += 1
            near = comes_near(_widened(flight, radius), users.seen, user, leg.fresh)
            near += comes_near(_widened(stay, radius), users.seen, user, leg.fresh)
            if near > 0.0:
                ring = DroneLeg(leg.profile, leg.route, leg.span_us, radius, leg.fresh)
                total = _cross(ring, users, user, out, total)
        most = max(most, total)
        kept = total if total > len(out) else _classes(out, kept, total, held)
    return max(kept, most) if most > len(out) else kept


@part
def _widened(way: Way, radius: float) -> Way:
    """Return the way for a circle of this radius, of that for a circle of none."""
    x0, y0, x1, y1, begin, end, out, within = way
    return Way(x0, y0, x1, y1, begin, end, out + radius, within + radius)


@part
def _classes(out: NDArray[np.int64], first: int, last: int, held: int) -> int:
    """Turn the crossings of a user into changes of class, and return the row after the last one.

    The crossings are the rows ``first`` … ``last`` - 1, circle by circle.
    """
    for k in range(first + 1, last):
        t_us, user, enters = out[k, TIME_US], out[k, USER], out[k, ENTERS]
        i = k
        while i > first and out[i - 1, TIME_US] > t_us:
            out[i, TIME_US], out[i, ENTERS] = out[i - 1, TIME_US], out[i - 1, ENTERS]
            i -= 1
        out[i, TIME_US], out[i, USER], out[i, ENTERS] = t_us, user, enters
    kept, now = first, held
    for k in range(first, last):
        now += 1 if out[k, ENTERS] else -1
        if k + 1 == last or out[k + 1, TIME_US] > out[k, TIME_US]:
            if now != held:
                out[kept, TIME_US], out[kept, USER] = out[k, TIME_US], out[k, USER]
                out[kept, CLASS] = now
                kept += 1
            held = now
    return kept
