"""Mobility: how users walk in each episode, as straight legs from home."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, Any, ClassVar, Protocol

import numpy as np
from annotated_types import Ge, Le
from numpy.typing import NDArray

from desim_uav.errors import SimulationError
from desim_uav.model.geometry.coverage import WalkLeg
from desim_uav.model.mobility.walking import ManyRowWalks, RowMobility, RowWalks, go_on
from desim_uav.model.mobility.walks import Area, Walks, in_rows, off_map
from desim_uav.model.random.streams import Purpose, Seeds, Streams, heading, seed_of_each, states_of
from desim_uav.model.rules import US
from desim_uav.registry import register
from desim_uav.rowcode.components import kind_of, works_on_rows
from desim_uav.rowcode.views import dtype_of, zeros


class Mobility(Protocol):
    """A mobility model, which determines the walks of all users.

    A model without randomness may have ``draws = False``; its walks are then made once and used in
    every episode.
    """

    def walks(
        self, homes: NDArray[np.float64], streams: Streams, area: Area, horizon_us: int
    ) -> Walks:
        """Return the walks of one episode from ``homes`` (users, 2), in metres.

        User u may draw from stream u only. ``horizon_us`` is the length of the episode in
        microseconds.
        """


@register("mobility", "static")
@dataclass(frozen=True)
class Static:
    """Users stay at home."""

    draws: ClassVar = False

    def walks(
        self, homes: NDArray[np.float64], streams: Streams, area: Area, horizon_us: int
    ) -> Walks:
        """Return one leg per user, at speed 0."""
        legs = zeros(WalkLeg, len(homes))
        legs["x_m"], legs["y_m"] = homes.T
        return Walks(legs, np.arange(len(homes) + 1))

    def expected_legs(self, users: int, area: Area, horizon_s: float) -> float:
        """Return the number of legs of all users in an episode."""
        return users


@register("mobility", "random_walk")
@dataclass(frozen=True)
class RandomWalk(RowMobility):
    """Each user takes a new uniform heading every ``leg_s``, and is reflected at the map's edge."""

    speed_mps: Annotated[float, Ge(0), Le(200)] = 1.4
    """The walking speed, in metres per second."""
    leg_s: Annotated[float, Ge(0.001)] = 60.0
    """How long a user walks before it takes a new heading, in seconds."""

    stays_on_map = True

    def next_leg(self, walker: Any, stream: Any, area: Any) -> None:
        """Walk to a turn, where the user takes a new heading, or to the edge of the map."""
        leg_us = int(np.rint(self.leg_s * US))
        since_us = walker.t_us % leg_us
        if since_us == 0:
            x, y = heading(stream)
            walker.vx_mps, walker.vy_mps = self.speed_mps * x, self.speed_mps * y
        go_on(walker, area, walker.t_us - since_us + leg_us)

    def expected_legs(self, users: int, area: Area, horizon_s: float) -> float:
        """Return the mean number of legs of all users in an episode: turns, and edges that are met.

        The mean speed along an axis is 2/π of the speed; an edge is met once per side of the map.
        """
        walls = 2.0 / math.pi * self.speed_mps * horizon_s * sum(1.0 / side for side in area)
        return users * (math.ceil(horizon_s / self.leg_s) + walls)


def walks_of(
    mobility: Mobility,
    homes: NDArray[np.float64],
    seeds: Seeds,
    episodes: Sequence[int],
    area: Area,
    horizon_us: int,
    first: int = 0,
) -> Sequence[Walks | RowWalks]:
    """Return the walks of several episodes from ``homes`` (users, 2), or rows that draw them.

    ``first`` is the number of the first user's random stream.
    """
    if works_on_rows(mobility, RowMobility):
        assert isinstance(mobility, RowMobility)
        states = states_of(seeds, Purpose.MOBILITY, episodes, len(homes), first)
        return ManyRowWalks(mobility, homes, states, area, horizon_us)
    own = zip(seed_of_each(seeds, episodes), episodes, strict=True)
    streams = [Streams(seed, Purpose.MOBILITY, episode, first) for seed, episode in own]
    walking = []
    for each in streams:
        walks = mobility.walks(homes, each, area, horizon_us)
        problem = misshapen(walks, len(homes))
        if not problem:
            walking.append(in_rows(walks))
            problem = leaves_the_map(walking[-1], area, horizon_us)
        if problem:
            raise SimulationError(f"users.mobility: {kind_of(mobility)!r}: {problem}")
    return walking


def misshapen(walks: Walks, users: int) -> str:
    """Return the problem if these are not legs of five columns, one at least for each user."""
    try:
        legs, offsets = (np.asarray(part) for part in walks)
    except (TypeError, ValueError):  # it has not two parts
        legs = offsets = np.zeros(0)
    are_legs = legs.dtype == dtype_of(WalkLeg) or (legs.ndim == 2 and legs.shape[1] == 5)
    if are_legs and offsets.shape == (users + 1,):
        bounds = offsets[0] == 0 and offsets[-1] == len(legs)
        if bounds and (np.diff(offsets) >= 1).all():
            return ""
    return f"walks() must return legs of five columns, one at least for each of {users} users"


def leaves_the_map(walks: Walks, area: Area, horizon_us: int) -> str:
    """Return which user is off the map first, and when; an empty text if all walks stay on it."""
    legs, offsets = walks
    begins = legs["begin_us"]
    ends = np.append(begins[1:], 0.0)
    ends[offsets[1:] - 1] = horizon_us  # the last leg of each user goes on
    seconds = np.maximum(np.minimum(ends, horizon_us) - begins, 0.0) / US
    exits = []
    for t_us, shift_s in ((begins, 0.0), (begins + seconds * US, seconds)):
        x = legs["x_m"] + legs["vx_mps"] * shift_s
        y = legs["y_m"] + legs["vy_mps"] * shift_s
        off = np.flatnonzero(off_map(x, y, area) & (t_us <= horizon_us))
        if len(off):
            first = off[np.argmin(t_us[off])]
            user = int(np.searchsorted(offsets, first, side="right")) - 1
            exits.append((t_us[first] / US, user, x[first], y[first]))
    if not exits:
        return ""
    t_s, user, x_m, y_m = min(exits)
    return (
        f"user {user} is off the map of {area.width_m:g} x {area.depth_m:g} m "
        f"at {t_s:g} s: ({x_m:g}, {y_m:g}) m"
    )
