"""Random scenarios of free flight, for the engine and for the simulator of fixed steps."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from desim_uav.errors import ScenarioError
from desim_uav.scenario.load import from_mapping
from desim_uav.world import build_world
from tests.verification.convergence import Scenarios, by_event, energetic, scenario_of

WINDY, CHOOSING = 32, 44
"""From these seeds on, scenarios of the first thousand have wind, and commands that choose a cruise
speed, and so have those tried instead."""


def freely(seed: int) -> dict[str, Any]:
    """The first scenario from a seed on that is accepted (see ``drawn``)."""
    return accepted(drawn, seed)


def freely_by_event(seed: int) -> dict[str, Any]:
    """The same with drones that are asked when they are free."""
    return accepted(lambda number: by_event(drawn(number), number), seed)


def accepted(scenarios: Scenarios, seed: int) -> dict[str, Any]:
    """The first scenario from a seed on, in steps of a thousand, that is not refused."""
    for number in range(seed, seed + 10_000, 1000):
        mapping = scenarios(number)
        try:
            build_world(from_mapping(mapping), seed)
        except ScenarioError:
            continue
        return mapping
    raise AssertionError(f"no scenario from seed {seed} on is accepted")


def drawn(seed: int) -> dict[str, Any]:
    """A scenario of ``scenario_of`` or ``energetic``, with drones that fly freely round boxes."""
    mapping, rng = (scenario_of, energetic)[seed // 2 % 2](seed), np.random.default_rng([12, seed])
    width_m, depth_m = mapping["map"]["size_m"]
    zones = []
    for _ in range(int(rng.integers(0, 5))):
        x, y = rng.uniform(0.0, 0.9) * width_m, rng.uniform(0.0, 0.9) * depth_m
        right, up = (x + rng.uniform(30.0, 250.0), y + rng.uniform(30.0, 250.0))
        right, up = min(right, width_m), min(up, depth_m)
        polygon = [[x, y], [right, y], [right, up], [x, up]]
        zones.append({"polygon_m": polygon, "altitude_m": [float(rng.choice([0, 35])), 300.0]})
    mapping["map"]["no_fly"] = zones
    mapping["drones"]["motion"] = {
        "kind": "bang_coast_bang",
        "space": "free",
        "max_speed_mps": float(rng.choice([8.3, 14.0])),
        "max_acceleration_mps2": float(rng.choice([2.0, 4.0])),
        "climb_mps": float(rng.choice([2.0, 5.0])),
        "descent_mps": float(rng.choice([1.5, 3.0])),
        "vertical_mps2": float(rng.choice([1.0, 2.0])),
        "margin_m": float(rng.choice([2.0, 7.5])),
    }
    mapping["position_noise"] = None
    if seed % 1000 >= WINDY:
        mapping["wind_mps"] = rng.uniform(-4.0, 4.0, 2).round(3).tolist()
    if seed % 1000 >= CHOOSING:
        lowest = math.hypot(*mapping["wind_mps"]) + float(rng.choice([0.3, 1.5]))
        highest = mapping["drones"]["motion"]["max_speed_mps"] - float(rng.choice([0.0, 0.9]))
        mapping["drones"]["motion"]["cruise"] = [lowest, highest]
    return mapping
