"""How many steps per second the compiled engine makes over a city, and what the buildings take.

Four drones hover, or fly over 1,000 users and about 2,000 buildings on 1 km², by random allowed
actions, which are other ones in each round. Users stand (``static``) or walk. The same scenarios
are measured with the mean loss in place of buildings. CPU time of one thread in the engine; medians
of the rounds, of which each has a new world, in which no leg was flown before.

If users stand, drones then fly on in the last of these worlds for so many ``--episodes`` in all, as
a learner would. The engine remembers what it found on their legs.
"""

from __future__ import annotations

import argparse
import statistics
import time
from typing import Any

import numpy as np

from desim_uav.engine.base import RunSettings
from desim_uav.engine.choose import make_engine
from desim_uav.model.rules import Action
from desim_uav.sample_path import draw
from desim_uav.scenario.load import from_mapping
from desim_uav.world import World, build_world

STEPS = 30


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
            "count": 4,
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
    player: Any = make_engine("batch", world, RunSettings((True,) * 4, False, False))
    rng = np.random.default_rng(episode)
    shown = player.reset(draw(world, 1, episode))
    total, stay = 0.0, world.actions.index(Action.HOVER)
    while not (shown.terminated or shown.truncated):
        chosen = [stay if hover else int(rng.choice(np.flatnonzero(mask))) for mask in shown.masks]
        begin = time.process_time()
        shown = player.step(chosen)
        total += time.process_time() - begin
    return total / STEPS


def measure(mobility: str, hover: bool, rounds: int, episodes: int) -> None:
    """Print the steps per second past buildings and with the mean loss."""
    times: dict[str, list[float]] = {"buildings": [], "mean": []}
    for number in range(rounds + 1):
        for sight, of in times.items():
            world = city(mobility, sight)
            of.append(seconds_per_step(world, hover, number))
            if number == rounds and mobility == "static" and not hover:
                more = [seconds_per_step(world, hover, number + k) for k in range(1, episodes)]
                mean = statistics.mean([of[-1], *more])
                print(
                    f"  flying, {sight}: {1.0 / mean:,.0f} steps/s in {episodes} episodes, ", end=""
                )
                print(f"{1.0 / statistics.mean(more[-10:]):,.0f} in the last ten")
    rates = [1.0 / statistics.median(of[1:]) for of in times.values()]  # the first compiles
    what = "hovering" if hover else "flying"
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
            measure(mobility, hover, args.rounds, args.episodes)


if __name__ == "__main__":
    main()
