"""One drone that learns by itself: its table, and the decision it is waiting to learn from."""

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
    """How values are learned: in ``tables`` tables, by a kernel.

    ``update(q, state, action, gained, discount, next_state, allowed, next_action, epsilon, alpha,
    coin)`` changes ``q`` (tables, states, actions) in place: ``action`` in ``state`` has gained so
    much by the next decision, whose value counts times ``discount``; there ``next_action`` of the
    ``allowed`` ones is taken. ``coin`` is uniform in [0, 1).
    """

    tables: int
    update: Any


def load_algorithm(name: str) -> Algorithm:
    """A built-in, or a class ``"package.module:Class"``. Raises ScenarioError."""
    try:
        algorithm: Any = resolve("algorithm", name)
    except ValueError as error:
        raise ScenarioError(f"learning.algorithm: {error}") from error
    tables, update = getattr(algorithm, "tables", 0), getattr(algorithm, "update", None)
    if type(tables) is not int or not 1 <= tables <= MOST_TABLES or not callable(update):
        raise ScenarioError(
            f"learning.algorithm: {name!r} is no algorithm: it needs 'tables', their number (at "
            f"most {MOST_TABLES}), and 'update', a function"
        )
    try:
        inspect.signature(update).bind(*UPDATE)
    except TypeError as error:
        raise ScenarioError(
            f"learning.algorithm: {name!r}: its 'update' must take {', '.join(UPDATE)} ({error})"
        ) from error
    return cast(Algorithm, algorithm)


Decision = tuple[int, int, float, float]
"""What is still to be learned from: state, action, what it has gained, the discount since."""


class Learner:
    """A drone's tables ``q`` (tables, states, actions), updated from decision to decision.

    ``sum`` is that of all values, kept up to date by an update's own entry.

    What a drone is forced to do (return, queue, charge, lie crashed) belongs to the decision
    before: its rewards are gained by it, discounted, and the value of the next decision, k steps
    later, counts γ^k. So the value of going home is that of the full battery it leads to.
    """

    def __init__(self, algorithm: Algorithm, gamma: float, q: NDArray[np.float32]) -> None:
        self.update = algorithm.update
        self.gamma = gamma
        self.q = q
        self.sum = float(q.sum(dtype=np.float64))
        self.forget()

    def forget(self) -> None:
        """There is no decision to learn from."""
        self.pending: tuple[int, int] | None = None
        self.gained = 0.0
        self.discount = 1.0

    def open_decision(self) -> Decision | None:
        """The decision that is still to be learned from."""
        if self.pending is None:
            return None
        return (*self.pending, self.gained, self.discount)

    def reopen(self, decision: Decision | None) -> None:
        """Wait to learn from this decision."""
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
        """Decide, and learn what the decision before was worth; ``draws``: three in [0, 1)."""
        allowed = as_array(mask)
        explore, which, coin = draws
        action = epsilon_greedy(self.q, state, allowed, epsilon, explore, which)
        self._learn(state, allowed, action, epsilon, alpha, coin)
        self.pending = state, action
        self.gained = 0.0
        self.discount = 1.0
        return action

    def gain(self, reward: float) -> None:
        """A step has ended."""
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
        """The episode is cut off here, with drones that start afresh: learn what is still open."""
        self.act(state, mask, epsilon, alpha, draws)
        self.forget()

    def conclude(self, mask: Sequence[bool], alpha: float, coin: float) -> None:
        """Nothing comes after this."""
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
    """A mask as a kernel takes it."""
    return np.array(mask)
