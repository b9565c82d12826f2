"""PettingZoo's parallel environment, in which each drone is an agent."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, ClassVar

import numpy as np
from gymnasium.spaces import Box, Dict, Discrete
from numpy.typing import NDArray
from pettingzoo import ParallelEnv  # type: ignore[import-untyped]

from desim_uav.copies import Independent
from desim_uav.env.configure import Source, WorldSeed, configured
from desim_uav.env.render import RENDERING, Screen
from desim_uav.env.saving import Saving
from desim_uav.env.session import ActionError, Session
from desim_uav.spaces import features, observation_space

Parts = dict[str, NDArray[Any]]
Infos = dict[str, dict[str, Any]]


class UavParallelEnv(Saving, Independent, ParallelEnv[str, Parts, int]):  # type: ignore[misc]
    """The drones of a scenario as agents ``drone_0``, ``drone_1``, …; a step is a decision epoch.

    An agent's observation is a dict of ``observation``, the scenario's encoding (int64, or float32
    if it has real numbers), and ``action_mask``, int8 with one entry per action, never all 0.
    Drones that return, charge or have crashed stay agents, and their mask leaves one action. The
    time limit truncates an episode; a crash terminates it if the scenario says so.

    An agent's reward is its drone's own. Its info holds numbers only, under the same keys at every
    reset and step (see ``Session.info``): attached users, crashes and the terms of the reward are
    the drone's own, the others those of the whole episode. The mask is in the observation only.

    Copies and pickles are independent environments (see ``UavEnv``).
    """

    metadata: ClassVar[dict[str, Any]] = {**RENDERING, "name": "uav_v0", "is_parallelizable": True}

    def __init__(
        self,
        scenario: Source,
        config: Mapping[str, Any] | None = None,
        render_mode: str | None = None,
        world_seed: WorldSeed = "scenario",
    ) -> None:
        """Make the environment of a scenario.

        ``scenario``: a file, a shipped name, a mapping or a Scenario; ``config``: changes to it;
        ``world_seed``: as in ``UavEnv``. Raises ScenarioError with every problem of the scenario,
        and UnsupportedMode if ``render_mode`` is unknown, or "human" without a display.
        """
        self.session = Session(configured(scenario, config, world_seed))
        self.screen = Screen(self.session, render_mode)
        self.render_mode = render_mode
        self.possible_agents = [f"drone_{d}" for d in range(self.session.drones)]
        self.agents: list[str] = []
        numbers, actions = features(self.session.world), len(self.session.world.actions)
        self.observation_spaces = {
            agent: Dict(
                {
                    "observation": observation_space(numbers),
                    "action_mask": Box(0, 1, (actions,), np.int8),
                }
            )
            for agent in self.possible_agents
        }
        self.action_spaces = {agent: Discrete(actions) for agent in self.possible_agents}

    def observation_space(self, agent: str) -> Dict:
        """Return the observation space of an agent, always the same object."""
        return self.observation_spaces[agent]

    def action_space(self, agent: str) -> Discrete[Any]:
        """Return the action space of an agent, always the same object."""
        return self.action_spaces[agent]

    def reset(
        self, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[dict[str, Parts], Infos]:
        """Begin the next episode; with a ``seed``, the first episode of a new run.

        Returns the observations and the infos of all agents. There are no ``options``.
        """
        self.session.reset(seed)
        return self._shown()

    def _shown(self) -> tuple[dict[str, Parts], Infos]:
        """Show the present decision epoch; return its observations and infos."""
        over = self.session.snapshot.terminated or self.session.snapshot.truncated
        self.agents = [] if over else self.possible_agents[:]
        self.screen.refresh()
        return self._observations_and_infos()

    def step(
        self, actions: Mapping[str, int]
    ) -> tuple[dict[str, Parts], dict[str, float], dict[str, bool], dict[str, bool], Infos]:
        """Take one action per agent, and run to the next decision epoch.

        A masked action is replaced by the only allowed one, or by hover. At the end of the
        episode ``agents`` is empty. Raises ResetNeeded outside an episode, and ActionError for an
        invalid action, or if the actions are not exactly one per agent.
        """
        if self.agents and actions.keys() != self.action_spaces.keys():
            raise ActionError(
                f"there must be one action for each of {self.agents}, not for {list(actions)}"
            )
        ordered = [actions[agent] for agent in self.agents]
        _, terminated, truncated = self.session.step(ordered if len(ordered) != 1 else ordered[0])
        if terminated or truncated:
            self.agents = []
        self.screen.refresh()
        observations, infos = self._observations_and_infos()
        rewards, ends, cuts = {}, {}, {}
        for agent, reward in zip(infos, self.session.snapshot.rewards, strict=True):
            rewards[agent], ends[agent], cuts[agent] = reward, terminated, truncated
        return observations, rewards, ends, cuts, infos

    def action_masks(self) -> NDArray[np.bool_]:
        """Return the masks of all drones, one after the other: bool (drones * actions,)."""
        return self.session.action_masks()

    def render(self) -> NDArray[np.uint8] | None:
        """Return the present frame, uint8 (height, width, 3), or None if a window shows it."""
        return self.screen.render()

    def close(self) -> None:
        """Close the window, if there is one."""
        self.screen.close()

    def _observations_and_infos(self) -> tuple[dict[str, Parts], Infos]:
        session, crashed = self.session, self.session.engine.log.crashed
        of_all, terms, every = session.info_of_all(), session.reward_terms(), session.encoded()
        masks = session.mask().reshape(session.drones, -1)
        snapshot, keys, dtype = session.snapshot, session.terms.items(), session.dtype
        observations, infos = {}, {}
        for drone, agent in enumerate(self.possible_agents):
            encoded, own = np.array(every[drone], dtype), terms[drone]
            observations[agent] = {"observation": encoded, "action_mask": masks[drone]}
            info = infos[agent] = of_all.copy()
            info["attached_users"] = snapshot.observations[drone].attached_users
            info["crashes"] = crashed.count(drone)
            for name, key in keys:
                info[key] = float(own[name])
        return observations, infos
