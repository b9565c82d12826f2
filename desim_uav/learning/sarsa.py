"""SARSA (Rummery and Niranjan, 1994): learns from the value of the action taken next."""

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
    """Update a value by the value of the next action a' that is taken.

    Q(s, a) += α (gained + discount · Q(s', a') - Q(s, a)).
    """
    following = q[0, next_state, next_action]
    q[0, state, action] += alpha * (gained + discount * following - q[0, state, action])


@register("algorithm", "sarsa")
class Sarsa:
    """SARSA, with one table per drone."""

    tables = 1
    update = staticmethod(update)
