"""When drones come too near to each other and part again, in the SimPy engine."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from desim_uav.engine.des.free import transit_of
from desim_uav.model.geometry.separation import approach, conflicts
from desim_uav.model.motion.motion import Transit
from desim_uav.model.radio.tracks import TRACK_COLUMNS, Flight, fly
from desim_uav.rules.separation import MOST_TRACK_ROWS, MOST_TURNS, route_of
from desim_uav.rules.words import OWN


class Separation:
    """What ``rules.separation`` asks of an engine: ``meet`` and ``least_m``."""

    def __init__(self, transits: Sequence[Transit]) -> None:
        self.transits = transits
        self.tracks = np.zeros((MOST_TRACK_ROWS, TRACK_COLUMNS))
        self.found = np.zeros((MOST_TURNS, 2), np.int64)

    def meet(self, world: Any, state: Any, pair: Any, until_us: int) -> None:
        """Write the times at which a pair comes too near and parts, the next one last."""
        span = (int(state.now_us), int(until_us))
        one, other = self._tracks(world, state.drones[pair.one], state.drones[pair.other], span)
        least_m = world.separation_m
        count = conflicts(self.tracks, one, other, least_m, span, pair.near, self.found)
        pair.turns[:] = self.found[:count, 0][::-1].tolist()

    def least_m(
        self, world: Any, state: Any, one: Any, other: Any, begin_us: int, end_us: int
    ) -> float:
        """Return the least distance of two drones in a part of their present legs, in metres."""
        span = (int(begin_us), int(end_us))
        mine, theirs = self._tracks(world, one, other, span)
        return approach(self.tracks, mine, theirs, 0.0, (span[1] - span[0]) * 1e-6).distance_m

    def _tracks(self, world: Any, one: Any, other: Any, span: tuple[int, int]) -> Any:
        first = (0, fly(self._flight(world, one), span, self.tracks, 0))
        return first, (first[1], fly(self._flight(world, other), span, self.tracks, first[1]))

    def _flight(self, world: Any, drone: Any) -> Flight:
        own = drone.transit == OWN
        flight = transit_of(drone.course.flight) if own else self.transits[drone.transit]
        return Flight(flight.profile, route_of(world, drone), drone.since_us)
