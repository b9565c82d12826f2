"""Lévy walks: many short flights and a few very long ones, with pauses between them."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Annotated, Any, ClassVar

from annotated_types import Ge, Le

from desim_uav.model.mobility.walking import RowMobility, Start, go_on, later, stay
from desim_uav.model.mobility.walks import Area
from desim_uav.model.random.distributions import ascending, mean_of_power_law, power_law
from desim_uav.model.random.streams import heading, uniform
from desim_uav.registry import Checked, register
from desim_uav.rowcode.kernels import rule

Length = Annotated[float, Ge(0.01), Le(1e6)]
Time = Annotated[float, Ge(0.01), Le(1e6)]
Exponent = Annotated[float, Ge(0.1), Le(10)]

FLIES, PAUSES = range(2)
"""What a user does next."""


@register("mobility", "levy")
@dataclass(frozen=True)
class Levy(RowMobility):
    """Users walk straight flights in uniform directions, with a pause after each.

    Lengths and pauses have truncated Pareto distributions: the density is in proportion to the
    power -(1 + exponent) (Rhee et al. 2011). A flight that meets the map's edge is reflected.
    """

    flight_m: Annotated[tuple[Length, Length], Checked(ascending)] = (10.0, 2000.0)
    """The range of the lengths of flights, in metres."""
    flight_exponent: Exponent = 1.5
    """The tail exponent of the lengths: the smaller, the more frequent are long flights."""
    pause_s: Annotated[tuple[Time, Time], Checked(ascending)] = (10.0, 3600.0)
    """The range of the pauses, in seconds."""
    pause_exponent: Exponent = 1.0
    """The tail exponent of the pauses."""
    speed_mps: Annotated[float, Ge(0.01), Le(200)] = 1.4
    """The walking speed, in metres per second."""
    start: Start = "stationary"
    """`stationary`: users begin as they are in the long run, anywhere on the map, and not at their
    homes. `home`: they begin a flight at home.
    """

    stationary: int = field(init=False, repr=False, compare=False)
    flies: float = field(init=False, repr=False, compare=False)
    """The share of the time that users walk, in the long run."""

    remembers: ClassVar = {"until_us": int, "next": int}
    stays_on_map = True

    def __post_init__(self) -> None:
        """Set the numbers that follow from the parameters."""
        flight_s, pause_s = self._means_s()
        object.__setattr__(self, "stationary", int(self.start == "stationary"))
        object.__setattr__(self, "flies", flight_s / (flight_s + pause_s))

    def begin(self, walker: Any, user: int, homes: Any, streams: Any, area: Any) -> None:
        """Draw a place, and the rest of the flight or pause that is under way at time 0.

        Of flights and of pauses, those under way at a given moment are longer than the others.
        """
        if not self.stationary:
            return
        stream = walker.stream
        walker.x_m = uniform(stream) * area.width_m
        walker.y_m = uniform(stream) * area.depth_m
        if uniform(stream) < self.flies:
            whole_m = power_law(stream, self.flight_m[0], self.flight_m[1], -self.flight_exponent)
            fly(walker, stream, self.speed_mps, uniform(stream) * whole_m)
            walker.next = PAUSES
        else:
            whole_s = power_law(stream, self.pause_s[0], self.pause_s[1], -self.pause_exponent)
            walker.until_us = later(0, uniform(stream) * whole_s)

    def next_leg(self, walker: Any, stream: Any, area: Any) -> None:
        """Walk to the end of a flight or to the edge of the map, or pause."""
        if walker.t_us == walker.until_us:
            if walker.next == FLIES:
                length_m = power_law(
                    stream, self.flight_m[0], self.flight_m[1], -1.0 - self.flight_exponent
                )
                fly(walker, stream, self.speed_mps, length_m)
            else:
                walker.until_us = later(
                    walker.t_us,
                    power_law(stream, self.pause_s[0], self.pause_s[1], -1.0 - self.pause_exponent),
                )
                walker.vx_mps = walker.vy_mps = 0.0
            walker.next = PAUSES - walker.next
        if walker.vx_mps == 0.0 and walker.vy_mps == 0.0:
            stay(walker, walker.until_us)
        else:
            go_on(walker, area, walker.until_us)

    def expected_legs(self, users: int, area: Area, horizon_s: float) -> float:
        """Return the mean number of legs of all users: flights, pauses, and edges that are met."""
        rounds = horizon_s / sum(self._means_s())
        walls = 2.0 / math.pi * self.speed_mps * horizon_s * sum(1.0 / side for side in area)
        return users * (1.0 + 2.0 * rounds + self.flies * walls)

    def _means_s(self) -> tuple[float, float]:
        """Return the mean durations of a flight and of a pause."""
        flight_m = mean_of_power_law(*self.flight_m, -1.0 - self.flight_exponent)
        pause_s = mean_of_power_law(*self.pause_s, -1.0 - self.pause_exponent)
        return flight_m / self.speed_mps, pause_s


@rule
def fly(walker: Any, stream: Any, speed_mps: float, length_m: float) -> None:
    """Let a user begin a flight of a length, in a uniform direction."""
    x, y = heading(stream)
    walker.vx_mps, walker.vy_mps = speed_mps * x, speed_mps * y
    walker.until_us = later(walker.t_us, length_m / speed_mps)
