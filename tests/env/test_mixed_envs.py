"""Environments of drones that fly freely beside drones that fly from cell to cell."""

from __future__ import annotations

import copy
from typing import Any

import numpy as np
import pytest
from gymnasium.spaces import Box, Discrete
from pettingzoo.test import parallel_api_test

from desim_uav.env.parallel import UavParallelEnv
from desim_uav.env.parallel_vector import UavParallelVectorEnv
from desim_uav.env.session import ActionError
from desim_uav.env.single import UavEnv
from desim_uav.env.skipping import SkipForcedParallel
from desim_uav.env.vector import UavVectorEnv
from desim_uav.errors import ScenarioError

ENGINES = ["des", pytest.param("batch", marks=pytest.mark.thorough)]
LIMITED = {"autonomy_min": 6, "return_below": 0.8}


def scenario(dimensions: int = 2, **changes: Any) -> dict[str, Any]:
    """Two drones of each kind over a small map, of which one of each kind has a battery."""
    built = {"obstacles": {"cells": [[0, 0, 35], [2, 1, 70]]}} if dimensions == 3 else {}
    free = {"name": "free", "count": 1, "motion": {"space": "free", "cruise": [2, 8]}}
    return {
        "seed": 1,
        "map": {"size_m": [800, 800], "cells": [4, 4], "dimensions": dimensions, **built},
        "drones": [
            {"name": "tethered", "count": 1, "battery": None, "start_cells": [[1, 1]]},
            {**free, "battery": LIMITED, "start_cells": [[2, 2]]},
            {"name": "by_cells", "count": 1, "battery": LIMITED, "start_cells": [[3, 3]]},
            {**free, "name": "light", "battery": None},
        ],
        "stations": {"count": 1, "radius_m": 200},
        "users": {"count": 9},
        "episode": {"steps": 8},
        **changes,
    }


def box(numbers: int) -> Box:
    return Box(-1.0, 1.0, (numbers,), np.float32)


@pytest.mark.parametrize("dimensions", [2, 3])
def test_each_agent_has_the_spaces_of_its_kind(dimensions: int):
    env = UavParallelEnv(scenario(dimensions))
    moves = 5 if dimensions == 2 else 7
    wanted = [Discrete(moves), box(dimensions + 2), Discrete(moves + 2), box(dimensions + 1)]
    assert [env.action_space(agent) for agent in env.possible_agents] == wanted
    shown, _ = env.reset(seed=1)
    masks = [(key, len(own[key])) for own in shown.values() for key in own if key != "observation"]
    numbers = [("action_mask", moves), ("allowed", 4), ("action_mask", moves + 2), ("allowed", 2)]
    assert masks == numbers
    for agent, own in shown.items():
        assert own in env.observation_space(agent)


@pytest.mark.parametrize("engine", ENGINES)
@pytest.mark.parametrize("dimensions", [2, 3])
def test_pettingzoo_finds_nothing(dimensions: int, engine: str):
    parallel_api_test(UavParallelEnv(scenario(dimensions), engine=engine), num_cycles=30)


@pytest.mark.parametrize("engine", ENGINES)
def test_masks_say_what_each_can_do(engine: str):
    # Batteries of 6 minutes are below 80 % after 72 s.
    env = UavParallelEnv(scenario(), engine=engine)
    shown, _ = env.reset(seed=1)
    assert shown["drone_1"]["allowed"].tolist() == [1, 1, 0, 0]
    assert shown["drone_2"]["action_mask"].tolist() == [1, 1, 1, 1, 1, 0, 0]
    still = [4, np.zeros(4, np.float32), 4, np.zeros(3, np.float32)]
    still[1][-1] = -1.0
    for _ in range(2):
        shown, *_ = env.step(dict(zip(env.agents, still, strict=True)))
    assert shown["drone_0"]["action_mask"].tolist() == [1, 1, 1, 1, 1]
    assert shown["drone_1"]["allowed"].tolist() == [1, 1, 1, 0]
    assert shown["drone_2"]["action_mask"].tolist() == [1, 1, 1, 1, 1, 1, 0]
    assert shown["drone_3"]["allowed"].tolist() == [1, 1]
    back = [4, np.array([0.0, 0.0, 0.0, 1.0], np.float32), 5, np.zeros(3, np.float32)]
    shown, *_, infos = env.step(dict(zip(env.agents, back, strict=True)))
    assert [infos[agent]["forced"] for agent in env.agents] == [0, 1, 1, 0]
    sums = [sum(own[key].sum() for key in own if key != "observation") for own in shown.values()]
    assert sums == [5, 1, 1, 2]


