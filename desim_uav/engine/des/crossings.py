"""The changes of class on a drone's leg, from ``model.geometry.crossings`` and ``model.radio``."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from desim_uav.engine.air import fits_between, windows_for
from desim_uav.model.geometry.coverage import (
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
from desim_uav.model.geometry.crossings import crossings_near
from desim_uav.model.geometry.relative import TIME_US, USER
from desim_uav.model.mobility.walking import Walks
from desim_uav.model.motion.motion import Transit
from desim_uav.model.radio.between import Climb, class_changes_between
from desim_uav.model.radio.nested import CHANGE, changes_on
from desim_uav.rowcode.rows import named
from desim_uav.rules import rows
from desim_uav.world import Links, World

Change: Any = named(rows.Change)
"""The change of a link's class: a tuple, which takes less time than a row."""

Course = tuple[Transit, "Way", tuple[int, int]]
"""A transit along a way, and the levels at its start and at its end."""

FreeCourse = tuple[Transit, "Way", tuple[float, float]]
"""A transit along a way, and the heights at its start and at its end, in metres."""

Way = tuple[float, float, float, float]
"""The start and the end of a leg: x0, y0, x1 and y1, in metres."""


def last_first(rows: list[list[int]]) -> list[Any]:
    """Return rows as changes, the last one first: by time, rises after falls, then by user."""
    rows.sort(key=lambda row: (row[TIME_US], row[CHANGE] > 0, row[USER]), reverse=True)
    return [Change(*row) for row in rows]


class Changes:
    """Computes the changes of class on a leg of a radio with these links.

    If users stand still, the changes on a leg are the same whenever it is flown. They are kept, by
    the leg's transit (which lives as long as its world), ends, levels and span and by whether the
    drone begins to serve, for as long as the users' positions do not change, which may be for many
    episodes.
    """

    def __init__(self, world: World, links: Links) -> None:
        self.radii_m, self.groups, area = links.rings_m, world.groups, world.area
        self._shape = bucket_grid(*area, max(float(self.radii_m.max()), 1e-6))
        one = self.radii_m[0].size == 1 and float(self.radii_m.min()) >= 0.0
        self._by_buckets = self._shape[0] > 0 and one
        self._fits = fits_between(world, links)
        self._windows = windows_for(world, self._fits)
        nx, ny = self._shape
        self._side_m = (area.width_m / max(nx, 1), area.depth_m / max(ny, 1))
        self._heads = np.empty(nx * ny, np.int64)
        self._far_m = 0.0
        self.walks = Walks(np.empty((0, 5)), np.zeros(1, np.int64))
        self._still = True
        self._kept: dict[tuple[object, ...], list[Change]] = {}
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

    def of(self, flight: Course, start_us: int, span_us: int, fresh: bool) -> list[Change]:
        """Return the changes on a leg, from ``start_us`` on.

        The last one is first; at the same time, falls are before rises, and then the order is by
        user. If the drone begins to serve (``fresh``), users rise to their classes at ``start_us``.
        """
        if not self._still:
            return self._find(flight, start_us, span_us, fresh)
        key = (id(flight[0]), *flight[1:], span_us, fresh)
        kept = self._kept.get(key)
        if kept is None:
            kept = self._kept[key] = self._find(flight, 0, span_us, fresh)
        return [Change(start_us + t_us, user, change) for t_us, user, change in kept]

    def of_free(self, flight: FreeCourse, start_us: int, span_us: int, fresh: bool) -> list[Change]:
        """Return the changes on a free leg, at all heights of which the classes are the same."""
        transit, way, (z0_m, z1_m) = flight
        users, span = self._seen(start_us, span_us)
        radius_m = float(self.radii_m[0, 0, 0])
        leg = DroneLeg(transit.profile, way, span, radius_m, fresh, z1_m - z0_m)
        if self._by_buckets:
            found = self._near(leg)
        else:
            found = changes_on(leg, users, self.radii_m[0], self.groups)
        return last_first(found.tolist())

    def _seen(self, start_us: int, span_us: int) -> tuple[Users, tuple[int, int]]:
        """Return the users, after a look at how they walk in a span, and the span."""
        users, span = self._users, (start_us, start_us + span_us)
        if self._span != span:
            look_around(users, *span)
            self._span = span
            if self._by_buckets:
                self._far_m = sort_into_buckets(users.seen, self._buckets)
        return users, span

    def _find(self, flight: Course, start_us: int, span_us: int, fresh: bool) -> list[Change]:
        """Compute the changes that ``of`` returns."""
        transit, way, (level, to_level) = flight
        users, span = self._seen(start_us, span_us)
        radii_m = self.radii_m[level]
        leg = DroneLeg(transit.profile, way, span, float(radii_m[0, 0]), fresh)
        if self._by_buckets:
            found = self._near(leg)
        elif level != to_level and self._fits.terms.size:
            found = self._between(leg, level, to_level)
        else:
            found = changes_on(leg, users, radii_m, self.groups)
        return last_first(found.tolist())

    def _between(self, leg: DroneLeg, level: int, to_level: int) -> NDArray[np.int64]:
        """Compute the changes on a leg between two levels."""
        lower, rings_m = min(level, to_level), (self.radii_m[level], self.radii_m[to_level])
        terms, ranges, (least_m, most_m) = (array[lower] for array in self._fits)
        upwards = float(to_level > level)
        climb = Climb(upwards, rings_m, least_m, most_m, terms, ranges, self._windows)
        while True:
            out = self._buffer
            count = class_changes_between(leg, climb, self._users, self.groups, out)
            if count <= len(out):
                return out[:count]
            self._buffer = np.empty((2 * count, 3), np.int64)

    def _near(self, leg: DroneLeg) -> NDArray[np.int64]:
        """Compute the changes of users in buckets near a leg."""
        while True:
            count = crossings_near(leg, self._users, self._buckets, self._far_m, self._buffer)
            if count <= len(self._buffer):
                return self._buffer[:count]
            self._buffer = np.empty((2 * count, 3), np.int64)
