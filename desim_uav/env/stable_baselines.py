"""A vector environment for stable-baselines3 on top of ``UavVectorEnv`` (extra ``sb3``)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from os import PathLike
from typing import Any, Self

import numpy as np
from gymnasium.spaces import MultiDiscrete, flatten_space
from gymnasium.vector import AutoresetMode
from numpy.typing import NDArray

from desim_uav.copies import Independent
from desim_uav.env.arguments import typed
from desim_uav.env.configure import Source, WorldSeed
from desim_uav.env.saving import EnvState
from desim_uav.env.tasks import Curriculum, TaskChange
from desim_uav.env.vector import UavVectorEnv
from desim_uav.errors import MissingExtraError

try:
    from stable_baselines3.common.vec_env import VecEnv
except ImportError as missing:
    raise MissingExtraError("UavVecEnv", "sb3") from missing

FINAL = "final_"
"""The prefix of info keys that exist only at the end of an episode."""


class UavVecEnv(Independent, VecEnv):
    """``num_envs`` environments for stable-baselines3 and sb3-contrib, MaskablePPO among them.

    The step that ends an episode also begins the next one; that environment's info then holds the
    last observation as ``terminal_observation``. ``TimeLimit.truncated`` is in the info of every
    step, as stable-baselines3's own vector environments have it. ``seed(s)`` counts from the next
    reset on: environment k has the seed s + k.

    Copies and pickles are independent environments (see ``UavEnv``) with threads of their own.
    """

    @typed
    def __init__(
        self,
        scenario: Source,
        num_envs: int,
        config: Mapping[str, Any] | None = None,
        threads: int = 1,
        render_mode: str | None = None,
        world_seed: WorldSeed = "scenario",
        curriculum: Curriculum | Sequence[TaskChange] | None = None,
        one_hot: bool = False,
    ) -> None:
        """Make the environments; other parameters and errors are those of ``UavVectorEnv``.

        With ``one_hot``, whole numbers that are observed, as those of ``position`` are, become
        one-hot vectors in a Box of float32, which RecurrentPPO, ``VecNormalize`` and
        ``VecFrameStack`` need.

        Raises ScenarioError for decisions by event too, because the learners of stable-baselines3
        discount each transition by the same factor.
        """
        mode = AutoresetMode.SAME_STEP
        self.vector = UavVectorEnv(
            scenario, num_envs, config, mode, threads, render_mode, world_seed, curriculum
        )
        self.actions: NDArray[Any] | None = None
        vector = self.vector
        vector.sessions[0].tasks.require_one_discount("stable-baselines3")
        seen = vector.single_observation_space
        self._numbers = seen if one_hot and isinstance(seen, MultiDiscrete) else None
        shown = flatten_space(seen) if self._numbers is not None else seen
        super().__init__(num_envs, shown, vector.single_action_space)

    def reset(self) -> NDArray[Any]:
        """Begin the next episode everywhere, or new runs if ``seed`` has been called."""
        observations, infos = self.vector.reset(seed=self._seeds)
        self.reset_infos = self._each(infos)
        self._reset_seeds()
        self._reset_options()
        return self._shown(observations)

    def step_async(self, actions: NDArray[Any]) -> None:
        """Store the actions of the next step."""
        self.actions = actions

    def step_wait(
        self,
    ) -> tuple[NDArray[Any], NDArray[np.float32], NDArray[np.bool_], list[dict[str, Any]]]:
        """Step all environments with the stored actions."""
        observations, rewards, terminated, truncated, all_infos = self.vector.step(
            np.asarray(self.actions)
        )
        infos = self._each(all_infos)
        ended = np.logical_or(terminated, truncated)
        last = self._each(all_infos["final_info"]) if ended.any() else []
        for k in ended.nonzero()[0].tolist():
            self.reset_infos[k], infos[k] = infos[k], last[k]
            infos[k]["terminal_observation"] = self._shown(all_infos["final_obs"][k])
        cut = np.logical_and(truncated, np.logical_not(terminated)).tolist()
        for k, info in enumerate(infos):
            info["TimeLimit.truncated"] = cut[k]
        return self._shown(observations), rewards.astype(np.float32), ended, infos

    @typed
    def save(self, k: int = 0) -> EnvState:
        """Return the state of environment k. Raises ResetNeeded before its first episode."""
        return self.vector.save(k)

    @typed
    def restore(
        self, state: EnvState | str | PathLike[str], which: int | Sequence[int] | None = None
    ) -> NDArray[Any]:
        """Let environments go on from a saved state, or from its file (see ``UavVectorEnv``).

        Returns the observations of all environments.
        """
        observations, infos = self.vector.restore(state, which)
        has_seed = infos["_seed"].tolist()
        for k, info in enumerate(self._each(infos)):
            if has_seed[k]:
                self.reset_infos[k] = info
        return self._shown(observations)

    @typed
    def fork(self, count: int, k: int = 0) -> Self:
        """Return new environments, this many, in the state of environment k."""
        other = type(self).__new__(type(self))
        other.vector, other.actions = self.vector.fork(count, k), None
        other._numbers = self._numbers
        VecEnv.__init__(other, count, self.observation_space, self.action_space)
        other.reset_infos = other._each(other.vector.infos(np.ones(count, np.bool_)))
        return other

    def get_images(self) -> Sequence[NDArray[np.uint8] | None]:
        """Return the present frame of each environment; ``render`` tiles them."""
        return self.vector.render() or [None] * self.num_envs

    def close(self) -> None:
        """Stop the threads."""
        self.vector.close()

    def get_attr(self, attr_name: str, indices: Any = None) -> list[Any]:
        """Return the attribute of ``UavVectorEnv`` with this name, once per environment."""
        if attr_name == "action_masks":
            return [None for _ in self._get_indices(indices)]
        return [getattr(self.vector, attr_name) for _ in self._get_indices(indices)]

    def set_attr(self, attr_name: str, value: object, indices: object = None) -> None:
        """Raise AttributeError, because environments cannot be changed after construction."""
        raise AttributeError(f"{attr_name}: attributes cannot be set; make a new UavVecEnv")

    def env_method(
        self, method_name: str, *method_args: Any, indices: Any = None, **method_kwargs: Any
    ) -> list[Any]:
        """Call ``action_masks`` of each environment. Raises AttributeError for other methods."""
        if method_name != "action_masks":
            raise AttributeError(f"{method_name}: only action_masks can be called")
        masks = self.vector.action_masks()
        return [masks[k] for k in self._get_indices(indices)]

    def env_is_wrapped(self, wrapper_class: type, indices: Any = None) -> list[bool]:
        """Return False for each environment, because none is wrapped."""
        return [False for _ in self._get_indices(indices)]

    def _shown(self, observations: NDArray[Any]) -> NDArray[Any]:
        """Return observations (…, numbers), whole numbers as one-hot vectors if these are shown."""
        if self._numbers is None:
            return observations
        sizes = self._numbers.nvec
        ones = np.cumsum(sizes) - sizes + (observations - self._numbers.start)
        shown = np.zeros((*observations.shape[:-1], int(sizes.sum())), np.float32)
        np.put_along_axis(shown, ones, 1.0, axis=-1)
        return shown

    def _each(self, infos: dict[str, Any]) -> list[dict[str, Any]]:
        """Return the infos as one dict per environment, with Python numbers."""
        plain = {
            key: list(values) if values.ndim > 1 else values.tolist()
            for key, values in infos.items()
            if not key.startswith(("_", FINAL))
        }
        rows: Sequence[tuple[Any, ...]] = list(zip(*plain.values(), strict=True))
        return [dict(zip(plain, row, strict=True)) for row in rows]
