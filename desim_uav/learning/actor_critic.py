"""An actor and a critic in NumPy, which PPO trains: their layers, slopes and random actions.

"Slopes" are the derivatives of the loss by the numbers of the layers (weights and biases).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from desim_uav.learning.sparse import slopes_of_sums, sums
from desim_uav.rowcode.kernels import kernel

Numbers = NDArray[np.float32]
Flags = NDArray[np.bool_]

LARGEST_NORM = 0.5
"""Slopes are scaled down to this norm if theirs is larger."""

LEAST = np.float32(1e-30)
"""The least wait in a race of actions, whose logarithm is a number."""

MEAN, SQUARE, EPSILON = 0.9, 0.999, 1e-5
"""The settings of Adam."""


class Network:
    """Fully connected layers, with max(0, x) between them.

    ``layers`` holds the numbers (inputs + 1, outputs) of each, the last row for biases, and
    ``slopes`` their slopes; both are parts of one array each. The first layer leaves out inputs
    of 0.
    """

    def __init__(self, sizes: Sequence[int], last_gain: float, rng: np.random.Generator) -> None:
        """Begin with orthogonal weights and biases of 0, and with ``last_gain`` in the end."""
        shapes = [(inputs + 1, outputs) for inputs, outputs in pairwise(sizes)]
        ends = np.cumsum([rows * columns for rows, columns in shapes])
        self.numbers, self.all_slopes = np.zeros((2, ends[-1]), np.float32)
        self.layers, self.slopes = (
            [part.reshape(shape) for part, shape in zip(np.split(one, ends), shapes, strict=False)]
            for one in (self.numbers, self.all_slopes)
        )
        for layer in self.layers:
            gain = last_gain if layer is self.layers[-1] else 2**0.5
            layer[:-1] = gain * _orthogonal(len(layer) - 1, layer.shape[1], rng)

    def forward(self, inputs: Numbers) -> list[Numbers]:
        """Return the inputs of each layer, and the outputs of the last one."""
        first, *others = self.layers
        values = [inputs, sums(inputs, first)]
        for layer in others:
            inputs = np.maximum(values[-1], 0.0, out=values[-1])
            values.append(inputs @ layer[:-1] + layer[-1])
        return values

    def back(self, values: Sequence[Numbers], slopes: Numbers) -> None:
        """Work out the slopes in all numbers, from what ``forward`` returned and its slopes."""
        for k in reversed(range(1, len(self.layers))):
            np.matmul(values[k].T, slopes, out=self.slopes[k][:-1])
            np.sum(slopes, 0, out=self.slopes[k][-1])
            slopes = (slopes @ self.layers[k][:-1].T) * (values[k] > 0)
        slopes_of_sums(values[0], slopes, self.slopes[0])


def _orthogonal(inputs: int, outputs: int, rng: np.random.Generator) -> NDArray[np.float64]:
    """Return a random matrix (inputs, outputs) whose columns or rows are orthonormal."""
    short, long = sorted((inputs, outputs))
    columns, signs = np.linalg.qr(rng.standard_normal((long, short)))
    columns *= np.sign(np.diag(signs))
    return columns if inputs == long else columns.T


class Adam:
    """The optimiser Adam, for some networks, with slopes of at most the largest norm together."""

    def __init__(self, networks: Sequence[Network]) -> None:
        self.networks, self.steps = networks, 0
        self.moments = [np.zeros((2, one.numbers.size), np.float32) for one in networks]

    def step(self, rate: float) -> None:
        """Move all numbers against their slopes."""
        norm = math.sqrt(sum(np.dot(one.all_slopes, one.all_slopes) for one in self.networks))
        self.steps += 1
        scale = min(1.0, LARGEST_NORM / (norm + 1e-6))
        corrected = rate / (1 - MEAN**self.steps), 1 / (1 - SQUARE**self.steps)
        of_step = np.array([scale, *corrected], np.float32)
        for network, moments in zip(self.networks, self.moments, strict=True):
            _moved(network.numbers, network.all_slopes, moments[0], moments[1], of_step)


@kernel
def _moved(numbers: Any, slopes: Any, means: Any, squares: Any, of_step: Any) -> None:
    """Move numbers by a step of Adam, of a scale of slopes, a rate and a scale of squares."""
    scale, rate, of_squares = of_step
    one, mean, square = np.float32(1.0), np.float32(MEAN), np.float32(SQUARE)
    for k in range(len(numbers)):
        slope = scale * slopes[k]
        means[k] += (one - mean) * (slope - means[k])
        squares[k] += (one - square) * (slope * slope - squares[k])
        numbers[k] -= rate * means[k] / (np.sqrt(of_squares * squares[k]) + np.float32(EPSILON))


class Cells:
    """How actions are drawn: with the probabilities softmax(outputs); masked ones never are."""

    def draw(
        self, outputs: Numbers, masks: Flags, rng: np.random.Generator
    ) -> tuple[NDArray[np.int64], Numbers]:
        """Return actions, and the logarithms of their probabilities."""
        logs = self.logs(outputs, masks)
        waits = rng.standard_exponential(logs.shape, np.float32)
        drawn = (logs - np.log(np.maximum(waits, LEAST))).argmax(-1)  # the first of a race
        return drawn, logs[np.arange(len(drawn)), drawn]

    def slopes(
        self, outputs: Numbers, masks: Flags, drawn: NDArray[Any]
    ) -> tuple[Numbers, Numbers, Numbers]:
        """Return the logarithms of probabilities, and the derivatives of these and of entropy."""
        logs = self.logs(outputs, masks)
        chances, rows = np.exp(logs), np.arange(len(drawn))
        surprise = np.where(masks, -logs, np.float32(0.0))
        entropy = (chances * surprise).sum(-1, keepdims=True)
        of_logs = -chances
        of_logs[rows, drawn] += 1.0
        return logs[rows, drawn], of_logs, chances * (surprise - entropy)

    def logs(self, outputs: Numbers, masks: Flags) -> Numbers:
        """Return the logarithms of all probabilities."""
        allowed = np.where(masks, outputs, np.float32(-np.inf))
        allowed -= allowed.max(-1, keepdims=True)
        logs: Numbers = allowed - np.log(np.exp(allowed).sum(-1, keepdims=True))
        return logs


class Freely:
    """How numbers of commands are drawn: around the outputs, with one standard deviation."""

    def __init__(self, deviation: float) -> None:
        self.deviation = deviation

    def draw(
        self, outputs: Numbers, masks: Flags, rng: np.random.Generator
    ) -> tuple[Numbers, Numbers]:
        """Return commands, and the logarithms of their densities."""
        off = rng.standard_normal(outputs.shape, np.float32)
        return outputs + np.float32(self.deviation) * off, self.logs(off)

    def slopes(
        self, outputs: Numbers, masks: Flags, drawn: NDArray[Any]
    ) -> tuple[Numbers, Numbers, Numbers]:
        """Return the logarithms of densities, their derivatives, and those of entropy: 0."""
        off = (drawn - outputs) / np.float32(self.deviation)
        return self.logs(off), off / np.float32(self.deviation), np.zeros_like(outputs)

    def logs(self, off: Numbers) -> Numbers:
        """Return the logarithms of the densities of numbers that are so many deviations off."""
        each = -(off**2) / 2 - np.float32(np.log(self.deviation * np.sqrt(2 * np.pi)))
        logs: Numbers = each.sum(-1)
        return logs


class Agent:
    """A network that chooses actions (actor), and one that estimates returns (critic).

    ``seen`` and ``state`` are the numbers of features of a drone, and of those that only the critic
    gets. ``shape`` is that of a command in free flight; else it is empty, and there are so many
    ``choices``. The actor has two layers of ``hidden`` units, and the critic of half as many.
    """

    def __init__(
        self, seen: int, state: int, shape: Sequence[int], choices: int, hidden: int, seed: int
    ) -> None:
        self.rng = np.random.default_rng(seed)
        self.actions: Cells | Freely = Freely(1.0) if shape else Cells()
        outputs, half = shape[0] if shape else choices, -(-hidden // 2)
        self.actor = Network([seen, hidden, hidden, outputs], 0.01, self.rng)
        self.critic = Network([seen + state, half, half, 1], 1.0, self.rng)
        self.adam = Adam([self.actor, self.critic])

    def decide(
        self, seen: Numbers, masks: Flags, states: Numbers
    ) -> tuple[NDArray[Any], Numbers, Numbers]:
        """Draw actions, and return them, the logarithms of their chances, and estimated returns.

        The arguments have the axes (rows, …), and so have the results.
        """
        outputs = self.actor.forward(seen)[-1]
        actions, logs = self.actions.draw(outputs, masks, self.rng)
        return actions, logs, self.worth(seen, states)[-1][:, 0]

    def worth(self, seen: Numbers, states: Numbers) -> list[Numbers]:
        """Return the inputs of each layer of the critic, and its estimates (rows, 1)."""
        both = np.concatenate([seen, states], -1) if states.size else seen
        return self.critic.forward(both)
