"""Learners of stable-baselines3 that need one number as their action, or a Box to observe."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest
from gymnasium.wrappers import FlattenObservation

import desim_uav.env
from desim_uav.env import InTurn, JointActions, UavEnv

sb3 = pytest.importorskip("stable_baselines3")
contrib = pytest.importorskip("sb3_contrib")
vec_env = pytest.importorskip("stable_baselines3.common.vec_env")

pytestmark = [
    pytest.mark.thorough,
    pytest.mark.filterwarnings("ignore:.*:UserWarning"),
    pytest.mark.filterwarnings("ignore:.*:DeprecationWarning"),
]
SMALL: dict[str, Any] = {"seed": 0, "policy_kwargs": {"net_arch": [16]}}
ONCE: dict[str, Any] = {**SMALL, "n_steps": 31, "batch_size": 31, "n_epochs": 1}
LOCAL = {"observation.kind": "local"}


def made(config: dict[str, Any] | None = None) -> UavEnv:
    return UavEnv("case8", config, engine="batch", world_seed=0)


def flies_an_episode(model: Any, env: Any) -> int:
    """Fly a whole episode by a model, and return the number of its choices."""
    observation, _ = env.reset(seed=9)
    over, choices = False, 0
    while not over:
        action, _ = model.predict(observation, deterministic=True)
        observation, _, terminated, truncated, _ = env.step(action)
        over, choices = terminated or truncated, choices + 1
    return choices


@pytest.mark.parametrize(("wrapper", "choices"), [(JointActions, 30), (InTurn, 90)])
@pytest.mark.parametrize("config", [None, LOCAL], ids=["position", "local"])
def test_dqn_flies_three_drones(
    wrapper: Callable[[Any], Any], choices: int, config: dict[str, Any] | None
):
    gamma = 0.95 if wrapper is JointActions else 0.95 ** (1 / 3)
    env = wrapper(made(config))
    model = sb3.DQN("MlpPolicy", env, gamma=gamma, learning_starts=60, **SMALL)
    model.learn(2 * choices + 5)
    assert flies_an_episode(model, wrapper(made(config))) == choices


@pytest.mark.parametrize("wrapper", [JointActions, InTurn])
def test_masks_are_heeded(wrapper: Callable[[Any], Any]):
    env = wrapper(made())
    model = contrib.MaskablePPO("MlpPolicy", env, **ONCE)
    model.learn(31)
    observation, info = env.reset(seed=4)
    for _ in range(60):
        action, _ = model.predict(observation, action_masks=env.action_masks())
        assert info["action_mask"][action]
        observation, _, terminated, truncated, info = env.step(action)
        if terminated or truncated:
            observation, info = env.reset()


def flattened() -> Any:
    return vec_env.DummyVecEnv([lambda: FlattenObservation(made())])


def local() -> Any:
    return desim_uav.env.UavVecEnv("case8", 2, LOCAL, world_seed=0)


def in_turn() -> Any:
    return vec_env.DummyVecEnv([lambda: InTurn(made())])


@pytest.mark.parametrize("make", [flattened, local, in_turn])
def test_recurrent_networks_and_wrappers_that_need_a_box(make: Callable[[], Any]):
    small = {**ONCE, "policy_kwargs": {"net_arch": [16], "lstm_hidden_size": 16}}
    contrib.RecurrentPPO("MlpLstmPolicy", make(), **small).learn(31)
    for env in (vec_env.VecNormalize(make()), vec_env.VecFrameStack(make(), 3)):
        sb3.PPO("MlpPolicy", env, **ONCE).learn(31)


def test_the_default_observation_is_no_box():
    """The how-to says so, and names what to do."""
    env = vec_env.DummyVecEnv([made])
    with pytest.raises(ValueError, match="VecNormalize only supports"):
        vec_env.VecNormalize(env)
    with pytest.raises(AssertionError, match="VecFrameStack only works"):
        vec_env.VecFrameStack(env, 3)
