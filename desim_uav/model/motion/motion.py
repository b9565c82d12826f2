"""Motion: how a drone flies from one cell to the next, in closed form.

A profile is a float64 array, one row for each phase of constant acceleration:
(start_s, distance_m, speed_mps, acceleration_mps2), each at the phase's start; the last row is the
rest at the destination. Drones fly rest to rest, one axis at a time.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, fields
from typing import Annotated, Any, ClassVar, Literal, NamedTuple, Protocol

import numpy as np
from annotated_types import Ge, Le, MaxLen, MinLen
from numpy.typing import NDArray

from desim_uav.model.rules import MOST_CHOICES, US, Choice, Variant, ascend
from desim_uav.registry import Checked, register
from desim_uav.rowcode.kernels import kernel, rule
from desim_uav.rowcode.rows import BoundedTable, Row, Table, row
from desim_uav.rowcode.views import records


class Piece(NamedTuple):
    """A piece of a transit of constant acceleration; ``start_s`` and ``from_m`` at its start."""

    start_s: float
    from_m: float
    speed_mps: float
    acceleration_mps2: float


@row
class PieceRow(Row):
    """A piece of a transit, as a row."""

    start_s: float
    from_m: float
    speed_mps: float
    acceleration_mps2: float


class Transit(NamedTuple):
    """A rest-to-rest flight along one axis.

    ``rises`` is the height gained per metre of the way: 1.0 straight up, -1.0 straight down.
    ``tail_mps`` is the wind along its level direction (below 0: against it), and ``side_mps`` that
    across it; a hover and a vertical flight have all of it from the side.
    """

    profile: NDArray[np.float64]
    duration_us: int
    distance_m: float
    rises: float = 0.0
    tail_mps: float = 0.0
    side_mps: float = 0.0

    @property
    def pieces(self) -> Table[Piece]:
        """The pieces of the profile."""
        return BoundedTable(Piece(*row) for row in self.profile.tolist())

    @property
    def rows(self) -> Any:
        """The pieces as an array of PieceRow."""
        return records(PieceRow, self.profile)


class Motion(Protocol):
    """A motion model, which determines how fast drones fly.

    It may have a method ``return_transit`` like ``BangCoastBang``; without one, the hops of a
    return are flown in minimum time. If it has ``cruise``, a tuple of ascending speeds in m/s, each
    move is commanded at one of them, and ``cruise_transit`` returns its transit. It can be used in
    wind if it has a method ``in_wind``, which returns the motion along a level direction, given the
    wind along it and across it.
    """

    def epoch_transit(self, distance_m: float, step_s: float) -> Transit:
        """Return the transit that a moving action commands.

        Raises ValueError if ``distance_m`` cannot be flown within a step of ``step_s``.
        """

    def fastest_transit(self, distance_m: float) -> Transit:
        """Return the transit in minimum time, as it is used to return to a charging station."""


def return_transit(motion: Motion, distance_m: float, step_s: float) -> Transit:
    """Return the transit of a hop of a return: in minimum time, unless the motion has its own."""
    own = getattr(motion, "return_transit", None)
    if own is None:
        return motion.fastest_transit(distance_m)
    transit: Transit = own(distance_m, step_s)
    return transit


def cruise_of(motion: Motion) -> tuple[float, ...]:
    """Return the cruise speeds that a command can choose, ascending; none if it has no choice."""
    return tuple(getattr(motion, "cruise", None) or ())


def commanded_transit(motion: Motion, choice: Choice, distance_m: float, step_s: float) -> Transit:
    """Return the transit that a moving action commands, at its cruise speed if it has one.

    Raises ValueError if it takes longer than a step.
    """
    if isinstance(choice, Variant) and choice.cruise_mps is not None:
        chooses: Any = motion
        transit: Transit = chooses.cruise_transit(distance_m, step_s, choice.cruise_mps)
        return transit
    return motion.epoch_transit(distance_m, step_s)


def transits_over(motion: Motion, distance_m: float, step_s: float) -> list[Transit]:
    """Return the transits that commands can have over a distance: one for each cruise speed.

    Raises ValueError if one of them takes longer than a step.
    """
    chooses: Any = motion
    speeds = cruise_of(motion)
    if not speeds:
        return [motion.epoch_transit(distance_m, step_s)]
    return [chooses.cruise_transit(distance_m, step_s, speed) for speed in speeds]


def flown_transit(
    motion: Motion, commanded: bool, distance_m: float, step_s: float, duration_us: int
) -> Transit:
    """Return the transit of a leg that was ``commanded``, or else was a hop of a return.

    Of several that commands can have, it is the one whose duration is nearest to ``duration_us``.
    """
    if not commanded:
        return return_transit(motion, distance_m, step_s)
    transits = transits_over(motion, distance_m, step_s)
    return min(transits, key=lambda transit: abs(transit.duration_us - duration_us))


CruiseSpeed = Annotated[float, Ge(0.001), Le(1000)]


CruiseSpeeds = Annotated[
    Annotated[tuple[CruiseSpeed, ...], MinLen(1), MaxLen(MOST_CHOICES)] | None, Checked(ascend)
]


@register("motion", "bang_coast_bang")
@dataclass(frozen=True)
class BangCoastBang:
    """Flies with a trapezoidal speed profile (bang-coast-bang acceleration), as in the paper.

    ``fill_epoch``: the drone cruises at the speed with which the transit lasts exactly one step
    (the paper's "240 m in about 60 s"). ``minimum_time``: it cruises at the highest speed and then
    hovers. ``return_timing`` is the timing of the hops of a return, which follow upon each other.
    With ``cruise``, each command chooses its cruise speed, and ``timing`` has no effect.
    With ``space: free``, drones fly straight to any place, in minimum time or at the cruise speed
    that the command chooses (see ``model.free``).
    """

    later: ClassVar = (
        *("cruise", "space", "reach", "climb_mps", "descent_mps", "vertical_mps2", "margin_m"),
    )

    max_speed_mps: Annotated[float, Ge(0.001), Le(1000)] = 8.3
    """The highest speed, in metres per second."""
    max_acceleration_mps2: Annotated[float, Ge(0.001), Le(10_000)] = 4.0
    """The highest acceleration, in metres per second squared."""
    timing: Literal["fill_epoch", "minimum_time"] = "fill_epoch"
    """`fill_epoch`: a move lasts exactly one step. `minimum_time`: it is as quick as possible,
    and the drone hovers for the rest of the step.
    """
    return_timing: Literal["fill_epoch", "minimum_time"] = "minimum_time"
    """The timing of each hop of a return to a charging station. `fill_epoch`: a hop lasts exactly
    one step. `minimum_time`: it is as quick as possible.
    """
    cruise: CruiseSpeeds = None
    """The cruise speeds from which each command of a move chooses, ascending, in metres per second
    through the air.
    There is an action for each move and speed (`right@8.3`), and the drone hovers for the rest of
    the step. null: no choice, and `timing` says how fast moves are.
    In free `space`, these are the lowest and the highest speed, and a command has one more number,
    which chooses one between them. null: flights are in minimum time.
    """
    space: Literal["cells", "free"] = "cells"
    """`cells`: drones fly from cell centre to cell centre. `free`: they fly straight to any place
    that they reach within a step, and `max_speed_mps` and `max_acceleration_mps2` limit the
    horizontal speed and acceleration.
    """
    reach: Literal["step", "map"] = "step"
    """What a command of free flight names. `step`: a displacement, as a share of the longest flight
    that is possible in a step. `map`: any place on the map; the leg lasts as long as it takes,
    which needs `decisions: event`.
    """
    climb_mps: Annotated[float, Ge(0.001), Le(1000)] = 5.0
    """The highest speed of climb in free flight, in metres per second."""
    descent_mps: Annotated[float, Ge(0.001), Le(1000)] = 3.0
    """The highest speed of descent in free flight, in metres per second."""
    vertical_mps2: Annotated[float, Ge(0.001), Le(10_000)] = 2.0
    """The highest vertical acceleration in free flight, in metres per second squared."""
    margin_m: Annotated[float, Ge(0.01), Le(1000)] = 5.0
    """The distance that drones keep from buildings and no-fly zones in free flight, in metres."""

    def too_fast(self) -> list[tuple[int, str]]:
        """Return the number of each cruise speed above the highest speed, and what is wrong."""
        return [
            (number, f"must be at most max_speed_mps = {self.max_speed_mps:g}")
            for number, speed in enumerate(self.cruise or ())
            if speed > self.max_speed_mps
        ]

    @property
    def highest_mps(self) -> float:
        """The highest speed over the ground."""
        return self._over_ground(self.max_speed_mps)

    def _over_ground(self, air_mps: float) -> float:
        """Return the speed over the ground at a speed through the air."""
        return air_mps

    @property
    def _limit(self) -> str:
        """The limit on the speed over the ground, for messages."""
        return f"max_speed_mps = {self.max_speed_mps:g}"

    def in_wind(self, tail_mps: float, side_mps: float) -> BangCoastBang:
        """Return the motion along a level direction with such a wind along it and across it.

        The highest speed and the cruise speeds are then those through the air. Raises ValueError
        if one is not above that of the wind, against which the drone could not fly.
        """
        wind_mps = math.hypot(tail_mps, side_mps)
        if self.cruise is not None and wind_mps >= self.cruise[0]:
            raise ValueError(
                f"a wind of {wind_mps:g} m/s is not below the lowest cruise speed, "
                f"{self.cruise[0]:g}"
            )
        if wind_mps >= self.max_speed_mps:
            raise ValueError(
                f"a wind of {wind_mps:g} m/s is not below max_speed_mps = {self.max_speed_mps:g}"
            )
        own = {each.name: getattr(self, each.name) for each in fields(self) if each.init}
        return _InWind(**own, tail_mps=tail_mps, side_mps=side_mps)

    def epoch_transit(self, distance_m: float, step_s: float) -> Transit:
        """Return the transit of ``distance_m`` within a step. Raises ValueError if none fits.

        With a choice of cruise speeds, it is the one at the highest of them.
        """
        if self.cruise is not None:
            return self.cruise_transit(distance_m, step_s, self.cruise[-1])
        if self.timing == "minimum_time":
            return _within_step(self.fastest_transit(distance_m), step_s)
        return self._filling_transit(distance_m, step_s)

    def cruise_transit(self, distance_m: float, step_s: float, cruise_mps: float) -> Transit:
        """Return the transit at a cruise speed, or in minimum time if it is too short to reach it.

        Raises ValueError if it takes longer than a step.
        """
        a = self.max_acceleration_mps2
        speed, duration = fastest(distance_m, self._over_ground(cruise_mps), a)
        return _within_step(_trapezoid(distance_m, speed, a, duration), step_s, cruise_mps)

    def return_transit(self, distance_m: float, step_s: float) -> Transit:
        """Return the transit of a hop of a return. Raises ValueError if it cannot fill a step."""
        if self.return_timing == "minimum_time":
            return self.fastest_transit(distance_m)
        return self._filling_transit(distance_m, step_s)

    def _filling_transit(self, distance_m: float, step_s: float) -> Transit:
        """Return the transit that lasts exactly a step. Raises ValueError if there is none."""
        speed = cruise_speed(distance_m, step_s, self.max_acceleration_mps2)
        if speed > self.highest_mps:
            raise ValueError(
                f"{distance_m:g} m in {step_s:g} s need a cruise speed of {speed:.6g} m/s, "
                f"above {self._limit}"
            )
        return _trapezoid(distance_m, speed, self.max_acceleration_mps2, step_s)

    def fastest_transit(self, distance_m: float) -> Transit:
        """Return the transit in minimum time."""
        a = self.max_acceleration_mps2
        speed, duration = fastest(distance_m, self.highest_mps, a)
        return _trapezoid(distance_m, speed, a, duration)


@dataclass(frozen=True)
class _InWind(BangCoastBang):
    """The motion along a level direction in wind (see ``BangCoastBang.in_wind``)."""

    tail_mps: float = 0.0
    side_mps: float = 0.0

    def _over_ground(self, air_mps: float) -> float:
        return ground_mps(air_mps, self.tail_mps, self.side_mps)

    @property
    def _limit(self) -> str:
        return (
            f"the {self.highest_mps:.6g} m/s over the ground that max_speed_mps = "
            f"{self.max_speed_mps:g} through the air leaves in the wind"
        )


@rule
def ground_mps(limit: float, tail: float, side: float) -> float:
    """Return the highest level speed over the ground at a highest speed through the air.

    ``tail`` is the wind along the way and ``side`` that across it. The limit must be above the
    speed of the wind. It is the larger root g of (g - tail)² + side² = limit², in a form that does
    not cancel against the wind.
    """
    root = math.sqrt(limit * limit - side * side)
    if tail >= 0.0:
        return tail + root
    return (limit * limit - (tail * tail + side * side)) / (root - tail)


def cruise_speed(distance_m: float, duration_s: float, acceleration_mps2: float) -> float:
    """Return the cruise speed at which a transit of ``distance_m`` takes ``duration_s``.

    v = (aT - sqrt((aT)² - 4ad)) / 2, in the form without cancellation. Raises ValueError if the
    equation has no root, because even a triangular profile is too slow.
    """
    at = acceleration_mps2 * duration_s
    discriminant = at * at - 4.0 * acceleration_mps2 * distance_m
    if discriminant < 0.0:
        raise ValueError(
            f"{distance_m:g} m cannot be flown in {duration_s:g} s at {acceleration_mps2:g} m/s²"
        )
    return 2.0 * acceleration_mps2 * distance_m / (at + math.sqrt(discriminant))


@rule
def fastest(distance: float, speed: float, acceleration: float) -> tuple[float, float]:
    """Return the cruise speed and the duration of a transit in minimum time, rest to rest.

    T = d/v + v/a if d >= v²/a, else 2 sqrt(d/a) (triangular).
    """
    if distance >= speed * speed / acceleration:
        return speed, distance / speed + speed / acceleration
    duration = 2.0 * math.sqrt(distance / acceleration)
    return acceleration * duration / 2.0, duration


TRAPEZOID = 4
"""The rows of the profile of a transit."""


@rule
def trapezoid(
    distance: float, speed: float, acceleration: float, duration: float
) -> tuple[Piece, Piece, Piece, Piece]:
    """Return the pieces of a transit with this cruise speed."""
    ramp = speed / acceleration
    ramp_distance = speed * ramp / 2.0
    return (
        Piece(0.0, 0.0, 0.0, acceleration),
        Piece(ramp, ramp_distance, speed, 0.0),
        Piece(duration - ramp, distance - ramp_distance, speed, -acceleration),
        Piece(duration, distance, 0.0, 0.0),
    )


def _within_step(transit: Transit, step_s: float, cruise_mps: float | None = None) -> Transit:
    """Return a transit. Raises ValueError if it takes longer than a step."""
    if transit.duration_us > round(step_s * US):
        how = "take at least" if cruise_mps is None else f"at {cruise_mps:g} m/s take"
        raise ValueError(
            f"{transit.distance_m:g} m {how} {transit.duration_us / US:g} s, "
            f"longer than the step of {step_s:g} s"
        )
    return transit


def _trapezoid(distance: float, speed: float, acceleration: float, duration: float) -> Transit:
    profile = np.array(trapezoid(distance, speed, acceleration, duration))
    return Transit(profile, round(duration * US), distance)


class TransitLeg(NamedTuple):
    """A transit between two positions (x, y, altitude in metres), followed by a hover there."""

    transit: Transit
    from_m: tuple[float, float]
    to_m: tuple[float, float]
    from_z_m: float
    to_z_m: float

    def position_m(self, elapsed_s: float) -> tuple[float, float, float]:
        """Return the position x, y, z after ``elapsed_s``."""
        (x0, y0), (x1, y1), z0, z1 = self.from_m, self.to_m, self.from_z_m, self.to_z_m
        if self.transit.distance_m == 0.0:
            return x0, y0, z0
        share = travelled(self.transit.rows, elapsed_s) / self.transit.distance_m
        return x0 + share * (x1 - x0), y0 + share * (y1 - y0), z0 + share * (z1 - z0)


REST = Transit(np.array([(0.0, 0.0, 0.0, 0.0)]), 0, 0.0)
"""Hovering: the transit of no distance."""


@kernel
def travelled(pieces: Table[PieceRow], elapsed_s: float) -> float:
    """Return the metres flown ``elapsed_s`` after the start of a transit with these pieces."""
    phase = 0
    while phase + 1 < len(pieces) and pieces[phase + 1].start_s <= elapsed_s:
        phase += 1
    piece = pieces[phase]
    t = elapsed_s - piece.start_s
    half_acceleration = 0.5 * piece.acceleration_mps2
    return float(piece.from_m + piece.speed_mps * t + half_acceleration * t * t)
