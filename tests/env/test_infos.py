"""What infos hold."""

from __future__ import annotations

import math
from copy import deepcopy

import numpy as np
import pytest

from desim_uav.env import UavEnv, UavParallelEnv
from tests.env.helpers import CASES, play_parallel, play_single

OF_ALL = [
    "sim_time_s", "qoe1_percent", "qoe2_iterations", "qoe3_percent", "seed", "world_seed",
    "episode_number", "attached_users", "crashes",
]  # fmt: skip
TERMS = {
    "coverage": ["users"],
    "coverage_battery": ["users", "return"],
    "multi_service": [
        "users", "throughput", "edge_computing", "data_gathering", "return", "charging"
    ],
}  # fmt: skip


@pytest.mark.parametrize("case", CASES)
def test_infos_hold_the_same_keys_and_flat_numbers(case: str):
    joint, each = UavEnv(case), UavParallelEnv(case)
    terms = [f"reward_{term}" for term in TERMS[joint.session.scenario.reward.kind]]
    keys = [*OF_ALL, *terms, "action_mask"]
    for told in play_single(joint, 2, seed=0):
        check_info(told[-1], keys)
    for told in play_parallel(each, 2, seed=0):
        assert list(told[-1]) == each.possible_agents
        for info in told[-1].values():
            check_info(info, keys)


def check_info(info: dict[str, object], keys: list[str]) -> None:
    assert list(info) == keys
    for key, value in info.items():
        if key == "action_mask":
            assert isinstance(value, np.ndarray)
        else:
            assert type(value) in (int, float), key


def test_infos_tell_of_the_episode_so_far():
    env = UavEnv("case1")
    _, info = env.reset(seed=0)
    assert info["sim_time_s"] == 0.0
    assert info["qoe1_percent"] == info["qoe2_iterations"] == info["reward_users"] == 0.0
    assert math.isnan(info["qoe3_percent"])
    for step in range(1, 31):
        _, reward, *_, info = env.step(0)
        assert info["sim_time_s"] == 60.0 * step
        assert info["reward_users"] == reward
        # Asked for all of the time: what is not served of it so far is missing from QoE1.
        assert info["qoe2_iterations"] == pytest.approx(step - 0.3 * info["qoe1_percent"])
        assert info["qoe3_percent"] * step == pytest.approx(info["qoe1_percent"] * 30)


def test_nothing_asked_for_is_nan():
    _, info = UavEnv("case8", {"demand": {"kind": "poisson", "rate_per_hour": 0.001}}).reset(seed=0)
    assert math.isnan(info["qoe1_percent"])
    assert math.isnan(info["qoe2_iterations"])


@pytest.mark.parametrize("case", ["case1", "case8"])
def test_what_is_told_is_the_callers_to_change(case: str):
    expected = [deepcopy(told) for told in play_parallel(UavParallelEnv(case), 2, seed=0)]
    env = UavParallelEnv(case)
    for told, before in zip(play_parallel(env, 2, seed=0), expected, strict=True):
        np.testing.assert_equal(told, before)
        for agent in env.possible_agents:
            told[0][agent]["observation"][:] = -1
            told[0][agent]["action_mask"][:] = -1
            told[-1][agent].clear()
