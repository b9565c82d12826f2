"""Motion: how a drone flies from one cell to the next, in closed form.

A profile is a float64 array, one row for each phase of constant acceleration:
(start_s, distance_m, speed_mps, acceleration_mps2), each at the phase's start; the last row is the
rest at the destination. Drones fly rest to rest, one axis at a time.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Annotated, ClassVar, Literal, NamedTuple, Protocol

import numpy as np
from annotated_types import Ge, Le
from numpy.typing import NDArray

from desim_uav.model.kernels import kernel, rule
from desim_uav.model.rules import US
from desim_uav.registry import register

START, DISTANCE, SPEED, ACCELERATION = range(4)


class Piece(NamedTuple):
    """A piece of a transit of constant acceleration; ``start_s`` and ``from_m`` at its start."""

    start_s: float
    from_m: float
    speed_mps: float
    acceleration_mps2: float


class Transit(NamedTuple):
    """A rest-to-rest flight along one axis.

    ``rises`` is the height gained per metre of the way: 1.0 straight up, -1.0 straight down.
    """

    profile: NDArray[np.float64]
    duration_us: int
    distance_m: float
    rises: float = 0.0

    @property
    def pieces(self) -> list[Piece]:
        """The rows of the profile by name."""
        return [Piece(*row) for row in self.profile.tolist()]


class Motion(Protocol):
    """A motion model, which determines how fast drones fly.

    It may have a method ``return_transit`` like ``BangCoastBang``; without one, the hops of a
    return are flown in minimum time.
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


@register("motion", "bang_coast_bang")
@dataclass(frozen=True)
class BangCoastBang:
    """Flies with a trapezoidal speed profile (bang-coast-bang acceleration), as in the paper.

    ``fill_epoch``: the drone cruises at the speed with which the transit lasts exactly one step
    (the paper's "240 m in about 60 s"). ``minimum_time``: it cruises at the highest speed and then
    hovers. ``return_timing`` says the same of the hops of a return, which follow upon each other.

    In free ``space``, drones fly straight to any place in minimum time (see ``model.free``).
    """

    later: ClassVar = ("space", "climb_mps", "descent_mps", "vertical_mps2", "margin_m")

    max_speed_mps: Annotated[float, Ge(0.001), Le(1000)] = 8.3
    """The highest speed, in metres per second."""
    max_acceleration_mps2: Annotated[float, Ge(0.001), Le(10_000)] = 4.0
    """The highest acceleration, in metres per second squared."""
    timing: Literal["fill_epoch", "minimum_time"] = "fill_epoch"
    """`fill_epoch`: a move lasts exactly one step. `minimum_time`: it is as quick as possible,
    and the drone hovers for the rest of the step.
    """
    return_timing: Literal["fill_epoch", "minimum_time"] = "minimum_time"
    """The same for each hop of a return to a charging station. `fill_epoch`: it takes as long as
    a step.
    """
    space: Literal["cells", "free"] = "cells"
    """`cells`: drones fly from cell centre to cell centre. `free`: they fly straight to any place
    that they reach within a step, always in minimum time, and `max_speed_mps` and
    `max_acceleration_mps2` limit the horizontal speed and acceleration.
    """
    climb_mps: Annotated[float, Ge(0.001), Le(1000)] = 5.0
    """The highest speed of climb in free flight, in metres per second."""
    descent_mps: Annotated[float, Ge(0.001), Le(1000)] = 3.0
    """The highest speed of descent in free flight, in metres per second."""
    vertical_mps2: Annotated[float, Ge(0.001), Le(10_000)] = 2.0
    """The highest vertical acceleration in free flight, in metres per second squared."""
    margin_m: Annotated[float, Ge(0.01), Le(1000)] = 5.0
    """How far drones keep away from buildings and from `map.no_fly` in free flight, in metres."""

    def epoch_transit(self, distance_m: float, step_s: float) -> Transit:
        """Return the transit of ``distance_m`` within a step. Raises ValueError if none fits."""
        if self.timing == "minimum_time":
            transit = self.fastest_transit(distance_m)
            if transit.duration_us > round(step_s * US):
                raise ValueError(
                    f"{distance_m:g} m take at least {transit.duration_us / US:g} s, "
                    f"longer than the step of {step_s:g} s"
                )
            return transit
        return self._filling_transit(distance_m, step_s)

    def return_transit(self, distance_m: float, step_s: float) -> Transit:
        """Return the transit of a hop of a return. Raises ValueError if it cannot fill a step."""
        if self.return_timing == "minimum_time":
            return self.fastest_transit(distance_m)
        return self._filling_transit(distance_m, step_s)

    def _filling_transit(self, distance_m: float, step_s: float) -> Transit:
        """Return the transit that lasts exactly a step. Raises ValueError if there is none."""
        speed = cruise_speed(distance_m, step_s, self.max_acceleration_mps2)
        if speed > self.max_speed_mps:
            raise ValueError(
                f"{distance_m:g} m in {step_s:g} s need a cruise speed of {speed:.6g} m/s, "
                f"above max_speed_mps = {self.max_speed_mps:g}"
            )
        return _trapezoid(distance_m, speed, self.max_acceleration_mps2, step_s)

    def fastest_transit(self, distance_m: float) -> Transit:
        """Return the transit in minimum time."""
        a = self.max_acceleration_mps2
        speed, duration = fastest(distance_m, self.max_speed_mps, a)
        return _trapezoid(distance_m, speed, a, duration)


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
def write_trapezoid(
    profile: NDArray[np.float64],
    distance: float,
    speed: float,
    acceleration: float,
    duration: float,
) -> None:
    """Write the profile of a transit with this cruise speed into the first rows of a table."""
    ramp = speed / acceleration
    ramp_distance = speed * ramp / 2.0
    for row in range(TRAPEZOID):
        for column in range(ACCELERATION + 1):
            profile[row, column] = 0.0
    profile[0, ACCELERATION] = acceleration
    profile[1, START], profile[1, DISTANCE], profile[1, SPEED] = ramp, ramp_distance, speed
    profile[2, START], profile[2, DISTANCE] = duration - ramp, distance - ramp_distance
    profile[2, SPEED], profile[2, ACCELERATION] = speed, -acceleration
    profile[3, START], profile[3, DISTANCE] = duration, distance


def _trapezoid(distance: float, speed: float, acceleration: float, duration: float) -> Transit:
    profile = np.empty((TRAPEZOID, ACCELERATION + 1))
    write_trapezoid(profile, distance, speed, acceleration, duration)
    return Transit(profile, round(duration * US), distance)


class Leg(NamedTuple):
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
        share = travelled(self.transit.profile, elapsed_s) / self.transit.distance_m
        return x0 + share * (x1 - x0), y0 + share * (y1 - y0), z0 + share * (z1 - z0)


REST = Transit(np.array([(0.0, 0.0, 0.0, 0.0)]), 0, 0.0)
"""Hovering: the transit of no distance."""


@kernel
def travelled(profile: NDArray[np.float64], elapsed_s: float) -> float:
    """Return the metres flown ``elapsed_s`` after the start of a profile."""
    phase = 0
    while phase + 1 < len(profile) and profile[phase + 1, START] <= elapsed_s:
        phase += 1
    t = elapsed_s - profile[phase, START]
    half_acceleration = 0.5 * profile[phase, ACCELERATION]
    speed = profile[phase, SPEED]
    return float(profile[phase, DISTANCE] + speed * t + half_acceleration * t * t)
