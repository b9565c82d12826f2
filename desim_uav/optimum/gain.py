"""The largest average reward per step in the long run, by policy iteration, with bounds on it.

The method is Howard's policy iteration on the semi-Markov process between renewals (see ``graph``).
The gain of a policy is the average reward per step of the cycle of renewals that it ends up in. The
bias of a renewal is the reward beyond that average on the way to the cycle. A sweep over all states
by battery then finds the policy that is best with these values after the next renewal: a larger
gain first, then a larger bias. If no state improves, the policy is the best one, and a sweep proves
it: with h the biases of the renewals and λ a gain, no policy gains more than
λ + max (sweep(h) - h) / steps. The maximum is over the renewals, and between two of them there is
at least one step.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array, eye_array
from scipy.sparse.csgraph import connected_components
from scipy.sparse.linalg import spsolve

from desim_uav.errors import SimulationError
from desim_uav.optimum.graph import Graph

Array = NDArray[np.float64]

ROUNDS, AHEAD = 1000, 300
"""The most improvements of a policy (fewer than ten are usual), and sweeps for the first policy."""

TOLERANCE = 1e-10
"""Differences of gains and biases below this share of the largest reward count as none."""


@dataclass(frozen=True, eq=False)
class Best:
    """The best policy, ``choice`` (states,) of the graph's actions, and its gain from the start.

    No policy has a gain above ``high``. The gain of this one, with rounding, is not below ``low``.
    """

    choice: NDArray[np.int64]
    gain: float
    low: float
    high: float


def best_policy(graph: Graph, brings: Array) -> Best:
    """Return the policy with the largest long-run average of ``brings`` per step.

    ``brings`` (states, actions) is the graph's reward or another quantity. Raises SimulationError
    if the bounds do not meet, which only rounding could cause.
    """
    tolerance = TOLERANCE * max(1.0, float(np.abs(brings).max()))
    gains = worths = np.zeros(len(graph.renewals))
    choice = np.zeros(len(graph.states), np.int64)  # hover, which is always allowed
    for _ in range(min(AHEAD, len(graph.renewals))):  # find a first policy, by totals
        choice, worth = _sweep(graph, brings, gains, worths, choice, tolerance)
        worths = worth[graph.renewals] - worth[graph.renewals[0]]
    for _ in range(ROUNDS):
        gains, worths = _worth(graph, brings, choice)
        better, _ = _sweep(graph, brings, gains, worths, choice, tolerance)
        if (better == choice).all():
            break
        choice = better
    gain = float(gains[0])
    low, high = _bounds(graph, brings, choice, gains, worths, tolerance)
    if not high - low <= 1e-9 * max(1.0, abs(gain)):
        raise SimulationError(
            f"the best policy cannot be proven: its gain is between {low:.9g} and {high:.9g}"
        )
    return Best(choice, gain, low, high)


def long_run(graph: Graph, brings: Array, choice: NDArray[np.int64]) -> float:
    """Return the long-run average of ``brings`` per step of a policy, from the start."""
    return float(_worth(graph, brings, choice)[0][0])


def path(graph: Graph, choice: NDArray[np.int64], renewal: int) -> list[int]:
    """Return the states in which a policy decides from one renewal to the next or the lottery."""
    states = [int(graph.renewals[renewal])]
    while True:
        follows = int(graph.target[states[-1], choice[states[-1]]])
        if follows >= len(graph.states):
            return states
        states.append(follows)


def renewal_after(graph: Graph, choice: NDArray[np.int64], state: int) -> int | None:
    """Return the renewal that follows the last state of a path, or None for the lottery."""
    follows = int(graph.target[state, choice[state]]) - len(graph.states)
    return follows if follows < len(graph.renewals) else None


def _sweep(
    graph: Graph,
    brings: Array,
    gains: Array,
    worths: Array,
    before: NDArray[np.int64],
    tolerance: float,
) -> tuple[NDArray[np.int64], Array]:
    """Return the best choice in each state and its value, given those of the renewals.

    A choice of ``before`` is kept if it is worse by no more than the tolerance.
    """
    count = len(graph.states)
    gain, worth = (
        np.array([*np.zeros(count), *renewal_values, graph.lottery @ renewal_values, -np.inf])
        for renewal_values in (gains, worths)
    )
    choice = np.empty(count, np.int64)
    for first, end in graph.layers:
        target, rows = graph.target[first:end], np.arange(end - first)
        to_gain = gain[target]
        gain[first:end] = most = to_gain.max(axis=1)
        value = brings[first:end] - most[:, None] * graph.steps[first:end] + worth[target]
        value[to_gain < most[:, None] - tolerance] = -np.inf
        best, old = value.argmax(axis=1), before[first:end]
        best = np.where(value[rows, old] >= value[rows, best] - tolerance, old, best)
        choice[first:end] = best
        worth[first:end] = value[rows, best]
    return choice, worth


def _worth(graph: Graph, brings: Array, choice: NDArray[np.int64]) -> tuple[Array, Array]:
    """Return the gain and the bias of each renewal under a policy."""
    count = len(graph.renewals)
    chances = csr_array(graph.lottery[None, :])
    gained, steps = np.empty(count), np.empty(count)
    rows = []
    for renewal in range(count):
        states = path(graph, choice, renewal)
        gained[renewal] = math.fsum(brings[states, choice[states]].tolist())
        steps[renewal] = graph.steps[states, choice[states]].sum()
        follows = renewal_after(graph, choice, states[-1])
        rows.append((chances.indices, chances.data) if follows is None else ([follows], [1.0]))
    ends = np.cumsum([0, *(len(columns) for columns, _ in rows)])
    columns, chance = (np.concatenate(parts) for parts in zip(*rows, strict=True))
    return _chain(gained, steps, csr_array((chance, columns, ends), (count, count)))


def _chain(gained: Array, steps: Array, leads: csr_array) -> tuple[Array, Array]:
    """Return gain and bias of each state of a semi-Markov chain with transitions ``leads``.

    All states of a recurrent class have the same gain: the mean reward over the mean number of
    steps in its stationary distribution. The bias of its first state is 0. The biases solve
    bias = gained - gain · steps + leads bias.
    """
    gains, bias = np.zeros(len(gained)), np.zeros(len(gained))
    _, class_of = connected_components(leads, connection="strong")
    sources, to = leads.nonzero()
    left_again = np.unique(class_of[sources[class_of[sources] != class_of[to]]])
    settled = ~np.isin(class_of, left_again)
    for members in _by_class(class_of, settled):
        equations = np.eye(len(members)) - leads[members][:, members].toarray()
        equations[:, 0] = steps[members]  # the unknown gain replaces the first bias
        solved = np.linalg.solve(equations, gained[members])
        gains[members] = solved[0]
        bias[members] = [0.0, *solved[1:]]
    left = np.flatnonzero(~settled)
    if len(left):
        stays = eye_array(len(left), format="csc") - leads[left][:, left].tocsc()
        ends = leads[left][:, np.flatnonzero(settled)]
        gains[left] = spsolve(stays, ends @ gains[settled])
        bias[left] = spsolve(stays, gained[left] - gains[left] * steps[left] + ends @ bias[settled])
    return gains, bias


def _by_class(class_of: NDArray[np.int32], mask: NDArray[np.bool_]) -> list[NDArray[np.int64]]:
    """Return the chosen states of each class."""
    states = np.flatnonzero(mask)
    states = states[np.argsort(class_of[states], kind="stable")]
    return np.split(states, np.flatnonzero(np.diff(class_of[states])) + 1)


def _bounds(
    graph: Graph,
    brings: Array,
    choice: NDArray[np.int64],
    gains: Array,
    bias: Array,
    tolerance: float,
) -> tuple[float, float]:
    """Return bounds on the largest gain from the start, including rounding (see the module).

    If a policy's own sweep falls short of its biases by some amount, its gain may fall short by the
    same amount. A renewal with a lower gain than the start's cannot improve the result, so its bias
    may be set so low that no policy gains by going there: the lower, the smaller its gain.
    """
    gain = np.full(len(gains), gains[0])
    _, worth = _sweep(graph, brings, gain, bias, choice, np.inf)
    largest = float(np.abs(worth[: len(graph.states)]).max())
    same = gains >= gains[0] - tolerance
    renewal_gains = np.sort(np.array([*gains, float(graph.lottery @ gains)]))
    drops = np.diff(renewal_gains)[np.diff(renewal_gains) > tolerance]
    slope = (4.0 * largest + 1.0) / drops.min() if len(drops) else 0.0
    worths = np.where(same, bias, bias - slope * (gains[0] - gains))
    _, best = _sweep(graph, brings, gain, worths, choice, 0.0)
    excess = max(0.0, float((best[graph.renewals] - worths).max()))
    lack = min(0.0, float((worth[graph.renewals] - bias)[same].min()))
    sums = len(graph.layers) + np.count_nonzero(graph.lottery) + 2
    largest = max(largest, float(np.abs(worths).max()))
    rounding = sums * float(np.finfo(float).eps) * (8.0 * largest + 1.0 + abs(gains[0]))
    return float(gains[0] + lack - rounding), float(gains[0] + excess + rounding)
