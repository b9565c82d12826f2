"""Random scenarios of everything at once: fleets, energy, charging, free flight, wind, decisions.

Radios, access points, services and maps are those of ``random_radio``. What cannot be combined is
not drawn together, so most scenarios are accepted at once.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from desim_uav.world import World
from tests.engine import random_parts, random_radio
from tests.engine.helpers import ALL_DEMANDS, ALL_WALKS
from tests.engine.random_fleet import ADMISSIONS
from tests.engine.random_parts import (
    CALL,
    OBSERVATIONS,
    REWARDS,
    Dice,
    accepted,
    battery,
    choose_speeds,
    disc,
    free_motion,
    motion,
    zone,
)

WALKS = (
    {"kind": "static"},
    {"kind": "random_walk"},
    {"kind": "random_walk", "speed_mps": 9, "leg_s": 13},
    *ALL_WALKS,
)
CONTINUOUS = {"kind": "continuous"}
DEMANDS = (
    {"kind": "poisson", "rate_per_hour": 90},
    {"kind": "dynamic", "think_time_s": 11},
    {"kind": "static", "none": 0.3},
    CONTINUOUS,
    *ALL_DEMANDS,
)
CHARGING: tuple[dict[str, Any], ...] = (
    {"full_charge_min": 2},
    {"charging": {"kind": "constant", "full_charge_min": 0.7}},
    {"charging": {"kind": "cc_cv", "full_charge_min": 3}},
    {"charging": {"kind": "cc_cv", "full_charge_min": 1, "taper_from": 0.0, "full_at": 0.5}},
    {"charging": {"kind": "swap", "minutes": 1.3}},
)
BY_POWER = {"charging": {"kind": "cc_cv", "power_w": 1800.5, "taper_from": 0.9}}
"""Charging that only batteries of energy have."""

THIRSTY = f"{random_parts.__name__}:Thirsty"
CIRCLING = {"kind": f"{random_parts.__name__}:Circling"}


STREETS = Path(__file__).with_name("streets.net.xml")


def _streets(size_m: Sequence[float], dice: Dice) -> dict[str, Any]:
    """Streets that begin off the map, cut off at its edge."""
    return {
        "kind": "streets",
        "file": str(STREETS),
        "by": dice.of("walking", "driving"),
        "speed_mps": dice.of([0.5, 2], [3, 14]),
        "pause_s": dice.of([0, 0], [0, 40]),
        "start": dice.of("stationary", "stationary", "home"),
        "offset_m": dice.of([-60, -70], [-333, -41]),
        "cut_at_m": list(size_m),
    }


def scenario(seed: int, mixed: bool = False) -> dict[str, Any]:
    """A random scenario; ``mixed``: some types of drones fly freely and others by cells."""
    made, dice = random_radio.scenario(seed), Dice(seed + 500_000)
    made["free"], made["event"] = dice.of(True, False), dice.of(True, False)
    made["wind_mps"] = dice.of([0, 0], [0, 0], [-2.5, 1], [0, 3.9], [4.2, -3])
    own = made["drones"]["radio"]
    if made["event"]:
        made["decisions"] = {"kind": "event", "patience_s": dice.of(20, 45.5, 90)}
    if dice.of(True, False, False):
        made["access_points"], made["association"] = [], "entered_first"
        made["services"], own = {"call": CALL}, None
    made["drones"] = _mixed_types(made, own, dice) if mixed else _types(made, own, dice)
    made["stations"] = _stations(made["drones"], dice)
    made["users"]["mobility"] = dice.of(*WALKS)
    if seed % 10_000 >= 100 and Dice(seed + 1_700_000).of(True, *[False] * 8):
        made["users"]["mobility"] = _streets(made["map"]["size_m"], Dice(seed + 1_800_000))
    offered = made["services"]
    volumes = any(each["kind"] == "transfer" for each in offered.values())
    made["demand"] = dict(dice.of(*[each for each in DEMANDS if not volumes or each != CONTINUOUS]))
    if made["demand"]["kind"] != "continuous":
        made["demand"]["mix"] = dict.fromkeys(offered, 1)
    made["reward"] = {"kind": dice.of(*REWARDS)}
    if made["reward"]["kind"] == "multi_service":
        made["reward"]["services"] = dict.fromkeys(offered, 0.3)
    made["observation"] = {"kind": dice.of(*OBSERVATIONS)}
    if dice.of(True, False):
        made["separation_m"] = dice.between(5, 300)
        made["on_conflict"] = dice.of("log", "hover_higher_index")
    if mixed:
        choosing = Dice(seed + 600_000).of(True, False)
        types = [each for each in made["drones"] if each["motion"].get("space") == "free"]
        choose_speeds(dice, types if choosing else [], made["wind_mps"])
    elif made["free"]:
        zones = [zone(dice, made["map"]["size_m"]) for _ in range(dice.of(0, 0, 1, 2))]
        made["map"]["no_fly"] = zones
        later = Dice(seed + 600_000)
        if later.of(True, False):
            choose_speeds(later, made["drones"], made["wind_mps"])
    del made["free"], made["event"]
    return made


def _types(made: dict[str, Any], own: Any, dice: Dice) -> list[dict[str, Any]]:
    """One to three types of drones, which fly all freely or all from cell to cell.

    ``own`` is the radio of the first one, if links have classes.
    """
    windy = any(made["wind_mps"])
    cruise = dice.of(None, None, [8.3] if windy else [5, 8.3])
    volumes = any(each["kind"] == "transfer" for each in made["services"].values())
    only_graded = own and (
        own["interference"] != "none"
        or own["sharing"] != "held"
        or made["access_points"]
        or volumes
    )
    types, admission = [], {"kind": dice.of(*ADMISSIONS)}
    for k in range(dice.of(1, 2, 3)):
        each: dict[str, Any] = {"name": f"type{k}", "count": dice.of(1, 1, 2)}
        each["admission"] = admission
        if own and (only_graded or dice.of(True, False)):
            each["radio"] = _radio(made, own, dice) if k else own
        else:
            each |= disc(dice)
        if not made["access_points"]:  # which admit requests as drones do
            each["admission"] = {"kind": dice.of(*ADMISSIONS)}
        each["motion"] = free_motion(dice) if made["free"] else motion(dice) | {"cruise": cruise}
        each["battery"] = _battery(made, each, dice)
        types.append(each)
    return types


def _mixed_types(made: dict[str, Any], own: Any, dice: Dice) -> list[dict[str, Any]]:
    """One or two types of each kind, in any order."""
    types: list[dict[str, Any]] = []
    for free in (True, False):
        made["free"] = free
        types += _types(made, own, dice)[:2]
    types = [types[k] for k in dice.rng.permutation(len(types))]
    if made["access_points"]:  # which admit requests as drones do
        types = [each | {"admission": types[0]["admission"]} for each in types]
    return [each | {"name": f"type{k}"} for k, each in enumerate(types)]


def _radio(made: dict[str, Any], own: dict[str, Any], dice: Dice) -> dict[str, Any]:
    """Another radio that goes with that of the first type."""
    other = random_radio.radio(dice, "obstacles" in made["map"])
    other |= {"interference": own["interference"]}
    if own["interference"] != "none":
        other |= {key: own[key] for key in ("carrier_ghz", "bandwidth_mhz")}
    if (other["sharing"] != "held") != (own["sharing"] != "held"):
        other["sharing"] = own["sharing"]
    return other


def _battery(made: dict[str, Any], drones: dict[str, Any], dice: Dice) -> dict[str, Any] | None:
    """A battery of any kind that the motion allows, which may be changed for it."""
    kinds, step_s = ["endurance", "rotary_wing", "rotary_wing", THIRSTY], made["episode"]["step_s"]
    flight = drones["motion"]
    cells = not made["free"] and flight["cruise"] is None
    if cells and not made["event"] and flight["timing"] == "fill_epoch":
        kinds += ["per_action"] * 2
    if cells and made["wind_mps"] == [0, 0]:
        kinds += ["fixed_wing"] * 2
    own = battery(dice, kinds, (2, 3.3, 5.2, 8))
    if own is None:
        return None
    if own["kind"] == "per_action":
        own["action_min"] = step_s / 60
    if own["kind"] == "rotary_wing":
        own["climb"] = dice.of(True, True, False)
    if own["kind"] == "fixed_wing":
        drones["motion"] = dict(CIRCLING)
    if made["event"]:
        own["respawn_after_min"] += made["decisions"]["patience_s"] / 60
    return own


def _stations(types: list[dict[str, Any]], dice: Dice) -> dict[str, Any]:
    """Stations with a way of charging that all batteries have."""
    batteries = [each["battery"] for each in types if each["battery"] is not None]
    if not batteries:
        return {"count": 0}
    ways = CHARGING
    if all("capacity_wh" in each for each in batteries):
        ways = (*ways, BY_POWER, BY_POWER)
    many = dice.of({"count": 1}, {"count": 1}, {"count": 2, "radius_m": 240})
    return {**many, "pads": dice.of(1, 2), **dice.of(*ways)}


def one_of_all(seed: int) -> dict[str, Any]:
    """A random scenario; in one of three, some types of drones fly freely and others by cells."""
    return scenario(seed, mixed=seed % 3 == 2)


def world_of(seed: int) -> World:
    """The world of a random scenario (``one_of_all``)."""
    return accepted(one_of_all, seed)
