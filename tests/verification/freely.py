"""Random scenarios of free flight, flown by the engine and by the simulator of fixed steps."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import cache
from typing import Any

import numpy as np

from desim_uav.engine.base import RunSettings
from desim_uav.engine.des import Simulation
from desim_uav.errors import ScenarioError
from desim_uav.sample_path import draw
from desim_uav.scenario.load import from_mapping
from desim_uav.world import World, build_world
from tests.reference import free
from tests.reference.inputs import Result
from tests.verification.convergence import (
    Case,
    energetic,
    exact_measures,
    inputs_of,
    sampled_measures,
    scenario_of,
    transfers_of,
)

WINDY, CHOOSING = 32, 44
"""From these seeds on, scenarios of the first thousand have wind, and commands that choose a cruise
speed, and so have those tried instead."""


def scenario(seed: int) -> dict[str, Any]:
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


def space_of(mapping: dict[str, Any], world: World, ceilings: Sequence[bool]) -> free.Space:
    """The limits and the obstacles of a scenario in plain numbers."""
    motion, grid = mapping["drones"]["motion"], world.grid
    dx, dy = grid.cell_m
    boxes = [
        ((x * dx, y * dy, 0.0), ((x + 1) * dx, (y + 1) * dy, float(grid.height_m[x, y])))
        for x, y in np.argwhere(grid.height_m > 0.0).tolist()
    ]
    for zone in mapping["map"]["no_fly"]:
        (left, low), _, (right, up), _ = zone["polygon_m"]
        bottom_m, top_m = zone["altitude_m"]
        boxes.append(((left, low, bottom_m), (right, up, top_m)))
    under = grid.levels_m[grid.levels_under_ceiling - 1]
    return free.Space(
        motion["max_speed_mps"],
        motion["max_acceleration_mps2"],
        motion["climb_mps"],
        motion["descent_mps"],
        motion["vertical_mps2"],
        tuple(mapping["map"]["size_m"]),
        grid.levels_m,
        [under if low else grid.levels_m[-1] for low in ceilings],
        boxes,
        motion["margin_m"],
        tuple(mapping.get("wind_mps", (0.0, 0.0))),
        tuple(motion["cruise"]) if "cruise" in motion else None,
    )


@cache
def case_of(seed: int) -> tuple[Case, free.Space]:
    """Fly the first scenario from a seed on that is accepted, with random commands."""
    for number in range(seed, seed + 10_000, 1000):
        try:
            return flown(scenario(number), number)
        except ScenarioError:
            continue
    raise AssertionError(f"no scenario from seed {seed} on is accepted")


def flown(mapping: dict[str, Any], seed: int) -> tuple[Case, free.Space]:
    world, rng = build_world(from_mapping(mapping), seed), np.random.default_rng([13, seed])
    ceilings = tuple(bool(rng.random() < 0.6) for _ in world.starts)
    engine = Simulation(world, RunSettings(ceilings, carry_over=False, keep_events=True))
    path, commands = draw(world, seed, 0), []
    shown = engine.reset(path)
    while not (shown.truncated or shown.terminated):
        told = rng.uniform(-1.2, 1.2, (len(world.starts), 4)).round(3)
        told[:, 3] = rng.choice([-1.0, 1.0], len(told))
        if world.chooses_cruise:
            told = np.column_stack([told, rng.uniform(-1.2, 1.2, len(told)).round(3)])
        commands.append(told.tolist())
        parts = [0, 1, *([2] if world.scenario.three_d else [])]
        parts += [4] if world.chooses_cruise else []
        parts += [3] if world.scenario.limited_battery else []
        shown = engine.step([[command[k] for k in parts] for command in commands[-1]])
    if not world.scenario.three_d:
        commands = [
            [[east, north, 0.0, *more] for east, north, _, *more in all_] for all_ in commands
        ]
    inputs = inputs_of(mapping, world, path, ceilings)
    case = Case(world, inputs, commands, engine.log, transfers_of(mapping, world))
    return case, space_of(mapping, world, ceilings)


@cache
def sampled(seed: int, dt_s: float) -> Result:
    case, space = case_of(seed)
    return free.simulate(case.inputs, space, case.commands, dt_s)


def pooled_errors(
    seeds: Sequence[int], dts_s: Sequence[float], measures: Sequence[str]
) -> dict[str, np.ndarray]:
    """For each measure and dt the mean error over scenarios, less the tenth furthest off."""
    errors = np.empty((len(measures), len(dts_s), len(seeds)))
    for column, seed in enumerate(seeds):
        exact = exact_measures(case_of(seed)[0])
        for row, dt_s in enumerate(dts_s):
            close = sampled_measures(sampled(seed, dt_s))
            errors[:, row, column] = [abs(close[name] - exact[name]) for name in measures]
    kept = np.sort(errors, axis=-1)[..., : math.ceil(0.9 * len(seeds))].mean(axis=-1)
    return dict(zip(measures, kept, strict=True))
