"""Networks that RLlib trained on ``UavParallelEnv``, with their connectors, without unpickling."""

from desim_uav.policies.rllib.adapter import RLlib
from desim_uav.policies.rllib.saving import save

__all__ = ["RLlib", "save"]
