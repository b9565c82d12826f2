"""Gymnasium's vector environment: many environments of one scenario, which one call steps."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from itertools import pairwise
from typing import Any

import numpy as np
from gymnasium import error, logger
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space
from numpy.typing import NDArray

from desim_uav.copies import Independent
from desim_uav.engine.compiled import calls
from desim_uav.env.compiled import COUNTED, MEASURED, CompiledSession, Outputs
from desim_uav.env.configure import Source, WorldSeed, configured
from desim_uav.env.render import RENDERING, Screen
from desim_uav.env.saving_vector import VectorSaving
from desim_uav.env.session import out_of_range, whole_numbers
from desim_uav.spaces import action_space, features, observation_space


class UavVectorEnv(VectorSaving, Independent, VectorEnv[NDArray[Any], NDArray[Any], NDArray[Any]]):
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
        first = CompiledSession(chosen, draws_ahead=False)
        others = [CompiledSession(chosen, first.world, False) for _ in range(num_envs - 1)]
        self.sessions = [first, *others]
        self.threads = min(threads, num_envs)
        self.screens = [Screen(session, render_mode) for session in self.sessions if render_mode]
        self.single_observation_space = observation_space(features(first.world) * first.drones)
        self.single_action_space = action_space(len(first.world.actions), first.drones)
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)
        self._all = np.ones(num_envs, np.bool_)
        self._set_up()

    def _set_up(self) -> None:
        """Make the arrays and threads, which are this object's own."""
        self.outputs = Outputs.of(self.sessions[0], self.num_envs)
        for k, session in enumerate(self.sessions):
            session.write_to(self.outputs, k)
        self._seeds = np.array([session.seeds() for session in self.sessions])
        bounds = np.linspace(0, self.num_envs, self.threads + 1).astype(int).tolist()
        self._shares = [slice(*pair) for pair in pairwise(bounds)]
        self._pool = ThreadPoolExecutor(self.threads) if self.threads > 1 else None

    def __getstate__(self) -> dict[str, Any]:
        """Return everything except arrays and threads, which a copy makes again."""
        own = ("outputs", "_seeds", "_shares", "_pool")
        return {key: part for key, part in vars(self).items() if key not in own}

    def __setstate__(self, kept: dict[str, Any]) -> None:
        """Restore the attributes, with arrays and threads of this object's own."""
        vars(self).update(kept)
        self._set_up()

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
        which = self._reset_mask(options)
        if seed is None or isinstance(seed, int | np.integer):
            seeds = [None if seed is None else int(seed) + k for k in range(self.num_envs)]
        else:
            seeds = list(seed)
        if len(seeds) != self.num_envs:
            raise error.Error(f"there are {len(seeds)} seeds for {self.num_envs} environments")
        self._begin(which, seeds)
        return self._observations(), self.infos(which)

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
        over = self._over()
        self._require_episodes(over)
        count, drones = self.num_envs, self.sessions[0].drones
        shapes = [(count,), (count, 1)] if drones == 1 else [(count, drones)]
        self._advance(whole_numbers(actions, *shapes).reshape(count, drones), ~over)
        if over.any():
            self._begin(over)
        rewards = self.outputs.rewards[:, 0].copy()
        terminated, truncated = self.outputs.over[:, :2].T.copy()
        final: dict[str, Any] = {}
        if self.autoreset_mode is AutoresetMode.SAME_STEP:
            ended = self._over()
            if ended.any():
                final = self._final(ended)
                self._begin(ended)
        infos = {**final, **self.infos(self._all)}
        return self._observations(), rewards, terminated, truncated, infos

    def infos(self, which: NDArray[np.bool_]) -> dict[str, Any]:
        """Return the present infos in Gymnasium's form.

        Each key has beside it, after an underscore, the mask ``which`` of the environments that
        have it; the entries of the others are 0.
        """
        numbers, seeds = self.outputs.numbers.T.copy(), self._seeds.T.copy()
        measures, counts, terms = numbers[:MEASURED], numbers[MEASURED:COUNTED], numbers[COUNTED:]
        columns = (*measures, *seeds, *counts.astype(np.int64), *terms)
        arrays = dict(zip(self.sessions[0].keys, columns, strict=True))
        infos: dict[str, Any] = {}
        for key, array in {**arrays, "action_mask": self.outputs.masks.copy()}.items():
            array[~which] = 0
            infos[key], infos[f"_{key}"] = array, which.copy()
        return infos

    def render(self) -> tuple[NDArray[np.uint8], ...] | None:
        """Return the frame of each environment, (height, width, 3), or None without render mode."""
        if self.render_mode is None:
            logger.warn("render() shows nothing without render_mode='rgb_array'")
            return None
        return tuple(screen.frame() for screen in self.screens)

    def action_masks(self) -> NDArray[np.bool_]:
        """Return the masks, bool (num_envs, drones * actions)."""
        return self.outputs.masks.astype(np.bool_)

    def close_extras(self, **kwargs: Any) -> None:
        """Stop the threads. Gymnasium below 1.3 also closes an environment that was not made."""
        pool = getattr(self, "_pool", None)
        if pool is not None:
            pool.shutdown()

    def _reset_mask(self, options: dict[str, Any] | None) -> NDArray[np.bool_]:
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

    def _over(self) -> NDArray[np.bool_]:
        """Return a mask of the environments whose episodes are over."""
        over: NDArray[np.bool_] = self.outputs.over[:, 0] | self.outputs.over[:, 1]
        return over

    def _require_episodes(self, over: NDArray[np.bool_]) -> None:
        """Raise ResetNeeded if there is an environment that cannot be stepped."""
        waiting = self._seeds[:, 2] < 0
        if waiting.any():
            which = np.flatnonzero(waiting).tolist()
            raise error.ResetNeeded(f"call reset first: no episode has begun in {which}")
        if self.autoreset_mode is AutoresetMode.DISABLED and over.any():
            which = np.flatnonzero(over).tolist()
            raise error.ResetNeeded(f"call reset first: the episode is over in {which}")

    def _begin(self, which: NDArray[np.bool_], seeds: Sequence[int | None] | None = None) -> None:
        """Begin the next episode of the environments ``which``; with seeds, new runs."""
        for k in np.flatnonzero(which).tolist():
            session = self.sessions[k]
            session.reset(None if seeds is None else seeds[k])
            self._seeds[k] = session.seeds()

    def _advance(self, commands: NDArray[np.int64], which: NDArray[np.bool_]) -> None:
        """Give the environments ``which`` their commands, and run each to its next epoch."""
        world, table = self.sessions[0].world, self.outputs.addresses
        if self._pool is None:
            stopped = calls.step_all(table, commands, which)
        elif commands.min() < 0 or commands.max() >= len(world.actions):
            stopped = -1  # before any thread has begun
        else:
            arrays = table, commands, which
            parts = [[array[share] for share in self._shares] for array in arrays]
            stopped = sum(self._pool.map(calls.step_all, *parts))
        if stopped < 0:
            raise out_of_range(commands.tolist(), world)
        if stopped > 0:
            for k in np.flatnonzero(self.outputs.over[:, 2]).tolist():
                self.sessions[k].go_on()

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


def _mode(mode: AutoresetMode | str) -> AutoresetMode:
    """Return the autoreset mode of this name or value. Raises gymnasium's Error."""
    try:
        return AutoresetMode(mode)
    except ValueError as problem:
        modes = ", ".join(repr(one.value) for one in AutoresetMode)
        raise error.Error(f"autoreset_mode {mode!r}: must be one of {modes}") from problem
