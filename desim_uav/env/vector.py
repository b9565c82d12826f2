"""Gymnasium's vector environment: many environments of one scenario, which one call steps."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from gymnasium import logger
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space
from numpy.typing import NDArray

from desim_uav.engine.base import COUNTS
from desim_uav.env.alone import alone
from desim_uav.env.arguments import typed
from desim_uav.env.compiled import COUNTED, MEASURED, as_counts
from desim_uav.env.configure import Source, WorldSeed
from desim_uav.env.many import Many
from desim_uav.env.render import RENDERING
from desim_uav.env.tasks import Curriculum, TaskChange, tasks_of
from desim_uav.spaces import features, observation_space


class UavVectorEnv(Many, VectorEnv[NDArray[Any], NDArray[Any], NDArray[Any]]):
    """``num_envs`` environments like ``UavEnv``, in the compiled engine.

    Environment k gives the same numbers as ``UavEnv`` with its seed, bit for bit, with any number
    of ``threads``. ``reset(seed=s)`` gives environment k the seed s + k; a list gives each its
    own. A seed also draws a world, so the environments fly in different worlds, which the paper's
    observation does not distinguish. With a ``world_seed`` they all fly in one world, which also
    takes less memory; the Gymnasium ids of the nine cases have ``world_seed=0``.

    Infos are arrays with one entry per environment: those of ``UavEnv``, the masks among them as
    ``action_mask`` (num_envs, drones * actions).

    Gymnasium's ``autoreset_mode`` determines what happens after the end of an episode. With
    ``NEXT_STEP`` the next step ignores the action of that environment and begins its next episode,
    with a reward of 0. With ``SAME_STEP`` the step that ends an episode also begins the next one,
    and returns the end as ``final_obs`` and ``final_info``. With ``DISABLED`` the caller resets the
    environments whose episodes are over: ``reset(options={"reset_mask": terminated | truncated})``.

    Copies and pickles are independent environments (see ``UavEnv``) with threads of their own.
    """

    metadata: dict[str, Any] = {  # noqa: RUF012 (Gymnasium gives each environment its own)
        "render_modes": ["rgb_array"],
        "render_fps": RENDERING["render_fps"],
        "autoreset_mode": AutoresetMode.NEXT_STEP,
    }

    @typed
    def __init__(
        self,
        scenario: Source,
        num_envs: int,
        config: Mapping[str, Any] | None = None,
        autoreset_mode: AutoresetMode | str = AutoresetMode.NEXT_STEP,
        threads: int = 1,
        render_mode: str | None = None,
        world_seed: WorldSeed = "scenario",
        curriculum: Curriculum | Sequence[TaskChange] | None = None,
    ) -> None:
        """Make ``num_envs`` environments of a scenario.

        ``scenario``, ``config``, ``world_seed`` and ``curriculum`` are as in ``UavEnv``.
        ``render_mode``: None or "rgb_array". ``threads``: the number of threads that share the
        environments.

        Raises ScenarioError with every problem of the scenario, and for a component that cannot be
        compiled; UnsupportedMode for another render mode; gymnasium's Error for another autoreset
        mode, if ``num_envs`` or ``threads`` is below 1, or if the observations do not fit in
        memory.
        """
        tasks = tasks_of(scenario, config, world_seed, curriculum)
        self.make_sessions(tasks, num_envs, autoreset_mode, threads, render_mode)
        self.metadata = {**type(self).metadata, "autoreset_mode": self.autoreset_mode}

    def _set_spaces(self) -> None:
        first = self.sessions[0]
        self.single_observation_space = observation_space(features(first.world) * first.drones)
        self.single_action_space = self.commands.space_of(first.drones)
        self.observation_space = batch_space(self.single_observation_space, self.num_envs)
        self.action_space = batch_space(self.single_action_space, self.num_envs)

    @typed
    @alone
    def reset(
        self,
        *,
        seed: int | Sequence[int | None] | None = None,
        options: dict[str, Any] | None = None,
    ) -> tuple[NDArray[Any], dict[str, Any]]:
        """Begin the next episode of every environment; with seeds, the first episodes of new runs.

        ``options={"reset_mask": mask}`` resets only the environments that the mask (num_envs,),
        bool, names; the others stay as they are, and their infos are 0. The seed of environment k
        is still s + k, or the list's entry k. There are no other options. Raises gymnasium's Error
        for a mask of another kind or shape, or one that names no environment.
        """
        return self._present(self.begin_chosen(seed, options))

    def _present(self, which: NDArray[np.bool_]) -> tuple[NDArray[Any], dict[str, Any]]:
        return self._observations(), self.infos(which)

    @alone
    def step(
        self, actions: NDArray[Any]
    ) -> tuple[
        NDArray[Any], NDArray[np.float64], NDArray[np.bool_], NDArray[np.bool_], dict[str, Any]
    ]:
        """Take the actions (num_envs, drones), or (num_envs,) with a single drone each.

        In free flight, they are the numbers of commands: (num_envs, drones * numbers).

        Raises ResetNeeded before the first reset of an environment and, with
        ``AutoresetMode.DISABLED``, after the end of its episode, and ActionError for an invalid
        action. No environment is stepped in these cases.
        """
        over = self.over()
        self.require_episodes(over)
        self.advance(actions, over, by_drone=False)
        rewards = self.outputs.rewards[:, 0].copy()
        terminated, truncated = self.outputs.over[:, :2].T.copy()
        final: dict[str, Any] = {}
        if self.autoreset_mode is AutoresetMode.SAME_STEP:
            ended = self.over()
            if ended.any():
                final = self._final(ended)
                self.begin(ended)
        infos = {**final, **self.infos(self._all)}
        return self._observations(), rewards, terminated, truncated, infos

    def infos(self, which: NDArray[np.bool_]) -> dict[str, Any]:
        """Return the present infos in Gymnasium's form.

        Each key has beside it, after an underscore, the mask ``which`` of the environments that
        have it; the entries of the others are 0.
        """
        numbers, labels = self.outputs.numbers.T.copy(), self._which.T.copy()
        measures, counts, rest = numbers[:MEASURED], numbers[MEASURED:COUNTED], numbers[COUNTED:]
        whole = as_counts(COUNTS, counts, self.sessions[0].world)
        columns = (*measures, *labels, *whole, *rest)
        arrays = dict(zip(self.sessions[0].keys, columns, strict=True))
        infos: dict[str, Any] = {}
        others = None if which.all() else ~which
        for key, array in {**arrays, "action_mask": self.outputs.masks.copy()}.items():
            if others is not None:
                array[others] = 0
            infos[key], infos[f"_{key}"] = array, which.copy()
        return infos

    @alone
    def render(self) -> tuple[NDArray[np.uint8], ...] | None:
        """Return the frame of each environment, (height, width, 3), or None without render mode."""
        if self.render_mode is None:
            logger.warn("render() shows nothing without render_mode='rgb_array'")
            return None
        return self.frames()

    def action_masks(self) -> NDArray[np.bool_]:
        """Return the masks, bool (num_envs, drones * actions)."""
        return self.outputs.masks.astype(np.bool_)

    def close_extras(self, **kwargs: Any) -> None:
        """Stop the threads. Gymnasium below 1.3 also closes an environment that was not made."""
        self.stop_threads()

    def _observations(self) -> NDArray[Any]:
        return self.outputs.observations.astype(self.sessions[0].dtype)

    def _final(self, ended: NDArray[np.bool_]) -> dict[str, Any]:
        """Return the last observations and infos of ended episodes, under Gymnasium's keys."""
        observations = np.full(self.num_envs, None, object)
        for k, last in zip(ended.nonzero()[0], self._observations()[ended], strict=True):
            observations[k] = last
        return {
            "final_obs": observations,
            "_final_obs": ended.copy(),
            "final_info": self.infos(ended),
            "_final_info": ended.copy(),
        }
