"""Gymnasium's vector environment: many environments of one scenario, which one call steps."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from gymnasium import error, logger
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space
from numpy.typing import NDArray

from desim_uav.copies import Independent
from desim_uav.env.compiled import Compiled, CompiledSession
from desim_uav.env.configure import Source, WorldSeed, configured
from desim_uav.env.render import RENDERING, Screen
from desim_uav.scenario.schema import Scenario
from desim_uav.spaces import action_space, features, observation_space
from desim_uav.world import World, build_world


class UavVectorEnv(Independent, VectorEnv[NDArray[Any], NDArray[Any], NDArray[Any]]):
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

    def __init__(
        self,
        scenario: Source,
        num_envs: int,
        config: Mapping[str, Any] | None = None,
        autoreset_mode: AutoresetMode | str = AutoresetMode.NEXT_STEP,
        threads: int = 1,
        render_mode: str | None = None,
        world_seed: WorldSeed = "scenario",
    ) -> None:
        """Make ``num_envs`` environments of a scenario.

        ``scenario``, ``config`` and ``world_seed`` are as in ``UavEnv``. ``render_mode``: None or
        "rgb_array". ``threads``: the number of threads that share the environments.

        Raises ScenarioError with every problem of the scenario, and for a component that cannot be
        compiled; UnsupportedMode for another render mode; gymnasium's Error for another autoreset
        mode, or if ``num_envs`` or ``threads`` is below 1.
        """
        if num_envs < 1 or not threads >= 1:
            raise error.Error(f"num_envs {num_envs}, threads {threads}: must be 1 or more")
        if render_mode not in (None, "rgb_array"):
            raise error.UnsupportedMode(
                f"render_mode {render_mode!r}: must be None or 'rgb_array'; only a single "
                "environment opens a window"
            )
        self.num_envs = num_envs
        self.render_mode = render_mode
        self.autoreset_mode = _mode(autoreset_mode)
        self.metadata = {**type(self).metadata, "autoreset_mode": self.autoreset_mode}
        chosen = configured(scenario, config, world_seed)
        worlds = _Worlds()
        sessions = [
            CompiledSession(chosen, worlds=worlds, starts=k == 0, ahead=False)
            for k in range(num_envs)
        ]
        self.compiled = Compiled(sessions, min(threads, num_envs))
        self.screens = [Screen(session, render_mode) for session in sessions]
        world, drones = sessions[0].world, chosen.drones.count
        self.single_observation_space = observation_space(features(world) * drones)
        self.single_action_space = action_space(len(world.actions), drones)
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)
        self._all = np.ones(num_envs, np.bool_)
        self._begun = np.zeros(num_envs, np.bool_)

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
        which = self._named(options)
        count = self.num_envs
        if seed is None:
            seeds: list[int | None] = [None] * count
        elif isinstance(seed, int | np.integer):
            seeds = [int(seed) + k for k in range(count)]
        else:
            seeds = list(seed)
        if len(seeds) != count:
            raise error.Error(f"there are {len(seeds)} seeds for {count} environments")
        self.compiled.begin(which, seeds)
        self._begun |= which
        return self._observations(), _infos(self.compiled.info(), which)

    def step(
        self, actions: NDArray[Any]
    ) -> tuple[
        NDArray[Any], NDArray[np.float64], NDArray[np.bool_], NDArray[np.bool_], dict[str, Any]
    ]:
        """Take the actions (num_envs, drones), or (num_envs,) with a single drone each.

        Raises ResetNeeded before the first reset of an environment and, with
        ``AutoresetMode.DISABLED``, after the end of its episode, and ActionError for an invalid
        action. No environment is stepped in these cases.
        """
        compiled = self.compiled
        over = compiled.over[:, 0] | compiled.over[:, 1]
        self._require_episodes(over)
        commands = compiled.commands(actions)
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
            {**final, **_infos(compiled.info(), self._all)},
        )

    def render(self) -> tuple[NDArray[np.uint8], ...] | None:
        """Return the frame of each environment, (height, width, 3), or None without render mode."""
        if self.render_mode is None:
            logger.warn("render() shows nothing without render_mode='rgb_array'")
            return None
        return tuple(screen.frame() for screen in self.screens)

    def action_masks(self) -> NDArray[np.bool_]:
        """Return the masks, bool (num_envs, drones * actions)."""
        return self.compiled.masks.astype(np.bool_)

    def close_extras(self, **kwargs: Any) -> None:
        """Stop the threads. Gymnasium below 1.3 also closes an environment that was not made."""
        if hasattr(self, "compiled"):
            self.compiled.close()

    def _named(self, options: dict[str, Any] | None) -> NDArray[np.bool_]:
        """Return the mask of the environments that a reset concerns."""
        if not options or "reset_mask" not in options:
            return self._all
        mask = np.asarray(options["reset_mask"])
        if mask.dtype != np.bool_ or mask.shape != (self.num_envs,) or not mask.any():
            raise error.Error(
                f"reset_mask {mask.tolist()}: must be an array of {self.num_envs} bool, "
                "at least one of them True"
            )
        return mask

    def _require_episodes(self, over: NDArray[np.bool_]) -> None:
        """Raise ResetNeeded if there is an environment that cannot be stepped."""
        if not self._begun.all():
            which = np.flatnonzero(~self._begun).tolist()
            raise error.ResetNeeded(f"call reset first: no episode has begun in {which}")
        if self.autoreset_mode is AutoresetMode.DISABLED and over.any():
            which = np.flatnonzero(over).tolist()
            raise error.ResetNeeded(f"call reset first: the episode is over in {which}")

    def _begin(self, which: NDArray[np.bool_]) -> None:
        self.compiled.begin(which, [None] * self.num_envs)

    def _observations(self) -> NDArray[Any]:
        return self.compiled.values.astype(self.compiled.dtype)

    def _final(self, ended: NDArray[np.bool_]) -> dict[str, Any]:
        """Return the last observations and infos of ended episodes, under Gymnasium's keys."""
        observations = np.full(self.num_envs, None, object)
        for k, shown in zip(ended.nonzero()[0], self._observations()[ended], strict=True):
            observations[k] = shown
        return {
            "final_obs": observations,
            "_final_obs": ended.copy(),
            "final_info": _infos(self.compiled.info(), ended),
            "_final_info": ended.copy(),
        }


def _mode(mode: AutoresetMode | str) -> AutoresetMode:
    """Return the autoreset mode of this name or value. Raises gymnasium's Error."""
    try:
        return AutoresetMode(mode)
    except ValueError as problem:
        modes = ", ".join(repr(one.value) for one in AutoresetMode)
        raise error.Error(f"autoreset_mode {mode!r}: must be one of {modes}") from problem


def _infos(told: dict[str, NDArray[Any]], which: NDArray[np.bool_]) -> dict[str, Any]:
    """Return infos in Gymnasium's form: next to each key, a mask of the environments that have it.

    The entries of the other environments are 0.
    """
    infos: dict[str, Any] = {}
    for key, array in told.items():
        array[~which] = 0
        infos[key], infos[f"_{key}"] = array, which.copy()
    return infos


class _Worlds:
    """Builds worlds, and lets environments with the same world seed share one."""

    def __init__(self) -> None:
        self._shared: tuple[int, World] | None = None

    def __call__(self, scenario: Scenario, seed: int) -> World:
        if scenario.world_seed is None:
            return build_world(scenario, seed)
        if self._shared is None or self._shared[0] != seed:
            self._shared = seed, build_world(scenario, seed)
        return self._shared[1]
