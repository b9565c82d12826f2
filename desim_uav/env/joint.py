"""Wrappers for learners that choose one whole number: for all drones at once, or drone by drone."""

from __future__ import annotations

from typing import Any, cast

import gymnasium
import numpy as np
from gymnasium import error
from gymnasium.spaces import Discrete, MultiDiscrete
from numpy.typing import NDArray

from desim_uav.copies import Independent
from desim_uav.env.arguments import ArgumentError, of_class, typed
from desim_uav.env.session import ActionError
from desim_uav.env.single import UavEnv
from desim_uav.one_number import InOrder, JointNumber

MOST_JOINT = 10_000
"""The largest number of joint actions, unless an argument says another one."""


class JointActions(Independent, gymnasium.Wrapper[Any, Any, Any, Any]):
    """``UavEnv``, or a wrapper of it, whose action is one number for all drones.

    The number of a joint action has a digit for each drone, that of drone 0 first, in the base of
    the number of actions of a drone. The mask, in the info and from ``action_masks``, has an entry
    for each joint action, which is allowed if each of its actions is.
    """

    @typed
    def __init__(self, env: gymnasium.Env[Any, Any], most: int = MOST_JOINT) -> None:
        """Wrap an environment, but none of ``JointActions`` or ``InTurn``.

        Raises ArgumentError for such a one, and if there are more than ``most`` actions.
        """
        if most < 1:
            raise ArgumentError(f"most: must be at least 1, not {most}")
        self._numbers = JointNumber(*_fleet_of(env, "JointActions"))
        drones, actions, count = self._numbers.drones, self._numbers.actions, self._numbers.count
        if count > most:
            raise ArgumentError(
                f"env: {drones} drones with {actions} actions each have {count:,} joint actions, "
                f"and at most {most:,} are allowed; InTurn asks drone after drone"
            )
        super().__init__(env)
        self.action_space = self._numbers.space()

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Any, dict[str, Any]]:
        """Begin the next episode (see ``UavEnv.reset``)."""
        observation, info = self.env.reset(seed=seed, options=options)
        return observation, self._with_mask(info)

    def step(self, action: Any) -> tuple[Any, Any, bool, bool, dict[str, Any]]:
        """Take a joint action. Raises ActionError for a number that is none."""
        if not self.action_space.contains(action):
            raise ActionError(f"action {action!r}: must be a whole number in {self.action_space}")
        own = self._numbers.split(int(action))
        observation, *rest, info = self.env.step(np.array(own) if len(own) > 1 else own[0])
        return observation, *rest, self._with_mask(info)

    def action_masks(self) -> NDArray[np.bool_]:
        """Return the mask of the joint actions: bool (actions ** drones,)."""
        return self._numbers.mask(cast(UavEnv, self.env.unwrapped).action_masks())

    def _with_mask(self, info: dict[str, Any]) -> dict[str, Any]:
        return info | {"action_mask": self._numbers.mask(info["action_mask"]).view(np.int8)}


class InTurn(Independent, gymnasium.Wrapper[Any, Any, Any, Any]):
    """``UavEnv``, or a wrapper of it, that asks drone after drone for one action each.

    An observation has the numbers of the wrapped one (whole numbers as one-hot vectors), then a 1
    in the place of the drone whose turn it is, and then the actions that the drones before it have
    chosen, as one-hot vectors that are 0 for the others: float32, a Box. The drones' decision epoch
    ends with the choice of the last one: this step has the reward, and its infos
    ``duration_steps`` and ``discount`` are those of the wrapped environment. The other steps take
    no time: their reward is 0 and their discount is 1. A learner with one discount for every step
    is given ``learning.gamma`` to the power of 1 over the number of drones. The mask, in the info
    and from ``action_masks``, is that of the drone whose turn it is, ``info["turn"]``.
    """

    @typed
    def __init__(self, env: gymnasium.Env[Any, Any]) -> None:
        """Wrap an environment, but none of ``JointActions`` or ``InTurn``.

        Raises ArgumentError for such a one, and unless drones fly from cell to cell.
        """
        self._drones, self._actions = _fleet_of(env, "InTurn")
        super().__init__(env)
        self._order = InOrder(env.observation_space, self._drones, self._actions)
        self.observation_space = self._order.space
        self.action_space = Discrete(self._actions)
        self._chosen: list[int] = []
        self._seen: Any = None
        self._info: dict[str, Any] = {}

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[NDArray[np.float32], dict[str, Any]]:
        """Begin the next episode (see ``UavEnv.reset``), in which drone 0 chooses first."""
        self._seen, self._info = self.env.reset(seed=seed, options=options)
        self._chosen = []
        return self._observation(), self._with_turn(self._info)

    def step(self, action: Any) -> tuple[NDArray[np.float32], float, bool, bool, dict[str, Any]]:
        """Let the drone whose turn it is choose; the last one's choice ends the decision epoch.

        Raises ResetNeeded outside an episode, and ActionError for a number that is no action.
        """
        if self._seen is None:
            raise error.ResetNeeded("call reset first: no episode has begun, or it is over")
        if not self.action_space.contains(action):
            raise ActionError(f"action {action!r}: must be a whole number in {self.action_space}")
        chosen = [*self._chosen, int(action)]
        if len(chosen) < self._drones:
            self._chosen = chosen
            timeless = self._info | {"duration_steps": 0.0, "discount": 1.0}
            return self._observation(), 0.0, False, False, self._with_turn(timeless)
        together = np.array(chosen) if self._drones > 1 else chosen[0]
        self._seen, reward, terminated, truncated, self._info = self.env.step(together)
        self._chosen = []
        observation, info = self._observation(), self._with_turn(self._info)
        if terminated or truncated:
            self._seen = None
        return observation, float(reward), terminated, truncated, info

    def action_masks(self) -> NDArray[np.bool_]:
        """Return the mask of the drone whose turn it is: bool (actions,)."""
        masks = cast(UavEnv, self.env.unwrapped).action_masks()
        own: NDArray[np.bool_] = masks.reshape(self._drones, -1)[len(self._chosen)]
        return own

    def _observation(self) -> NDArray[np.float32]:
        return self._order.observation(self._seen, self._chosen)

    def _with_turn(self, info: dict[str, Any]) -> dict[str, Any]:
        turn = len(self._chosen)
        own = np.asarray(info["action_mask"]).reshape(self._drones, -1)[turn].copy()
        return info | {"turn": turn, "action_mask": own}


def not_numbered(env: gymnasium.Env[Any, Any], wrapper: str) -> None:
    """Raise ArgumentError unless actions are still those of ``UavEnv``, one for each drone."""
    of_class(UavEnv, env)
    below: Any = env
    while isinstance(below, gymnasium.Wrapper):
        if isinstance(below, JointActions | InTurn):
            changed = f"{type(below).__name__}, which has changed the actions"
            raise ArgumentError(f"env: {wrapper} cannot wrap {changed}")
        below = below.env


def _fleet_of(env: gymnasium.Env[Any, Any], wrapper: str) -> tuple[int, int]:
    """Return the number of drones and that of the actions of each. Raises ArgumentError."""
    not_numbered(env, wrapper)
    space = env.action_space
    if isinstance(space, Discrete):
        return 1, int(space.n)
    if isinstance(space, MultiDiscrete):
        return len(space.nvec), int(space.nvec[0])
    raise ArgumentError(
        f"env: {wrapper} needs drones that fly from cell to cell, whose actions are numbered, and "
        f"not an environment whose action space is {space}"
    )
