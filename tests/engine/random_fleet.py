"""Random scenarios of several types of drones, which differ in every key that a type has."""

from __future__ import annotations

from typing import Any

from desim_uav.world import World
from tests.engine import random_parts, random_radio
from tests.engine.random_parts import (
    CALL,
    OBSERVATIONS,
    REWARDS,
    Dice,
    accepted,
    battery,
    disc,
    motion,
)

BATTERIES = ("endurance", "rotary_wing", f"{random_parts.__name__}:Thirsty")
ADMISSIONS = ("first_come", f"{random_parts.__name__}:Smallest")


def drones(dice: Dice, radio: dict[str, Any] | None) -> dict[str, Any]:
    """A type of drones: with a radio that has classes, or a disc."""
    made = {
        "count": dice.of(1, 1, 2),
        "motion": motion(dice),
        "battery": battery(dice, BATTERIES, (1.5, 3, 5.2, 8)),
        "admission": {"kind": dice.of(*ADMISSIONS)},
    }
    if radio is not None:
        return made | {"radio": radio}
    return made | disc(dice)


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
        made["services"], made["demand"]["mix"] = {"call": CALL}, {"call": 1}
    if any(each["battery"] for each in types):
        ways = {"full_charge_min": 2}, {"charging": {"kind": "cc_cv", "full_charge_min": 3}}
        made["stations"] = {"count": 1, "pads": dice.of(1, 2), **dice.of(*ways)}
    made["reward"] = {"kind": dice.of(*REWARDS)}
    if made["reward"]["kind"] == "multi_service":
        made["reward"]["services"] = dict.fromkeys(made["services"], 0.3)
    made["observation"] = {"kind": dice.of(*OBSERVATIONS)}
    made["wind_mps"] = dice.of([0, 0], [0, 0], [-2.5, 1], [0, 3.9])
    return made


def world_of(seed: int, graded: bool) -> World:
    """The world of a random scenario whose types differ."""
    return accepted(lambda k: scenario(k, graded), seed, lambda found: bool(found.differing))