def played(env: UavParallelEnv, seed: int, episodes: int = 2) -> list[Any]:
    """Return all that an environment returns in whole episodes of random actions."""
    told, rng = [], np.random.default_rng(seed)
    for episode in range(episodes):
        told.append(plain(env.reset(seed=seed if episode == 0 else None)))
        while env.agents:
            told.append(plain(env.step(some_actions(env, rng))))
            told.append(env.state().tolist())
    return told


def some_actions(env: UavParallelEnv, rng: np.random.Generator) -> dict[str, Any]:
    actions: dict[str, Any] = {}
    for agent in env.agents:
        space = env.action_space(agent)
        if isinstance(space, Box):
            actions[agent] = rng.uniform(-1, 1, space.shape).astype(np.float32)
        else:
            actions[agent] = int(rng.integers(space.n))
    return actions


def plain(value: Any) -> Any:
    """Arrays as lists, so that what was returned can be compared."""
    if isinstance(value, dict):
        return {key: plain(each) for key, each in value.items()}
    if isinstance(value, tuple):
        return [plain(each) for each in value]
    return value.tolist() if isinstance(value, np.ndarray) else value


@pytest.mark.thorough
@pytest.mark.parametrize("dimensions", [2, 3])
def test_both_engines_play_the_same_episodes(dimensions: int):
    described = scenario(dimensions, episode={"steps": 8, "carry_over": True})
    one, other = UavParallelEnv(described), UavParallelEnv(described, engine="batch")
    assert played(one, 3) == played(other, 3)


@pytest.mark.parametrize("engine", ENGINES)
def test_copies_and_saved_states_go_on_as_the_original(engine: str):
    env = UavParallelEnv(scenario(3), engine=engine)
    env.reset(seed=2)
    rng = np.random.default_rng(0)
    for _ in range(3):
        env.step(some_actions(env, rng))
    saved, twin, other = env.save(), copy.deepcopy(env), UavParallelEnv(scenario(3), engine=engine)
    assert plain(other.restore(saved))[0] == plain(twin.restore(saved))[0]
    while env.agents:
        actions = some_actions(env, rng)
        told = plain(env.step(actions))
        assert told == plain(twin.step(actions)) == plain(other.step(actions))


def test_wrong_actions_are_refused_by_the_drone():
    env = UavParallelEnv(scenario())
    env.reset(seed=1)
    right: dict[str, Any] = {"drone_0": 4, "drone_1": np.zeros(4), "drone_2": 4}
    right["drone_3"] = np.zeros(3)
    wrong: list[tuple[str, Any]] = [
        ("drone_0", np.zeros(4)),
        ("drone_0", 5),
        ("drone_0", 0.5),
        ("drone_1", 4),
        ("drone_1", np.zeros(3)),
        ("drone_2", 7),
        ("drone_2", -1),
        ("drone_3", np.full(3, np.nan)),
    ]
    for agent, action in wrong:
        with pytest.raises(ActionError, match=agent):
            env.step({**right, agent: action})
    env.step(right)


def test_forced_epochs_are_skipped():
    env = SkipForcedParallel(UavParallelEnv(scenario()))
    rng = np.random.default_rng(1)
    env.reset(seed=1)
    while env.agents:
        *_, infos = env.step(some_actions(env, rng))
        assert not env.agents or not all(each["forced"] for each in infos.values())


@pytest.mark.parametrize(
    "make", [UavEnv, lambda one: UavVectorEnv(one, 2), lambda one: UavParallelVectorEnv(one, 2)]
)
def test_an_array_of_actions_needs_drones_of_one_kind(make: Any):
    with pytest.raises(ScenarioError, match=r"free, light fly freely .* actions are one array"):
        make(scenario())
