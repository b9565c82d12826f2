"""A scenario as a task of BenchMARL, with all its environments in one compiled batch."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any, Self

import torch
from benchmarl.environments.common import TaskClass
from tensordict import TensorDictBase
from torchrl.data import Categorical, Composite
from torchrl.envs import EnvBase, ObservationNorm, Transform

from desim_uav.env.configure import Source, WorldSeed
from desim_uav.env.tasks import Curriculum, TaskChange
from desim_uav.env.torchrl import GROUP, UavTorchEnv
from desim_uav.policies.mlp import scaling_of

FIRST_SEED = 2**40
"""What is added to the seed of an experiment, so that no run of one's own has its seeds."""


class UavTask(TaskClass):  # type: ignore[misc]
    """A scenario as a task; ``config`` holds the arguments of ``UavTorchEnv`` (see ``of``).

    All drones are one group, ``"drone"``, with masks, their own rewards, and the whole state of
    the simulation as global state for critics and mixers. No step is skipped, also where a drone
    has no choice, so that a discount per step is one per time: what is ``elapsed_steps`` later is
    discounted by gamma to this power. Decisions by event are refused, because the algorithms of
    BenchMARL discount each transition by the same factor.
    """

    @classmethod
    def of(
        cls,
        scenario: Source,
        config: Mapping[str, Any] | None = None,
        world_seed: WorldSeed = "scenario",
        threads: int = 1,
        render_mode: str | None = None,
        curriculum: Curriculum | Sequence[TaskChange] | None = None,
    ) -> Self:
        """Return the task of a scenario: a file, a shipped name, a mapping or a Scenario.

        ``config`` are changes to it, such as another observation or reward. The parameters are
        those of ``UavTorchEnv``, which raises the errors when an experiment makes environments.
        """
        settings = {
            "scenario": scenario,
            "config": dict(config or {}),
            "world_seed": world_seed,
            "threads": threads,
            "render_mode": render_mode,
            "curriculum": curriculum,
        }
        name = scenario if isinstance(scenario, str) else getattr(scenario, "name", "scenario")
        return cls(str(name), settings)

    @staticmethod
    def env_name() -> str:
        """Return the name of the environment in the tables of BenchMARL."""
        return "desim_uav"

    def get_env_fun(
        self, num_envs: int, continuous_actions: bool, seed: int | None, device: object
    ) -> Callable[[], EnvBase]:
        """Return a function that makes a batch of ``num_envs`` environments."""
        first = None if seed is None else FIRST_SEED + seed * num_envs

        def make() -> EnvBase:
            env = UavTorchEnv(num_envs=num_envs, seed=first, device=device, **self.config)
            env.vector.sessions[0].scenario.require_cells("a task of BenchMARL")
            env.vector.sessions[0].tasks.require_one_discount("BenchMARL")
            return env

        return make

    def supports_continuous_actions(self) -> bool:
        """Return False: actions are discrete."""
        return False

    def supports_discrete_actions(self) -> bool:
        """Return True: actions are discrete."""
        return True

    def has_state(self) -> bool:
        """Return True: there is a global state."""
        return True

    def has_render(self, env: EnvBase) -> bool:
        """Return whether the environments were asked for frames."""
        return env.vector.render_mode is not None

    def max_steps(self, env: EnvBase) -> int:
        """Return the steps of an episode."""
        return int(env.vector.sessions[0].scenario.episode.steps)

    def group_map(self, env: EnvBase) -> dict[str, list[str]]:
        """Return the names of all drones, which are one group."""
        return {GROUP: list(env.vector.possible_agents)}

    def observation_spec(self, env: EnvBase) -> Composite:
        """Return what the networks see."""
        return self._of_group(env, "observation")

    def action_mask_spec(self, env: EnvBase) -> Composite:
        """Return what says which actions are allowed."""
        return self._of_group(env, "action_mask")

    def info_spec(self, env: EnvBase) -> Composite:
        """Return what is logged of each drone."""
        return self._of_group(env, "info")

    def state_spec(self, env: EnvBase) -> Composite:
        """Return the whole state of the simulation."""
        return Composite({"state": env.full_observation_spec_unbatched["state"].clone()})

    def action_spec(self, env: EnvBase) -> Composite:
        """Return the action of each drone."""
        drones, actions = env.vector.drones, int(env.vector.single_action_space.n)
        action = Categorical(actions, (drones,), device=env.device)
        return Composite({GROUP: Composite({"action": action}, shape=(drones,))})

    def get_env_transforms(self, env: EnvBase) -> list[Transform]:
        """Return the scaling of observations, which is that of policy files (``scaling_of``)."""
        low, scale = (torch.from_numpy(one) for one in scaling_of(env.vector.sessions[0].world))
        return [ObservationNorm(-low * scale, scale, in_keys=[(GROUP, "observation")])]

    @staticmethod
    def log_info(batch: TensorDictBase) -> dict[str, float]:
        """Return the quality of experience of the episodes that end in a batch, for the logs.

        QoE1 is over all requests of these episodes, QoE3 and the crashes are means over episodes.
        """
        over = batch["next", "done"].squeeze(-1)
        if not over.any():
            return {}
        infos, own = batch["next", "info"][over], batch["next", GROUP, "info"][over]
        requests = infos["requests"].float()
        served = (infos["qoe1_percent"] * requests).sum()
        return {
            "collection/episode/qoe1_percent": float(served / requests.sum().clamp(min=1)),
            "collection/episode/qoe3_percent": float(infos["qoe3_percent"].mean()),
            "collection/episode/crashes": float(own["crashes"].sum(-1).float().mean()),
        }

    @staticmethod
    def render_callback(experiment: object, env: EnvBase, data: TensorDictBase) -> Any:
        """Return the present frame of the first environment, (height, width, 3)."""
        return torch.from_numpy(env.render()[0])

    def _of_group(self, env: EnvBase, key: str) -> Composite:
        spec = env.full_observation_spec_unbatched[GROUP, key].clone()
        return Composite({GROUP: Composite({key: spec}, shape=(env.vector.drones,))})
