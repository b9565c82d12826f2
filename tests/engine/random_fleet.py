"""Random scenarios of several types of drones, which differ in every key that a type has."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Annotated, Any

from annotated_types import Ge, Le

from desim_uav.errors import ScenarioError
from desim_uav.model.admission import RowAdmission
from desim_uav.model.battery import Endurance
from desim_uav.rules.admission import admit
from desim_uav.rules.service import fits
from desim_uav.scenario.load import from_mapping
from desim_uav.world import World, build_world
from tests.engine import random_radio
from tests.engine.helpers import HOVER_WH
from tests.engine.random_radio import Dice


def motion(dice: Dice) -> dict[str, Any]:
    """Speeds at which 240 m fit a step, as the case may be with a hover behind."""
    return {
        "kind": "bang_coast_bang",
        "max_speed_mps": dice.of(8.3, 12, 20.5),
        "max_acceleration_mps2": dice.of(2, 4),
        "timing": dice.of("minimum_time", "fill_epoch"),
    }


def battery(dice: Dice) -> dict[str, Any] | None:
    """A battery that is soon empty, or an unlimited one."""
    if dice.of(True, False, False):
        return None
    kind, lasts_min = (
        dice.of("endurance", "rotary_wing", f"{__name__}:Thirsty"),
        dice.of(1.5, 3, 5.2, 8),
    )
    held = {"autonomy_min": lasts_min}
    if kind == "rotary_wing":
        held = {"capacity_wh": HOVER_WH * lasts_min, "electronics_w": dice.of(0, 12)}
    return {
        "kind": kind,
        **held,
        "return_below": dice.of(0.2, 0.6, 1.0),
        "on_crash": dice.of("respawn", "respawn", "remove", "end_episode"),
        "respawn_after_min": dice.of(0, 1, 2.3),
    }


def drones(dice: Dice, radio: dict[str, Any] | None) -> dict[str, Any]:
    """A type of drones: with a radio that has classes, or a disc."""
    made = {
        "count": dice.of(1, 1, 2),
        "motion": motion(dice),
        "battery": battery(dice),
        "admission": {"kind": dice.of("first_come", f"{__name__}:Smallest")},
    }
    if radio is not None:
        return made | {"radio": radio}
    return made | {
        "footprint_radius_m": dice.of(90, 180, 300, 600),
        "bandwidth_kbps": dice.of(None, 300, 1000, 5000),
    }


def scenario(seed: int, graded: bool) -> dict[str, Any]:
    """A random scenario; ``graded``: some types have links with classes."""
    made, dice = random_radio.scenario(seed), Dice(seed + 1)
    own = made["drones"]["radio"]
    types = []
    for k in range(dice.of(2, 2, 3)):
        radio = None
        if graded and (own["interference"] != "none" or dice.of(True, True, False)):
            built = "obstacles" in made["map"]
            radio = random_radio.radio(dice, built) | {"interference": own["interference"]}
            if own["interference"] != "none":
                radio |= {key: own[key] for key in ("carrier_ghz", "bandwidth_mhz")}
            if (radio["sharing"] != "held") != (own["sharing"] != "held"):
                radio["sharing"] = own["sharing"]
        types.append({"name": f"type{k}", **drones(dice, radio)})
    cruise = Dice(seed + 2).of(None, None, [5, 8.3])  # which all types have in common
    for each in types:
        each["motion"]["cruise"] = cruise
    if made["access_points"]:  # which admit requests as drones do
        types = [each | {"admission": types[0]["admission"]} for each in types]
    made["drones"] = types
    if not graded:
        made["access_points"], made["association"] = [], "entered_first"
        call = {"kind": "uniform_choice", "duration_min": [0.5, 2], "bandwidth_kbps": [64, 900]}
        made["services"], made["demand"]["mix"] = {"call": call}, {"call": 1}
    if any(each["battery"] for each in types):
        ways = {"full_charge_min": 2}, {"charging": {"kind": "cc_cv", "full_charge_min": 3}}
        made["stations"] = {"count": 1, "pads": dice.of(1, 2), **dice.of(*ways)}
    made["reward"] = {"kind": dice.of("multi_service", "coverage_battery", "qoe")}
    if made["reward"]["kind"] == "multi_service":
        made["reward"]["services"] = dict.fromkeys(made["services"], 0.3)
    made["observation"] = {"kind": dice.of("local", "position", "team", "radar")}
    made["wind_mps"] = dice.of([0, 0], [0, 0], [-2.5, 1], [0, 3.9])
    return made


def world_of(seed: int, graded: bool) -> World:
    """The world of a random scenario: of the first from this seed on that its checks accept.

    Its types differ.
    """
    for k in range(20):
        try:
            found = from_mapping(scenario(seed + 10_000 * k, graded))
            if found.differing:
                return build_world(found, seed)
        except ScenarioError:
            continue
    raise AssertionError(f"no scenario from seed {seed} on is accepted")


# ---- components that a type may have, compiled for both engines


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

    def lasts(self, flight: Any, battery_us: int) -> int:
        """The first microsecond at which it is used up."""
        if flight.distance_m == 0.0:
            return battery_us
        return math.ceil(battery_us / self.share)


@dataclass(frozen=True)
class Smallest(RowAdmission):
    """Serves the requests with the smallest bandwidth first."""

    def scan_rows(self, world: Any, path: Any, state: Any, drone: Any, phase: int) -> None:
        """Serve the smallest of those that fit, until none does."""
        best = 0
        while best >= 0:
            best = -1
            for k in range(len(drone.waiting)):
                needs_hz = state.users[drone.waiting[k]].request.needs_hz
                if fits(world, drone, needs_hz) and (
                    best < 0 or needs_hz < state.users[best].request.needs_hz
                ):
                    best = drone.waiting[k]
            if best >= 0:
                admit(world, state, drone, best, phase)
