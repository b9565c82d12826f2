"""Environments for reinforcement learning: PettingZoo's (an agent per drone) and Gymnasium's.

Importing this package registers the ids of Gymnasium's.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

from desim_uav.env.registration import register_envs

if TYPE_CHECKING:
    from desim_uav.env.joint import InTurn, JointActions
    from desim_uav.env.parallel import UavParallelEnv
    from desim_uav.env.parallel_vector import UavParallelVectorEnv
    from desim_uav.env.reward_terms import UavMoEnv
    from desim_uav.env.single import UavEnv
    from desim_uav.env.skipping import SkipForced, SkipForcedParallel
    from desim_uav.env.stable_baselines import UavVecEnv
    from desim_uav.env.tasks import Curriculum
    from desim_uav.env.vector import UavVectorEnv

_PUBLIC = {
    "Curriculum": "desim_uav.env.tasks",
    "InTurn": "desim_uav.env.joint",
    "JointActions": "desim_uav.env.joint",
    "SkipForced": "desim_uav.env.skipping",
    "SkipForcedParallel": "desim_uav.env.skipping",
    "UavEnv": "desim_uav.env.single",
    "UavMoEnv": "desim_uav.env.reward_terms",
    "UavParallelEnv": "desim_uav.env.parallel",
    "UavParallelVectorEnv": "desim_uav.env.parallel_vector",
    "UavVecEnv": "desim_uav.env.stable_baselines",
    "UavVectorEnv": "desim_uav.env.vector",
}

__all__ = [
    "Curriculum",
    "InTurn",
    "JointActions",
    "SkipForced",
    "SkipForcedParallel",
    "UavEnv",
    "UavMoEnv",
    "UavParallelEnv",
    "UavParallelVectorEnv",
    "UavVecEnv",
    "UavVectorEnv",
]

register_envs()


def __getattr__(name: str) -> Any:
    """Import an environment when it is first used, so that ``import desim_uav`` stays fast."""
    if name in _PUBLIC:
        return getattr(importlib.import_module(_PUBLIC[name]), name)
    raise AttributeError(f"module 'desim_uav.env' has no attribute {name!r}")
