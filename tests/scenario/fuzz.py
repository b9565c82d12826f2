"""Overrides at random: whatever ``-S`` says, a command ends soon, in 0, 2 or 3.

``python -m tests.scenario.fuzz COUNT SEED`` prints how often each code came, and what went wrong.
A scenario that is foreseen to have more than ``MOST`` events, or to take more than ``MOST_MIB`` of
memory, is loaded but not run: it is the estimate that keeps a run short.
"""

from __future__ import annotations

import json
import random
import sys
import time
from collections import Counter
from collections.abc import Iterator
from typing import NamedTuple

from desim_uav.errors import DesimError
from desim_uav.experiment.run import run
from desim_uav.policies import load_policy
from desim_uav.scenario.cost import cost
from desim_uav.scenario.load import from_mapping, to_plain
from desim_uav.scenario.schema import Scenario
from desim_uav.world import build_world

MOST, MOST_MIB, MOST_S = 20_000.0, 200, 20.0

BASE = {
    "name": "fuzzed",
    "episode": {"steps": 3},
    "users": {"count": 5},
    "map": {"cells": [4, 4], "size_m": [960, 960]},
    "drones": {"count": 2},
    "position_noise": {},
}
"""Quick to run, and yet everything is in it: a battery, stations, buildings, walks, noise."""

NUMBERS = (
    *(0, 1, 2, 3, 7, 10, 100, 999, 1000, 1001, 10_000, 10**6, 10**9, 2**31, 2**53, 2**63, 10**30),
    *(-1, -5, -(10**9), -(2**63)),
    *(5e-324, 1e-300, 1e-12, 1e-9, 1e-6, 1e-3, 0.001, 0.01, 0.1, 0.25, 0.5, 0.9, 0.999),
    *(0.999999999999, 1.5, 2.5, 59.999, 1e5, 1e7, 1e12, 1e100, 1e300, 1.7976931348623157e308),
    *(-5e-324, -0.5, -1e-3, -1e300),
)
WORDS = (".nan", ".inf", "-.inf", "null", "true", '"x"', "[]", "{}", "[1, 2]", "-0.0", "1e400")
COMPONENTS = (
    "demand={kind: static, none: 0.5}",
    "demand={kind: continuous}",
    "demand={kind: poisson, rate_per_hour: 60}",
    "demand={kind: profile, profiles: [[[0, 3], [8, 30]], [[2, 5]]], shape: linear}",
    "users.mobility={kind: static}",
    "users.mobility={kind: random_waypoint, speed_mps: [1, 2], pause_s: [0, 9]}",
    "users.mobility={kind: gauss_markov, alpha: 0.5}",
    "users.mobility={kind: manhattan, street_m: 240}",
    "users.mobility={kind: group, groups: 3, radius_m: 20}",
    "users.mobility={kind: levy, flight_m: [5, 500], pause_s: [1, 60]}",
    "drones.motion.timing=minimum_time",
    "drones.battery=null",
    "drones.bandwidth_kbps=null",
    "drones.battery.on_crash=end_episode",
    "observation={kind: local}",
    "observation={kind: team}",
    "observation={kind: radar}",
    "reward={kind: qoe}",
    "reward={kind: coverage}",
    "map.dimensions=2",
    "users.clusters.count=1",
    "map.obstacles.square_m=50",
    "map.obstacles={cells: [[0, 0, 50]]}",
    "episode.carry_over=true",
    "preset=paper",
)


class Outcome(NamedTuple):
    """How a command with some overrides ended: its code, what was said, and how long it took."""

    overrides: tuple[str, ...]
    code: int
    said: str
    took_s: float
    was_run: bool


def numeric_keys() -> dict[str, float]:
    """Every key that holds a number, and its default."""

    def under(path: str, value: object) -> Iterator[tuple[str, float]]:
        if isinstance(value, dict):
            for key, item in value.items():
                yield from under(f"{path}.{key}" if path else key, item)
        elif isinstance(value, list):
            for index, item in enumerate(value):
                yield from under(f"{path}.{index}", item)
        elif isinstance(value, int | float) and not isinstance(value, bool):
            yield path, value

    return {**dict(under("", to_plain(from_mapping(BASE)))), "demand.rate_per_hour": 60.0}


def overrides(chance: random.Random, keys: dict[str, float]) -> tuple[str, ...]:
    """One override or two, and sometimes another component beneath them."""
    first = [chance.choice(COMPONENTS)] if chance.random() < 0.3 else []
    return (*first, *(_override(chance, keys) for _ in range(chance.choice((1, 2)))))


def _override(chance: random.Random, keys: dict[str, float]) -> str:
    """A key with its default made larger or smaller, or else with an odd value."""
    key, how = chance.choice(list(keys)), chance.random()
    if how < 0.75:
        value = (
            keys[key]
            * 10.0 ** chance.uniform(-1, 1) ** 3
            * chance.choice((1, 1, 1, 1e-3, 1e3, 1e6))
        )
        return f"{key}={round(value) if isinstance(keys[key], int) else value!r}"
    return f"{key}={chance.choice(WORDS) if how < 0.8 else repr(chance.choice(NUMBERS))}"


def outcome(given: tuple[str, ...], engine: str) -> Outcome:
    """What becomes of the base with these overrides."""
    begun = time.process_time()
    code, said, was_run = 0, "", False
    try:
        was_run = _run(from_mapping(BASE, overrides=given), engine)
    except DesimError as error:
        code, said = error.exit_code, str(error)
    except Exception as error:
        code, said = 1, f"the simulation failed: {type(error).__name__}: {error}"
    return Outcome(given, code, said, time.process_time() - begun, was_run)


def _run(scenario: Scenario, engine: str) -> bool:
    """Run an episode if it is a short one."""
    foreseen = cost(scenario, engine)
    if foreseen.event_count > MOST or foreseen.memory_bytes > MOST_MIB * 2**20:
        return False
    world = build_world(scenario, scenario.effective_world_seed)
    run(world, load_policy("random"), "random", scenario.seed, engine=engine)
    return True


def outcomes(count: int, seed: int, engine: str = "des") -> Iterator[Outcome]:
    """So many of them."""
    chance, keys = random.Random(seed), numeric_keys()
    return (outcome(overrides(chance, keys), engine) for _ in range(count))


def is_wrong(found: Outcome) -> bool:
    """Did it end in another code than 0, 2 or 3, or late?"""
    return found.code not in (0, 2, 3) or found.took_s > MOST_S


if __name__ == "__main__":
    codes: Counter[str] = Counter()
    longest = 0.0
    for found in outcomes(int(sys.argv[1]), int(sys.argv[2]), *sys.argv[3:]):
        codes[f"{found.code}{'' if found.was_run or found.code else ' (not run)'}"] += 1
        longest = max(longest, found.took_s)
        if is_wrong(found):
            print(json.dumps(found._asdict()), flush=True)
    print(dict(codes), f"longest {longest:.1f} s")
