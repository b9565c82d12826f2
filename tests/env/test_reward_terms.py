"""Vectors of rewards, in the conventions of MO-Gymnasium, and the memory of many environments."""

from __future__ import annotations

import copy
import warnings
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium import error

from desim_uav.env import UavEnv, UavMoEnv, UavVectorEnv, room
from desim_uav.errors import ScenarioError


class Plain:
    """A reward that does not work on rows."""

    def terms(self, drone: Any, *_: Any) -> dict[str, float]:
        return {"users": 1.0}


@pytest.mark.parametrize("engine", ["des", "batch"])
def test_the_reward_is_the_vector_of_its_terms(engine: str):
    config = {"reward": {"kind": "qoe", "crash": 2.0}}
    many, one = (kind("case8", config, engine=engine) for kind in (UavMoEnv, UavEnv))
    assert many.reward_terms == ("qoe1", "qoe3", "crash")
    assert many.reward_space.shape == (3,) == (many.reward_dim,)
    for env in (many, one):
        env.reset(seed=3)
    rng, total = np.random.default_rng(0), 0.0
    for _ in range(30):
        action = rng.integers(0, 9, 3)
        seen, paid, *ends, info = many.step(action)
        plain, reward, *same_ends, same_info = one.step(action)
        assert isinstance(paid, np.ndarray) and paid.dtype == np.float32
        assert many.reward_space.contains(paid)
        names = [f"reward_{name}" for name in many.reward_terms]
        assert paid.tolist() == [np.float32(info[name]) for name in names]
        assert float(paid.sum()) == pytest.approx(reward, abs=1e-6)
        assert (seen == plain).all() and ends == same_ends and info.keys() == same_info.keys()
        total += abs(paid[:2]).sum()
    assert total > 1.0


def test_gymnasium_makes_it_by_name_without_a_warning():
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        env = gymnasium.make("desim_uav/MoUav-v0", scenario="case4")
        assert env.unwrapped.reward_space.shape == (2,)  # as learners of several objectives ask
        env.reset(seed=0)
        _, paid, *_ = env.step(env.action_space.sample())
    assert paid.shape == (2,)


def test_a_copy_goes_on_with_vectors():
    env = UavMoEnv("case4", engine="batch")
    env.reset(seed=1)
    env.step([0, 1])
    other = copy.deepcopy(env)
    one, another = env.step([2, 3]), other.step([2, 3])
    assert (one[1] == another[1]).all() and other.reward_space == env.reward_space


def test_a_reward_whose_terms_are_not_declared_is_refused():
    with pytest.raises(ScenarioError, match="'Plain' does not name its terms"):
        UavMoEnv("case1", {"reward": {"kind": f"{__name__}:Plain"}})


def test_environments_that_do_not_fit_are_foreseen(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(room, "available_bytes", lambda: 10**6)
    radar = {"observation": {"kind": "radar"}}
    UavVectorEnv("case8", 20, radar)
    with pytest.raises(error.Error, match=r"num_envs 1000: .* of 1,551 numbers each .* 0.0372 GB"):
        UavVectorEnv("case8", 1000, radar)
