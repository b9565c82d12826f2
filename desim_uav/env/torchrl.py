"""Many environments of one scenario as one environment of TorchRL (extra ``torchrl``)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from gymnasium.spaces import Box
from gymnasium.vector import AutoresetMode
from numpy.typing import NDArray

from desim_uav.env.configure import Source, WorldSeed
from desim_uav.env.parallel_vector import UavParallelVectorEnv
from desim_uav.env.tasks import Curriculum, TaskChange
from desim_uav.errors import MissingExtraError
from desim_uav.spaces import features

try:
    import torch
    from tensordict import TensorDict, TensorDictBase
    from torchrl.data import Bounded, Categorical, Composite, Unbounded
    from torchrl.envs import EnvBase
except ImportError as missing:
    raise MissingExtraError("UavTorchEnv", "torchrl") from missing

GROUP = "drone"
"""The group of all drones, named as TorchRL names it for ``UavParallelEnv``."""

ENDS = ("done", "terminated", "truncated")


class UavTorchEnv(EnvBase):  # type: ignore[misc]
    """``num_envs`` environments in the compiled engine, with batch size (num_envs,).

    Under ``"drone"`` stand ``observation``, float32 (num_envs, drones, features), ``action_mask``,
    bool (num_envs, drones, actions), ``action``, int64 (num_envs, drones), ``reward``, float32
    (num_envs, drones, 1), and ``info``. At the root stand ``state``, the whole state, float32
    (num_envs, numbers), ``info`` with what all drones share, and ``done``, ``terminated`` and
    ``truncated``, (num_envs, 1), because the episodes of all drones end together.

    In free flight, ``action`` has the numbers of commands, from -1 to 1, float32 (num_envs, drones,
    numbers), and the mask is called ``allowed``, because it does not mask these numbers. A fleet in
    which only some types fly freely is refused.

    The values are those of ``UavParallelVectorEnv`` (the attribute ``vector``), bit for bit where
    float32 holds them. ``set_seed(s)`` counts from the next reset of all environments on:
    environment k has the seed s + k. ``rand_action`` chooses among the allowed actions, or draws
    numbers. Environments whose episodes have ended are begun again by ``reset`` with a ``_reset``
    mask, as TorchRL's rollouts and collectors do.
    """

    def __init__(
        self,
        scenario: Source,
        num_envs: int,
        config: Mapping[str, Any] | None = None,
        threads: int = 1,
        render_mode: str | None = None,
        world_seed: WorldSeed = "scenario",
        curriculum: Curriculum | Sequence[TaskChange] | None = None,
        seed: int | None = None,
        device: Any = "cpu",
    ) -> None:
        """Make the environments of a scenario.

        ``seed`` is that of the first reset, and ``device`` where the tensors are. The other
        parameters and the errors are those of ``UavParallelVectorEnv``.
        """
        super().__init__(device=torch.device(device), batch_size=torch.Size([num_envs]))
        self.vector = UavParallelVectorEnv(
            scenario,
            num_envs,
            config,
            AutoresetMode.DISABLED,
            threads,
            render_mode,
            world_seed,
            curriculum=curriculum,
        )
        self.group_map = {GROUP: self.vector.possible_agents}
        self._next_seed = seed
        self._set_specs()

    def _set_specs(self) -> None:
        vector = self.vector
        count, drones = vector.num_envs, vector.drones
        world = vector.sessions[0].world
        columns, actions = features(world), len(world.actions)
        low, high = (
            torch.tensor([getattr(feature, end) for feature in columns], dtype=torch.float32)
            for end in ("low", "high")
        )
        shape = (count, drones, len(columns))
        of_all = (count, len(vector.state_names))
        mask = Categorical(2, (count, drones, actions), dtype=torch.bool)
        ends = {name: Categorical(2, (count, 1), dtype=torch.bool) for name in ENDS}
        own, shared = self._infos(vector.infos())
        group = {
            "observation": Bounded(low.expand(shape), high.expand(shape), shape),
            self._mask_name: mask,
            "info": _unbounded(own),
        }
        self.observation_spec = self._spec(
            group, state=Bounded(0.0, 1.0, of_all, dtype=torch.float32), info=_unbounded(shared)
        )
        self.action_spec = self._spec({"action": self._action_spec()})
        self.reward_spec = self._spec({"reward": Unbounded((count, drones, 1))})
        self.done_spec = Composite(ends, shape=(count,)).to(self.device)

    @property
    def _mask_name(self) -> str:
        """The key of the masks."""
        return self.vector.commands.mask_key

    def _action_spec(self) -> Any:
        """Return the spec of the actions of all drones."""
        space = self.vector.action_space
        if isinstance(space, Box):
            return Bounded(-1.0, 1.0, space.shape, dtype=torch.float32)
        return Categorical(len(self.vector.commands.actions), space.shape)

    def _spec(self, of_drones: dict[str, Any], **others: Any) -> Composite:
        group = Composite(of_drones, shape=(self.vector.num_envs, self.vector.drones))
        return Composite({GROUP: group, **others}, shape=(self.vector.num_envs,)).to(self.device)

    # ---- what TorchRL calls

    def _set_seed(self, seed: int | None) -> None:
        self._next_seed = seed

    def _reset(self, tensordict: TensorDictBase | None = None, **_: Any) -> TensorDictBase:
        which = None if tensordict is None else tensordict.get("_reset", None)
        if which is None or which.all():
            seed, self._next_seed = self._next_seed, None
            observations, infos = self.vector.reset(seed=seed)
        else:
            mask = which.reshape(-1).cpu().numpy()
            observations, infos = self.vector.reset(options={"reset_mask": mask})
        return self._content(observations, infos)

    def _step(self, tensordict: TensorDictBase) -> TensorDictBase:
        actions = tensordict[GROUP, "action"].cpu().numpy()
        observations, rewards, *_, infos = self.vector.step(actions)
        content = self._content(observations, infos)
        content[GROUP, "reward"] = self._tensor(rewards.astype(np.float32)).unsqueeze(-1)
        return content

    def rand_action(self, tensordict: TensorDictBase | None = None) -> TensorDictBase:
        """Choose actions at random, among those that are allowed now, or numbers from -1 to 1."""
        masks = torch.from_numpy(self.vector.action_masks())
        if isinstance(self.vector.action_space, Box):
            actions = self.full_action_spec[GROUP, "action"].rand()
        else:
            actions = torch.multinomial(masks.flatten(0, 1).float(), 1).view(masks.shape[:2])
        if tensordict is None:
            tensordict = TensorDict({}, self.batch_size, device=self.device)
        if tensordict.get(GROUP, None) is None:
            tensordict[GROUP] = TensorDict({}, masks.shape[:2], device=self.device)
        tensordict[GROUP, "action"] = actions.to(self.device)
        return tensordict

    def render(self) -> NDArray[np.uint8] | None:
        """Return the frames, uint8 (num_envs, height, width, 3), or None without render mode."""
        frames = self.vector.render()
        return None if frames is None else np.stack(frames)

    def close(self, *, raise_if_closed: bool = True) -> None:
        """Stop the threads."""
        self.vector.close()
        super().close(raise_if_closed=raise_if_closed)

    # ---- tensors

    def _content(self, observations: NDArray[Any], infos: dict[str, Any]) -> TensorDict:
        """Return everything that is observed now, and which episodes are over."""
        own, shared = self._infos(infos)
        drones = {
            "observation": self._tensor(observations.astype(np.float32, copy=False)),
            self._mask_name: self._tensor(infos["action_mask"].view(np.bool_)),
            "info": own,
        }
        over = self.vector.outputs.over
        terminated, truncated = (self._tensor(over[:, k, np.newaxis].copy()) for k in (0, 1))
        content = {
            GROUP: TensorDict(drones, own.shape, self.device),
            "state": self._tensor(self.vector.state()),
            "info": shared,
            "done": terminated | truncated,
            "terminated": terminated,
            "truncated": truncated,
        }
        return TensorDict(content, self.batch_size, self.device)

    def _infos(self, infos: dict[str, NDArray[Any]]) -> tuple[TensorDict, TensorDict]:
        """Return the infos that each drone has of its own, and those that all have in common."""
        count, drones = self.vector.num_envs, self.vector.drones
        parts: tuple[dict[str, Any], ...] = ({}, {})
        for key, values in infos.items():
            if key != "action_mask":
                narrow = values if values.dtype.kind == "i" else values.astype(np.float32)
                parts[values.ndim == 1][key] = self._tensor(narrow)
        return (
            TensorDict(parts[0], (count, drones), self.device),
            TensorDict(parts[1], (count,), self.device),
        )

    def _tensor(self, values: NDArray[Any]) -> torch.Tensor:
        return torch.from_numpy(values).to(self.device)


def _unbounded(infos: TensorDict) -> Composite:
    """Return the spec of infos."""
    specs = {key: Unbounded(one.shape, dtype=one.dtype) for key, one in infos.items()}
    return Composite(specs, shape=infos.shape)
