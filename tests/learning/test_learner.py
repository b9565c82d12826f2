"""What a drone learns from: decisions, with all that is forced in between."""

import sys
from typing import Any

import numpy as np
import pytest

from desim_uav.errors import ScenarioError
from desim_uav.learning.algorithm import load_algorithm
from desim_uav.learning.learner import act, close, conclude, forget, gain
from desim_uav.learning.q_learning import QLearning
from desim_uav.learning.rows import EpisodeRow, Learner, QValues
from desim_uav.rowcode.rows import blank, fill

GAMMA = 0.9
BOTH, ONE = (True, True), (True, False)


def learner(algorithm: Any = QLearning) -> Any:
    """One table of three states and two actions, whose values are 0."""
    pupil = blank(Learner)
    pupil.q = fill(QValues, (np.zeros((1, 3, 2), np.float32).data, 1, 3, 2, 0.0))
    pupil.gamma, pupil.share, pupil.update = GAMMA, 1.0, algorithm.update
    pupil.lesson.allowed, pupil.lesson.alpha, pupil.explore = BOTH, 1.0, 0.9
    forget(pupil)
    return pupil


def decide(pupil: Any, state: int, mask: tuple[bool, ...] = BOTH) -> int:
    """The greedy choice in a state."""
    pupil.lesson.next_state, pupil.lesson.allowed = state, mask
    act(pupil)
    return int(pupil.command)


def get(pupil: Any, *rewards: float) -> None:
    for reward in rewards:
        pupil.reward = reward
        gain(pupil)


def test_a_step_is_learned_from_at_the_next_decision():
    pupil = learner()
    pupil.q[0, 1, 0], pupil.q[0, 1, 1] = 5, 7
    assert decide(pupil, 0) == 0
    assert pupil.q[0, 0, 0] == 0.0
    get(pupil, 3.0)
    decide(pupil, 1)
    assert pupil.q[0, 0, 0] == np.float32(3 + GAMMA * 7)


def test_what_is_forced_belongs_to_the_decision_before():
    """Home, a queue, a charge: k steps later the next decision counts γ^k."""
    pupil = learner()
    pupil.q[0, 2, 0], pupil.q[0, 2, 1] = 10, 4
    decide(pupil, 0)
    get(pupil, -1.0, -0.5, 0.0, 0.0)
    decide(pupil, 2)
    expected = -1 + GAMMA * -0.5 + GAMMA**4 * 10
    assert pupil.q[0, 0, 0] == pytest.approx(expected, rel=1e-6)
    assert pupil.rewards == -1.5


def test_a_forbidden_action_is_worth_nothing_to_the_decision_before():
    pupil = learner()
    pupil.q[0, 1, 0], pupil.q[0, 1, 1] = 5, 7
    decide(pupil, 0)
    get(pupil, 0.0)
    decide(pupil, 1, mask=ONE)
    assert pupil.q[0, 0, 0] == np.float32(GAMMA * 5)


def test_the_end_has_no_value_after_it():
    pupil = learner()
    pupil.q[0, 0, 1] = 100
    assert decide(pupil, 0) == 1
    get(pupil, 2.0)
    pupil.lesson.alpha = 0.5
    conclude(pupil)
    assert pupil.q[0, 0, 1] == 51.0
    assert pupil.lesson.state == -1


def test_a_cut_is_no_end():
    """The drone can decide in the last state, with whose value it learns."""
    pupil = learner()
    pupil.q[0, 1, 1] = 10
    decide(pupil, 0)
    get(pupil, 1.0)
    pupil.lesson.next_state, pupil.decides = 1, 1
    close(blank(EpisodeRow), pupil)
    assert pupil.q[0, 0, 0] == np.float32(1 + GAMMA * 10)
    assert pupil.lesson.state == -1


def test_nothing_is_learned_on_the_way():
    pupil = learner()
    decide(pupil, 0)
    get(pupil, 1.0)
    close(blank(EpisodeRow), pupil)
    assert (pupil.q.sum, pupil.lesson.state) == (0.0, -1)


class Halving:
    """An algorithm of one's own: half of what was gained."""

    tables = 1

    @staticmethod
    def update(q, lesson) -> None:
        q[0, lesson.state, lesson.action] = lesson.gained / 2


class Nothing:
    """No algorithm."""


class Flat(Halving):
    """An algorithm whose update has too many parameters."""

    @staticmethod
    def update(q, state, action, gained) -> None:
        q[0, state, action] = gained


def test_an_algorithm_of_ones_own(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setitem(sys.modules, "mine", sys.modules[__name__])
    pupil = learner(load_algorithm("mine:Halving"))
    decide(pupil, 0)
    get(pupil, 3.0)
    decide(pupil, 1)
    assert pupil.q[0, 0, 0] == 1.5
    with pytest.raises(
        ScenarioError, match=r"learning\.algorithm: 'mine:Nothing' is not an algorithm"
    ):
        load_algorithm("mine:Nothing")
    with pytest.raises(ScenarioError, match=r"'mine:Flat': its 'update' must take q, lesson"):
        load_algorithm("mine:Flat")
    with pytest.raises(ScenarioError, match=r"learning\.algorithm: cannot import 'mine:Other'"):
        load_algorithm("mine:Other")
