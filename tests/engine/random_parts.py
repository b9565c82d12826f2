"""What random scenarios are made of: dice, motions, batteries, zones, components of drones.

``random_radio``, ``random_fleet`` and ``random_free`` draw what one part of the model needs, and
``random_all`` draws everything at once.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Annotated, Any, ClassVar

import numpy as np
from annotated_types import Ge, Le

from desim_uav.errors import ScenarioError
from desim_uav.model.admission import RowAdmission
from desim_uav.model.energy.battery import Endurance
from desim_uav.model.motion.motion import Transit
from desim_uav.model.rules import US
from desim_uav.rules.admission import admit
from desim_uav.rules.service import fits
from desim_uav.scenario.load import from_mapping
from desim_uav.scenario.schema import Scenario
from desim_uav.world import World, build_world
from tests.engine.helpers import HOVER_WH

CALL = {"kind": "uniform_choice", "duration_min": [0.5, 2], "bandwidth_kbps": [64, 900]}
OBSERVATIONS = ("local", "position", "team", "radar")
REWARDS = ("multi_service", "coverage_battery", "qoe")


class Dice:
    """Draws from lists, by name of what is drawn."""

    def __init__(self, seed: int) -> None:
        self.rng = np.random.default_rng(seed)

    def of(self, *options: Any) -> Any:
        """One of the options."""
        return options[int(self.rng.integers(len(options)))]

    def between(self, low: float, high: float) -> float:
        """A number with three decimals."""
        return round(float(self.rng.uniform(low, high)), 3)


def accepted(
    make: Callable[[int], dict[str, Any]],
    seed: int,
    wanted: Callable[[Scenario], bool] = lambda scenario: True,
) -> World:
    """The world of the first scenario from a seed on that is accepted and ``wanted``."""
    for k in range(60):
        try:
            found = from_mapping(make(seed + 10_000 * k))
            if wanted(found):
                return build_world(found, seed)
        except ScenarioError:
            continue
    raise AssertionError(f"no scenario from seed {seed} on is accepted")


# ---- parts of drones


def motion(dice: Dice) -> dict[str, Any]:
    """Speeds at which 240 m fit a step, as the case may be with a hover behind."""
    return {
        "kind": "bang_coast_bang",
        "max_speed_mps": dice.of(8.3, 12, 20.5),
        "max_acceleration_mps2": dice.of(2, 4),
        "timing": dice.of("minimum_time", "fill_epoch"),
    }


def free_motion(dice: Dice) -> dict[str, Any]:
    """Limits of free flight, and a margin that leaves room in the middle of cells."""
    return {
        "space": "free",
        "max_speed_mps": dice.of(8.3, 12, 20.5),
        "max_acceleration_mps2": dice.of(2, 4),
        "climb_mps": dice.of(2, 5),
        "descent_mps": dice.of(1.5, 4),
        "vertical_mps2": dice.of(1, 2.5),
        "margin_m": dice.of(1, 5, 17.5),
    }


def choose_speeds(dice: Dice, types: list[dict[str, Any]], wind_mps: Any) -> None:
    """Let commands of free flight choose a speed, from just above that of the wind."""
    wind = math.hypot(*wind_mps)
    for each in types:
        top = each["motion"]["max_speed_mps"]
        each["motion"]["cruise"] = [wind + dice.of(0.2, 1.5), dice.of(top, (wind + 1.6 + top) / 2)]


def battery(
    dice: Dice,
    kinds: Sequence[str],
    lasts_min: Sequence[float],
    return_below: Sequence[float] = (0.2, 0.6, 1.0),
    some_in: int = 3,
) -> dict[str, Any] | None:
    """A battery that is soon empty, or in one of ``some_in`` cases an unlimited one."""
    if dice.of(True, *[False] * (some_in - 1)):
        return None
    kind, minutes = dice.of(*kinds), dice.of(*lasts_min)
    held = {"autonomy_min": minutes}
    if kind == "rotary_wing":
        held = {"capacity_wh": HOVER_WH * minutes, "electronics_w": dice.of(0, 12)}
    if kind == "fixed_wing":
        held = {"capacity_wh": LOITER_WH * minutes}
    return {
        "kind": kind,
        **held,
        "return_below": dice.of(*return_below),
        "on_crash": dice.of("respawn", "respawn", "remove", "end_episode"),
        "respawn_after_min": dice.of(0, 1, 2.3),
    }


LOITER_WH = 85 / 60
"""About what a fixed wing takes in a minute of loitering, in Wh."""


def disc(dice: Dice) -> dict[str, Any]:
    """A footprint and a bandwidth."""
    return {
        "footprint_radius_m": dice.of(90, 180, 300, 600),
        "bandwidth_kbps": dice.of(None, 300, 1000, 5000),
    }


def zone(dice: Dice, size_m: Sequence[float] = (1000, 1000)) -> dict[str, Any]:
    """A triangle or an arrow somewhere on a map, below or above 60 m."""
    x, y = (dice.between(0.1 * side, 0.9 * side) for side in size_m)
    size = dice.between(30, 160)
    arrow = [[x, y], [x + size, y], [x + size / 3, y + size / 3], [x, y + size]]
    return {
        "polygon_m": dice.of(arrow, [arrow[0], arrow[1], arrow[3]]),
        "altitude_m": dice.of([0, 60], [0, 35], [50, 200]),
    }


# ---- components of drones, compiled for both engines


@dataclass(frozen=True)
class Thirsty(Endurance):
    """A battery that moves drain faster than hovers."""

    share: Annotated[float, Ge(1), Le(4)] = 1.5
    """How much faster."""

    def drains(self, flight: Any, elapsed_us: int) -> int:
        """The autonomy used by so much of a move."""
        if flight.distance_m == 0.0:
            return elapsed_us
        return math.floor(self.share * elapsed_us)

    def lasts(self, flight: Any, charge: int) -> int:
        """The first microsecond at which it is used up."""
        if flight.distance_m == 0.0:
            return charge
        return math.ceil(charge / self.share)


@dataclass(frozen=True)
class Smallest(RowAdmission):
    """Serves the requests with the smallest bandwidth first."""

    def scan_rows(self, world: Any, path: Any, state: Any, drone: Any, phase: int) -> None:
        """Serve the smallest of those that fit, until none does."""
        best = 0
        while best >= 0:
            best = -1
            for k in range(len(drone.waiting)):
                user = state.users[drone.waiting[k]]
                if fits(world, state, drone, user) and (
                    best < 0 or user.request.needs_hz < state.users[best].request.needs_hz
                ):
                    best = drone.waiting[k]
            if best >= 0:
                admit(world, state, drone, best, phase)


@dataclass(frozen=True)
class Circling:
    """A motion at one speed that never hovers, for fixed wings."""

    hovers: ClassVar = False
    mps: Annotated[float, Ge(1), Le(100)] = 20.0
    """The speed."""

    def epoch_transit(self, distance_m: float, step_s: float) -> Transit:
        """The flight of a move."""
        return self.fastest_transit(distance_m)

    def fastest_transit(self, distance_m: float) -> Transit:
        """The flight of a hop of a return."""
        lasts_s = distance_m / self.mps
        pieces = [(0.0, 0.0, self.mps, 0.0), (lasts_s, distance_m, 0.0, 0.0)]
        return Transit(np.array(pieces), round(lasts_s * US), distance_m)
