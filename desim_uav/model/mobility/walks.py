"""The walks of users, and the loop that draws their legs in a span of time."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from desim_uav.errors import SimulationError
from desim_uav.model.demand.requests import joined_offsets
from desim_uav.model.geometry.coverage import WalkLeg
from desim_uav.model.random.streams import Stream, begin_stream
from desim_uav.rowcode.components import (
    kind_of,
)
from desim_uav.rowcode.kernels import rule
from desim_uav.rowcode.rows import (
    Row,
    Table,
    row,
)
from desim_uav.rowcode.views import records

STRAY_M, NEAR_M = 1e-4, 1e-3
"""Tolerances in metres: how far rounding may put a user off the map, and how far a leg's end may be
from the point to which its velocity leads, because its time is in whole microseconds."""

SHORTEST_US = 1000
"""Legs of a user last at least a millisecond on average: shorter ones are mistakes of units."""


class Area(NamedTuple):
    """The map, which extends from 0 to ``width_m`` in x and to ``depth_m`` in y, in metres."""

    width_m: float
    depth_m: float


class Walks(NamedTuple):
    """The walks of all users: an array of the rows WalkLeg.

    Those of user u are ``offsets[u]:offsets[u + 1]``. A user's first leg begins at time 0. Each leg
    begins where and when the one before ends; the last one has no end. A model of one's own may
    make a table of five columns instead (see ``in_rows``).
    """

    legs: Any
    offsets: NDArray[np.int64]

    def drawn(self) -> Walks:
        """Return these walks, which need not be drawn (see ``RowWalks``)."""
        return self


def in_rows(walks: Walks) -> Walks:
    """Return walks of a model, which may have made a table of five columns, with legs as rows."""
    named = walks.legs.dtype.names
    return walks if named else Walks(records(WalkLeg, walks.legs), walks.offsets)


def joined_walks(parts: Sequence[Walks]) -> Walks:
    """Return the walks of groups of users, in the order of the groups."""
    if len(parts) == 1:
        return parts[0]
    legs = np.concatenate([part.legs for part in parts])
    return Walks(legs, joined_offsets([part.offsets for part in parts]))


@row
class Walker(Row):
    """A walking user: the end of its present leg, its velocity, and the beginning of the leg.

    The walkers of a mobility model also have the numbers that the model remembers.
    """

    x_m: float
    y_m: float
    vx_mps: float
    vy_mps: float
    t_us: int
    from_us: int
    from_x_m: float
    from_y_m: float
    stream: Stream


@row
class Walking(Row):
    """All users' walks in an episode: the walkers, and their legs in the present span of time.

    The legs of user u are those from ``legs_at[u]`` to ``legs_at[u + 1]`` - 1.
    ``count`` is their number, which may exceed the memory for them. ``lost`` is the number of the
    user whose leg is invalid (see ``misstep``), plus 1; 0 if there is none.
    """

    scratch = ("legs", "legs_at")
    width_m: float
    depth_m: float
    horizon_us: int
    begun: int
    lost: int
    count: int
    walkers: Table[Walker]
    legs: Table[WalkLeg]
    legs_at: Table[int]


# ---- legs of a span of time


def begin_by(begin: Callable[..., None]) -> Callable[..., None]:
    """Return a function that puts all users where they are at time 0."""

    def begin_all(
        mobility: object, walking: Walking, homes: Table[float], streams: Table[int]
    ) -> None:
        walking.begun = 1
        area = Area(walking.width_m, walking.depth_m)
        for user in range(len(walking.walkers)):
            walker = walking.walkers[user]
            walker.x_m, walker.y_m = homes[2 * user], homes[2 * user + 1]
            begin_stream(walker.stream, streams, 4 * user)
            begin(mobility, walker, user, homes, streams, area)

    return begin_all


def walk_by(
    next_leg: Callable[..., None],
    stays_on_map: bool,
    held: Callable[[Any], Any] = lambda walker: walker,
    put_back: Callable[[Any, Any], None] = lambda walker, held: None,
) -> Callable[..., None]:
    """Return a function that writes all legs of a span, beginning with those under way.

    Spans follow one another. The function ends at once if a leg is invalid. Compiled code works on
    a copy of each walker (``held``), which is in registers.
    """

    def walk(mobility: object, walking: Walking, start_us: int, end_us: int) -> None:
        area = Area(walking.width_m, walking.depth_m)
        first_us = min(start_us + 1, walking.horizon_us)
        last_us = min(end_us + 1, walking.horizon_us)
        legs, count, most = walking.legs, 0, len(walking.legs)
        walking.legs_at[0] = 0
        for user in range(len(walking.walkers)):
            walker = held(walking.walkers[user])
            while True:
                if walker.t_us >= first_us:
                    if count < most:
                        leg = legs[count]
                        leg.begin_us = float(walker.from_us)
                        leg.x_m, leg.y_m = walker.from_x_m, walker.from_y_m
                        leg.vx_mps, leg.vy_mps = walker.vx_mps, walker.vy_mps
                    count += 1
                    if walker.t_us >= last_us:
                        break
                walker.from_us = walker.t_us
                walker.from_x_m, walker.from_y_m = walker.x_m, walker.y_m
                next_leg(mobility, walker, walker.stream, area)
                takes_time = walker.t_us > walker.from_us
                if not takes_time or not (stays_on_map or _leads_on(walker, area)):
                    walking.lost = user + 1
                    break
            put_back(walking.walkers[user], walker)
            if walking.lost:
                return
            walking.legs_at[user + 1] = min(count, most)
        walking.count = count

    return walk


@rule
def _leads_on(walker: Walker, area: Area) -> Any:
    """Return whether a leg's velocity leads to its end, and this is on the map."""
    lasts_us = walker.t_us - walker.from_us
    apart_m = abs(walker.from_x_m + walker.vx_mps * lasts_us * 1e-6 - walker.x_m)
    apart_m += abs(walker.from_y_m + walker.vy_mps * lasts_us * 1e-6 - walker.y_m)
    return (
        (apart_m <= NEAR_M)
        & (abs(walker.x_m - 0.5 * area.width_m) <= 0.5 * area.width_m + STRAY_M)
        & (abs(walker.y_m - 0.5 * area.depth_m) <= 0.5 * area.depth_m + STRAY_M)
    )


