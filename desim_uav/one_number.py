"""One whole number as an action: for all drones at once, or for one drone after the other."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from gymnasium.spaces import Box, Discrete, Space, flatten, flatten_space
from numpy.typing import ArrayLike, NDArray


@dataclass(frozen=True)
class JointNumber:
    """Numbers for the actions of all drones.

    A number has a digit for each drone, that of drone 0 first, in the base of the number of
    ``actions`` of a drone.
    """

    drones: int
    actions: int

    @property
    def count(self) -> int:
        """The number of joint actions, each of which has a number."""
        return int(self.actions**self.drones)

    def space(self) -> Discrete:
        """Return the space of the numbers."""
        return Discrete(self.count)

    def split(self, number: int) -> list[int]:
        """Return the action of each drone."""
        shape = (self.actions,) * self.drones
        return [int(digit) for digit in np.unravel_index(number, shape)]

    def mask(self, masks: ArrayLike) -> NDArray[np.bool_]:
        """Return which numbers are allowed: those of which each drone's action is."""
        joint = np.ones(1, bool)
        for own in np.asarray(masks, bool).reshape(self.drones, -1):
            joint = np.logical_and.outer(joint, own).ravel()
        return joint


@dataclass(frozen=True)
class InOrder:
    """What a drone observes whose turn it is to choose one of ``actions``.

    These are the numbers of what is observed of all drones (whole numbers as one-hot vectors), then
    a 1 in the place of the drone whose turn it is, and then the actions that the drones before it
    have chosen, as one-hot vectors that are 0 for the others.
    """

    wrapped: Space[Any]
    drones: int
    actions: int

    @cached_property
    def space(self) -> Box:
        """The space of the observations, float32."""
        wrapped, more = flatten_space(self.wrapped), self.drones * (1 + self.actions)
        assert isinstance(wrapped, Box)
        return Box(
            np.concatenate([wrapped.low, np.zeros(more)]).astype(np.float32),
            np.concatenate([wrapped.high, np.ones(more)]).astype(np.float32),
        )

    def observation(self, observed: Any, chosen: Sequence[int]) -> NDArray[np.float32]:
        """Return what the next drone observes, after the choices of those before it."""
        turns, actions = np.eye(self.drones), np.eye(self.actions)
        earlier = np.zeros((self.drones, self.actions))
        earlier[: len(chosen)] = actions[list(chosen)]
        wrapped: Any = flatten(self.wrapped, observed)
        parts = wrapped, turns[len(chosen)], earlier.ravel()
        return np.concatenate(parts).astype(np.float32)
