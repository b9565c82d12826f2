"""Manhattan: users who walk along the streets of a grid and turn at its crossings."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Annotated, Any, ClassVar

import numpy as np
from annotated_types import Ge, Le

from desim_uav.model.mobility.walking import RowMobility, Start, go_to
from desim_uav.model.mobility.walks import Area
from desim_uav.model.random.distributions import SpeedRange, between, mean_slowness, power_law
from desim_uav.model.random.streams import uniform
from desim_uav.registry import register
from desim_uav.rowcode.kernels import rule

AT_CROSSING, ON_STREET, OFF_STREETS = range(3)
"""Where a user is when a leg begins."""

MOST_STREETS = 100_000


@register("mobility", "manhattan")
@dataclass(frozen=True)
class Manhattan(RowMobility):
    """Users walk along streets; at a crossing they go straight on (1/2), left or right (1/4 each).

    Streets run along both axes, ``street_m`` apart, the outermost along the edges of the map. A
    user whose draw would lead off the map turns back. In the long run, users are then uniform on
    all streets. The speed is drawn anew for each block.
    """

    street_m: Annotated[float, Ge(1), Le(1e6)] = 240.0
    """The distance between parallel streets, in metres, which divides both sides of the map."""
    speed_mps: SpeedRange = (1.0, 1.8)
    """The range from which the speed along each block is drawn, in metres per second."""
    start: Start = "stationary"
    """`stationary`: users begin anywhere on the streets, as they are in the long run, and not at
    their homes. `home`: they begin with a walk from home straight to the nearest street.
    """

    stationary: int = field(init=False, repr=False, compare=False)

    remembers: ClassVar = {"place": int, "east": int, "north": int, "first": float}
    stays_on_map = True

    def __post_init__(self) -> None:
        """Set the numbers that follow from the parameters."""
        object.__setattr__(self, "stationary", int(self.start == "stationary"))

    def problems(self, users: int, area: Area) -> list[str]:
        """Return the problem of streets that do not fit a map."""
        blocks = [side / self.street_m for side in area]
        if any(count > MOST_STREETS for count in blocks):
            return [f"street_m: {self.street_m:g}: makes more than {MOST_STREETS:,} streets"]
        if all(round(n) >= 1 and abs(n - round(n)) <= 1e-6 * n for n in blocks):
            return []
        return [
            f"street_m: {self.street_m:g}: must divide both sides of the map, which is "
            f"{area.width_m:g} x {area.depth_m:g} m"
        ]

    def begin(self, walker: Any, user: int, homes: Any, streams: Any, area: Any) -> None:
        """Draw a place on the streets, a direction and a speed, unless the user begins at home."""
        stream = walker.stream
        if not self.stationary:
            walker.place = OFF_STREETS
            return
        columns = int(np.rint(area.width_m / self.street_m))
        rows = int(np.rint(area.depth_m / self.street_m))
        along_x = columns * (rows + 1)
        block = int(uniform(stream) * (along_x + rows * (columns + 1)))
        share, way = uniform(stream), 1 if uniform(stream) < 0.5 else -1
        if block < along_x:
            column, row = block % columns, block // columns
            walker.x_m = line_m(column, columns, area.width_m) * (1.0 - share)
            walker.x_m += line_m(column + 1, columns, area.width_m) * share
            walker.y_m, walker.east = line_m(row, rows, area.depth_m), way
        else:
            column, row = (block - along_x) // rows, (block - along_x) % rows
            walker.y_m = line_m(row, rows, area.depth_m) * (1.0 - share)
            walker.y_m += line_m(row + 1, rows, area.depth_m) * share
            walker.x_m, walker.north = line_m(column, columns, area.width_m), way
        walker.first = power_law(stream, self.speed_mps[0], self.speed_mps[1], -1.0)
        walker.place = ON_STREET

    def next_leg(self, walker: Any, stream: Any, area: Any) -> None:
        """Walk to the next crossing, or first to the nearest street."""
        columns = int(np.rint(area.width_m / self.street_m))
        rows = int(np.rint(area.depth_m / self.street_m))
        if walker.place == OFF_STREETS:
            walker.place = ON_STREET
            x_m = nearest_m(walker.x_m, columns, area.width_m)
            y_m = nearest_m(walker.y_m, rows, area.depth_m)
            way = 1 if uniform(stream) < 0.5 else -1
            if abs(x_m - walker.x_m) <= abs(y_m - walker.y_m):
                walker.north, y_m = way, walker.y_m
            else:
                walker.east, x_m = way, walker.x_m
            go_to(walker, x_m, y_m, between(stream, self.speed_mps[0], self.speed_mps[1]))
            return
        if walker.place == AT_CROSSING:
            east, north = walker.east, walker.north
            turn_at_crossing(walker, stream)
            if leads_off(walker.x_m, walker.east, columns, area.width_m) or leads_off(
                walker.y_m, walker.north, rows, area.depth_m
            ):
                walker.east, walker.north = -east, -north
        speed_mps = walker.first
        if speed_mps == 0.0:
            speed_mps = between(stream, self.speed_mps[0], self.speed_mps[1])
        walker.first, walker.place = 0.0, AT_CROSSING
        x_m, walker.east = next_line_m(walker.x_m, walker.east, columns, area.width_m)
        y_m, walker.north = next_line_m(walker.y_m, walker.north, rows, area.depth_m)
        go_to(walker, x_m, y_m, speed_mps)

    @property
    def mean_speed_mps(self) -> float:
        """The mean speed of users in the long run."""
        return 1.0 / mean_slowness(*self.speed_mps)

    def expected_legs(self, users: int, area: Area, horizon_s: float) -> float:
        """Return the mean number of legs of all users in an episode, of a block each."""
        return users * (1.0 + math.ceil(horizon_s * self.mean_speed_mps / self.street_m))


@rule
def line_m(number: int, count: int, size_m: float) -> float:
    """Return where a line is of those that divide a side of the map into ``count`` parts."""
    return size_m if number == count else number * (size_m / count)


@rule
def nearest_m(at_m: float, count: int, size_m: float) -> float:
    """Return where the line is that is nearest to a place."""
    return line_m(int(np.rint(at_m / size_m * count)), count, size_m)


@rule
def next_line_m(at_m: float, way: int, count: int, size_m: float) -> tuple[float, int]:
    """Return where the next line is in a direction (1, -1, or 0: here), and the direction.

    It is turned if it leads off the map. Places within a millionth of a part of a line are on it.
    """
    if way == 0:
        return at_m, way
    parts = at_m / size_m * count
    line = np.rint(parts)
    if abs(parts - line) > 1e-6:
        return line_m(math.floor(parts) + (1 if way > 0 else 0), count, size_m), way
    if leads_off(at_m, way, count, size_m):
        way = -way
    return line_m(int(line) + way, count, size_m), way


@rule
def leads_off(at_m: float, way: int, count: int, size_m: float) -> Any:
    """Return whether a way from a line leads off the map."""
    number = int(np.rint(at_m / size_m * count)) + way
    return (number < 0) | (number > count)


@rule
def turn_at_crossing(walker: Any, stream: Any) -> None:
    """Draw in which direction a user goes on."""
    chance, east, north = uniform(stream), walker.east, walker.north
    if 0.5 <= chance < 0.75:
        walker.east, walker.north = -north, east
    elif chance >= 0.75:
        walker.east, walker.north = north, -east
