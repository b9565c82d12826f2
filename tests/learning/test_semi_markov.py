"""What is learned in a semi-Markov decision process of two states, by hand, for each algorithm."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from desim_uav.learning.training import Training
from desim_uav.scenario.load import from_mapping
from desim_uav.world import build_world
from tests.semi_markov import BEST, EAST, HOVER, OTHERS, TWO, WEST

CELLS = {"west": 0, "east": 1}
GREEDY = {("east", 0): 24 / 7}
"""What a greedy learner does whose values begin at 3: in the east, the first of the hovers."""

AT_RANDOM = {
    ("west", EAST): 1 + 2.725 / 2,
    ("west", HOVER): 0.525 / 8,
    ("east", WEST): 0.525 / 2,
    ("east", HOVER): 3 + 2.725 / 8,
}
"""If each of five actions is as likely, of which one is a move: the west is worth 0.525, which is
(1 + 2.725/2 + 4 · 0.525/8) / 5, and the east 2.725, which is (0.525/2 + 4 (3 + 2.725/8)) / 5."""

VALUES: dict[str, tuple[float, Any, dict[tuple[str, int], float]]] = {
    "q_learning": (1.0, "zero", BEST | OTHERS),
    "double_q": (1.0, "zero", BEST | OTHERS),
    "expected_sarsa": (1.0, "zero", AT_RANDOM),
    "sarsa": (0.0, 3.0, GREEDY),
}
"""The probability of random actions, the values at the beginning, and those that are learned."""


@pytest.mark.parametrize("engine", ["des", "batch"])
@pytest.mark.parametrize("algorithm", VALUES)
def test_values_are_those_of_a_semi_markov_process(algorithm: str, engine: str):
    """A decision that the end of the episode interrupts is not learned from, as drones go on."""
    epsilon, initial, expected = VALUES[algorithm]
    learning = {"algorithm": algorithm, "alpha": 1.0, "epsilon": epsilon, "initial_q": initial}
    scenario = from_mapping(
        TWO
        | {"episode": {"steps": 1000, "carry_over": True}}
        | {"learning": {**TWO["learning"], **learning, "restart_every": None}}
    )
    training = Training(build_world(scenario, 0), 0, engine)
    training.play()
    tables = training.q.reshape(-1, 2, 5)
    for (cell, action), value in expected.items():
        assert np.allclose(tables[:, CELLS[cell], action], value, rtol=1e-5), (cell, action)
