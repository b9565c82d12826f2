"""PPO: what it learns, and that its policy files do what its networks say."""

from __future__ import annotations

import importlib.util
import json
import re
import signal
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import desim_uav as du
from desim_uav.env import UavParallelVectorEnv
from desim_uav.policies import load_policy
from desim_uav.policies.mlp import MlpFile, scaling_of
from desim_uav.scenario.load import from_mapping
from desim_uav.world import build_world
from tests.command_line import started
from tests.policies.far import FAR
from tests.semi_markov import DISCOUNTS, GAMMA, REWARDS, TWO, WAY

ROOT = Path(__file__).parents[2]
PPO = ROOT / "policies" / "ppo.py"
pytestmark = pytest.mark.thorough

FREELY = {**FAR, "drones": {**FAR["drones"], "motion": {"space": "free", "max_speed_mps": 8.3}}}
"""The same in free flight: two steps of 490 m lead to the users."""


@pytest.fixture(scope="module")
def ppo() -> Any:
    spec = importlib.util.spec_from_file_location("ppo_in_one_file", PPO)
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def trained(ppo: Any, scenario: Any = FAR, **changes: Any) -> tuple[Any, Any]:
    """The last network of a short training, as torch has it and as it is saved."""
    saved: list[Any] = []
    changes = {"steps": 16 * 32, "envs": 4, "rollout": 32, "hidden": 16, **changes}
    options = ppo.options_of(**changes)
    agent = ppo.train(from_mapping(scenario), options, saved.append)
    return agent, saved[-1]


def test_it_learns_to_fly_to_the_users(ppo: Any, tmp_path: Path):
    """Nobody does better than to fly straight there: four steps, and then to stay."""
    network = trained(ppo, steps=20_000, envs=16, gamma=0.9)[1]
    (tmp_path / "far.npz").write_bytes(network.to_bytes())
    script = tmp_path / "best.csv"
    script.write_text("step,drone,action\n" + "".join(f"{k},0,right\n" for k in range(4)))
    mine, best, hover = (
        du.run(FAR, policy=policy, episodes=2, engine="batch", progress=False).summaries()[0]
        for policy in (tmp_path / "far.npz", script, "hover")
    )
    assert mine["qoe3_percent"] == best["qoe3_percent"] > 60 and hover["qoe3_percent"] == 0


def test_it_learns_to_fly_freely_to_the_users(ppo: Any, tmp_path: Path):
    """Nobody does better than to fly straight there, in two steps, and then to stay."""
    network = trained(ppo, FREELY, steps=30_000, envs=16, gamma=0.9)[1]
    (tmp_path / "far.npz").write_bytes(network.to_bytes())
    assert network.about["actions"] == ["aim_x", "aim_y"]

    def straight(observation: Any, mask: Any) -> Any:
        return [1.0 if observation.step < 2 else 0.0, 0.0]

    mine, best, hover = (
        du.run(FREELY, policy=policy, episodes=2, engine="batch", progress=False).summaries()[0]
        for policy in (tmp_path / "far.npz", straight, "hover")
    )
    assert hover["qoe3_percent"] == 0 and best["qoe3_percent"] > 80
    assert 0.9 * best["qoe3_percent"] < mine["qoe3_percent"] <= 100


def test_the_deviation_of_commands_falls_to_a_tenth(ppo: Any):
    agent, _ = trained(ppo, FREELY, steps=4 * 32)
    assert agent.actions.deviation == pytest.approx(0.6), "the first update is the only one"
    agent, _ = trained(ppo, FREELY, steps=20 * 4 * 32)
    assert agent.actions.deviation == pytest.approx(0.06), "a tenth at least: 0.6 * max(1 / 20, …)"


@pytest.mark.parametrize("scenario", [FAR, FREELY])
@pytest.mark.parametrize("central", [False, True])
def test_a_file_computes_what_the_network_does(ppo: Any, central: bool, scenario: Any):
    agent, network = trained(ppo, scenario, central=central)
    rng = np.random.default_rng(0)
    for _ in range(20):
        seen = rng.normal(size=len(network.low)).astype(np.float32)
        scores = agent.actor.forward(((seen - network.low) * network.scale)[np.newaxis])[-1][0]
        assert np.allclose(network.scores(seen.tolist()), scores, atol=1e-5)


def test_one_seed_gives_one_result(ppo: Any):
    for scenario in (FAR, FREELY):
        one, again, other = (trained(ppo, scenario, seed=seed)[1].to_bytes() for seed in (3, 3, 4))
        assert one == again != other


class OnTheWay:
    """An agent that flies the way of ``tests.semi_markov``."""

    def __init__(self) -> None:
        self.way = iter(WAY)

    def decide(self, seen: Any, masks: Any, states: Any) -> Any:
        return np.array([next(self.way)]), np.zeros(1), np.zeros(1)

    def worth(self, seen: Any, states: Any) -> Any:
        return [np.zeros((1, 1))]


