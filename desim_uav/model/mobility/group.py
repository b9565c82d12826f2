"""Groups: users who keep within a disc round a leader that walks on random waypoints (RPGM)."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Annotated, Any, ClassVar

from annotated_types import Ge, Le

from desim_uav.model.mobility.random_waypoint import PauseRange, on_the_way
from desim_uav.model.mobility.walking import RowMobility, Start, go_until, later
from desim_uav.model.mobility.walks import Area
from desim_uav.model.random.distributions import (
    SpeedRange,
    between,
    in_disc,
    longer_first,
    mean_distance,
    mean_slowness,
    power_law,
)
from desim_uav.model.random.streams import Stream, apart, begin_stream, uniform
from desim_uav.registry import register
from desim_uav.rowcode.kernels import rule

WALKS, PAUSES = range(2)
"""What a leader does next."""


@register("mobility", "group")
@dataclass(frozen=True)
class Group(RowMobility):
    """Users walk in groups: each keeps within a disc round its group's leader, who is no user.

    Leaders walk as in `random_waypoint`, no closer to the map's edge than the radius of the disc.
    Every ``step_s``, and where its leader turns, a member is at a new uniform place of the disc; it
    walks straight from one to the next, and so is never outside of the disc (Hong, Gerla, Pei and
    Chiang 1999).
    """

    groups: Annotated[int, Ge(1), Le(1_000_000)] = 4
    """The number of groups. User u is in group u modulo this number, as it is in cluster u modulo
    `users.clusters.count`: if both are equal, each cluster has a leader.
    """
    radius_m: Annotated[float, Ge(0), Le(1e6)] = 50.0
    """The radius of the disc round a leader, in metres; less than half of the map's shorter
    side.
    """
    step_s: Annotated[float, Ge(0.1), Le(1e6)] = 60.0
    """The time from one place in the disc to the next, in seconds."""
    speed_mps: SpeedRange = (0.8, 2.0)
    """The range from which the speed of each walk of a leader is drawn, in metres per second."""
    pause_s: PauseRange = (0.0, 120.0)
    """The range from which each pause of a leader is drawn, in seconds."""
    start: Start = "stationary"
    """`stationary`: leaders begin as they are in the long run, anywhere on the map, with the
    members round them and not at their homes. `home`: a leader begins at the home of the first
    member of its group, and the members at theirs; after the first step they are in the disc.
    """

    stationary: int = field(init=False, repr=False, compare=False)
    slowness: float = field(init=False, repr=False, compare=False)
    """The mean of 1 / v."""

    remembers: ClassVar = {
        "leader": Stream,
        "next": int,
        "since_us": int,
        "until_us": int,
        "since_x_m": float,
        "since_y_m": float,
        "until_x_m": float,
        "until_y_m": float,
    }
    stays_on_map = True

    def __post_init__(self) -> None:
        """Set the numbers that follow from the parameters."""
        object.__setattr__(self, "stationary", int(self.start == "stationary"))
        object.__setattr__(self, "slowness", mean_slowness(*self.speed_mps))

    def problems(self, users: int, area: Area) -> list[str]:
        """Return the problem of discs that do not fit a map."""
        if self.radius_m < 0.5 * min(area):
            return []
        return [
            f"radius_m: {self.radius_m:g}: must be less than half of the shorter side of the map, "
            f"which is {area.width_m:g} x {area.depth_m:g} m"
        ]

    def begin(self, walker: Any, user: int, homes: Any, streams: Any, area: Any) -> None:
        """Draw the leader's walk or pause at time 0, and a place in the disc.

        All members draw the same walks of the leader, from a stream that the first one's leads to.
        """
        first = user % self.groups
        begin_stream(walker.leader, streams, 4 * first)
        apart(walker.leader)
        if not self.stationary:
            walker.until_x_m = inside(homes[2 * first], self.radius_m, area.width_m)
            walker.until_y_m = inside(homes[2 * first + 1], self.radius_m, area.depth_m)
            return
        leader = walker.leader
        width_m, depth_m = area.width_m - 2 * self.radius_m, area.depth_m - 2 * self.radius_m
        walks_s = mean_distance(width_m, depth_m) * self.slowness
        pauses_s = 0.5 * (self.pause_s[0] + self.pause_s[1])
        x_m, y_m, to_x_m, to_y_m = on_the_way(leader, width_m, depth_m)
        if uniform(leader) * (walks_s + pauses_s) < pauses_s:
            x_m = to_x_m = uniform(leader) * width_m
            y_m = to_y_m = uniform(leader) * depth_m
            rest_s = uniform(leader) * longer_first(leader, self.pause_s[0], self.pause_s[1])
            walker.next = WALKS
        else:
            away_x_m, away_y_m = to_x_m - x_m, to_y_m - y_m
            rest_s = math.sqrt(away_x_m * away_x_m + away_y_m * away_y_m)
            rest_s /= power_law(leader, self.speed_mps[0], self.speed_mps[1], -1.0)
            walker.next = PAUSES
        walker.since_x_m, walker.since_y_m = x_m + self.radius_m, y_m + self.radius_m
        walker.until_x_m, walker.until_y_m = to_x_m + self.radius_m, to_y_m + self.radius_m
        walker.until_us = later(0, rest_s)
        x, y = in_disc(walker.stream)
        walker.x_m = inside(walker.since_x_m + self.radius_m * x, 0.0, area.width_m)
        walker.y_m = inside(walker.since_y_m + self.radius_m * y, 0.0, area.depth_m)

    def next_leg(self, walker: Any, stream: Any, area: Any) -> None:
        """Walk to a place of the disc where it is a step later, or when the leader turns."""
        if walker.t_us == walker.until_us:
            leader = walker.leader
            walker.since_us = walker.until_us
            walker.since_x_m, walker.since_y_m = walker.until_x_m, walker.until_y_m
            if walker.next == PAUSES and self.pause_s[1] > 0.0:
                pause_s = between(leader, self.pause_s[0], self.pause_s[1])
                walker.until_us = later(walker.t_us, pause_s)
                walker.next = WALKS
            else:
                x_m = between(leader, self.radius_m, area.width_m - self.radius_m)
                y_m = between(leader, self.radius_m, area.depth_m - self.radius_m)
                away_x_m, away_y_m = x_m - walker.since_x_m, y_m - walker.since_y_m
                far_m = math.sqrt(away_x_m * away_x_m + away_y_m * away_y_m)
                speed_mps = between(leader, self.speed_mps[0], self.speed_mps[1])
                walker.until_us = later(walker.t_us, far_m / speed_mps)
                walker.until_x_m, walker.until_y_m = x_m, y_m
                walker.next = PAUSES
        end_us = min(later(walker.t_us, self.step_s), walker.until_us)
        share = (end_us - walker.since_us) / (walker.until_us - walker.since_us)
        x, y = in_disc(stream)
        x_m = walker.since_x_m + share * (walker.until_x_m - walker.since_x_m)
        y_m = walker.since_y_m + share * (walker.until_y_m - walker.since_y_m)
        x_m = inside(x_m + self.radius_m * x, 0.0, area.width_m)
        y_m = inside(y_m + self.radius_m * y, 0.0, area.depth_m)
        go_until(walker, x_m, y_m, end_us)

    @property
    def mean_speed_mps(self) -> float:
        """The speed of members, more or less: that of the leader, and that of places in the disc.

        Two uniform points of a disc are 0.9054 of its radius apart on average.
        """
        return math.hypot(1.0 / self.slowness, 0.905415 * self.radius_m / self.step_s)

    def expected_legs(self, users: int, area: Area, horizon_s: float) -> float:
        """Return the mean number of legs of all users: steps, and turns of leaders."""
        sides = (side - 2.0 * self.radius_m for side in area)
        round_s = mean_distance(*sides) * self.slowness + 0.5 * sum(self.pause_s)
        return users * (1.0 + horizon_s / self.step_s + 2.0 * horizon_s / round_s)


@rule
def inside(at_m: float, margin_m: float, size_m: float) -> float:
    """Return a place on the map that is a margin from its edge at least, near a given place."""
    return min(max(at_m, margin_m), size_m - margin_m)
