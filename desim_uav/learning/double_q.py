"""Double Q-learning (van Hasselt, 2010): one table chooses the next action, the other values it."""

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
    """Update the table A that a coin chooses, with the values of the other table B.

    A(s, a) += α (gained + discount · B(s', argmax A(s', ·)) - A(s, a)).
    """
    learns = 0 if coin < 0.5 else 1
    best = -1
    for candidate in range(len(allowed)):
        if allowed[candidate] and (
            best < 0 or q[learns, next_state, candidate] > q[learns, next_state, best]
        ):
            best = candidate
    following = q[1 - learns, next_state, best]
    q[learns, state, action] += alpha * (gained + discount * following - q[learns, state, action])


@register("algorithm", "double_q")
class DoubleQ:
    """Double Q-learning, which chooses actions by the sum of its two tables."""

    tables = 2
    update = staticmethod(update)
