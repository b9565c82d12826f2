"""What one update does, worked by hand, for each algorithm."""

import numpy as np
import pytest

import desim_uav.learning
from desim_uav.learning.double_q import DoubleQ
from desim_uav.learning.expected_sarsa import ExpectedSarsa
from desim_uav.learning.learner import epsilon_greedy
from desim_uav.learning.q_learning import QLearning
from desim_uav.learning.rows import Learner, Lesson, QValues
from desim_uav.learning.sarsa import Sarsa
from desim_uav.registry import names, resolve
from desim_uav.rowcode.rows import blank, fill
from desim_uav.scenario.learning import ALGORITHMS

ALPHA, GAINED, DISCOUNT, EPSILON = 0.5, 2.0, 0.9, 0.2
ALLOWED = (True, True, False)


def table(tables: int = 1) -> np.ndarray:
    """Two states, three actions; the forbidden action of state 1 is the most valuable."""
    q = np.array([[1.0, 0.0, 0.0], [3.0, 5.0, 100.0]], np.float32)
    other = np.array([[2.0, 0.0, 0.0], [7.0, 1.0, 200.0]], np.float32)
    return np.stack([q, other][:tables])


def values(q: np.ndarray) -> QValues:
    return fill(QValues, (q.data, *q.shape, float(q.sum(dtype=np.float64))))


def lesson(next_action: int = 0, coin: float = 0.0, epsilon: float = EPSILON, **fields) -> Lesson:
    """Return a lesson about action 0 in state 0, after which the drone is in state 1."""
    given = {"state": 0, "action": 0, "gained": GAINED, "discount": DISCOUNT, "next_state": 1}
    given |= {"next_action": next_action, "allowed": ALLOWED, "coin": coin}
    given |= {"epsilon": epsilon, "alpha": ALPHA} | fields
    return fill(Lesson, [given[name] for name in Lesson.kinds])


def updated(algorithm, **fields):
    q = table(algorithm.tables)
    algorithm.update(values(q), lesson(**fields))
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
    q = updated(algorithm, discount=0.0, alpha=1.0)
    assert q[0, 0, 0] == GAINED


def test_the_sum_of_the_values_is_kept():
    q = table(2)
    known = values(q)
    for coin in (0.1, 0.9, 0.2):
        DoubleQ.update(known, lesson(coin=coin))
    known[1, 1, 2] = -0.1
    assert known[1, 1, 2] == q[1, 1, 2] == np.float32(-0.1)
    assert known.sum == pytest.approx(q.sum(dtype=np.float64), rel=1e-12)


def test_the_scenario_knows_all_algorithms():
    assert desim_uav.learning is not None
    assert set(names("algorithm")) == set(ALGORITHMS)


def chosen(q, allowed, epsilon=0.0, explore=0.5, which=0.5) -> int:
    learner = blank(Learner)
    learner.q = values(np.array(q, np.float32))
    learner.lesson = lesson(epsilon=epsilon, next_state=0, allowed=allowed)
    learner.explore, learner.which = explore, which
    return epsilon_greedy(learner)


def test_greedy_takes_the_best_allowed_and_of_equals_the_first():
    assert chosen([[[1.0, 4.0, 4.0, 9.0]]], (True, True, True, False)) == 1


def test_greedy_sums_the_tables():
    assert chosen([[[3.0, 0.0]], [[0.0, 4.0]]], (True, True)) == 1


@pytest.mark.thorough
def test_exploring_is_uniform_over_what_is_allowed():
    draws = np.random.default_rng(0).random((30_000, 2)).tolist()
    allowed = (False, True, False, True, True)
    taken = np.array([chosen(np.zeros((1, 1, 5)), allowed, 0.3, *row) for row in draws])
    counts = np.bincount(taken, minlength=5) / len(draws)
    assert counts[[0, 2]].tolist() == [0, 0]
    error = 4 * np.sqrt(0.1 * 0.9 / len(draws))
    assert abs(counts[3] - 0.1) < error and abs(counts[4] - 0.1) < error
    assert abs(counts[1] - 0.8) < 2 * error, "the greedy one, and a third of the exploring"


def test_negative_values_are_values():
    q = np.array([[[-5.0, -3.0, -4.0]]], np.float32)
    assert chosen(q, (True, False, True)) == 2
    only = lesson(gained=0.0, discount=1.0, next_state=0, allowed=(False, False, True), alpha=1.0)
    QLearning.update(values(q), only)
    assert q[0, 0, 0] == -4.0
