"""ε-greedy choice among the allowed actions, with numbers drawn before the episode."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from desim_uav.model.kernels import kernel, part


@kernel
def epsilon_greedy(
    q: NDArray[np.float32],
    state: int,
    allowed: NDArray[np.bool_],
    epsilon: float,
    explore: float,
    which: float,
) -> int:
    """Return an allowed action: with probability ε a random one, else the best one.

    The best action has the largest sum over the tables ``q`` (tables, states, actions); of equally
    good ones, it is the first. ``explore`` and ``which`` are uniform in [0, 1).
    """
    if explore < epsilon:
        nth = int(which * allowed.sum())
        for action in range(len(allowed)):
            if allowed[action]:
                if nth == 0:
                    return action
                nth -= 1
    best, best_value = -1, -np.inf
    for action in range(len(allowed)):
        if allowed[action]:
            value = value_of(q, state, action)
            if best < 0 or value > best_value:
                best, best_value = action, value
    return best


@part
def value_of(q: NDArray[np.float32], state: int, action: int) -> float:
    """Return the value of an action: the sum over the tables ``q`` (tables, states, actions)."""
    value = 0.0
    for table in range(len(q)):
        value += q[table, state, action]
    return value
