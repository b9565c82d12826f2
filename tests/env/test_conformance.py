"""The libraries' own checks of an environment, and whole episodes, on all nine cases."""

from __future__ import annotations

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.passive_env_checker import env_render_passive_checker
from pettingzoo.test import parallel_seed_test

from desim_uav.env import UavEnv, UavParallelEnv
from desim_uav.testing import check_environment
from tests.env.helpers import BRITTLE, CASES, play_parallel, play_single

LOCAL = {"observation.kind": "local"}
CONFIGS = [(case, {}) for case in CASES] + [(case, LOCAL) for case in ("case1", "case5", "case8")]
IDS = [case + ("-local" if config else "") for case, config in CONFIGS]


@pytest.mark.parametrize(("case", "config"), CONFIGS, ids=IDS)
def test_gymnasium(case: str, config: dict[str, str]):
    check_environment(gymnasium.make(f"desim_uav/{case.capitalize()}-v0", config=config))


@pytest.mark.parametrize("case", ["case1", "case9"])
def test_gymnasium_frames(case: str):
    env = UavEnv(case, render_mode="rgb_array")
    env.reset(seed=0)
    env_render_passive_checker(env)


@pytest.mark.parametrize(("case", "config"), CONFIGS, ids=IDS)
def test_pettingzoo(case: str, config: dict[str, str]):
    check_environment(UavParallelEnv(case, config))
    parallel_seed_test(lambda: UavParallelEnv(case, config))


@pytest.mark.parametrize(("case", "config"), CONFIGS[7:], ids=IDS[7:])
def test_pettingzoo_compiled(case: str, config: dict[str, str]):
    check_environment(UavParallelEnv(case, config, engine="batch"))
    parallel_seed_test(lambda: UavParallelEnv(case, config, engine="batch"))


@pytest.mark.parametrize(("case", "config"), CONFIGS, ids=IDS)
def test_stable_baselines(case: str, config: dict[str, str]):
    checker = pytest.importorskip("stable_baselines3.common.env_checker")
    checker.check_env(UavEnv(case, config), warn=True)


def test_episode_statistics():
    env = gymnasium.make("desim_uav/Case8-v0")
    env = gymnasium.wrappers.RecordEpisodeStatistics(env)
    told = list(play_single(env, 2, seed=0))
    for episode in (told[:31], told[31:]):
        statistics = episode[-1][-1]["episode"]
        assert statistics["l"] == 30
        assert statistics["r"] == pytest.approx(sum(step[1] for step in episode[1:]))


@pytest.mark.thorough
@pytest.mark.parametrize("kind", ["position", "local"])
def test_a_learner_learns(kind: str):
    learners = pytest.importorskip("sb3_contrib")
    env = gymnasium.make("desim_uav/Case8-v0", config={"observation.kind": kind})
    learner = learners.MaskablePPO(
        "MlpPolicy", env, n_steps=32, batch_size=32, n_epochs=1, device="cpu"
    )
    learner.learn(64)
    assert len(learner.ep_info_buffer) == 2
    env.close()


def test_vectors_of_environments():
    envs = gymnasium.make_vec("desim_uav/Case8-v0", num_envs=3, vectorization_mode="sync")
    _, infos = envs.reset(seed=5)
    assert infos["seed"].tolist() == [5, 6, 7]
    envs.action_space.seed(0)
    for _ in range(32):
        seen, rewards, _, _, infos = envs.step(envs.action_space.sample())
        assert seen in envs.observation_space
        assert np.isfinite(rewards).all()
        assert infos["action_mask"].shape == (3, 27)
    assert infos["episode_number"].tolist() == [1, 1, 1]
    envs.close()


@pytest.mark.parametrize("kind", ["position", "local"])
@pytest.mark.parametrize("noise", [None, {"probability": 0.5, "sigma_cells": 3}])
def test_what_is_shown_lies_in_its_space(kind: str, noise: dict[str, float] | None):
    """Whatever world a seed draws: the spaces are those of the scenario, not of its first world."""
    config = {**BRITTLE, "observation.kind": kind, "position_noise": noise, "map.levels.step_m": 7}
    joint, each = UavEnv("case8", config), UavParallelEnv("case8", config)
    space = joint.observation_space
    levels = set()
    for seed in range(8):
        for seen, *_ in play_single(joint, 1, seed):
            assert seen in space
            assert seen.dtype == space.dtype == (np.int64 if kind == "position" else np.float32)
        for told, *_ in play_parallel(each, 1, seed):
            assert all(told[agent] in each.observation_space(agent) for agent in told)
        levels.add(joint.session.world.grid.levels_under_ceiling)
    assert len(levels) > 1


def test_the_spaces_of_case_8():
    joint, each = UavEnv("case8"), UavParallelEnv("case8")
    assert joint.observation_space.nvec.tolist() == [10, 10, 2, 31] * 3
    assert joint.action_space.nvec.tolist() == [9, 9, 9]
    assert each.possible_agents == ["drone_0", "drone_1", "drone_2"]
    assert each.observation_space("drone_1")["observation"].nvec.tolist() == [10, 10, 2, 31]
    assert each.observation_space("drone_1")["action_mask"].shape == (9,)
    assert each.action_space("drone_1").n == 9
    local = UavEnv("case8", LOCAL).observation_space
    assert local.shape == (3 * 17,)
    assert UavEnv("case1").action_space.n == 5
