"""Random scenarios of ``random_radio`` whose drones have the path loss of 3GPP TR 36.777."""

from __future__ import annotations

from typing import Any

from desim_uav.world import World
from tests.engine import random_radio
from tests.engine.random_parts import Dice, accepted
from tests.verification.engines import differences, engines

LEVELS = {"rma": (11, 30, 41), "uma": (23, 40, 101), "umi": (23, 40, 90)}
"""The lowest levels that are drawn in each environment."""


def scenario(seed: int) -> dict[str, Any]:
    """A random scenario; what is drawn beside ``random_radio`` has a seed of its own."""
    made, dice = random_radio.scenario(seed), Dice(seed + 2_100_000)
    site, built = dice.of(*LEVELS), "obstacles" in made["map"]
    made["map"]["levels"] = {
        "min_altitude_m": dice.of(*LEVELS[site]),
        "step_m": dice.of(9, 17.5, 30),
    }
    made["users"]["max_height_m"] = 0
    own = made["drones"]["radio"]
    own["path_loss"] = {"kind": "tr36777", "environment": site}
    own["line_of_sight"] = dice.of("mean", "buildings") if built else "mean"
    own["power_dbm"] = dice.between(-15, 15)
    if own["line_of_sight"] == "mean":
        own["shadowing"] = None
    return made


def world_of(seed: int) -> World:
    """The world of a random scenario."""
    return accepted(scenario, seed)


def unlike(seed: int) -> list[str]:
    """In what two episodes of both engines differ."""
    world = world_of(seed)
    one, other = engines(world, (True,) * world.scenario.drone_count)
    return [name for episode in range(2) for name in differences(one, other, seed, episode)]
