"""The Gymnasium ids: one for each of the nine cases, and one for other scenarios."""

from __future__ import annotations

from typing import Any

from gymnasium.envs.registration import register, registry

CASES = range(1, 10)
CASES_WORLD = 0
"""The world seed of the nine ids."""

ENTRY_POINT = "desim_uav.env.single:UavEnv"
MULTI_OBJECTIVE = "desim_uav.env.reward_terms:UavMoEnv"
VECTOR = "desim_uav.env.vector:UavVectorEnv"


MO_ID = "desim_uav/MoUav-v0"


def register_envs() -> None:
    """Register ``desim_uav/Case1-v0`` … ``Case9-v0`` and ``desim_uav/Uav-v0``, once.

    Each case has one world, that of world seed 0, as in the paper: seeds draw walks and requests
    only. ``world_seed=3`` gives another world, and ``world_seed=None`` a new one per seed.
    ``Uav-v0`` needs a ``scenario``, which determines its world. So does ``MoUav-v0``, whose reward
    is a vector; Gymnasium's checker, which expects a number, is off for it.

    The specs have no ``max_episode_steps``, because an environment truncates its episodes itself,
    after ``episode.steps`` of its scenario. Gymnasium's TimeLimit would not know of a ``config``
    that changes this number, and would cut longer episodes short.
    """
    parameters_of: dict[str, dict[str, Any]] = {
        f"desim_uav/Case{number}-v0": {"scenario": f"case{number}", "world_seed": CASES_WORLD}
        for number in CASES
    }
    for name, parameters in {**parameters_of, "desim_uav/Uav-v0": {}}.items():
        if name not in registry:
            register(name, entry_point=ENTRY_POINT, vector_entry_point=VECTOR, kwargs=parameters)
    if MO_ID not in registry:
        register(MO_ID, entry_point=MULTI_OBJECTIVE, disable_env_checker=True)
