"""Case 1 is a finite decision process of one drone: what is learned, against value iteration."""

import numpy as np
import pytest

from desim_uav.learning.training import Training
from desim_uav.optimum.discounted import optimal_return, policy_return
from desim_uav.scenario.load import load
from desim_uav.scenario.schema import ALGORITHMS
from desim_uav.shipped import scenario_path
from desim_uav.world import World, build_world

GAMMA = 0.95


THOROUGH = (
    "learning.episodes=24000",
    "learning.epsilon={start: 1, decay: 0.9998, end: 0}",
    "learning.alpha.decay=0.9998",
)
"""Twice the episodes, and exploration that ends: what SARSA needs to learn the greedy policy's
values, and double Q-learning, each of whose tables learns from half of what happens."""

LEAST = {"q_learning": 1.0, "expected_sarsa": 1.0, "double_q": 1.0, "sarsa": 0.99}


def shares(seed: int, algorithm: str, *changes: str) -> tuple[float, World]:
    """The discounted return of the greedy policy from the start cell, over the largest one."""
    settings = [f"seed={seed}", f"learning.algorithm={algorithm}", *changes]
    scenario = load(scenario_path("case1"), settings)
    world = build_world(scenario, seed)
    training = Training(world, seed, "batch")
    for _ in range(scenario.learning.episodes):
        training.play()
    greedy = training.q[0].sum(axis=0).argmax(axis=1).reshape(10, 10)
    best, _ = optimal_return(world, GAMMA)
    start = world.starts[0]
    return float(policy_return(world, GAMMA, greedy)[start] / best[start]), world


def test_q_learning_finds_the_best_way_in_case_1():
    share, _ = shares(0, "q_learning", "learning.episodes=1500")
    assert share == pytest.approx(1.0, abs=1e-9)


@pytest.mark.slow
@pytest.mark.parametrize("algorithm", ALGORITHMS)
@pytest.mark.parametrize("seed", range(10))
def test_the_best_way_in_case_1(seed: int, algorithm: str):
    share, _ = shares(seed, algorithm, *(THOROUGH if algorithm in ("sarsa", "double_q") else ()))
    assert LEAST[algorithm] - 1e-9 <= share <= 1 + 1e-9


def test_values_on_the_way_are_those_of_the_best_policy():
    """After a long training α is small and exploration rare: the start's value is V*, nearly."""
    scenario = load(scenario_path("case1"), ["learning.episodes=1500"])
    world = build_world(scenario, 0)
    training = Training(world, 0)
    for _ in range(1500):
        training.play()
    best, _ = optimal_return(world, GAMMA)
    learned = training.q[0, 0].max(axis=1).reshape(10, 10)
    place = np.unravel_index(np.nanargmax(best), best.shape)
    assert learned[place] == pytest.approx(best[place], rel=0.02)
    assert (learned <= best + 1e-3).all(), "values begin below the best, and never pass it"
