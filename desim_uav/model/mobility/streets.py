"""Streets: users who walk or drive from place to place by the shortest ways along streets."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal

import numpy as np
from annotated_types import Ge, Gt, Le

from desim_uav.model.mobility.random_waypoint import PauseRange
from desim_uav.model.mobility.recorded_walks import Shift
from desim_uav.model.mobility.street_files import ways_of
from desim_uav.model.mobility.street_graph import cut, graph_of
from desim_uav.model.mobility.walking import RowMobility, Start, go_to, later, stay
from desim_uav.model.mobility.walks import Area, off_map
from desim_uav.model.random.distributions import SpeedRange, between, mean_slowness
from desim_uav.model.random.streams import uniform
from desim_uav.model.traces import version_of
from desim_uav.registry import register
from desim_uav.rowcode.kernels import rule
from desim_uav.rowcode.rows import Table

FROM_HOME, SETS_OUT, WALKS, PAUSES, FIRST_LEG, FIRST_PAUSE = range(6)
"""What a user does next: go to the nearest street, draw a place, go on to it, pause, or the rest of
the leg or pause in which it is at time 0.
"""

BY_TAIL, BY_HEAD, ON_IT = range(3)
"""How a user comes to the street of its place: over one of its ends, or it is on it already."""

Side = Annotated[float, Gt(0), Le(1e6)]
Longitude = Annotated[float, Ge(-180), Le(180)]
Latitude = Annotated[float, Ge(-90), Le(90)]


@register("mobility", "streets")
@dataclass(frozen=True)
class Streets(RowMobility):
    """Users go to uniform random places on streets by the shortest ways, and pause at each of them.

    The streets come from a file: an OpenStreetMap extract, GeoJSON, or a network of SUMO. They meet
    where they have a point in common. Only their largest part is kept in which every place can be
    reached from every other one.
    """

    file: Path
    """The file, relative to the scenario's file."""
    later: ClassVar = ("by", "speed_mps", "pause_s", "start", "origin", "offset_m", "cut_at_m")

    by: Literal["walking", "driving"] = "walking"
    """`walking`: on all streets that pedestrians may use, in both directions. `driving`: on those
    for cars, and along one-way streets in their direction only.
    """
    speed_mps: SpeedRange = (0.8, 2.0)
    """The range from which the speed of each way is drawn, in metres per second."""
    pause_s: PauseRange = (0.0, 120.0)
    """The range from which each pause is drawn, in seconds."""
    start: Start = "stationary"
    """`stationary`: users begin as they are in the long run, anywhere on the streets, and not at
    their homes. `home`: they begin at home and go straight to the nearest street.
    """
    origin: tuple[Longitude, Latitude] | None = None
    """The longitude and latitude of the map's south-western corner, in degrees, for GeoJSON and
    OpenStreetMap. It is the one of `map.buildings`, if these are of the same city.
    """
    offset_m: tuple[Shift, Shift] = (0.0, 0.0)
    """What is added to each x and y of the file to get places on the map, in metres."""
    cut_at_m: tuple[Side, Side] | None = None
    """The width and depth of the map, in metres, if streets that lead off it are to be cut off at
    its edge. Without it, all streets must lie on the map.
    """

    version: str = field(init=False, repr=False)
    """The digest of the file."""
    attribution: str = field(init=False, repr=False, compare=False)
    """Whose data the streets are; "" if the file does not say so."""
    stationary: int = field(init=False, repr=False, compare=False)
    longest_s: float = field(init=False, repr=False, compare=False)
    """No way and the pause after it take longer together, in seconds."""
    left_out_m: float = field(init=False, repr=False, compare=False)
    x_m: Table[float] = field(init=False, repr=False, compare=False)
    """The points of all streets, one street after the other (see ``StreetGraph``)."""
    y_m: Table[float] = field(init=False, repr=False, compare=False)
    along_m: Table[float] = field(init=False, repr=False, compare=False)
    first: Table[float] = field(init=False, repr=False, compare=False)
    ends_m: Table[float] = field(init=False, repr=False, compare=False)
    """The lengths of all streets up to and with each of them, in metres."""
    tails: Table[float] = field(init=False, repr=False, compare=False)
    heads: Table[float] = field(init=False, repr=False, compare=False)
    one_way: Table[float] = field(init=False, repr=False, compare=False)
    arcs: Table[float] = field(init=False, repr=False, compare=False)
    arcs_at: Table[float] = field(init=False, repr=False, compare=False)
    lengths_m: Table[float] = field(init=False, repr=False, compare=False)

    remembers: ClassVar = {
        "next": int,
        "after": int,
        "first_x_m": float,
        "first_y_m": float,
        "first_s": float,
        "street": int,
        "point": int,
        "along_m": float,
        "forwards": int,
        "goal": int,
        "goal_along_m": float,
        "over": int,
        "speed_mps": float,
    }
    stays_on_map = True

    def __post_init__(self) -> None:
        """Read the file. Raises ValueError with its name if it has no such streets."""
        ways, whose = ways_of(self.file, self.by == "driving", self.offset_m, self.origin)
        if self.cut_at_m is not None:
            ways = cut(ways, Area(*self.cut_at_m))
        try:
            graph, left_out_m = graph_of(ways)
        except ValueError as error:
            raise ValueError(f"{self.file}: {error} for {self.by}") from error
        longest_m = float(graph.lengths_m.max()) + 2.0 * float(graph.street_m.max())
        x_m, y_m = graph.places_m.T
        values = {
            "version": version_of(self.file)[1],
            "attribution": whose,
            "stationary": int(self.start == "stationary"),
            "longest_s": longest_m / self.speed_mps[0] + self.pause_s[1],
            "left_out_m": left_out_m,
            "x_m": x_m,
            "y_m": y_m,
            "ends_m": np.cumsum(graph.street_m),
        }
        values |= {name: getattr(graph, name) for name in ("along_m", "first", "tails", "heads")}
        values |= {name: getattr(graph, name) for name in ("one_way", "arcs", "arcs_at")}
        values["lengths_m"] = graph.lengths_m.reshape(-1)
        for name, value in values.items():
            is_table = isinstance(value, np.ndarray)
            kept = Table(value.astype(float).tolist()) if is_table else value
            object.__setattr__(self, name, kept)

    def problems(self, users: int, area: Area) -> list[str]:
        """Return the problem of streets that lead off the map."""
        x_m, y_m = np.array(self.x_m), np.array(self.y_m)
        if not off_map(x_m, y_m, area).any():
            return []
        return [
            f"{self.file}: streets reach from ({x_m.min():g}, {y_m.min():g}) to ({x_m.max():g}, "
            f"{y_m.max():g}) m, off the map of {area.width_m:g} x {area.depth_m:g} m; "
            f"cut_at_m: [{area.width_m:g}, {area.depth_m:g}] cuts them off at its edge, and "
            "offset_m shifts them"
        ]

    def doubts(self, users: int, area: Area, horizon_s: float) -> Iterator[str]:
        """Yield if a large part of the streets cannot be reached from the others."""
        if self.left_out_m > 0.1 * self.ends_m[-1]:
            yield (
                f"{self.file}: {self.left_out_m:.0f} m of streets are left out, which cannot be "
                f"reached from the others or lead nowhere back; {self.ends_m[-1]:.0f} m remain"
            )

    def summary(self, users: int, horizon_s: float) -> str:
        """Return in words how many streets there are."""
        return (
            f"{self.file.name}: {len(self.tails)} streets between {len(self.arcs_at) - 1} "
            f"junctions, {self.ends_m[-1] / 1000:.2f} km, for {self.by}"
        )

    def lines(self) -> list[tuple[tuple[float, float], ...]]:
        """Return the points of each street, in metres."""
        points = list(zip(self.x_m, self.y_m, strict=True))
        ends = map(int, self.first)
        return [tuple(points[since:until]) for since, until in pairwise(ends)]

    @property
    def mean_speed_mps(self) -> float:
        """The mean speed of users who are on their way, in the long run."""
        return 1.0 / mean_slowness(*self.speed_mps)

    def expected_legs(self, users: int, area: Area, horizon_s: float) -> float:
        """Return about how many legs all users have in an episode: straight pieces, and pauses."""
        piece_m = self.ends_m[-1] / (len(self.x_m) - len(self.tails))
        return users * (2.0 + 1.5 * horizon_s * self.mean_speed_mps / piece_m)

    def begin(self, walker: Any, user: int, homes: Any, streams: Any, area: Any) -> None:
        """Draw where a user is on a way or in the pause after it, unless it begins at home.

        At time 0 a way and its pause are under way with a density in proportion to how long they
        take together, so they are drawn by rejection.
        """
        if not self.stationary:
            return
        stream = walker.stream
        while True:
            walker.street, walker.along_m = place_on(self, uniform(stream))
            far_m = set_out(self, walker, stream)
            walks_s = far_m / walker.speed_mps
            lasts_s = walks_s + between(stream, self.pause_s[0], self.pause_s[1])
            if uniform(stream) * self.longest_s < lasts_s:
                break
        since_s = uniform(stream) * lasts_s
        if since_s < walks_s:
            walk_for(self, walker, since_s * walker.speed_mps)
        else:
            walker.street, walker.along_m = walker.goal, walker.goal_along_m
            walker.x_m, walker.y_m = at(self, walker.street, walker.along_m)
            walker.first_s, walker.next = lasts_s - since_s, FIRST_PAUSE

    def next_leg(self, walker: Any, stream: Any, area: Any) -> None:
        """Go on to the next bend or junction, or pause."""
        doing = walker.next
        if doing == FROM_HOME:
            go_to_street(self, walker, between(stream, self.speed_mps[0], self.speed_mps[1]))
        elif doing == FIRST_LEG:
            walker.next = walker.after
            go_to(walker, walker.first_x_m, walker.first_y_m, walker.speed_mps)
        elif doing == FIRST_PAUSE:
            walker.next = SETS_OUT
            stay(walker, later(walker.t_us, walker.first_s))
        elif doing == PAUSES:
            walker.next = SETS_OUT
            stay(walker, later(walker.t_us, between(stream, self.pause_s[0], self.pause_s[1])))
        else:
            if doing == SETS_OUT:
                set_out(self, walker, stream)
            walk_on(self, walker)


