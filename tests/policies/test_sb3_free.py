"""Networks of Stable-Baselines3 for free flight: they act as they were trained."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from desim_uav.env import UavEnv
from desim_uav.env.configure import configured
from desim_uav.model.streams import Purpose, Streams
from desim_uav.policies import load_policy
from desim_uav.policies.base import decide
from desim_uav.world import build_world
from tests.env.test_free_envs import scenario

sb3 = pytest.importorskip("stable_baselines3")

OFF_POLICY = {"learning_starts": 8, "buffer_size": 100, "train_freq": 4}
ALGORITHMS: dict[str, dict[str, Any]] = {
    "PPO": {"n_steps": 16, "batch_size": 16, "n_epochs": 1},
    "A2C": {"n_steps": 8},
    "SAC": {**OFF_POLICY, "policy_kwargs": {"net_arch": [8]}},
    "TD3": {**OFF_POLICY, "policy_kwargs": {"net_arch": {"pi": [8], "qf": [9]}}},
    "DDPG": {**OFF_POLICY, "policy_kwargs": {"net_arch": [8]}},
}


@pytest.mark.thorough
@pytest.mark.parametrize("drones", [1, 2])
@pytest.mark.parametrize("algorithm", ALGORITHMS)
def test_a_network_acts_as_it_was_trained(tmp_path: Path, algorithm: str, drones: int):
    described = scenario(count=drones, start_cells=[[1, 1], [2, 2]][:drones])
    described |= {"observation": {"kind": "local"}}
    env = UavEnv(described)
    made = getattr(sb3, algorithm)("MlpPolicy", env, seed=0, device="cpu", **ALGORITHMS[algorithm])
    made.learn(32)
    made.save(tmp_path / "net.zip")
    world = build_world(configured(described), 1)
    policy = load_policy(f"sb3:{tmp_path / 'net.zip'}")
    policy.begin(world, Streams(0, Purpose.LEARNER, 0))
    seen, _ = env.reset(seed=1)
    for _ in range(5):
        wanted, _ = made.predict(seen, deterministic=True)
        commands = decide(policy, env.session.snapshot)
        np.testing.assert_allclose(np.concatenate(commands), wanted, rtol=1e-5, atol=1e-6)
        seen, *_ = env.step(wanted)
