"""What infos hold."""

from __future__ import annotations

from copy import deepcopy

import numpy as np
import pytest
from gymnasium.vector import AutoresetMode

from desim_uav.env import UavEnv, UavParallelEnv, UavVectorEnv
from tests.env.helpers import CASES, log_steps, play_parallel, play_single

OF_ALL = [
    "sim_time_s", "qoe1_percent", "qoe2_iterations", "qoe3_percent", "seed", "world_seed",
    "episode_number", "compiled", "attached_users", "crashes", "requests", "elapsed_steps",
    "forced", "duration_steps", "discount",
]  # fmt: skip
TERMS = {
    "coverage": ["users"],
    "coverage_battery": ["users", "return"],
    "multi_service": [
        "users", "throughput", "edge_computing", "data_gathering", "return", "charging"
    ],
}  # fmt: skip


NOTHING_ASKED = {"demand": {"kind": "poisson", "rate_per_hour": 0.001}}
"""No measure of requests exists until the first request."""


def keys_of(case: str) -> list[str]:
    terms = TERMS[UavEnv(case).session.scenario.reward.kind]
    return [*OF_ALL, *(f"reward_{term}" for term in terms)]


@pytest.mark.parametrize("engine", ["des", "batch"])
@pytest.mark.parametrize("case", CASES)
def test_infos_of_the_joint_environment_hold_the_same_keys_and_finite_numbers(
    case: str, engine: str
):
    keys = keys_of(case)
    for config in ({}, NOTHING_ASKED):
        for told in play_single(UavEnv(case, config, engine=engine), 2, seed=0):
            info = dict(told[-1])
            assert info.pop("action_mask").dtype == np.int8
            check_info(info, keys)


@pytest.mark.thorough
@pytest.mark.parametrize("case", CASES)
def test_infos_of_the_parallel_environment_hold_the_same_keys_and_finite_numbers(case: str):
    keys = keys_of(case)
    for config in ({}, NOTHING_ASKED):
        env = UavParallelEnv(case, config)
        for told in play_parallel(env, 2, seed=0):
            assert list(told[-1]) == env.possible_agents
            for info in told[-1].values():
                check_info(info, keys)


@pytest.mark.parametrize("mode", list(AutoresetMode))
def test_infos_of_the_vector_environment_hold_the_same_keys_and_finite_numbers(mode: AutoresetMode):
    keys = keys_of("case8")
    env = UavVectorEnv("case8", 3, {**NOTHING_ASKED, "episode.steps": 4}, autoreset_mode=mode)
    _, infos = env.reset(seed=0)
    check_infos(infos, keys)
    for _ in range(9):
        *_, terminated, truncated, infos = env.step(env.action_space.sample())
        ended = terminated | truncated
        if ended.any() and mode is AutoresetMode.SAME_STEP:
            check_infos(infos.pop("final_info"), keys)
            for key in ("final_obs", "_final_obs", "_final_info"):
                del infos[key]
        check_infos(infos, keys)
        if ended.any() and mode is AutoresetMode.DISABLED:
            _, infos = env.reset(options={"reset_mask": ended})
            check_infos(infos, keys)


def test_infos_for_stable_baselines_hold_the_same_keys_and_finite_numbers():
    pytest.importorskip("stable_baselines3")
    from desim_uav.env import UavVecEnv

    keys = keys_of("case8")
    env = UavVecEnv("case8", 2, {**NOTHING_ASKED, "episode.steps": 4})
    env.reset()
    for info in env.reset_infos:
        assert info.pop("action_mask").dtype == np.int8
        check_info(info, keys)
    for step in range(1, 9):
        *_, infos = env.step([env.action_space.sample() for _ in range(2)])
        for info in infos:
            assert info.pop("action_mask").dtype == np.int8
            assert info.pop("TimeLimit.truncated") is (step % 4 == 0)
            assert (info.pop("terminal_observation", None) is not None) is (step % 4 == 0)
            check_info(info, keys)


def check_info(info: dict[str, object], keys: list[str]) -> None:
    assert list(info) == keys
    for key, value in info.items():
        assert type(value) in (int, float), key
        assert np.isfinite(value), key


def check_infos(infos: dict[str, np.ndarray], keys: list[str]) -> None:
    """The same of arrays with an entry per environment, beside each of which its mask stands."""
    keys = [*keys, "action_mask"]
    assert list(infos) == [name for key in keys for name in (key, f"_{key}")]
    for key in keys:
        assert infos[key].dtype in (np.int8, np.int64, np.float64), key
        assert np.isfinite(infos[key]).all(), key


def test_infos_tell_of_the_episode_so_far():
    env = UavEnv("case1")
    _, info = env.reset(seed=0)
    assert info["sim_time_s"] == 0.0
    assert info["qoe1_percent"] == info["qoe2_iterations"] == info["reward_users"] == 0.0
    assert info["qoe3_percent"] == 0.0
    assert info["requests"] == 14
    for step in range(1, 31):
        _, reward, *_, info = env.step(0)
        assert info["sim_time_s"] == 60.0 * step
        assert info["reward_users"] == reward
        assert info["requests"] == 14
        # Asked for all of the time: what is not served of it so far is missing from QoE1.
        assert info["qoe2_iterations"] == pytest.approx(step - 0.3 * info["qoe1_percent"])
        assert info["qoe3_percent"] * step == pytest.approx(info["qoe1_percent"] * 30)


@pytest.mark.parametrize("engine", ["des", "batch"])
def test_a_measure_that_does_not_exist_is_0_and_so_is_its_weight(engine: str):
    """QoE1 and QoE2 are means over ``requests``, QoE3 is a mean over ``sim_time_s``."""
    env = UavEnv("case8", {"demand": {"kind": "poisson", "rate_per_hour": 0.3}}, engine=engine)
    _, info = env.reset(seed=0)
    assert env.session.engine.measures() == (None, None, None)
    assert info["requests"] == info["sim_time_s"] == 0
    assert info["qoe1_percent"] == info["qoe2_iterations"] == info["qoe3_percent"] == 0.0
    made = 0
    while made == 0:
        info = env.step([4, 4, 4])[-1]
        made = info["requests"]
        qoe1, qoe2, qoe3 = env.session.engine.measures()
        assert (qoe1 is None) is (qoe2 is None) is (made == 0)
        assert info["qoe3_percent"] == qoe3
    assert (info["qoe1_percent"], info["qoe2_iterations"]) == (qoe1, qoe2)


@pytest.mark.parametrize("case", ["case1", "case6", "case8"])
def test_requests_are_counted_as_the_log_counts_them(case: str):
    env = UavParallelEnv(case, engine="des")
    env.reset(seed=0)
    log_steps(env)
    *_, last = play_parallel(env, 1)
    assert last[-1]["drone_0"]["requests"] == len(env.session.engine.log.requests) > 0


@pytest.mark.parametrize("case", ["case1", "case8"])
def test_what_is_told_is_the_callers_to_change(case: str):
    expected = [
        deepcopy(told) for told in play_parallel(UavParallelEnv(case, engine="des"), 2, seed=0)
    ]
    env = UavParallelEnv(case, engine="des")
    for told, before in zip(play_parallel(env, 2, seed=0), expected, strict=True):
        np.testing.assert_equal(told, before)
        for agent in env.possible_agents:
            told[0][agent]["observation"][:] = -1
            told[0][agent]["action_mask"][:] = -1
            told[-1][agent].clear()
