"""What keeps a network of RLlib to what is allowed: connectors, and a module with masks.

The environments show an agent a dict of ``observation`` and ``action_mask``. RLlib's networks want
one row of real numbers, and its filters would spoil a mask, so the two are parted and put together
again: ``[EncodeObservation(), <filters>, AddActionMask()]``, and a ``MaskedModule`` takes it.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import torch
from gymnasium.spaces import Box, Dict, MultiDiscrete
from numpy.typing import NDArray
from ray.rllib.algorithms.ppo.torch.default_ppo_torch_rl_module import DefaultPPOTorchRLModule
from ray.rllib.connectors.env_to_module.observation_preprocessor import (
    SingleAgentObservationPreprocessor,
)
from ray.rllib.core.columns import Columns

OBSERVATION, MASK = "observation", "action_mask"


class EncodeObservation(SingleAgentObservationPreprocessor):  # type: ignore[misc]
    """An agent's observation without its mask, as one row of float32.

    Whole numbers become one-hot codes, one after the other; real numbers stay as they are. The
    episode keeps the mask for ``AddActionMask``.
    """

    def recompute_output_observation_space(self, observations: Any, actions: Any) -> Dict:
        """A Box for each agent."""
        return Dict({agent: _encoded(space[OBSERVATION]) for agent, space in observations.items()})

    def preprocess(self, observation: Any, episode: Any) -> NDArray[np.float32]:
        """The row of one agent."""
        space = self.input_observation_space[episode.agent_id][OBSERVATION]
        values = observation[OBSERVATION]
        episode.custom_data[MASK] = observation[MASK]
        if not isinstance(space, MultiDiscrete):
            return values.astype(np.float32)  # type: ignore[no-any-return]
        row = np.zeros(int(space.nvec.sum()), np.float32)
        row[np.cumsum(space.nvec) - space.nvec + values - space.start] = 1.0
        return row


class AddActionMask(SingleAgentObservationPreprocessor):  # type: ignore[misc]
    """The row of an agent and the mask that ``EncodeObservation`` has put aside, as a dict."""

    def recompute_output_observation_space(self, observations: Any, actions: Any) -> Dict:
        """A Dict for each agent."""
        return Dict(
            {
                agent: Dict({OBSERVATION: space, MASK: Box(0.0, 1.0, (int(actions[agent].n),))})
                for agent, space in observations.items()
            }
        )

    def preprocess(self, observation: Any, episode: Any) -> dict[str, NDArray[np.float32]]:
        """Both, of one agent. Raises ValueError if no ``EncodeObservation`` comes before this."""
        mask = episode.custom_data.get(MASK)
        if mask is None:
            raise ValueError("AddActionMask needs an EncodeObservation before it in the pipeline")
        return {OBSERVATION: observation, MASK: np.asarray(mask, np.float32)}


class MaskedModule(DefaultPPOTorchRLModule):  # type: ignore[misc]
    """PPO's own network, in which what is masked has no chance, neither explored nor learned from.

    Its observation is what ``AddActionMask`` makes.
    """

    def __init__(self, *, observation_space: Dict, **settings: Any) -> None:
        self.with_mask = observation_space
        super().__init__(observation_space=observation_space[OBSERVATION], **settings)

    def setup(self) -> None:
        """Build the network for the observation alone."""
        super().setup()
        self.observation_space = self.with_mask

    def _forward(self, batch: dict[str, Any], **settings: Any) -> dict[str, Any]:
        return _masked(super()._forward(_bare(batch), **settings), batch)

    def _forward_train(self, batch: dict[str, Any], **settings: Any) -> dict[str, Any]:
        return _masked(super()._forward_train(_bare(batch), **settings), batch)

    def compute_values(self, batch: dict[str, Any], embeddings: Any = None) -> Any:
        """The values of states, whatever is allowed in them."""
        return super().compute_values(_bare(batch), embeddings)


def _encoded(space: Any) -> Box:
    if isinstance(space, MultiDiscrete):
        return Box(0.0, 1.0, (int(space.nvec.sum()),))
    return Box(space.low, space.high, dtype=np.float32)


def _bare(batch: dict[str, Any]) -> dict[str, Any]:
    """The batch with observations that have no masks."""
    return {**batch, Columns.OBS: batch[Columns.OBS][OBSERVATION]}


def _masked(told: dict[str, Any], batch: dict[str, Any]) -> dict[str, Any]:
    """What a network tells, with the least of numbers for what is masked: infinities spread."""
    logits = told[Columns.ACTION_DIST_INPUTS]
    allowed = batch[Columns.OBS][MASK] > 0
    least = torch.finfo(logits.dtype).min
    return {**told, Columns.ACTION_DIST_INPUTS: logits.masked_fill(~allowed, least)}
