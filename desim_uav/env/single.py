"""Gymnasium's environment, in which one controller flies all drones."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import gymnasium
import numpy as np
from numpy.typing import NDArray

from desim_uav.copies import Independent
from desim_uav.env.alone import alone
from desim_uav.env.arguments import typed
from desim_uav.env.compiled import faster, session_of
from desim_uav.env.configure import Source, WorldSeed
from desim_uav.env.render import RENDERING, Screen
from desim_uav.env.saving import Saving
from desim_uav.env.tasks import Curriculum, TaskChange, tasks_of
from desim_uav.spaces import features, observation_space


class UavEnv(Saving, Independent, gymnasium.Env[NDArray[Any], Any]):
    """The drones of a scenario under one controller; a step is a decision epoch.

    The observation holds the drones' encoded observations, one after the other (int64, or float32
    if the encoding has real numbers). An action has one entry per drone; for a single drone it is
    one number. The reward is the mean over the drones, and so are its terms in the info; attached
    users and crashes are counted over all drones. The masks, in the info and from
    ``action_masks``, are those of the drones, one after the other; each allows at least one
    action. The time limit truncates an episode; a crash terminates it if the scenario says so.

    In free flight (``motion: {space: free}``), the action space is a Box. For each drone it has 2
    or 3 numbers for the displacement, one for the cruise speed if the motion has ``cruise``, and
    one more if batteries are limited: if this is above 0, the drone charges or returns to a station
    (see ``docs/howto/free_flight.md``).

    If the scenario has several types of drones, each drone has as many features and actions as the
    type with the most: its own features are followed by zeros, and its mask forbids the actions
    that its type does not have.

    ``copy.copy``, ``copy.deepcopy`` and ``pickle`` make an independent environment at any point of
    an episode. It continues exactly as this one would. A pickle does so in any process that has
    the same versions of desim-uav and Python. ``save`` and ``restore`` go back to an epoch, with
    either engine. A copy with ``render_mode="human"`` opens a window when it first renders.
    """

    metadata = RENDERING

    @typed
    def __init__(
        self,
        scenario: Source,
        config: Mapping[str, Any] | None = None,
        render_mode: str | None = None,
        engine: str = "auto",
        world_seed: WorldSeed = "scenario",
        curriculum: Curriculum | Sequence[TaskChange] | None = None,
    ) -> None:
        """Make the environment of a scenario.

        ``scenario``: a file, a shipped name, a mapping or a Scenario; ``config``: changes to it.
        ``engine``: "des" (SimPy), or "batch" (compiled), which gives the same numbers faster.
        "auto" is the compiled engine if its machine code is on disk; else SimPy begins at once,
        another process compiles, and a later ``reset`` changes to the compiled engine. It is SimPy
        to the end, with a notice, if a component cannot be compiled. ``compiled`` in an info says
        which engine plays the episode.
        ``world_seed``: the seed of the world to fly in; None: each seed draws a world of its own;
        "scenario": the scenario's own, which for the shipped cases is None; "train", "validation",
        "test" or a range of world seeds: each episode draws one of these worlds and begins with
        all drones at their starts. A ``world_seed`` in ``config`` takes precedence.
        ``curriculum``: a schedule over keys of the scenario (see ``Curriculum``), or its stages.

        Raises ScenarioError with every problem of the scenario or curriculum, and UnsupportedMode
        if ``render_mode`` is unknown, or "human" without a display.
        """
        self.session = session_of(engine, tasks_of(scenario, config, world_seed, curriculum))
        self.guard = self.session.guard
        self.screen = Screen(self.session, render_mode)
        self.render_mode = render_mode
        self.drones = self.session.drones
        world = self.session.world
        self.observation_space = observation_space(features(world) * self.drones)
        commands = world.commands.of_all("an environment whose actions are one array")
        self.action_space = commands.space_of(self.drones)

    @typed
    @alone
    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[NDArray[Any], dict[str, Any]]:
        """Begin the next episode; with a ``seed``, the first episode of a new run.

        Returns the observation and the info. There are no ``options``.
        """
        self.session = self.screen.session = faster(self.session)
        self.session.reset(seed)
        super().reset(seed=None if seed is None else self.session.seed)
        return self._present()

    def _present(self) -> tuple[NDArray[Any], dict[str, Any]]:
        """Show the present decision epoch; return its observation and its info."""
        self.screen.refresh()
        return self.session.observation(), self.session.info()

    @alone
    def step(self, action: object) -> tuple[NDArray[Any], float, bool, bool, dict[str, Any]]:
        """Take one action per drone, (drones,), and run to the next decision epoch.

        A masked action is replaced by the only allowed one, or by hover. Raises ResetNeeded
        outside an episode, and ActionError for an invalid action.
        """
        reward, terminated, truncated = self.session.step(action)
        self.screen.refresh()
        return self.session.observation(), reward, terminated, truncated, self.session.info()

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
