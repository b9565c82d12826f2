"""The crossings of users and footprints on a drone's leg, from ``model.crossings``."""

from __future__ import annotations

from operator import itemgetter
from typing import Any

import numpy as np

from desim_uav.model.coverage import (
    SEEN_ROWS,
    VX,
    VY,
    Buckets,
    DroneLeg,
    Users,
    bucket_grid,
    look_around,
    sort_into_buckets,
)
from desim_uav.model.crossings import ENTERS, TIME_US, USER, crossings, crossings_near
from desim_uav.model.motion import Transit
from desim_uav.model.rows import named
from desim_uav.model.walking import Area, Walks
from desim_uav.rules import rows

_BY_TIME = itemgetter(TIME_US, ENTERS, USER)


Crossing: Any = named(rows.Crossing)
"""The crossing of a footprint's edge by a user: a tuple, which takes less time than a row."""

Way = tuple[float, float, float, float]
"""The start and the end of a leg: x0, y0, x1 and y1, in metres."""


class Crossings:
    """Computes the crossings on a leg.

    If users stand still, the crossings on a leg are the same whenever it is flown. They are kept,
    by the leg's ends and span and by whether the drone begins to serve, for as long as the users'
    positions do not change, which may be for many episodes.
    """

    def __init__(self, radius_m: float, area: Area) -> None:
        self.radius_m = radius_m
        self._shape = bucket_grid(*area, radius_m)
        nx, ny = self._shape
        self._side_m = (area.width_m / max(nx, 1), area.depth_m / max(ny, 1))
        self._heads = np.empty(nx * ny, np.int64)
        self._far_m = 0.0
        self.walks = Walks(np.empty((0, 5)), np.zeros(1, np.int64))
        self._still = True
        self._kept: dict[tuple[object, ...], list[Crossing]] = {}
        self._buffer = np.empty((256, 3), np.int64)
        self._span = (-1, -1)

    def begin(self, walks: Walks) -> None:
        """Begin an episode with these walks."""
        if walks is self.walks:
            return
        standing = len(walks.legs) < len(walks.offsets) and not walks.legs[:, VX : VY + 1].any()
        if not standing or not np.array_equal(walks.legs, self.walks.legs):
            self._kept.clear()
        self._still = standing
        self.walks = walks
        users = len(walks.offsets) - 1
        self._users = Users(*walks, np.zeros((SEEN_ROWS, users)))
        following = np.empty(users, np.int64)
        self._buckets = Buckets(self._shape, self._side_m, self._heads, following)
        self._span = (-1, -1)

    def of(
        self, transit: Transit, way: Way, start_us: int, span_us: int, fresh: bool
    ) -> list[Crossing]:
        """Return the crossings on a leg from ``start_us`` on, the last one first.

        At the same time, exits are before entries, and then the order is by user. If the drone
        begins to serve (``fresh``), the users in its footprint enter it at ``start_us``.
        """
        if not self._still:
            return self._find(transit, way, start_us, span_us, fresh)
        key = (way, span_us, fresh)
        kept = self._kept.get(key)
        if kept is None:
            kept = self._kept[key] = self._find(transit, way, 0, span_us, fresh)
        return [Crossing(start_us + t_us, user, enters) for t_us, user, enters in kept]

    def _find(
        self, transit: Transit, way: Way, start_us: int, span_us: int, fresh: bool
    ) -> list[Crossing]:
        """Compute the crossings that ``of`` returns."""
        users, buckets, span = self._users, self._buckets, (start_us, start_us + span_us)
        if self._span != span:
            look_around(users, *span)
            self._span = span
            if self._shape[0]:
                self._far_m = sort_into_buckets(users.seen, buckets)
        leg = DroneLeg(transit.profile, way, span, self.radius_m, fresh)
        while True:
            if self._shape[0]:
                count = crossings_near(leg, users, buckets, self._far_m, self._buffer)
            else:
                count = crossings(leg, users, self._buffer)
            if count <= len(self._buffer):
                found: list[Any] = self._buffer[:count].tolist()
                found.sort(key=_BY_TIME, reverse=True)
                return [Crossing(*row) for row in found]
            self._buffer = np.empty((2 * count, 3), np.int64)
