"""What a drone learns from: decisions, with all that is forced in between."""

import sys

import numpy as np
import pytest

from desim_uav.errors import ScenarioError
from desim_uav.learning.learner import Learner, load_algorithm
from desim_uav.learning.q_learning import QLearning

GAMMA = 0.9
BOTH, ONE = (True, True), (True, False)


def learner() -> Learner:
    return Learner(QLearning, GAMMA, np.zeros((1, 3, 2), np.float32))


def greedy(pupil: Learner, state: int, mask=BOTH, alpha: float = 1.0) -> int:
    return pupil.act(state, mask, 0.0, alpha, (0.9, 0.0, 0.0))


def test_a_step_is_learned_from_at_the_next_decision():
    pupil = learner()
    pupil.q[0, 1] = 5, 7
    assert greedy(pupil, 0) == 0
    assert pupil.q[0, 0, 0] == 0.0
    pupil.gain(3.0)
    greedy(pupil, 1)
    assert pupil.q[0, 0, 0] == np.float32(3 + GAMMA * 7)


def test_what_is_forced_belongs_to_the_decision_before():
    """Home, a queue, a charge: k steps later the next decision counts γ^k."""
    pupil = learner()
    pupil.q[0, 2] = 10, 4
    greedy(pupil, 0)
    for reward in (-1.0, -0.5, 0.0, 0.0):
        pupil.gain(reward)
    greedy(pupil, 2)
    expected = -1 + GAMMA * -0.5 + GAMMA**4 * 10
    assert pupil.q[0, 0, 0] == pytest.approx(expected, rel=1e-6)


def test_a_forbidden_action_is_worth_nothing_to_the_decision_before():
    pupil = learner()
    pupil.q[0, 1] = 5, 7
    greedy(pupil, 0)
    pupil.gain(0.0)
    greedy(pupil, 1, mask=ONE)
    assert pupil.q[0, 0, 0] == np.float32(GAMMA * 5)


def test_the_end_has_no_value_after_it():
    pupil = learner()
    pupil.q[0, 0, 1] = 100
    assert greedy(pupil, 0) == 1
    pupil.gain(2.0)
    pupil.conclude(BOTH, 0.5, 0.0)
    assert pupil.q[0, 0, 1] == 51.0
    assert pupil.open_decision() is None


def test_a_cut_is_no_end():
    pupil = learner()
    pupil.q[0, 1] = 0, 10
    greedy(pupil, 0)
    pupil.gain(1.0)
    pupil.bootstrap(1, BOTH, 0.0, 1.0, (0.9, 0.0, 0.0))
    assert pupil.q[0, 0, 0] == np.float32(1 + GAMMA * 10)
    assert pupil.open_decision() is None


def test_an_open_decision_can_be_handed_on():
    one, other = learner(), learner()
    greedy(one, 0)
    one.gain(1.0)
    one.gain(0.5)
    other.reopen(one.open_decision())
    for pupil in (one, other):
        pupil.gain(0.25)
        greedy(pupil, 2)
    assert (one.q == other.q).all() and one.q[0, 0, 0] > 1


class Halving:
    """An algorithm of one's own: half of what was gained."""

    tables = 1

    @staticmethod
    def update(q, state, action, gained, *rest) -> None:
        q[0, state, action] = gained / 2


class Nothing:
    """No algorithm."""


def test_an_algorithm_of_ones_own(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setitem(sys.modules, "mine", sys.modules[__name__])
    pupil = Learner(load_algorithm("mine:Halving"), GAMMA, np.zeros((1, 3, 2), np.float32))
    greedy(pupil, 0)
    pupil.gain(3.0)
    greedy(pupil, 1)
    assert pupil.q[0, 0, 0] == 1.5
    with pytest.raises(
        ScenarioError, match=r"learning\.algorithm: 'mine:Nothing' is not an algorithm"
    ):
        load_algorithm("mine:Nothing")
    with pytest.raises(ScenarioError, match=r"learning\.algorithm: cannot import 'mine:Other'"):
        load_algorithm("mine:Other")
