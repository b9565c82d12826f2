"""Random waypoint: users walk to random places, one after the other, and pause at each of them."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Annotated, Any, ClassVar

from annotated_types import Ge, Le

from desim_uav.model.mobility.walking import RowMobility, Start, go_to, later, stay
from desim_uav.model.mobility.walks import Area
from desim_uav.model.random.distributions import (
    SpeedRange,
    ascending,
    between,
    longer_first,
    mean_distance,
    mean_slowness,
    power_law,
)
from desim_uav.model.random.streams import Stream, uniform
from desim_uav.registry import Checked, register
from desim_uav.rowcode.kernels import rule

Pause = Annotated[float, Ge(0), Le(1e6)]
PauseRange = Annotated[tuple[Pause, Pause], Checked(ascending)]

GOES, PAUSES, FIRST_WALK, FIRST_PAUSE = range(4)
"""What a user does next: walk to a new place, pause, or the rest of what it does at time 0."""


@register("mobility", "random_waypoint")
@dataclass(frozen=True)
class RandomWaypoint(RowMobility):
    """Each user walks straight to a uniform random place, pauses there, and goes on to the next.

    It walks each leg at a speed of its own. With a stationary start, users are at time 0 as they
    are in the long run (Navidi and Camp 2004).
    """

    speed_mps: SpeedRange = (0.8, 2.0)
    """The range from which the speed of each leg is drawn, in metres per second."""
    pause_s: PauseRange = (0.0, 120.0)
    """The range from which each pause is drawn, in seconds."""
    start: Start = "stationary"
    """`stationary`: users begin as they are in the long run, anywhere on the map, and not at their
    homes. `home`: they begin at home with a walk to a random place, and drift away from there.
    """

    stationary: int = field(init=False, repr=False, compare=False)
    slowness: float = field(init=False, repr=False, compare=False)
    """The mean of 1 / v."""

    remembers: ClassVar = {"next": int, "goal_x_m": float, "goal_y_m": float, "first": float}
    stays_on_map = True

    def __post_init__(self) -> None:
        """Set the numbers that follow from the parameters."""
        object.__setattr__(self, "stationary", int(self.start == "stationary"))
        object.__setattr__(self, "slowness", mean_slowness(*self.speed_mps))

    def begin(self, walker: Any, user: int, homes: Any, streams: Any, area: Any) -> None:
        """Draw what a user does at time 0, unless it begins at home."""
        if not self.stationary:
            return
        stream = walker.stream
        walks_s = mean_distance(area.width_m, area.depth_m) * self.slowness
        pauses_s = 0.5 * (self.pause_s[0] + self.pause_s[1])
        if uniform(stream) * (walks_s + pauses_s) < pauses_s:
            walker.x_m = uniform(stream) * area.width_m
            walker.y_m = uniform(stream) * area.depth_m
            walker.first = uniform(stream) * longer_first(stream, self.pause_s[0], self.pause_s[1])
            walker.next = FIRST_PAUSE
        else:
            walker.x_m, walker.y_m, walker.goal_x_m, walker.goal_y_m = on_the_way(
                stream, area.width_m, area.depth_m
            )
            walker.first = power_law(stream, self.speed_mps[0], self.speed_mps[1], -1.0)
            walker.next = FIRST_WALK

    def next_leg(self, walker: Any, stream: Any, area: Any) -> None:
        """Walk to a random place, or pause."""
        doing = walker.next
        walker.next = GOES
        if doing == FIRST_WALK:
            go_to(walker, walker.goal_x_m, walker.goal_y_m, walker.first)
        elif doing == FIRST_PAUSE:
            stay(walker, later(walker.t_us, walker.first))
        elif doing == PAUSES:
            pause_s = between(stream, self.pause_s[0], self.pause_s[1])
            stay(walker, later(walker.t_us, pause_s))
        else:
            x_m, y_m = uniform(stream) * area.width_m, uniform(stream) * area.depth_m
            go_to(walker, x_m, y_m, between(stream, self.speed_mps[0], self.speed_mps[1]))
        if doing in (GOES, FIRST_WALK) and self.pause_s[1] > 0.0:
            walker.next = PAUSES

    @property
    def mean_speed_mps(self) -> float:
        """The mean speed of users who are walking, in the long run."""
        return 1.0 / self.slowness

    def expected_legs(self, users: int, area: Area, horizon_s: float) -> float:
        """Return the mean number of legs of all users in an episode: walks, and pauses."""
        round_s = mean_distance(*area) * self.slowness + 0.5 * sum(self.pause_s)
        return users * (1.0 + horizon_s / round_s * (2.0 if self.pause_s[1] > 0.0 else 1.0))


@rule
def on_the_way(stream: Stream, width_m: float, depth_m: float) -> tuple[float, float, float, float]:
    """Return where a user is that is under way from one random place to another, and the latter.

    Of ways between random places, a longer one is under way for a longer time: the density is in
    proportion to the length, from which it is drawn by rejection. The user is anywhere on the way.
    """
    longest2 = width_m * width_m + depth_m * depth_m
    while True:
        from_x_m, from_y_m = uniform(stream) * width_m, uniform(stream) * depth_m
        to_x_m, to_y_m = uniform(stream) * width_m, uniform(stream) * depth_m
        x_m, y_m, share = to_x_m - from_x_m, to_y_m - from_y_m, uniform(stream)
        if share * share * longest2 <= x_m * x_m + y_m * y_m:
            break
    share = uniform(stream)
    return from_x_m + share * x_m, from_y_m + share * y_m, to_x_m, to_y_m
