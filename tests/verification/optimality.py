"""Learned policies against the optimum: value iteration and all placements of the drones.

Case 1 is a finite decision process of one drone.
"""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from functools import reduce
from itertools import combinations_with_replacement, product
from operator import or_
from pathlib import Path

import numpy as np

from desim_uav.experiment.evaluate import evaluate
from desim_uav.experiment.train.course import table_of
from desim_uav.learning.training import Training
from desim_uav.optimum.cover import Spots, cover
from desim_uav.optimum.discounted import optimal_return, policy_return
from desim_uav.scenario.load import load
from desim_uav.shipped import scenario_path
from desim_uav.world import World, build_world
from tests.verification.figure import Exact, Figure

GAMMA = 0.95

THOROUGH = (
    "learning.episodes=24000",
    "learning.epsilon={start: 1, decay: 0.9998, end: 0}",
    "learning.alpha.decay=0.9998",
)
"""Twice the episodes, and exploration that ends: what SARSA needs to learn the greedy policy's
values, and double Q-learning, each of whose tables learns from half of what happens."""

LEAST = {"q_learning": 1.0, "expected_sarsa": 1.0, "double_q": 1.0, "sarsa": 0.99}


def figures(quick: bool = False) -> Iterator[Figure]:
    """The value of what is learned, the cells that are best, and hovering over them."""
    found = [share(seed, "q_learning", "learning.episodes=1500") for seed in range(1)]
    if not quick:
        found += [share(seed, "q_learning") for seed in range(10)]
    worst = min(found)
    yield Exact(
        "greedy discounted return divided by the optimum", worst, 1.0, 1e-9, cases=len(found)
    )
    training, world = trained(0, "q_learning", "learning.episodes=1500")
    best, _ = optimal_return(world, GAMMA)
    learned = training.q[0, 0].max(axis=1).reshape(10, 10)
    place = np.unravel_index(np.nanargmax(best), best.shape)
    yield Exact("learned value of the best cell", learned[place], best[place], 0.02, True)
    above = int((learned > best + 1e-3).sum())
    yield Exact("learned values above the optimal values", above, 0, cases=learned.size)
    places = [Spots(build_world(load(scenario_path("case3")), seed)) for seed in range(3)]
    ours, by_hand = (sum(map(most, places)) for most in (_searched, most_covered))
    yield Exact("case 3: users in the best cover", ours, by_hand, cases=len(places))
    qoe3, least = learned_qoe3(training), 100.0 * _searched(Spots(world)) / len(world.homes)
    yield Exact("case 1: learned QoE3 divided by that of the best cover", qoe3 / least, 1.0, 1e-9)


def share(seed: int, algorithm: str, *changes: str) -> float:
    """The discounted return of the greedy policy from the start cell, over the largest one."""
    training, world = trained(seed, algorithm, *changes)
    greedy = training.q[0].sum(axis=0).argmax(axis=1).reshape(10, 10)
    best, _ = optimal_return(world, GAMMA)
    start = world.starts[0]
    return float(policy_return(world, GAMMA, greedy)[start] / best[start])


def trained(seed: int, algorithm: str, *changes: str) -> tuple[Training, World]:
    """A training of case 1, over."""
    settings = [f"seed={seed}", f"learning.algorithm={algorithm}", *changes]
    scenario = load(scenario_path("case1"), settings)
    world = build_world(scenario, seed)
    training = Training(world, seed, "batch")
    for _ in range(scenario.learning.episodes):
        training.play()
    return training, world


def learned_qoe3(training: Training) -> float:
    """In percent, of the greedy policy on sample paths of its own, after two episodes."""
    with tempfile.TemporaryDirectory() as folder:
        policy = Path(folder) / "policy.npz"
        policy.write_bytes(table_of(training).to_bytes())
        measured = evaluate(load(scenario_path("case1")), str(policy), 0, 10, 2)
    assert measured["qoe3_percent"] is not None
    return measured["qoe3_percent"]


def most_covered(places: Spots) -> int:
    """The most users that the drones cover, by all ways to put them over cells."""
    x, y, _ = places.world.homes.T
    radius_m = places.world.scenario.drones.footprint_radius_m
    centres = product((np.arange(10) + 0.5) * 240.0, repeat=2)
    held = [np.hypot(x - cx, y - cy) <= radius_m for cx, cy in centres]
    bits = [sum(1 << int(user) for user in np.flatnonzero(inside)) for inside in held]
    chosen = combinations_with_replacement(bits, places.drones)
    return max(reduce(or_, covers).bit_count() for covers in chosen)


def _searched(places: Spots) -> int:
    return cover(places).users
