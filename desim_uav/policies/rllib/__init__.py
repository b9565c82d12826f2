"""Reads networks that RLlib trained on ``UavParallelEnv``, and their connectors, as plain data."""

from desim_uav.policies.rllib.adapter import RLlib
from desim_uav.policies.rllib.saving import save

__all__ = ["RLlib", "save"]
