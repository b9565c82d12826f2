"""PettingZoo's parallel environment, in which each drone is an agent."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, ClassVar

import numpy as np
from gymnasium.spaces import Box, Dict, Discrete
from numpy.typing import NDArray
from pettingzoo import ParallelEnv

from desim_uav.copies import Independent
from desim_uav.env.alone import alone
from desim_uav.env.arguments import typed
from desim_uav.env.compiled import faster, session_of
from desim_uav.env.configure import Source, WorldSeed
from desim_uav.env.render import RENDERING, Screen
from desim_uav.env.saving import Saving
from desim_uav.env.session import ActionError, as_commands
from desim_uav.env.tasks import Curriculum, TaskChange, tasks_of
from desim_uav.spaces import features_of, observation_space, state_space

Parts = dict[str, NDArray[Any]]
Infos = dict[str, dict[str, Any]]


class UavParallelEnv(Saving, Independent, ParallelEnv[str, Parts, int]):  # type: ignore[misc]
    """The drones of a scenario as agents ``drone_0``, ``drone_1``, …; a step is a decision epoch.

    An agent's observation is a dict of ``observation``, the scenario's encoding (int64, or float32
    if it has real numbers), and ``action_mask``, int8 with one entry per action, never all 0.
    Drones that return, charge or have crashed stay agents, and their mask leaves one action. The
    time limit truncates an episode; a crash terminates it if the scenario says so.

    In free flight (``motion: {space: free}``), an action is a Box of 2 or 3 numbers of the
    displacement, one for the cruise speed if the motion has ``cruise``, and, if the drone's battery
    is limited, one more, by which it asks for a charge.
    The mask is called ``allowed`` then, because an ``action_mask`` is that of a Discrete space. Its
    entries are those of ``World.actions``: to fly, to hover, to return to a station, to charge.

    If the scenario has several types of drones, the spaces are those of the drone's own type: one
    without a battery has no actions for charging, and some may fly freely and others from cell to
    cell. Actions have the same numbers for all that fly from cell to cell.

    An agent's reward is its drone's own. Its info holds numbers only, under the same keys at every
    reset and step (see ``Session.info``): attached users, crashes and the terms of the reward are
    the drone's own, the others those of the whole episode. The mask is in the observation only.

    Copies and pickles are independent environments (see ``UavEnv``).
    """

    metadata: ClassVar[dict[str, Any]] = {**RENDERING, "name": "uav_v0", "is_parallelizable": True}

    @typed
    def __init__(
        self,
        scenario: Source,
        config: Mapping[str, Any] | None = None,
        render_mode: str | None = None,
        world_seed: WorldSeed = "scenario",
        engine: str = "auto",
        curriculum: Curriculum | Sequence[TaskChange] | None = None,
    ) -> None:
        """Make the environment of a scenario.

        ``scenario``: a file, a shipped name, a mapping or a Scenario; ``config``: changes to it;
        ``world_seed``, ``engine`` and ``curriculum``: as in ``UavEnv``. Raises ScenarioError with
        every problem of the scenario, and for a component that the compiled engine cannot run;
        gymnasium's Error for another engine; UnsupportedMode if ``render_mode`` is unknown, or
        "human" without a display.
        """
        self.session = session_of(engine, tasks_of(scenario, config, world_seed, curriculum))
        self.guard = self.session.guard
        self.screen = Screen(self.session, render_mode)
        self.render_mode = render_mode
        self.possible_agents = [f"drone_{d}" for d in range(self.session.drones)]
        self.agents: list[str] = []
        world, self.observation_spaces, self.action_spaces = self.session.world, {}, {}
        self._parts: list[tuple[int, str, Any]] = []
        for drone, agent in enumerate(self.possible_agents):
            numbers, commands = features_of(world, drone), world.commands.of(drone)
            mask = Box(0, 1, (len(world.type_of(drone).actions),), np.int8)
            self.observation_spaces[agent] = Dict(
                {"observation": observation_space(numbers), commands.mask_key: mask}
            )
            self.action_spaces[agent] = commands.space(drone)
            self._parts.append((len(numbers), commands.mask_key, commands.entries(drone)))
        self.state_space = state_space(len(self.session.state_names))

    def observation_space(self, agent: str) -> Dict:
        """Return the observation space of an agent, always the same object."""
        return self.observation_spaces[agent]

    def action_space(self, agent: str) -> Discrete[Any] | Box:
        """Return the action space of an agent, always the same object."""
        space: Discrete[Any] | Box = self.action_spaces[agent]
        return space

    @typed
    @alone
    def reset(
        self, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[dict[str, Parts], Infos]:
        """Begin the next episode; with a ``seed``, the first episode of a new run.

        Returns the observations and the infos of all agents. There are no ``options``.
        """
        self.session = self.screen.session = faster(self.session)
        self.session.reset(seed)
        return self._present()

    def _present(self) -> tuple[dict[str, Parts], Infos]:
        """Show the present decision epoch; return its observations and infos."""
        over = self.session.snapshot.terminated or self.session.snapshot.truncated
        self.agents = [] if over else self.possible_agents[:]
        self.screen.refresh()
        return self._observations_and_infos()

    @alone
    def step(
        self, actions: Mapping[str, int]
    ) -> tuple[dict[str, Parts], dict[str, float], dict[str, bool], dict[str, bool], Infos]:
        """Take one action per agent, and run to the next decision epoch.

        A masked action is replaced by the only allowed one, or by hover. At the end of the
        episode ``agents`` is empty. Raises ResetNeeded outside an episode, and ActionError for an
        invalid action, or if the actions are not exactly one per agent.
        """
        if not isinstance(actions, Mapping):
            raise ActionError(
                f"actions must be a mapping from agents to actions, not {actions!r}; there must be "
                f"one for each of {self.agents}"
            )
        if self.agents and actions.keys() != self.action_spaces.keys():
            raise ActionError(
                f"there must be one action for each of {self.agents}, not for {list(actions)}"
            )
        ordered = [actions[agent] for agent in self.agents]
        joined = as_commands(self.session.world.commands.joined, ordered) if ordered else ordered
        _, terminated, truncated = self.session.step(joined)
        if terminated or truncated:
            self.agents = []
        self.screen.refresh()
        observations, infos = self._observations_and_infos()
        rewards, ends, cuts = {}, {}, {}
        for agent, reward in zip(infos, self.session.rewards(), strict=True):
            rewards[agent], ends[agent], cuts[agent] = reward, terminated, truncated
        return observations, rewards, ends, cuts, infos

    @alone
    def state(self) -> NDArray[np.float32]:
        """Return the whole state, for learners that train centrally (see ``rules.whole_state``)."""
        return self.session.state()

    def action_masks(self) -> NDArray[np.bool_]:
        """Return the masks of all drones, one after the other: bool (drones * actions,)."""
        return self.session.action_masks()

    @alone
    def render(self) -> NDArray[np.uint8] | None:
        """Return the present frame, uint8 (height, width, 3), or None if a window shows it."""
        return self.screen.render()

    def close(self) -> None:
        """Close the window, if there is one."""
        self.screen.close()

    def _observations_and_infos(self) -> tuple[dict[str, Parts], Infos]:
        session, observations = self.session, {}
        masks = session.mask().reshape(session.drones, -1)
        for agent, encoded, mask, (numbers, mask_key, actions) in zip(
            self.possible_agents, session.observations(), masks, self._parts, strict=True
        ):
            observations[agent] = {"observation": encoded[:numbers], mask_key: mask[actions]}
        return observations, dict(zip(self.possible_agents, session.infos(), strict=True))
