"""Networks of Stable-Baselines3 for free flight: they act as they were trained."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from desim_uav.env import UavEnv
from desim_uav.env.configure import configured
from desim_uav.experiment.run import play
from desim_uav.model.random.streams import Purpose, Streams
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
        commands = decide(policy, env.session.snapshot, env.session.world)
        np.testing.assert_allclose(np.concatenate(commands), wanted, rtol=1e-5, atol=1e-6)
        seen, *_ = env.step(wanted)


@pytest.mark.thorough
@pytest.mark.parametrize("algorithm", ["sac", "td3"])
def test_the_recipe_trains_one_network_for_each_drone(tmp_path: Path, algorithm: str):
    from policies.train_continuous import EachDrone, train

    described = configured({**scenario(), "observation": {"kind": "local"}})
    quick = {"learning_starts": 32, "buffer_size": 200, "batch_size": 16, "gradient_steps": 2}
    model = train(algorithm, described, 160, 3, **quick)
    assert model.num_timesteps == 160 and model._n_updates > 0
    model.save(tmp_path / "net.zip")
    policy = load_policy(f"sb3:{tmp_path / 'net.zip'}")
    world = build_world(configured({**scenario(), "observation": {"kind": "local"}}), 3)
    ((log, _),) = play(world, policy, "mine", 3)
    assert policy.act_jointly is None and len(log.steps) == 16
    assert {step.action.name for step in log.steps} >= {"FLY"}

    env = EachDrone(described, 2, 3)
    assert env.num_envs == 4 and env.action_space.shape == (3,)
    shown = env.reset()
    for step in range(8):
        assert shown.shape == (4, *env.observation_space.shape)
        shown, rewards, over, infos = env.step(np.zeros((4, 3), np.float32))
        assert rewards.shape == (4,) and over.tolist() == [step == 7] * 4
    for info, first in zip(infos, shown, strict=True):
        last = info["terminal_observation"]
        assert info["TimeLimit.truncated"] and last.shape == first.shape
        assert not np.array_equal(last, first), "the next episode has begun"


def test_the_recipe_refuses_flight_by_cells(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    from policies.train_continuous import main

    assert main(["case1", str(tmp_path / "net.zip"), "--steps", "8"]) == 2
    assert capsys.readouterr().err == "case1: needs drones.motion: {space: free}\n"
