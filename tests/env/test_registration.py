"""Gymnasium knows the environments by name."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable
from typing import Any

import gymnasium
import numpy as np
import pytest

from desim_uav.env import UavEnv, UavParallelEnv, UavVectorEnv
from desim_uav.env.configure import configured
from desim_uav.env.registration import register_envs
from desim_uav.errors import ScenarioError, UsageError
from desim_uav.world import build_world
from tests.env.helpers import CASES, play_single


@pytest.mark.parametrize("case", CASES)
def test_every_case_has_an_id(case: str):
    env = gymnasium.make(f"desim_uav/{case.capitalize()}-v0", config={"episode.steps": 3})
    assert env.unwrapped.session.scenario.name == case
    _, info = env.reset(seed=4)
    assert info["seed"] == 4
    env.action_space.seed(0)
    ends = [env.step(env.action_space.sample())[2:4] for _ in range(3)]
    assert ends == [(False, False), (False, False), (False, True)]
    env.close()


def worlds_after_seeds(env: gymnasium.Env, seeds: range) -> list[int]:
    return [env.reset(seed=seed)[1]["world_seed"] for seed in seeds]


@pytest.mark.parametrize("case", CASES)
def test_an_id_of_a_case_has_one_world(case: str):
    name = f"desim_uav/{case.capitalize()}-v0"
    env = gymnasium.make(name)
    assert worlds_after_seeds(env, range(1, 4)) == [0, 0, 0]
    homes = env.unwrapped.session.world.homes
    assert (homes == build_world(configured(case), 0).homes).all()
    assert worlds_after_seeds(gymnasium.make(name, world_seed=3), range(1, 4)) == [3, 3, 3]
    assert worlds_after_seeds(gymnasium.make(name, world_seed=None), range(1, 4)) == [1, 2, 3]


def test_environments_side_by_side_fly_in_one_world():
    """Four worlds were one to the paper's observation: where the users are, it does not say."""
    for mode in (None, "sync"):
        envs = gymnasium.make_vec("desim_uav/Case8-v0", 4, vectorization_mode=mode)
        _, infos = envs.reset(seed=0)
        assert infos["seed"].tolist() == [0, 1, 2, 3]
        assert infos["world_seed"].tolist() == [0, 0, 0, 0]
        envs.close()
        envs = gymnasium.make_vec("desim_uav/Case8-v0", 4, vectorization_mode=mode, world_seed=None)
        assert envs.reset(seed=5)[1]["world_seed"].tolist() == [5, 6, 7, 8]
        envs.close()


def test_environments_of_stable_baselines_fly_in_one_world():
    util = pytest.importorskip("stable_baselines3.common.env_util")
    envs = util.make_vec_env("desim_uav/Case8-v0", 4, seed=0)
    envs.reset()
    told = [(info["seed"], info["world_seed"]) for info in envs.reset_infos]
    assert told == [(0, 0), (1, 0), (2, 0), (3, 0)]
    envs = util.make_vec_env("desim_uav/Case8-v0", 2, seed=0, env_kwargs={"world_seed": None})
    envs.reset()
    assert [info["world_seed"] for info in envs.reset_infos] == [0, 1]


@pytest.mark.parametrize("make", [UavEnv, UavParallelEnv, lambda *a, **k: UavVectorEnv(*a, 1, **k)])
def test_the_world_of_an_environment(make: Callable[..., Any]):
    """By keyword, else as the scenario says; what the configuration names counts first."""

    def world(**told: Any) -> int:
        env = make("case8", **told)
        env.reset(seed=7)
        (session,) = env.sessions if isinstance(env, UavVectorEnv) else (env.session,)
        return session.world.seed

    assert world() == 7
    assert world(world_seed=3) == 3
    assert world(world_seed=None) == 7
    assert world(config={"world_seed": 5}) == 5
    assert world(config={"world_seed": 5}, world_seed=3) == 5
    for wrong in (-1, 2**63, "zero", 0.5):
        with pytest.raises((ScenarioError, UsageError), match="world_seed"):
            world(world_seed=wrong)


def test_a_case_with_another_world_in_its_configuration():
    env = gymnasium.make("desim_uav/Case8-v0", config={"world_seed": 5})
    assert worlds_after_seeds(env, range(1, 3)) == [5, 5]
    env = gymnasium.make("desim_uav/Uav-v0", scenario="case8")
    assert worlds_after_seeds(env, range(1, 3)) == [1, 2]


