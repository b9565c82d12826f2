"""The crossings of a drone's leg, as the air link wants them."""

from __future__ import annotations

from operator import itemgetter

import numpy as np

from desim_uav.model.coverage import (
    ENTERS,
    SEEN_COLUMNS,
    TIME_US,
    USER,
    VX,
    VY,
    crossings,
    look_around,
)
from desim_uav.model.mobility import Walks
from desim_uav.model.motion import Leg

Crossing = list[int]
"""(time, user, enters)."""

_BY_TIME = itemgetter(TIME_US, ENTERS, USER)


class Crossings:
    """Finds all crossings of a leg; where nobody walks, only once.

    A leg past users who stand still is crossed in the same way whenever it is flown: what was
    found is kept, by its ends, its span and whether the drone begins to serve, as long as the
    users stand where they stood, which may be for many episodes.
    """

    def __init__(self, radius_m: float) -> None:
        self.radius_m = radius_m
        self.walks = Walks(np.empty((0, 5)), np.zeros(1, np.int64))
        self._still = True
        self._kept: dict[tuple[object, ...], list[Crossing]] = {}
        self._found = np.empty((256, 3), np.int64)
        self._span = (-1, -1)

    def begin(self, walks: Walks) -> None:
        """An episode begins."""
        standing = len(walks.legs) < len(walks.offsets) and not walks.legs[:, VX : VY + 1].any()
        if not standing or not np.array_equal(walks.legs, self.walks.legs):
            self._kept.clear()
        self._still = standing
        self.walks = walks
        self._seen = np.empty((len(walks.offsets) - 1, SEEN_COLUMNS))
        self._span = (-1, -1)

    def of(self, flight: Leg, start_us: int, span_us: int, fresh: bool) -> list[Crossing]:
        """The crossings of a leg, the last one first: at a time exits, by user.

        A drone that begins to serve (``fresh``) enters the users it finds in its footprint.
        """
        if not self._still:
            return self._find(flight, start_us, span_us, fresh)
        key = (flight.from_m, flight.to_m, span_us, fresh)
        kept = self._kept.get(key)
        if kept is None:
            kept = self._kept[key] = self._find(flight, 0, span_us, fresh)
        return [[start_us + t_us, user, enters] for t_us, user, enters in kept]

    def _find(self, flight: Leg, start_us: int, span_us: int, fresh: bool) -> list[Crossing]:
        (transit, (x0, y0), (x1, y1), _, _), (legs, offsets) = flight, self.walks
        end_us, radius_m, profile = start_us + span_us, self.radius_m, transit.profile
        seen = self._seen
        if self._span != (start_us, end_us):
            look_around(legs, offsets, start_us, end_us, seen)
            self._span = (start_us, end_us)
        while True:
            out = self._found
            count = crossings(
                profile, x0, y0, x1, y1, start_us, end_us, radius_m, legs, offsets, seen, fresh, out
            )
            if count <= len(self._found):
                found: list[Crossing] = self._found[:count].tolist()
                found.sort(key=_BY_TIME, reverse=True)
                return found
            self._found = np.empty((2 * count, 3), np.int64)