@rule
def place_on(streets: Any, share: float) -> tuple[int, float]:
    """Return the street at a share of the length of all streets, and how far along it this is."""
    low, high = 0, len(streets.tails) - 1
    at_m = share * streets.ends_m[high]
    while low < high:
        middle = (low + high) // 2
        if streets.ends_m[middle] <= at_m:
            low = middle + 1
        else:
            high = middle
    along_m = at_m - streets.ends_m[low - 1] if low > 0 else at_m
    return low, min(along_m, long_m(streets, low))


@rule
def long_m(streets: Any, street: int) -> float:
    """Return the length of a street, in metres."""
    return float(streets.along_m[int(streets.first[street + 1]) - 1])


@rule
def point_before(streets: Any, street: int, along_m: float) -> int:
    """Return the last point of a street, but its end, that is not further along than a place."""
    point = int(streets.first[street])
    while point + 2 < int(streets.first[street + 1]) and streets.along_m[point + 1] <= along_m:
        point += 1
    return point


@rule
def at(streets: Any, street: int, along_m: float) -> tuple[float, float]:
    """Return the place that is so far along a street."""
    k = point_before(streets, street, along_m)
    share = (along_m - streets.along_m[k]) / (streets.along_m[k + 1] - streets.along_m[k])
    x_m, y_m = streets.x_m[k], streets.y_m[k]
    return x_m + share * (streets.x_m[k + 1] - x_m), y_m + share * (streets.y_m[k + 1] - y_m)


