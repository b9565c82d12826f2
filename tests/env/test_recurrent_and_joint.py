"""Learners of stable-baselines3 that need one number as their action, or a Box to observe."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from gymnasium.spaces import flatten, flatten_space
from gymnasium.wrappers import FlattenObservation

import desim_uav.env
from desim_uav.env import InTurn, JointActions, UavEnv
from desim_uav.shipped import scenario_path

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
HOW_TO = Path(__file__).parents[2] / "docs" / "howto" / "environments.md"
REMEDY = "observation: {kind: local}"


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


def one_hot() -> Any:
    return desim_uav.env.UavVecEnv("case8", 2, world_seed=0, one_hot=True)


def in_turn() -> Any:
    return vec_env.DummyVecEnv([lambda: InTurn(made())])


def learners(env: Any) -> list[Callable[[], Any]]:
    """Learners on an environment, whose making fails if they need a Box and there is none."""
    small = {**ONCE, "policy_kwargs": {"net_arch": [16], "lstm_hidden_size": 16}}
    return [
        lambda: contrib.RecurrentPPO("MlpLstmPolicy", env, **small),
        lambda: sb3.PPO("MlpPolicy", vec_env.VecNormalize(env), **ONCE),
        lambda: sb3.PPO("MlpPolicy", vec_env.VecFrameStack(env, 3), **ONCE),
    ]


@pytest.mark.parametrize("make_env", [flattened, one_hot, local, in_turn])
def test_recurrent_networks_and_wrappers_that_need_a_box(make_env: Callable[[], Any]):
    for make in learners(make_env()):
        make().learn(31)


def test_one_hot_vectors_are_those_of_gymnasium():
    """At a reset, at the end of an episode, in a fork and in a copy of a state."""
    config = {"episode.steps": 3}
    plain = desim_uav.env.UavVecEnv("case8", 2, config, world_seed=0)
    shown = desim_uav.env.UavVecEnv("case8", 2, config, world_seed=0, one_hot=True)
    space = plain.observation_space
    assert shown.observation_space == flatten_space(space)

    def same(mine: Any, theirs: Any) -> bool:
        flat = np.array([flatten(space, each) for each in np.atleast_2d(theirs)])
        return bool((np.atleast_2d(mine) == flat).all())

    assert same(shown.reset(), plain.reset())
    for step in range(4):
        actions = np.full((2, 3), step)
        (mine, *_, infos), (theirs, *_, known) = shown.step(actions), plain.step(actions)
        assert same(mine, theirs)
        ends = [
            (one["terminal_observation"], each["terminal_observation"])
            for one, each in zip(infos, known, strict=True)
            if "terminal_observation" in each
        ]
        assert len(ends) == (2 if step == 2 else 0)
        assert all(same(*each) for each in ends)
    assert same(shown.restore(shown.save(1)), plain.restore(plain.save(1)))
    one, other = shown.fork(3), plain.fork(3)
    assert same(one.step(np.zeros((3, 3), int))[0], other.step(np.zeros((3, 3), int))[0])


def test_the_how_to_has_what_libraries_say_of_the_default_observation():
    text = HOW_TO.read_text(encoding="utf-8")
    for make in learners(vec_env.DummyVecEnv([made])):
        with pytest.raises((TypeError, ValueError, AssertionError)) as error:
            make()
        said, _, _ = f"{error.type.__name__}: {error.value}".partition("(")
        assert f"\n{said}" in text


def test_the_line_that_the_how_to_names_mends_it(tmp_path: Path):
    assert f"`{REMEDY}`" in HOW_TO.read_text(encoding="utf-8")
    file = tmp_path / "case8.yaml"
    file.write_text(scenario_path("case8").read_text(encoding="utf-8") + REMEDY, encoding="utf-8")
    for make in learners(vec_env.DummyVecEnv([lambda: UavEnv(file, engine="batch")])):
        make().learn(31)