class Forced:
    """What ``advantages`` reads of rollouts: drone 0 has no choice at the steps 1 and 2."""

    def __init__(self, ppo: Any) -> None:
        self.options = ppo.options_of(rollout=4, gamma=0.5, decay=0.25)
        self.rewards = np.reshape([1.0, 2.0, 4.0, 8.0, 0.0], (5, 1, 1))
        self.values = np.reshape([3.0, 50.0, 70.0, 5.0, 6.0], (5, 1, 1))
        self.masks = np.ones((5, 1, 1, 2), np.bool_)
        self.masks[1:3, ..., 0] = False
        self.terminated, self.over = np.zeros((2, 5, 1, 1), np.bool_)
        self.discounts = np.full((5, 1, 1), 0.5)


def test_values_of_forced_steps_cancel_out(ppo: Any):
    """The discount of a decision is gamma to the power of the steps until the next one."""
    rollouts = Forced(ppo)
    found = ppo.Rollouts.advantages(rollouts).flatten().tolist()
    last = 8 / 2 + 6 / 2 - 5
    ahead = 1 / 2 + 2 / 4 + 4 / 8 + (5 + 0.25 * last) / 8
    assert found[3] == last and found[0] == ahead - 3


def test_advantages_by_event_are_those_of_a_semi_markov_process(ppo: Any):
    """By hand, for lambda 0 and 1, if the values are 1, 2, 3, … and rewards count times 1/2."""
    options = ppo.options_of(envs=1, rollout=6, gamma=GAMMA, decay=0.0)
    scaling = scaling_of(build_world(from_mapping(TWO), 0))
    rollouts = ppo.Rollouts(UavParallelVectorEnv(TWO, 1), scaling, options)
    rollouts.play(OnTheWay())
    assert rollouts.rewards[:-1].flatten().tolist() == REWARDS
    assert rollouts.discounts[:-1].flatten().tolist() == DISCOUNTS
    rollouts.values[:] = np.arange(1.0, 8.0).reshape(-1, 1, 1)
    ahead = [r / 2 + g * v for r, g, v in zip(REWARDS, DISCOUNTS, range(2, 8), strict=True)]
    errors = [a - v for a, v in zip(ahead, range(1, 7), strict=True)]
    assert rollouts.advantages().flatten().tolist() == errors
    options.decay, expected = 1.0, [0.0]
    for error, discount in zip(reversed(errors), reversed(DISCOUNTS), strict=True):
        expected.append(error + discount * expected[-1])
    assert rollouts.advantages().flatten().tolist() == expected[:0:-1]
    network = trained(ppo, TWO, steps=32, gamma=0.875)[1]
    assert "gamma: 0.875" in network.about["training"]["scenario_yaml"], "that of the discounts"


def test_a_new_episode_adds_nothing_to_the_one_before(ppo: Any):
    """At a time limit the value of the last observation counts, and after a crash nothing."""
    rollouts = Forced(ppo)
    rollouts.masks[:] = True
    rollouts.over[2] = True
    cut = ppo.Rollouts.advantages(rollouts).flatten().tolist()
    assert cut[1] == 2 / 2 + 70 / 2 - 50 and cut[2] == 0
    rollouts.terminated[2] = True
    assert ppo.Rollouts.advantages(rollouts).flatten().tolist()[1] == 2 / 2 - 50


def test_it_is_interrupted_and_says_what_is_wrong(tmp_path: Path):
    (tmp_path / "far.yaml").write_text(json.dumps(FAR))
    quick = ("--envs", 2, "--rollout", 8, "--hidden", 8, "--out", tmp_path / "far.npz")
    with started(PPO, tmp_path / "far.yaml", *quick, "--steps", 10**9) as running:
        for line in running.stderr:
            if re.match(r"[0-9,]+ steps", line) and (tmp_path / "far.npz").exists():
                break
        running.send_signal(signal.SIGINT)
        out, err = running.communicate(timeout=60)
    assert running.returncode == 130 and out == "" and "interrupted" in err
    training = MlpFile(tmp_path / "far.npz").about["training"]
    assert training["command"][0] == "policies/ppo.py" and training["processor"]
    load_policy(tmp_path / "far.npz")
    for arguments, code, message in (
        (("none.yaml",), 3, "none.yaml"),
        ((tmp_path / "far.yaml", "--gamma", 2), 2, "--gamma 2.0: must be from 0.0"),
        ((tmp_path / "far.yaml", "--out", tmp_path), 2, "is not a file"),
    ):
        with started(PPO, *arguments) as failed:
            out, err = failed.communicate(timeout=60)
        assert (failed.returncode, out) == (code, "") and message in err
        assert "Traceback" not in err
