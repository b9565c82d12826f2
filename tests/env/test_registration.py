"""Gymnasium knows the environments by name."""

from __future__ import annotations

import subprocess
import sys

import gymnasium
import pytest

from desim_uav.env.registration import register_envs, register_with_gymnasium
from desim_uav.errors import ScenarioError
from tests.env.helpers import CASES


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
    register_with_gymnasium()
    assert dict(gymnasium.registry) == before


REGISTER = "from desim_uav.env.registration import register_with_gymnasium as r; r(); r()"
LIGHT = """
import sys
heavy = {"numba", "pandas", "simpy", "pydantic", "matplotlib", "PIL", "gymnasium"}
assert not heavy & set(sys.modules), heavy & set(sys.modules)
"""
MAKE = """
assert "desim_uav/Uav-v0" in gymnasium.registry and "CartPole-v1" in gymnasium.registry
print(gymnasium.make("desim_uav/Case8-v0").reset(seed=1)[1]["seed"])
"""


@pytest.mark.parametrize(
    "script",
    [
        pytest.param(
            f"import gymnasium\n{REGISTER}\n{MAKE}",
            id="gymnasium first",
            marks=pytest.mark.thorough,
        ),
        pytest.param(f"{REGISTER}\n{LIGHT}\nimport gymnasium\n{MAKE}", id="gymnasium last"),
    ],
)
def test_the_order_of_imports_does_not_matter(script: str):
    command = [sys.executable, "-W", "error", "-c", script]
    told = subprocess.run(command, capture_output=True, check=False, text=True)
    assert (told.stdout, told.stderr) == ("1\n", "")
