"""The networks that PPO trains: their slopes are those of the loss, and draws fit the masks."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scipy import stats

from desim_uav.learning.actor_critic import Adam, Agent, Cells, Freely, Network

RNG = np.random.default_rng(0)


def test_slopes_of_a_network_are_those_of_finite_differences():
    """Of the sum of weighted outputs, in float64, in which the differences are exact enough."""
    network = Network([3, 5, 4, 2], 1.0, np.random.default_rng(1))
    network.layers = [layer.astype(np.float64) for layer in network.layers]
    inputs, weights = RNG.normal(size=(6, 3)), RNG.normal(size=(6, 2))

    def loss() -> float:
        return float((network.forward(inputs.copy())[-1] * weights).sum())

    network.back(network.forward(inputs.copy()), weights)
    for layer, slopes in zip(network.layers, network.slopes, strict=True):
        for place in np.ndindex(layer.shape):
            before = layer[place]
            layer[place] = before + 1e-6
            more = loss()
            layer[place] = before - 1e-6
            assert slopes[place] == pytest.approx((more - loss()) / 2e-6, abs=1e-4)
            layer[place] = before


def test_cells_are_drawn_with_their_probabilities_and_masked_ones_never():
    logits, mask = np.array([0.0, 1.0, -2.0, 5.0], np.float32), np.array([1, 1, 1, 0], np.bool_)
    outputs, masks = np.tile(logits, (40_000, 1)), np.tile(mask, (40_000, 1))
    drawn, logs = Cells().draw(outputs, masks, np.random.default_rng(2))
    chances = np.exp(logits.astype(np.float64)) * mask
    chances /= chances.sum()
    counts = np.bincount(drawn, minlength=4)
    assert counts[3] == 0 and np.allclose(np.exp(logs), chances[drawn])
    assert stats.chisquare(counts[:3], 40_000 * chances[:3]).pvalue > 1e-3


class Never:
    """Random numbers of which all are as small as they can be."""

    def standard_exponential(self, shape: Any, dtype: Any) -> Any:
        return np.zeros(shape, dtype)


def test_a_masked_cell_is_not_drawn_with_waits_of_zero():
    masks = np.array([[False, True]])
    drawn, _ = Cells().draw(np.zeros((1, 2), np.float32), masks, Never())  # type: ignore[arg-type]
    assert drawn == [1]


@pytest.mark.parametrize("actions", [Cells(), Freely(0.6)])
def test_slopes_of_chances_and_of_entropy_are_those_of_finite_differences(actions: Any):
    outputs = RNG.normal(size=(4, 3)).astype(np.float32)
    masks = np.array([[1, 1, 1], [1, 0, 1], [1, 1, 0], [0, 1, 1]], np.bool_)
    drawn, _ = actions.draw(outputs, masks, np.random.default_rng(3))
    _, of_logs, of_entropy = actions.slopes(outputs, masks, drawn)
    for place in np.ndindex(outputs.shape):
        ends = []
        for off in (-1e-3, 1e-3):
            moved = outputs.astype(np.float64)
            moved[place] += off
            logs = actions.slopes(moved, masks, drawn)[0].sum()
            entropy = 0.0
            if isinstance(actions, Cells):
                chances = np.exp(actions.logs(moved, masks))
                entropy = -(chances * np.log(np.where(chances > 0, chances, 1.0))).sum()
            ends.append((logs, entropy))
        (less, less_entropy), (more, more_entropy) = ends
        assert of_logs[place] == pytest.approx((more - less) / 2e-3, abs=1e-4)
        assert of_entropy[place] == pytest.approx((more_entropy - less_entropy) / 2e-3, abs=1e-4)


def test_densities_of_free_flight_are_those_of_a_normal_distribution():
    outputs = np.zeros((5, 2), np.float32)
    drawn, logs = Freely(0.6).draw(outputs, np.ones((5, 2), np.bool_), np.random.default_rng(4))
    assert np.allclose(logs, stats.norm.logpdf(drawn, scale=0.6).sum(-1), atol=1e-5)


def test_adam_moves_by_the_rate_and_scales_large_slopes_down():
    """The first step of Adam moves each number by the rate against the sign of its slope."""
    network = Network([1, 1], 1.0, np.random.default_rng(5))
    network.numbers[:], network.all_slopes[:] = [1.0, 2.0], [30.0, -40.0]
    adam = Adam([network])
    adam.step(0.1)
    assert np.allclose(network.numbers, [0.9, 2.1], atol=1e-4)
    assert np.allclose(adam.moments[0][0], [0.03, -0.04]), "a tenth of slopes of the norm 0.5"


def test_steps_of_adam_are_those_of_its_authors():
    """Kingma and Ba, 2015, algorithm 1, with the epsilon beside the corrected root."""
    network, rng = Network([2, 1], 1.0, np.random.default_rng(6)), np.random.default_rng(7)
    adam, numbers = Adam([network]), network.numbers.astype(np.float64)
    mean, square = np.zeros((2, 3))
    for step in range(1, 6):
        network.all_slopes[:] = slopes = 0.1 * rng.normal(size=3).astype(np.float32)
        adam.step(0.01)
        mean, square = 0.9 * mean + 0.1 * slopes, 0.999 * square + 0.001 * slopes.astype(float) ** 2
        root = np.sqrt(square / (1 - 0.999**step)) + 1e-5
        numbers -= 0.01 * mean / (1 - 0.9**step) / root
        assert np.allclose(network.numbers, numbers, atol=1e-5)


def test_only_the_critic_depends_on_the_state():
    agent = Agent(3, 2, (), 4, 32, 0)
    seen, states = RNG.normal(size=(1, 3)).astype(np.float32), np.ones((1, 2), np.float32)
    one, other = (agent.worth(seen, of)[-1] for of in (states, 2 * states))
    assert one != other and agent.actor.layers[0].shape == (4, 32)
