"""SARSA (Rummery and Niranjan, 1994): learn the value of the action that is taken next."""

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
    """Q(s, a) += α (gained + discount · Q(s', a') - Q(s, a)), with a' the next action taken."""
    following = q[0, next_state, next_action]
    q[0, state, action] += alpha * (gained + discount * following - q[0, state, action])


@register("algorithm", "sarsa")
class Sarsa:
    """SARSA."""

    tables = 1
    update = staticmethod(update)
