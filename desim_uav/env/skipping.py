"""Wrappers that skip the decision epochs at which there is nothing to decide.

A drone that returns, queues, charges or has crashed has one allowed action: its step is *forced*
(info ``forced``), and so is that of a drone that is asked later, if decisions are by event. Rewards
r1, r2, … of the steps from a free decision to the next one are one reward, r1 + gamma r2 + gamma²
r3 + … by clock; by event, each exponent is the time that has passed, in steps. The infos
``duration_steps`` and ``discount`` then cover all these steps: what follows the next decision
is to be discounted by ``discount``, which is gamma to the power of ``duration_steps``.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import gymnasium
import numpy as np
from gymnasium import error
from gymnasium.spaces import Box
from pettingzoo.utils import BaseParallelWrapper

from desim_uav.copies import Independent
from desim_uav.env.arguments import of_class, typed
from desim_uav.env.joint import not_numbered
from desim_uav.env.parallel import UavParallelEnv
from desim_uav.model.decisions import discount_of


class SkipForced(Independent, gymnasium.Wrapper[Any, Any, Any, Any]):
    """``UavEnv``, or a wrapper of it, without the epochs at which no drone has a choice.

    A step runs to the next epoch at which at least one drone has a choice, or to the end of the
    episode. Its reward is the sum of the rewards on the way, discounted by ``gamma`` for each step.
    The info is that of the last step, except for ``duration_steps`` and ``discount``, which cover
    all steps taken, with this ``gamma``. A reset skips nothing: if drones carry over, the first
    step of an episode may be a forced one.
    """

    @typed
    def __init__(self, env: gymnasium.Env[Any, Any], gamma: float = 1.0) -> None:
        """Wrap an environment, which must have an action for each drone.

        Raises gymnasium's Error otherwise, and if not 0 < ``gamma`` <= 1.
        """
        not_numbered(env, "SkipForced")
        super().__init__(env)
        self.gamma = _checked(gamma)
        self._drones = int(env.unwrapped.drones)  # type: ignore[attr-defined]

    def step(self, action: object) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        """Take an action, and then the only allowed ones until there is a choice."""
        gained, way = 0.0, Way()
        while True:
            observation, reward, terminated, truncated, info = self.env.step(action)
            gained += way.discount * float(reward)
            way.go_on(self.gamma, info)
            if terminated or truncated or not info["forced"]:
                return observation, gained, terminated, truncated, info | way.told()
            action = self._forced(info)

    def _forced(self, info: dict[str, Any]) -> Any:
        """Return the only allowed actions; in free flight, commands do not count then."""
        if isinstance(self.action_space, Box):
            return np.zeros(self.action_space.shape, self.action_space.dtype)
        only = np.asarray(info["action_mask"]).reshape(self._drones, -1).argmax(axis=1)
        return only if self._drones > 1 else int(only[0])


class SkipForcedParallel(Independent, BaseParallelWrapper):  # type: ignore[misc]
    """``UavParallelEnv`` without the epochs at which no agent has a choice.

    A step runs to the next epoch at which at least one agent has a choice, or to the end of the
    episode, and returns the values of all agents there. An agent that has a choice there gets the
    sum of its rewards since its own last free decision, or since the beginning of the episode,
    discounted by ``gamma`` for each step. An agent that has none gets 0, and its rewards later, at
    the end of the episode at the latest. A learner leaves out the decisions of agents whose
    ``forced`` is 1. The infos ``duration_steps`` and ``discount`` of an agent that is paid are
    those of the time for which it is paid, with this ``gamma``; of another agent they are 0 and 1.
    """

    @typed
    def __init__(self, env: object, gamma: float = 1.0) -> None:
        """Wrap an environment. Raises gymnasium's Error if not 0 < ``gamma`` <= 1."""
        of_class(UavParallelEnv, env)
        super().__init__(env)
        self.gamma = _checked(gamma)
        self._gained: dict[str, float] = {}
        self._ways: dict[str, Way] = {}

    @typed
    def reset(
        self, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[dict[str, Any], dict[str, Any]]:
        """Begin the next episode; nothing is skipped."""
        start: tuple[dict[str, Any], dict[str, Any]] = super().reset(seed=seed, options=options)
        self._gained = dict.fromkeys(self.agents, 0.0)
        self._ways = {agent: Way() for agent in self.agents}
        return start

    def step(self, actions: dict[str, Any]) -> tuple[dict[str, Any], ...]:
        """Take one action per agent, and then the only allowed ones until there is a choice."""
        choices = actions
        while True:
            observations, rewards, ends, cuts, infos = super().step(choices)
            for agent, reward in rewards.items():
                self._gained[agent] += self._ways[agent].discount * reward
                self._ways[agent].go_on(self.gamma, infos[agent])
            over = not self.agents
            if over or not all(info["forced"] for info in infos.values()):
                return observations, self._paid(infos, over), ends, cuts, infos
            choices = {agent: self._forced(agent, one) for agent, one in observations.items()}

    def _forced(self, agent: str, one: dict[str, Any]) -> Any:
        """Return the only allowed action; in free flight, a command does not count then."""
        space = self.action_space(agent)
        if isinstance(space, Box):
            return np.zeros(space.shape, space.dtype)
        return int(one["action_mask"].argmax())

    def _paid(self, infos: dict[str, Any], over: bool) -> dict[str, float]:
        """Return the rewards that are due now, which are then no longer owed."""
        paid = {}
        for agent, info in infos.items():
            due = over or not info["forced"]
            paid[agent] = self._gained[agent] if due else 0.0
            info.update((self._ways[agent] if due else Way()).told())
            if due:
                self._gained[agent], self._ways[agent] = 0.0, Way()
        return paid


@dataclass
class Way:
    """The steps from a decision to the next one: their duration and their discount so far."""

    steps: float = 0.0
    discount: float = 1.0

    def go_on(self, gamma: float, info: dict[str, Any]) -> None:
        """Add a step."""
        self.steps += info["duration_steps"]
        self.discount *= discount_of(gamma, info["duration_steps"])

    def told(self) -> dict[str, float]:
        """Return the entries of infos about these steps."""
        return {"duration_steps": self.steps, "discount": self.discount}


def _checked(gamma: float) -> float:
    if not 0.0 < gamma <= 1.0:
        raise error.Error(f"gamma {gamma}: must be above 0 and at most 1")
    return float(gamma)
