"""BenchMARL trains the drones (extra marl-test, in an environment of its own)."""

from __future__ import annotations

import csv
from importlib.util import find_spec
from pathlib import Path

import pytest

pytestmark = [
    pytest.mark.skipif(not find_spec("benchmarl"), reason="needs benchmarl: the extra marl-test"),
    pytest.mark.filterwarnings("ignore"),  # BenchMARL has many
]


def test_one_iteration_of_mappo(tmp_path: Path):
    from policies.train_benchmarl import ENVS, EPISODES, experiment

    training = experiment("case8", tmp_path, seed=0, iterations=1)
    training.run()
    assert training.total_frames == ENVS * EPISODES * 30
    (file,) = tmp_path.rglob("collection_reward_reward_mean.csv")
    ((_, reward),) = csv.reader(file.open())
    assert 0 < float(reward) < 1


def test_masked_actions_are_never_sampled(tmp_path: Path):
    from torchrl.envs.utils import ExplorationType, set_exploration_type

    from policies.train_benchmarl import experiment

    training = experiment("case8", tmp_path, seed=0, iterations=1)
    with set_exploration_type(ExplorationType.RANDOM):
        told = training.test_env.rollout(60, training.policy, break_when_any_done=False)
    masks, actions = told["drone", "action_mask"], told["drone", "action"]
    assert not masks.all()
    assert masks.gather(-1, actions[..., None]).all()