def misstep(mobility: object, walking: Any) -> SimulationError:
    """Return the error of an invalid leg: it takes no time, leaves the map or misses its end."""
    user = walking.lost - 1
    walker = walking.walkers[user]
    at_s, x_m, y_m = walker.t_us / 1e6, walker.x_m, walker.y_m
    if walker.t_us <= walker.from_us:
        problem = f"the leg of user {user} that begins at {walker.from_us / 1e6:g} s takes no time"
    elif off_map(x_m, y_m, walking):
        problem = (
            f"user {user} is off the map of {walking.width_m:g} x {walking.depth_m:g} m "
            f"at {at_s:g} s: ({x_m:g}, {y_m:g}) m"
        )
    else:
        problem = f"the velocity of user {user} does not lead to where it is at {at_s:g} s"
    return SimulationError(f"users.mobility: {kind_of(mobility)!r}: {problem}")


def too_many(mobility: object, legs: int, horizon_us: int) -> SimulationError:
    """Return the error of a model with more legs than one in a millisecond for each user."""
    return SimulationError(
        f"users.mobility: {kind_of(mobility)!r}: users walk {legs:,} legs in {horizon_us / 1e6:g} "
        "s, fewer than a millisecond each; walker.t_us is in microseconds"
    )


def off_map(x_m: Any, y_m: Any, area: Area) -> Any:
    """Return whether places are off the map, by more than rounding."""
    on_map = (x_m >= -STRAY_M) & (x_m <= area.width_m + STRAY_M)
    on_map &= (y_m >= -STRAY_M) & (y_m <= area.depth_m + STRAY_M)
    return np.logical_not(on_map)
