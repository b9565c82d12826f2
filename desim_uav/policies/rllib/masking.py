"""Action masks for RLlib: two connectors, and a network module that obeys masks.

The environments give an agent a dict of ``observation`` and ``action_mask``. RLlib's networks need
one row of real numbers, and its filters would change a mask, so the two are separated before the
filters and joined after them: ``[EncodeObservation(), <filters>, AddActionMask()]``. The result is
the input of a ``MaskedModule``.
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
    """Turns an agent's observation into one row of float32, without its mask.

    Whole numbers become one-hot codes, one after the other; real numbers stay as they are. The
    mask is kept in the episode for ``AddActionMask``.
    """

    def recompute_output_observation_space(self, observations: Any, actions: Any) -> Dict:
        """Return a Box per agent."""
        return Dict({agent: _encoded(space[OBSERVATION]) for agent, space in observations.items()})

    def preprocess(self, observation: Any, episode: Any) -> NDArray[np.float32]:
        """Return the row of one agent."""
        space = self.input_observation_space[episode.agent_id][OBSERVATION]
        values = observation[OBSERVATION]
        episode.custom_data[MASK] = observation[MASK]
        if not isinstance(space, MultiDiscrete):
            return values.astype(np.float32)  # type: ignore[no-any-return]
        row = np.zeros(int(space.nvec.sum()), np.float32)
        row[np.cumsum(space.nvec) - space.nvec + values - space.start] = 1.0
        return row


class AddActionMask(SingleAgentObservationPreprocessor):  # type: ignore[misc]
    """Joins an agent's row and the mask that ``EncodeObservation`` kept, in a dict."""

    def recompute_output_observation_space(self, observations: Any, actions: Any) -> Dict:
        """Return a Dict space per agent."""
        return Dict(
            {
                agent: Dict({OBSERVATION: space, MASK: Box(0.0, 1.0, (int(actions[agent].n),))})
                for agent, space in observations.items()
            }
        )

    def preprocess(self, observation: Any, episode: Any) -> dict[str, NDArray[np.float32]]:
        """Return row and mask of one agent. Raises ValueError without an ``EncodeObservation``."""
        mask = episode.custom_data.get(MASK)
        if mask is None:
            raise ValueError("AddActionMask needs an EncodeObservation before it in the pipeline")
        return {OBSERVATION: observation, MASK: np.asarray(mask, np.float32)}


class MaskedModule(DefaultPPOTorchRLModule):  # type: ignore[misc]
    """PPO's default network, in which masked actions have probability 0, in training as well.

    Its observations are the dicts that ``AddActionMask`` makes.
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

    def compute_values(self, batch: dict[str, Any], embeddings: object = None) -> Any:
        """Return the values of states; masks do not matter to them."""
        return super().compute_values(_bare(batch), embeddings)


def _encoded(space: Any) -> Box:
    if isinstance(space, MultiDiscrete):
        return Box(0.0, 1.0, (int(space.nvec.sum()),))
    return Box(space.low, space.high, dtype=np.float32)


def _bare(batch: dict[str, Any]) -> dict[str, Any]:
    """Return the batch with the masks removed from its observations."""
    return {**batch, Columns.OBS: batch[Columns.OBS][OBSERVATION]}


def _masked(output: dict[str, Any], batch: dict[str, Any]) -> dict[str, Any]:
    """Return a network's output with the smallest float, not -inf, for masked actions."""
    logits = output[Columns.ACTION_DIST_INPUTS]
    allowed = batch[Columns.OBS][MASK] > 0
    least = torch.finfo(logits.dtype).min
    return {**output, Columns.ACTION_DIST_INPUTS: logits.masked_fill(~allowed, least)}
