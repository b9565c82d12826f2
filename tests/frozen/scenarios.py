"""The scenarios whose runs are frozen: the nine cases, and cases with other components and values.

Together the changed ones have every kind of demand, mobility, reward, crash and timing of the
paper. The other committed scenarios, the benchmark's tasks and random scenarios have the rest.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

from desim_uav.scenario.schema import Scenario
from tests.engine import random_all
from tests.engine.random_parts import accepted

HERE = Path(__file__).parent

SKYLINE = [
    *([x, 6, 130.0 - 10 * x] for x in range(1, 9)),
    *([4, y, 35.0 + 20 * y] for y in range(1, 6)),
    *([8, 8, 20.0], [7, 1, 19.5], [1, 8, 64.9], [0, 0, 90.0]),
]
"""Two walls of unequal height that meet, and some towers: [cell x, cell y, height in metres]."""

CASES = [f"case{number}" for number in range(1, 10)]

CHANGED: dict[str, tuple[str, dict[str, Any]]] = {
    "paper preset": ("case9", {"preset": "paper"}),
    "some ask for nothing": ("case7", {"demand.none": 0.3, "episode.carry_over": False}),
    "arrivals": (
        "case8",
        {"demand": {"kind": "poisson", "rate_per_hour": 40.0, "none": 0.1}},
    ),
    "traces": (
        "case8",
        {
            "users.count": 6,
            "users.mobility": {"kind": "trace", "file": str(HERE / "walks.csv")},
            "demand": {"kind": "trace", "file": str(HERE / "requests.csv")},
            "drones.bandwidth_kbps": 600.0,
        },
    ),
    "crowded": (
        "case8",
        {"users.count": 120, "drones.bandwidth_kbps": 1000.0, "demand.think_time_s": 5.0},
    ),
    "queue for two pads": (
        "case9",
        {
            "drones.count": 4,
            "stations": {"count": 1, "pads": 2, "full_charge_min": 20.0},
            "drones.battery": {"kind": "endurance", "return_below": 1.0},
        },
    ),
    "replaced at once": (
        "case8",
        {
            "drones.count": 6,
            "drones.battery": {"kind": "endurance", "autonomy_min": 6, "respawn_after_min": 0},
        },
    ),
    "replaced later": (
        "case9",
        {
            "drones.battery": {"kind": "endurance", "autonomy_min": 4, "respawn_after_min": 2.3},
            "position_noise": {"probability": 0.5, "sigma_cells": 2.0},
        },
    ),
    "removed": (
        "case8",
        {"drones.battery": {"kind": "endurance", "autonomy_min": 9, "on_crash": "remove"}},
    ),
    "crash ends the episode": (
        "case9",
        {"drones.battery": {"kind": "endurance", "autonomy_min": 9, "on_crash": "end_episode"}},
    ),
    "buckets": (
        "case8",
        {
            "map.size_m": [7200, 4800],
            "map.cells": [30, 20],
            "users.count": 150,
            "drones.count": 5,
        },
    ),
    "minimum time": ("case8", {"drones.motion.timing": "minimum_time", "episode.step_s": 45.5}),
    "skyline": (
        "case9",
        {
            "map.obstacles": {"cells": SKYLINE},
            "map.levels": {"min_altitude_m": 20.0, "step_m": 15.0},
        },
    ),
    "unlimited bandwidth": ("case8", {"drones.bandwidth_kbps": None, "episode.steps": 12}),
    "unlimited batteries": (
        "case8",
        {
            "drones.battery": None,
            "drones.count": 5,
            "stations.count": 0,
            "reward.kind": "coverage",
            "map.dimensions": 2,
        },
    ),
    "paid for danger": (
        "case8",
        {"reward": {"kind": "coverage_battery", "cost_sign": 1}, "episode.carry_over": False},
    ),
    "fast walkers": (
        "case9",
        {
            "users.mobility": {"kind": "random_walk", "speed_mps": 6.0, "leg_s": 20.0},
            "drones.footprint_radius_m": 250.0,
        },
    ),
}
"""The case that each is made from, and the keys that differ."""

SCENARIOS = [*CASES, *CHANGED]


def of_name(name: str) -> tuple[str, dict[str, Any]]:
    """Return the shipped scenario and the changed keys of a frozen scenario."""
    return CHANGED.get(name, (name, {}))


ROOT = HERE.parents[1] / "scenarios"
COMMITTED = sorted(str(file.relative_to(ROOT)) for file in ROOT.rglob("*.yaml"))
"""All committed scenarios, with the tasks of the benchmark."""

RANDOM = range(40)
"""The random scenarios of everything that are frozen."""


def of_seed(seed: int) -> Scenario:
    """Return a random scenario of everything."""
    return accepted(random_all.one_of_all, seed).scenario
