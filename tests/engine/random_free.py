"""Random scenarios of free flight: commands of real numbers, buildings, zones, types of drones."""

from __future__ import annotations

from typing import Any

from desim_uav.world import World
from tests.engine import random_radio
from tests.engine.random_parts import (
    OBSERVATIONS,
    REWARDS,
    Dice,
    accepted,
    battery,
    choose_speeds,
    disc,
    free_motion,
    zone,
)

LOW = (0.4, 0.7, 1.0)
"""Below which share of the battery drones may return."""


def drones(dice: Dice, graded: bool) -> dict[str, Any]:
    """A type of drones; ``graded``: with links that have classes."""
    made: dict[str, Any] = {
        "count": dice.of(1, 1, 2),
        "motion": free_motion(dice),
        "battery": battery(dice, ("endurance", "rotary_wing"), (2.5, 4, 6.2, 10), LOW, 4),
    }
    if graded:
        classes = [{"snr_db": 3.0, "bit_s_hz": 1.0}, {"snr_db": 12.0, "bit_s_hz": 2.5}]
        loss = {"kind": "al_hourani", "environment": dice.of("suburban", "urban")}
        return made | {
            "radio": {
                "kind": "link_classes",
                "power_dbm": dice.of(0, 8),
                "path_loss": loss,
                "classes": classes,
            }
        }
    return made | disc(dice)


def scenario(seed: int) -> dict[str, Any]:
    """A random scenario."""
    dice = Dice(seed)
    three_d = dice.of(True, True, False)
    graded = not three_d and dice.of(True, False)
    map_: dict[str, Any] = {
        "size_m": [1000, 1000],
        "cells": [dice.of(5, 8), dice.of(5, 8)],
        "dimensions": 3 if three_d else 2,
        "no_fly": [zone(dice) for _ in range(dice.of(0, 1, 3))],
    }
    if three_d:
        map_["levels"] = {"min_altitude_m": 20, "step_m": dice.of(15, 20)}
        map_["obstacles"] = dice.of(
            {"coverage": [0.05, 0.25], "height_m": [15, 70]}, {"coverage": [0.3, 0.4]}
        )
    made: dict[str, Any] = {
        "map": map_,
        "drones": [{"name": f"type{k}", **drones(dice, graded)} for k in range(dice.of(1, 2, 2))],
        "stations": {"count": dice.of(1, 2, 3), "radius_m": 300, "pads": dice.of(1, 2)},
        "users": {
            "count": dice.of(8, 30),
            "mobility": {"kind": dice.of("static", "random_walk", "random_waypoint")},
        },
        "episode": {"steps": 12, "step_s": dice.of(60, 37.5), "carry_over": dice.of(True, False)},
        "reward": {"kind": dice.of(*REWARDS)},
        "observation": {"kind": dice.of(*OBSERVATIONS)},
    }
    if dice.of(True, False, False):
        made["position_noise"] = {"probability": 0.3, "sigma_cells": 1.0}
    later = Dice(seed + 1)
    made["wind_mps"] = later.of([0, 0], [0, 0], [-2.5, 1], [0, 5.9], [4.2, 3])
    if later.of(True, False, False):
        made["separation_m"] = later.between(15, 400)
        made["on_conflict"] = later.of("log", "hover_higher_index")
    return made


def choosing(seed: int) -> World:
    """The world of a random scenario in which commands choose a cruise speed, in wind or not.

    Drones of some of them decide by event.
    """
    return accepted(_choosing, seed, lambda found: True)


def _choosing(seed: int) -> dict[str, Any]:
    made, dice = scenario(seed), Dice(seed + 2)
    choose_speeds(dice, made["drones"], made["wind_mps"])
    if dice.of(True, False):
        made["decisions"] = {"kind": "event", "patience_s": dice.of(20, 33.3)}
    return made


def with_links(seed: int) -> dict[str, Any]:
    """A random scenario of radio, in which drones fly freely."""
    made = random_radio.scenario(seed)
    made["drones"]["motion"] = free_motion(Dice(seed + 1))
    return made


def world_of(seed: int, links: bool = False, windy: bool = False) -> World:
    """The world of a random scenario.

    ``links``: it is one of those that ``random_radio`` makes. ``windy``: it has wind.
    """
    make = with_links if links else scenario
    return accepted(make, seed, lambda found: not windy or any(found.wind_mps))
