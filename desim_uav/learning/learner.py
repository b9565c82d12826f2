"""One independent learner: a drone's Q-tables, and the decision it has still to learn from."""

from __future__ import annotations

import inspect
from collections.abc import Sequence
from functools import cache
from typing import Any, Protocol, cast

import numpy as np
from numpy.typing import NDArray

from desim_uav.errors import ScenarioError
from desim_uav.learning.exploration import epsilon_greedy, value_of
from desim_uav.registry import resolve

UPDATE = (
    *("q", "state", "action", "gained", "discount", "next_state", "allowed", "next_action"),
    *("epsilon", "alpha", "coin"),
)
MOST_TABLES = 16


class Algorithm(Protocol):
    """A learning algorithm: the number of its ``tables``, and the kernel that updates them.

    ``update(q, state, action, gained, discount, next_state, allowed, next_action, epsilon, alpha,
    coin)`` changes ``q`` (tables, states, actions) in place. ``gained`` is the discounted reward
    of ``action`` in ``state`` until the next decision, whose value is multiplied by ``discount``.
    In ``next_state`` the actions ``allowed`` can be taken, and ``next_action`` is. ``coin`` is
    uniform in [0, 1).
    """

    tables: int
    update: Any


def load_algorithm(name: str) -> Algorithm:
    """Return a built-in algorithm, or one of a class ``"package.module:Class"``.

    Raises ScenarioError if there is no such algorithm, or if its ``update`` is unsuitable.
    """
    try:
        algorithm: Any = resolve("algorithm", name)
    except ValueError as error:
        raise ScenarioError(f"learning.algorithm: {error}") from error
    tables, update = getattr(algorithm, "tables", 0), getattr(algorithm, "update", None)
    if type(tables) is not int or not 1 <= tables <= MOST_TABLES or not callable(update):
        raise ScenarioError(
            f"learning.algorithm: {name!r} is not an algorithm: it needs 'tables', their number "
            f"(at most {MOST_TABLES}), and 'update', a function"
        )
    try:
        inspect.signature(update).bind(*UPDATE)
    except TypeError as error:
        raise ScenarioError(
            f"learning.algorithm: {name!r}: its 'update' must take {', '.join(UPDATE)} ({error})"
        ) from error
    return cast(Algorithm, algorithm)


Decision = tuple[int, int, float, float]
"""A decision to learn from: state, action, discounted reward so far, and discount so far."""


class Learner:
    """A drone's tables ``q`` (tables, states, actions), updated from decision to decision.

    ``sum`` is the sum of all values, which each update keeps up to date.

    Steps in which a drone has no choice (it returns, queues, charges or has crashed) belong to the
    decision before them: that decision gains their discounted rewards, and the value of the next
    decision, k steps later, is multiplied by γ^k. The value of a return is thus that of the full
    battery to which it leads.
    """

    def __init__(self, algorithm: Algorithm, gamma: float, q: NDArray[np.float32]) -> None:
        self.update = algorithm.update
        self.gamma = gamma
        self.q = q
        self.sum = float(q.sum(dtype=np.float64))
        self.forget()

    def forget(self) -> None:
        """Forget the decision that is still to be learned from."""
        self.pending: tuple[int, int] | None = None
        self.gained = 0.0
        self.discount = 1.0

    def open_decision(self) -> Decision | None:
        """The decision that is still to be learned from, or None."""
        if self.pending is None:
            return None
        return (*self.pending, self.gained, self.discount)

    def reopen(self, decision: Decision | None) -> None:
        """Take this decision as the one that is still to be learned from."""
        self.forget()
        if decision is not None:
            state, action, self.gained, self.discount = decision
            self.pending = state, action

    def act(
        self,
        state: int,
        mask: Sequence[bool],
        epsilon: float,
        alpha: float,
        draws: Sequence[float],
    ) -> int:
        """Choose an action, and learn from the previous decision; ``draws``: three in [0, 1)."""
        allowed = as_array(mask)
        explore, which, coin = draws
        action = epsilon_greedy(self.q, state, allowed, epsilon, explore, which)
        self._learn(state, allowed, action, epsilon, alpha, coin)
        self.pending = state, action
        self.gained = 0.0
        self.discount = 1.0
        return action

    def gain(self, reward: float) -> None:
        """Add the reward of a step that has ended to the decision's gain."""
        self.gained += self.discount * reward
        self.discount *= self.gamma

    def bootstrap(
        self,
        state: int,
        mask: Sequence[bool],
        epsilon: float,
        alpha: float,
        draws: Sequence[float],
    ) -> None:
        """Learn from the open decision at a truncation, with the value of the last state."""
        self.act(state, mask, epsilon, alpha, draws)
        self.forget()

    def conclude(self, mask: Sequence[bool], alpha: float, coin: float) -> None:
        """Learn from the open decision at a terminal state, which has no value."""
        self.discount = 0.0
        self._learn(0, as_array(mask), int(np.argmax(mask)), 0.0, alpha, coin)
        self.forget()

    def _learn(
        self,
        state: int,
        allowed: NDArray[np.bool_],
        action: int,
        epsilon: float,
        alpha: float,
        coin: float,
    ) -> None:
        if self.pending is not None:
            before = value_of(self.q, *self.pending)
            self.update(
                self.q,
                *self.pending,
                self.gained,
                self.discount,
                state,
                allowed,
                action,
                epsilon,
                alpha,
                coin,
            )
            self.sum += value_of(self.q, *self.pending) - before


@cache
def as_array(mask: tuple[bool, ...]) -> NDArray[np.bool_]:
    """Return a mask as an array, for a kernel."""
    return np.array(mask)
