"""Random scenarios of free flight: commands of real numbers, buildings, zones, types of drones."""

from __future__ import annotations

from typing import Any

from desim_uav.errors import ScenarioError
from desim_uav.scenario.load import from_mapping
from desim_uav.world import World, build_world
from tests.engine import random_radio
from tests.engine.helpers import HOVER_WH
from tests.engine.random_radio import Dice


def motion(dice: Dice) -> dict[str, Any]:
    """Limits of flight, and a margin that leaves room in the middle of cells."""
    return {
        "space": "free",
        "max_speed_mps": dice.of(8.3, 12, 20.5),
        "max_acceleration_mps2": dice.of(2, 4),
        "climb_mps": dice.of(2, 5),
        "descent_mps": dice.of(1.5, 4),
        "vertical_mps2": dice.of(1, 2.5),
        "margin_m": dice.of(1, 5, 17.5),
    }


def battery(dice: Dice) -> dict[str, Any] | None:
    """A battery that is soon empty, or an unlimited one."""
    if dice.of(True, False, False, False):
        return None
    kind, lasts_min = dice.of("endurance", "rotary_wing"), dice.of(2.5, 4, 6.2, 10)
    held = {"autonomy_min": lasts_min}
    if kind == "rotary_wing":
        held = {"capacity_wh": HOVER_WH * lasts_min, "electronics_w": dice.of(0, 12)}
    return {
        "kind": kind,
        **held,
        "return_below": dice.of(0.4, 0.7, 1.0),
        "on_crash": dice.of("respawn", "respawn", "remove", "end_episode"),
        "respawn_after_min": dice.of(0, 1, 2.3),
    }


def drones(dice: Dice, graded: bool) -> dict[str, Any]:
    """A type of drones; ``graded``: with links that have classes."""
    made: dict[str, Any] = {
        "count": dice.of(1, 1, 2),
        "motion": motion(dice),
        "battery": battery(dice),
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
    return made | {
        "footprint_radius_m": dice.of(90, 180, 300, 600),
        "bandwidth_kbps": dice.of(None, 300, 1000, 5000),
    }


def zone(dice: Dice) -> dict[str, Any]:
    """A triangle or an arrow somewhere on a map of 1 km, below or above 60 m."""
    x, y = dice.between(100, 900), dice.between(100, 900)
    size = dice.between(30, 160)
    arrow = [[x, y], [x + size, y], [x + size / 3, y + size / 3], [x, y + size]]
    return {
        "polygon_m": dice.of(arrow, [arrow[0], arrow[1], arrow[3]]),
        "altitude_m": dice.of([0, 60], [0, 35], [50, 200]),
    }


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
        "reward": {"kind": dice.of("multi_service", "coverage_battery", "qoe")},
        "observation": {"kind": dice.of("local", "position", "team", "radar")},
    }
    if dice.of(True, False, False):
        made["position_noise"] = {"probability": 0.3, "sigma_cells": 1.0}
    later = Dice(seed + 1)
    made["wind_mps"] = later.of([0, 0], [0, 0], [-2.5, 1], [0, 5.9], [4.2, 3])
    if later.of(True, False, False):
        made["separation_m"] = later.between(15, 400)
        made["on_conflict"] = later.of("log", "hover_higher_index")
    return made


def with_links(seed: int) -> dict[str, Any]:
    """A random scenario of radio, in which drones fly freely."""
    made = random_radio.scenario(seed)
    made["drones"]["motion"] = motion(Dice(seed + 1))
    return made


def world_of(seed: int, links: bool = False, windy: bool = False) -> World:
    """The world of a random scenario: of the first from this seed on that is accepted.

    ``links``: it is one of those that ``random_radio`` makes. ``windy``: it has wind.
    """
    make = with_links if links else scenario
    for k in range(50):
        made = make(seed + 10_000 * k)
        if windy and made["wind_mps"] == [0, 0]:
            continue
        try:
            return build_world(from_mapping(made), seed)
        except ScenarioError:
            continue
    raise AssertionError(f"no scenario from seed {seed} on is accepted")