@rule
def set_out(streets: Any, walker: Any, stream: Any) -> float:
    """Draw a place and a speed, choose the first and the last part of the way; return its length.

    A way leads along one street, or over an end of the first street to an end of the last one. Of
    equally long ways, that over the tails of the streets is taken.
    """
    walker.goal, walker.goal_along_m = place_on(streets, uniform(stream))
    walker.speed_mps = between(stream, streets.speed_mps[0], streets.speed_mps[1])
    street, goal = walker.street, walker.goal
    ahead_m = walker.goal_along_m - walker.along_m
    least_m, walker.over, walker.forwards = math.inf, ON_IT, 1
    if street == goal and (ahead_m >= 0.0 or not streets.one_way[street]):
        least_m, walker.forwards = abs(ahead_m), int(ahead_m >= 0.0)
    rest_m, last_m = long_m(streets, street) - walker.along_m, long_m(streets, goal)
    count = len(streets.arcs_at) - 1
    for forwards in range(int(streets.one_way[street]), 2):
        start = int(streets.heads[street] if forwards else streets.tails[street])
        begins_m = rest_m if forwards else walker.along_m
        for over in range(2 - int(streets.one_way[goal])):
            stop = int(streets.heads[goal] if over == BY_HEAD else streets.tails[goal])
            ends_m = last_m - walker.goal_along_m if over == BY_HEAD else walker.goal_along_m
            far_m = begins_m + streets.lengths_m[start * count + stop] + ends_m
            if far_m < least_m:
                least_m, walker.over, walker.forwards = far_m, over, forwards
    walker.point = point_before(streets, street, walker.along_m) + (1 - walker.forwards)
    walker.next = WALKS
    return least_m


