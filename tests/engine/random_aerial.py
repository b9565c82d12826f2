"""Random scenarios of ``random_radio`` with antennas, and with the path loss of 3GPP TR 36.777.

What is drawn beside ``random_radio`` has a seed of its own.
"""

from __future__ import annotations

from typing import Any

from desim_uav.world import World
from tests.engine import random_radio
from tests.engine.random_parts import Dice, accepted
from tests.verification.engines import differences, engines

LEVELS = {"rma": (11, 30, 41), "uma": (23, 40, 101), "umi": (23, 40, 90)}
"""The lowest levels that are drawn in each environment."""


def scenario(seed: int) -> dict[str, Any]:
    """A random scenario whose drones have the path loss of 3GPP TR 36.777."""
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
    own["antenna"] = dice.of("isotropic", "isotropic", antenna(dice, own))
    return made


def antenna(dice: Dice, radio: dict[str, Any]) -> dict[str, Any]:
    """An antenna that goes with a radio."""
    element = {
        "kind": "element",
        "gain_dbi": dice.between(0, 12),
        "beamwidth_deg": dice.of(65, 30, 110),
        "front_to_back_db": dice.of(30, 12),
    }
    cone = {
        "kind": "cone",
        "half_angle_deg": dice.between(20, 88),
        "gain_dbi": dice.between(2, 14),
        "side_dbi": dice.of(-200, -5.5, 2),
    }
    plain = radio["line_of_sight"] == "mean" and radio["shadowing"] is None
    return dict(dice.of(element, cone, cone) if plain else element)


def aimed_scenario(seed: int) -> dict[str, Any]:
    """A random scenario whose drones and access points have antennas."""
    made, dice = random_radio.scenario(seed), Dice(seed + 2_200_000)
    for radio in (made["drones"]["radio"], *[point["radio"] for point in made["access_points"]]):
        if dice.of(True, False) and radio["line_of_sight"] == "drawn":
            radio |= {"line_of_sight": "mean", "shadowing": None}
        radio["antenna"] = antenna(dice, radio)
    return made


def world_of(seed: int) -> World:
    """The world of a random scenario with this path loss."""
    return accepted(scenario, seed)


def aimed_world_of(seed: int) -> World:
    """The world of a random scenario with antennas."""
    return accepted(aimed_scenario, seed)


def unlike(world: World, seed: int) -> list[str]:
    """In what two episodes of both engines differ."""
    one, other = engines(world, (True,) * world.scenario.drone_count)
    return [name for episode in range(2) for name in differences(one, other, seed, episode)]
