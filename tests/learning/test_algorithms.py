"""What one update does, worked by hand, for each algorithm."""

import numpy as np
import pytest

import desim_uav.learning
from desim_uav.learning.double_q import DoubleQ
from desim_uav.learning.expected_sarsa import ExpectedSarsa
from desim_uav.learning.exploration import epsilon_greedy
from desim_uav.learning.q_learning import QLearning
from desim_uav.learning.sarsa import Sarsa
from desim_uav.registry import names, resolve
from desim_uav.scenario.schema import ALGORITHMS

ALPHA, GAINED, DISCOUNT, EPSILON = 0.5, 2.0, 0.9, 0.2
ALLOWED = np.array([True, True, False])


def table(tables: int = 1) -> np.ndarray:
    """Two states, three actions; the forbidden action of state 1 is the most valuable."""
    q = np.array([[1.0, 0.0, 0.0], [3.0, 5.0, 100.0]], np.float32)
    other = np.array([[2.0, 0.0, 0.0], [7.0, 1.0, 200.0]], np.float32)
    return np.stack([q, other][:tables])


def updated(algorithm, next_action: int = 0, coin: float = 0.0, epsilon: float = EPSILON):
    q = table(algorithm.tables)
    algorithm.update(q, 0, 0, GAINED, DISCOUNT, 1, ALLOWED, next_action, epsilon, ALPHA, coin)
    return q


def test_q_learning_looks_at_the_best_allowed_action():
    q = updated(QLearning, next_action=0)
    assert q[0, 0, 0] == np.float32(1 + 0.5 * (2 + 0.9 * 5 - 1))


def test_sarsa_looks_at_the_action_taken():
    assert updated(Sarsa, next_action=0)[0, 0, 0] == np.float32(1 + 0.5 * (2 + 0.9 * 3 - 1))
    assert updated(Sarsa, next_action=1)[0, 0, 0] == np.float32(1 + 0.5 * (2 + 0.9 * 5 - 1))


def test_expected_sarsa_looks_at_the_mean_of_what_may_be_taken():
    expected = 0.8 * 5 + 0.2 * (3 + 5) / 2
    assert updated(ExpectedSarsa)[0, 0, 0] == np.float32(1 + 0.5 * (2 + 0.9 * expected - 1))
    greedy = updated(ExpectedSarsa, epsilon=0.0)
    assert greedy[0, 0, 0] == updated(QLearning)[0, 0, 0]


def test_double_q_lets_one_table_choose_and_the_other_value():
    heads = updated(DoubleQ, coin=0.2)
    assert heads[0, 0, 0] == np.float32(1 + 0.5 * (2 + 0.9 * 1 - 1)), "A prefers 1, worth 1 to B"
    assert heads[1, 0, 0] == 2.0
    tails = updated(DoubleQ, coin=0.7)
    assert tails[1, 0, 0] == np.float32(2 + 0.5 * (2 + 0.9 * 3 - 2)), "B prefers 0, worth 3 to A"
    assert tails[0, 0, 0] == 1.0


@pytest.mark.parametrize("name", ALGORITHMS)
def test_an_update_changes_one_entry(name: str):
    algorithm = resolve("algorithm", name)
    for coin in (0.1, 0.9):
        changed = updated(algorithm, coin=coin) != table(algorithm.tables)
        assert changed.sum() == 1


@pytest.mark.parametrize("name", ALGORITHMS)
def test_nothing_after_the_end_counts(name: str):
    algorithm = resolve("algorithm", name)
    q = table(algorithm.tables)
    algorithm.update(q, 0, 0, GAINED, 0.0, 1, ALLOWED, 0, EPSILON, 1.0, 0.0)
    assert q[0, 0, 0] == GAINED


def test_the_scenario_knows_all_algorithms():
    assert desim_uav.learning is not None
    assert set(names("algorithm")) == set(ALGORITHMS)


def test_greedy_takes_the_best_allowed_and_of_equals_the_first():
    q = np.array([[[1.0, 4.0, 4.0, 9.0]]], np.float32)
    allowed = np.array([True, True, True, False])
    assert epsilon_greedy(q, 0, allowed, 0.0, 0.0, 0.0) == 1


def test_greedy_sums_the_tables():
    q = np.array([[[3.0, 0.0]], [[0.0, 4.0]]], np.float32)
    assert epsilon_greedy(q, 0, np.array([True, True]), 0.0, 0.5, 0.5) == 1


def test_exploring_is_uniform_over_what_is_allowed():
    q = np.zeros((1, 1, 5), np.float32)
    allowed = np.array([False, True, False, True, True])
    draws = np.random.default_rng(0).random((30_000, 2))
    taken = np.array([epsilon_greedy(q, 0, allowed, 0.3, *row) for row in draws])
    counts = np.bincount(taken, minlength=5) / len(draws)
    assert counts[[0, 2]].tolist() == [0, 0]
    error = 4 * np.sqrt(0.1 * 0.9 / len(draws))
    assert abs(counts[3] - 0.1) < error and abs(counts[4] - 0.1) < error
    assert abs(counts[1] - 0.8) < 2 * error, "the greedy one, and a third of the exploring"


def test_negative_values_are_values():
    q = np.array([[[-5.0, -3.0, -4.0]]], np.float32)
    assert epsilon_greedy(q, 0, np.array([True, False, True]), 0.0, 0.0, 0.0) == 2
    QLearning.update(q, 0, 0, 0.0, 1.0, 0, np.array([False, False, True]), 2, 0.0, 1.0, 0.0)
    assert q[0, 0, 0] == -4.0