@rule
def walk_on(streets: Any, walker: Any) -> None:
    """Let a user walk to the next bend or end of its street, or to its place on it.

    ``walker.point`` is the point of the street that it has passed last.
    """
    street = walker.street
    step = 1 if walker.forwards else -1
    ahead = walker.point + step
    if walker.over == ON_IT and step * (walker.goal_along_m - streets.along_m[ahead]) <= 0.0:
        x_m, y_m = at(streets, street, walker.goal_along_m)
        walker.along_m = walker.goal_along_m
        walker.next = PAUSES if streets.pause_s[1] > 0.0 else SETS_OUT
        go_to(walker, x_m, y_m, walker.speed_mps)
        return
    walker.point = ahead
    go_to(walker, streets.x_m[ahead], streets.y_m[ahead], walker.speed_mps)
    if ahead == int(streets.first[street]):
        turn(streets, walker, int(streets.tails[street]))
    elif ahead == int(streets.first[street + 1]) - 1:
        turn(streets, walker, int(streets.heads[street]))


@rule
def turn(streets: Any, walker: Any, junction: int) -> None:
    """Let a user at a junction enter the next street of its way.

    Of equally long ways, that over the street which comes first in the file is taken.
    """
    goal = walker.goal
    stop = int(streets.heads[goal] if walker.over == BY_HEAD else streets.tails[goal])
    if junction == stop:
        walker.street, walker.forwards = goal, int(walker.over == BY_TAIL)
        walker.over = ON_IT
    else:
        count, least_m = len(streets.arcs_at) - 1, math.inf
        for k in range(int(streets.arcs_at[junction]), int(streets.arcs_at[junction + 1])):
            street, backwards = int(streets.arcs[k]) // 2, int(streets.arcs[k]) % 2
            there = int(streets.tails[street] if backwards else streets.heads[street])
            far_m = long_m(streets, street) + streets.lengths_m[there * count + stop]
            if far_m < least_m:
                least_m, walker.street, walker.forwards = far_m, street, 1 - backwards
    if walker.forwards:
        walker.point = int(streets.first[walker.street])
    else:
        walker.point = int(streets.first[walker.street + 1]) - 1


@rule
def walk_for(streets: Any, walker: Any, to_go_m: float) -> None:
    """Put a user where it is after some metres of its way, and remember the rest of this leg."""
    walker.x_m, walker.y_m = at(streets, walker.street, walker.along_m)
    while True:
        from_x_m, from_y_m = walker.x_m, walker.y_m
        walk_on(streets, walker)
        x_m, y_m = walker.x_m - from_x_m, walker.y_m - from_y_m
        leg_m = math.sqrt(x_m * x_m + y_m * y_m)
        if to_go_m < leg_m or walker.next != WALKS:
            break
        to_go_m -= leg_m
    share = min(to_go_m / leg_m, 1.0) if leg_m > 0.0 else 1.0
    walker.first_x_m, walker.first_y_m, walker.after = walker.x_m, walker.y_m, walker.next
    walker.x_m, walker.y_m = from_x_m + share * x_m, from_y_m + share * y_m
    walker.vx_mps = walker.vy_mps = 0.0
    walker.t_us, walker.next = 0, FIRST_LEG


@rule
def go_to_street(streets: Any, walker: Any, speed_mps: float) -> None:
    """Let a user walk straight to the place on all streets that is nearest to it."""
    least, best_x_m, best_y_m = math.inf, 0.0, 0.0
    for street in range(len(streets.tails)):
        for k in range(int(streets.first[street]), int(streets.first[street + 1]) - 1):
            x_m, y_m = streets.x_m[k], streets.y_m[k]
            dx_m, dy_m = streets.x_m[k + 1] - x_m, streets.y_m[k + 1] - y_m
            share = (walker.x_m - x_m) * dx_m + (walker.y_m - y_m) * dy_m
            share = min(max(share / (dx_m * dx_m + dy_m * dy_m), 0.0), 1.0)
            x_m, y_m = x_m + share * dx_m, y_m + share * dy_m
            away = (walker.x_m - x_m) * (walker.x_m - x_m) + (walker.y_m - y_m) * (walker.y_m - y_m)
            if away < least:
                least, best_x_m, best_y_m, walker.street = away, x_m, y_m, street
                length_m = streets.along_m[k + 1] - streets.along_m[k]
                walker.along_m = streets.along_m[k] + share * length_m
    walker.next = SETS_OUT
    go_to(walker, best_x_m, best_y_m, speed_mps)
