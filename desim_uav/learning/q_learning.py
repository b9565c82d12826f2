"""Q-learning (Watkins, 1989): learns from the value of the best next action."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from desim_uav.model.kernels import kernel
from desim_uav.registry import register


@kernel
def update(
    q: NDArray[np.float32],
    state: int,
    action: int,
    gained: float,
    discount: float,
    next_state: int,
    allowed: NDArray[np.bool_],
    next_action: int,
    epsilon: float,
    alpha: float,
    coin: float,
) -> None:
    """Update a value by the largest value of the next state.

    Q(s, a) += α (gained + discount · max over allowed a' of Q(s', a') - Q(s, a)).
    """
    best = -np.inf
    for candidate in range(len(allowed)):
        if allowed[candidate]:
            best = max(best, q[0, next_state, candidate])
    q[0, state, action] += alpha * (gained + discount * best - q[0, state, action])


@register("algorithm", "q_learning")
class QLearning:
    """Q-learning, with one table per drone."""

    tables = 1
    update = staticmethod(update)
