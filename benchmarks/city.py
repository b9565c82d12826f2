"""How many steps per second the compiled engine makes over a city, and what the buildings take.

Four drones hover, or fly over 1,000 users and about 2,000 buildings on 1 km², by random allowed
actions, which are drawn before the clock starts and are other ones in each round. Users stand
(``static``) or walk. The same scenarios are measured with the mean loss in place of buildings. CPU
time of one thread; medians of the rounds, of which each has a new world. Over users who stand,
drones then fly so many ``--episodes`` in one world, in which the engine remembers their legs.
"""

from __future__ import annotations

import argparse
import statistics
import time
from typing import Any

import numpy as np

from desim_uav.engine.base import RunSettings
from desim_uav.engine.choose import make_engine
from desim_uav.engine.leg_memory import known_legs
from desim_uav.model.rules import Action
from desim_uav.sample_path import draw
from desim_uav.scenario.load import from_mapping
from desim_uav.world import World, build_world

STEPS, DRONES = 30, 4
SIGHTS = ("buildings", "mean")


def city(mobility: str, sight: str) -> World:
    """Return the world: 2,000 buildings per km², of which a third of the ground is built."""
    scenario = {
        "map": {
            "size_m": [1000, 1000],
            "cells": [20, 20],
            "levels": {"min_altitude_m": 80, "step_m": 20},
            "buildings": {"kind": "itu", "alpha": 0.3, "beta": 2000, "gamma": 15},
        },
        "drones": {
            "count": DRONES,
            "battery": None,
            "radio": {
                "kind": "link_classes",
                "power_dbm": 0,
                "path_loss": {"kind": "al_hourani", "environment": "dense_urban"},
                "line_of_sight": sight,
                "sharing": "equal",
            },
        },
        "users": {"count": 1000, "mobility": {"kind": mobility}},
        "services": {"download": {"kind": "transfer", "volume_mbit": [20, 50]}},
        "demand": {"kind": "dynamic", "mix": {"download": 1}},
        "episode": {"steps": STEPS},
    }
    return build_world(from_mapping(scenario), 0)


def seconds_per_step(world: World, hover: bool, episode: int) -> float:
    """Return the CPU time of a step in an episode, whose number seeds the actions."""
    player: Any = make_engine("batch", world, RunSettings((True,) * DRONES, False, False))
    rng = np.random.default_rng(episode)
    shown = player.reset(draw(world, 1, episode))
    total, stay = 0.0, world.actions.index(Action.HOVER)
    while not (shown.terminated or shown.truncated):
        chosen = [stay if hover else int(rng.choice(np.flatnonzero(mask))) for mask in shown.masks]
        begin = time.process_time()
        shown = player.step(chosen)
        total += time.process_time() - begin
    return total / STEPS


def measure(mobility: str, hover: bool, rounds: int) -> None:
    """Print the steps per second in the first episode of a world."""
    times: dict[str, list[float]] = {sight: [] for sight in SIGHTS}
    for number in range(rounds + 1):
        for sight, of in times.items():
            took = seconds_per_step(city(mobility, sight), hover, number)
            if number:  # the first round compiles
                of.append(took)
    say("hovering" if hover else "flying", [statistics.median(of) for of in times.values()])


def fly_on(episodes: int) -> None:
    """Print the mean steps per second in many episodes of one world, in which users stand."""
    times, known = [], []
    for sight in SIGHTS:
        world, before = city("static", sight), known_legs()
        times.append([seconds_per_step(world, False, number) for number in range(episodes)])
        known.append(known_legs() - before)
    share = 1.0 - known[0] / (episodes * STEPS * DRONES)
    say(f"flying, {episodes} episodes", [statistics.mean(of) for of in times])
    say("flying, the last ten", [statistics.mean(of[-10:]) for of in times])
    print(f"  past buildings, {share:.0%} of all legs were flown before")


def say(what: str, seconds: list[float]) -> None:
    """Print the steps per second past buildings and with the mean loss."""
    rates = [1.0 / each for each in seconds]
    print(f"  {what}: {rates[0]:,.0f} steps/s past buildings, {rates[1]:,.0f} with the mean loss")


def main() -> None:
    """Print steps per second."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--episodes", type=int, default=100)
    args = parser.parse_args()
    for mobility in ("static", "random_walk"):
        print(f"{mobility}: {len(city(mobility, 'buildings').grid.city)} buildings")
        for hover in (True, False):
            measure(mobility, hover, args.rounds)
        if mobility == "static":
            fly_on(args.episodes)


if __name__ == "__main__":
    main()
