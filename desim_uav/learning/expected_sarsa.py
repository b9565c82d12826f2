"""Expected SARSA (van Seijen et al., 2009): learns from the mean value of the ε-greedy choice."""

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
    """Update a value by the expected value of the next ε-greedy choice.

    Q(s, a) += α (gained + discount · ((1 - ε) max Q(s', ·) + ε mean Q(s', ·)) - Q(s, a)).
    """
    best, total, count = -np.inf, 0.0, 0
    for candidate in range(len(allowed)):
        if allowed[candidate]:
            value = q[0, next_state, candidate]
            best = max(best, value)
            total += value
            count += 1
    expected = (1.0 - epsilon) * best + epsilon * total / count
    q[0, state, action] += alpha * (gained + discount * expected - q[0, state, action])


@register("algorithm", "expected_sarsa")
class ExpectedSarsa:
    """Expected SARSA, with one table per drone."""

    tables = 1
    update = staticmethod(update)
