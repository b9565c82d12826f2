"""The largest gain of one drone with a battery in an episode, by backward induction."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from desim_uav.model.sums import in_order
from desim_uav.optimum.graph import Forced, Graph

Array = NDArray[np.float64]
Choices = NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class BestEpisode:
    """The best policy, ``choices`` (steps left, states) of the graph's actions, and its total.

    No policy has an expected total above ``high``; that of this one is not below ``low``.
    """

    choices: Choices
    total: float
    low: float
    high: float


def best_episode(graph: Graph, brings: Array, forced: list[Forced], steps: int) -> BestEpisode:
    """Return the best policy over an episode of ``steps`` steps.

    ``brings`` counts in an action's first step, except for ``forced`` actions, which the end of the
    episode may cut short.
    """
    ahead, choices = _induced(graph, brings, forced, steps, None)
    total = float(ahead[steps, len(graph.states)])
    rounding = 4.0 * steps * np.finfo(float).eps * float(np.abs(ahead[:, :-1]).max())
    return BestEpisode(choices, total, total - rounding, total + rounding)


def episode_total(graph: Graph, brings: Array, forced: list[Forced], choices: Choices) -> float:
    """Return the expected total of a policy's ``choices`` in an episode."""
    steps = len(choices) - 1
    ahead, _ = _induced(graph, brings, forced, steps, choices)
    return float(ahead[steps, len(graph.states)])


def _induced(
    graph: Graph, brings: Array, forced: list[Forced], steps: int, choices: Choices | None
) -> tuple[Array, Choices]:
    """Return the expected rest (steps left, targets) and the choices; None means the best ones."""
    count, renewals = len(graph.states), len(graph.renewals)
    ahead = np.zeros((steps + 1, count + renewals + 2))
    ahead[:, -1] = -np.inf
    best = np.zeros((steps + 1, count), np.int64) if choices is None else choices
    rows, length = np.arange(count), graph.steps.astype(np.int64)
    for left in range(1, steps + 1):
        value = brings + ahead[np.maximum(left - length, 0), graph.target]
        for state, action, by_step in forced:
            if len(by_step) > left:
                value[state, action] = in_order(by_step[:left])
        if choices is None:
            best[left] = value.argmax(axis=1)
        ahead[left, :count] = value[rows, best[left]]
        ahead[left, count : count + renewals] = ahead[left, graph.renewals]
        ahead[left, count + renewals] = graph.lottery @ ahead[left, graph.renewals]
    return ahead, best