@pytest.mark.parametrize("case", CASES)
def test_no_spec_has_a_time_limit(case: str):
    """The environment truncates by itself, whatever the configuration makes of its steps."""
    name = f"desim_uav/{case.capitalize()}-v0"
    assert gymnasium.spec(name).max_episode_steps is None
    env = gymnasium.make(name, config={"episode.steps": 33})
    env.reset(seed=0)
    ends = [env.step(env.action_space.sample())[2:4] for _ in range(33)]
    assert ends == [(False, False)] * 32 + [(False, True)]


def test_a_time_limit_of_the_same_length_changes_nothing():
    """Nobody needs one, but who gives it gets the same flags, infos and carried-over drones."""
    one = gymnasium.make("desim_uav/Case8-v0")
    other = gymnasium.make("desim_uav/Case8-v0", max_episode_steps=30)
    for told, same in zip(play_single(one, 2, seed=0), play_single(other, 2, seed=0), strict=True):
        np.testing.assert_equal(told, same)


def test_a_scenario_of_ones_own():
    env = gymnasium.make("desim_uav/Uav-v0", scenario={"name": "mine", "drones": {"count": 2}})
    assert env.unwrapped.session.scenario.name == "mine"
    assert env.action_space.nvec.tolist() == [9, 9]
    with pytest.raises(TypeError, match="scenario"):
        gymnasium.make("desim_uav/Uav-v0")
    with pytest.raises(ScenarioError, match="did you mean 'count'"):
        gymnasium.make("desim_uav/Case8-v0", config={"drones.cuont": 2})


def test_to_register_again_changes_nothing():
    before = dict(gymnasium.registry)
    register_envs()
    assert dict(gymnasium.registry) == before


LIGHT = """
heavy = {"numba", "pandas", "simpy", "pydantic", "matplotlib", "PIL"}
assert not heavy & set(sys.modules), heavy & set(sys.modules)
"""
MAKE = """
assert "desim_uav/Uav-v0" in gymnasium.registry and "CartPole-v1" in gymnasium.registry
print(gymnasium.make("desim_uav/Case8-v0").reset(seed=1)[1]["seed"])
"""
COMMAND = """
import sys
sys.argv = ["/usr/bin/desim-uav", "--help"]
import desim_uav.cli
assert "gymnasium" not in sys.modules
import desim_uav.env, gymnasium
"""


@pytest.mark.thorough
@pytest.mark.parametrize(
    "script",
    [
        pytest.param(
            f"import sys, gymnasium, desim_uav\n{LIGHT}\n{MAKE}",
            id="gymnasium first",
            marks=pytest.mark.thorough,
        ),
        pytest.param(f"import sys, desim_uav, gymnasium\n{LIGHT}\n{MAKE}", id="gymnasium last"),
        pytest.param(f"{COMMAND}\n{MAKE}", id="command line", marks=pytest.mark.thorough),
    ],
)
def test_ids_are_registered_in_either_order_of_imports(script: str):
    command = [sys.executable, "-W", "error", "-c", script]
    told = subprocess.run(command, capture_output=True, check=False, text=True)
    assert (told.stdout, told.stderr) == ("1\n", "")


@pytest.mark.parametrize(
    "imports",
    [
        ("desim_uav", "gymnasium"),
        ("gymnasium", "desim_uav"),
        ("desim_uav", "importlib.util", "gymnasium.envs.registration"),
        ("desim_uav.env",),
    ],
)
def test_the_ids_are_there_once_both_are_imported(imports: tuple[str, ...]):
    """Whatever is imported first, and if somebody has only looked whether Gymnasium is there."""
    lines = [f"import {each}" for each in imports]
    lines.insert(1, "import importlib.util; importlib.util.find_spec('gymnasium')")
    code = "\n".join([*lines, "import gymnasium, sys", "print(*sorted(gymnasium.registry))"])
    code += "\nprint([type(each).__module__ for each in sys.meta_path])"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert {"desim_uav/Case1-v0", "desim_uav/Uav-v0", "desim_uav/MoUav-v0"} <= set(
        done.stdout.split()
    )
    assert "desim_uav" not in done.stdout.splitlines()[-1]
