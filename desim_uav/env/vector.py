"""Gymnasium's vector environment: many environments of one scenario, stepped in one call."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from gymnasium import error
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space
from numpy.typing import NDArray

from desim_uav.env.compiled import Compiled, CompiledSession
from desim_uav.env.configure import Source, configured
from desim_uav.scenario.schema import Scenario
from desim_uav.spaces import action_space, features, observation_space
from desim_uav.world import World, build_world

MODES = (AutoresetMode.NEXT_STEP, AutoresetMode.SAME_STEP)


class UavVectorEnv(VectorEnv[NDArray[Any], NDArray[Any], NDArray[Any]]):
    """``num_envs`` environments like ``UavEnv``, in the compiled engine.

    Environment k gives the numbers that ``UavEnv`` gives with its seed, bit for bit, whatever the
    number of ``threads``. ``reset(seed=s)`` gives it the seed s + k, a list each its own; a world
    is drawn from the seed, too, unless the scenario has a ``world_seed``: then all fly in that one,
    which takes less memory. Infos are arrays, one entry an environment: those of ``UavEnv``, the
    masks among them as ``action_mask`` (num_envs, drones * actions). An environment whose episode
    is over begins the next one in the next step (``AutoresetMode.NEXT_STEP``, in which its action
    counts for nothing and its reward is 0), or in the same step (``SAME_STEP``), which shows the
    end as ``final_obs`` and ``final_info``.
    """

    def __init__(
        self,
        scenario: Source,
        num_envs: int,
        config: Mapping[str, Any] | None = None,
        autoreset_mode: AutoresetMode = AutoresetMode.NEXT_STEP,
        threads: int = 1,
    ) -> None:
        """``scenario`` and ``config`` as in ``UavEnv``.

        Raises ScenarioError with every problem of them, also where a component has no kernel, and
        gymnasium's Error for another number or mode.
        """
        if num_envs < 1 or not threads >= 1:
            raise error.Error(f"num_envs {num_envs}, threads {threads}: must be 1 or more")
        if autoreset_mode not in MODES:
            raise error.Error(f"autoreset_mode {autoreset_mode}: must be one of {list(MODES)}")
        self.num_envs = num_envs
        self.autoreset_mode = autoreset_mode
        self.metadata = {"autoreset_mode": autoreset_mode}
        chosen = configured(scenario, config)
        worlds = _Worlds()
        sessions = [
            CompiledSession(chosen, worlds=worlds, starts=k == 0, ahead=False)
            for k in range(num_envs)
        ]
        self.compiled = Compiled(sessions, min(threads, num_envs))
        world, drones = sessions[0].world, chosen.drones.count
        self.single_observation_space = observation_space(features(world) * drones)
        self.single_action_space = action_space(len(world.actions), drones)
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)
        self._all = np.ones(num_envs, np.bool_)
        self._begun = False

    def reset(
        self,
        *,
        seed: int | Sequence[int | None] | None = None,
        options: dict[str, Any] | None = None,
    ) -> tuple[NDArray[Any], dict[str, Any]]:
        """Begin the next episode everywhere; with seeds, the first of new runs.

        There are no ``options``.
        """
        count = self.num_envs
        if seed is None:
            seeds: list[int | None] = [None] * count
        elif isinstance(seed, int | np.integer):
            seeds = [int(seed) + k for k in range(count)]
        else:
            seeds = list(seed)
        if len(seeds) != count:
            raise error.Error(f"{len(seeds)} seeds for {count} environments")
        self.compiled.begin(self._all, seeds)
        self._begun = True
        return self._observations(), self._infos(self.compiled.info())

    def step(
        self, actions: NDArray[Any]
    ) -> tuple[
        NDArray[Any], NDArray[np.float64], NDArray[np.bool_], NDArray[np.bool_], dict[str, Any]
    ]:
        """An action for each environment: (num_envs, drones), or (num_envs,) of a single drone.

        Raises ResetNeeded before the first reset, ActionError for what is no action.
        """
        if not self._begun:
            raise error.ResetNeeded("call reset first: no episode has begun")
        compiled = self.compiled
        commands = compiled.commands(actions)
        over = compiled.over[:, 0] | compiled.over[:, 1]
        compiled.step(commands, np.logical_not(over))
        if over.any():
            self._begin(over)
            compiled.rewards[over] = 0.0
        rewards, terminated = compiled.rewards.copy(), compiled.over[:, 0].copy()
        truncated = compiled.over[:, 1].copy()
        final: dict[str, Any] = {}
        if self.autoreset_mode is AutoresetMode.SAME_STEP:
            ended = terminated | truncated
            if ended.any():
                final = self._final(ended)
                self._begin(ended)
        return (
            self._observations(),
            rewards,
            terminated,
            truncated,
            {**final, **self._infos(compiled.info())},
        )

    def action_masks(self) -> NDArray[np.bool_]:
        """The masks, (num_envs, drones * actions)."""
        return self.compiled.masks.astype(np.bool_)

    def close_extras(self, **kwargs: Any) -> None:
        """End the threads. Gymnasium below 1.3 also closes what could not be made."""
        if hasattr(self, "compiled"):
            self.compiled.close()

    def _begin(self, which: NDArray[np.bool_]) -> None:
        self.compiled.begin(which, [None] * self.num_envs)

    def _observations(self) -> NDArray[Any]:
        return self.compiled.values.astype(self.compiled.dtype)

    def _infos(self, told: dict[str, NDArray[Any]]) -> dict[str, Any]:
        """As Gymnasium has them: beside each key, which environments it is told of."""
        return {
            name: value
            for key, array in told.items()
            for name, value in ((key, array), (f"_{key}", self._all.copy()))
        }

    def _final(self, ended: NDArray[np.bool_]) -> dict[str, Any]:
        """The observations and infos of episodes that have ended, as Gymnasium has them."""
        observations = np.full(self.num_envs, None, object)
        for k, shown in zip(ended.nonzero()[0], self._observations()[ended], strict=True):
            observations[k] = shown
        told = {}
        for key, array in self.compiled.info().items():
            array[~ended] = 0
            told[key], told[f"_{key}"] = array, ended.copy()
        return {
            "final_obs": observations,
            "_final_obs": ended.copy(),
            "final_info": told,
            "_final_info": ended.copy(),
        }


class _Worlds:
    """Builds each world once, as long as somebody flies in it."""

    def __init__(self) -> None:
        self._shared: tuple[int, World] | None = None

    def __call__(self, scenario: Scenario, seed: int) -> World:
        if scenario.world_seed is None:
            return build_world(scenario, seed)
        if self._shared is None or self._shared[0] != seed:
            self._shared = seed, build_world(scenario, seed)
        return self._shared[1]
