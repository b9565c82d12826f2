"""Environments of free flight: their spaces, their masks, and whole episodes of checkers."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from gymnasium.spaces import Box
from gymnasium.utils.env_checker import check_env
from pettingzoo.test import parallel_api_test

from desim_uav.env.parallel import UavParallelEnv
from desim_uav.env.parallel_vector import UavParallelVectorEnv
from desim_uav.env.session import ActionError
from desim_uav.env.single import UavEnv
from desim_uav.env.skipping import SkipForced, SkipForcedParallel
from desim_uav.env.vector import UavVectorEnv

ENGINES = ["des", pytest.param("batch", marks=pytest.mark.thorough)]


def scenario(dimensions: int = 2, limited: bool = True, **drones: Any) -> dict[str, Any]:
    """Two drones over a small map."""
    built = {"obstacles": {"cells": [[0, 0, 35], [2, 1, 70]]}} if dimensions == 3 else {}
    battery = {"autonomy_min": 6, "return_below": 0.8} if limited else None
    return {
        "seed": 1,
        "map": {"size_m": [800, 800], "cells": [4, 4], "dimensions": dimensions, **built},
        "drones": {
            "count": 2,
            "start_cells": [[1, 1], [2, 2]],
            "motion": {"space": "free"},
            "battery": battery,
            **drones,
        },
        "stations": {"count": 1, "radius_m": 200} if limited else {"count": 0},
        "users": {"count": 9},
        "episode": {"steps": 8},
    }


def box(numbers: int) -> Box:
    return Box(-1.0, 1.0, (numbers,), np.float32)


@pytest.mark.parametrize(
    ("dimensions", "limited", "numbers"), [(2, False, 2), (2, True, 3), (3, False, 3), (3, True, 4)]
)
def test_an_action_is_a_displacement_and_the_wish_to_charge(dimensions, limited, numbers):
    described = scenario(dimensions, limited)
    assert UavEnv(described).action_space == box(2 * numbers)
    assert UavParallelEnv(described).action_space("drone_1") == box(numbers)


@pytest.mark.parametrize(("dimensions", "limited", "numbers"), [(2, False, 3), (3, True, 5)])
def test_a_choice_of_cruise_speeds_is_one_more_number(dimensions, limited, numbers):
    described = choosing(dimensions, limited)
    assert UavEnv(described).action_space == box(2 * numbers)
    assert UavParallelEnv(described).action_space("drone_1") == box(numbers)


def choosing(dimensions: int = 2, limited: bool = True) -> dict[str, Any]:
    """The same scenario, in which commands choose a cruise speed from 2 to 8 m/s."""
    return scenario(dimensions, limited, motion={"space": "free", "cruise": [2, 8]})


@pytest.mark.parametrize("engine", ENGINES)
@pytest.mark.parametrize("dimensions", [2, 3])
def test_gymnasium_and_pettingzoo_find_nothing(dimensions, engine):
    check_env(UavEnv(scenario(dimensions), engine=engine), skip_render_check=True)
    parallel_api_test(UavParallelEnv(scenario(dimensions), engine=engine), num_cycles=20)
    check_env(UavEnv(choosing(dimensions), engine=engine), skip_render_check=True)


@pytest.mark.parametrize("engine", ENGINES)
def test_the_mask_says_what_the_last_number_can_do(engine):
    # fly, hover, return, charge: a drone with less than 80 % may return, and then does nothing else
    env = UavParallelEnv(scenario(), engine=engine)
    shown, _ = env.reset(seed=1)
    assert shown["drone_0"]["allowed"].tolist() == [1, 1, 0, 0]
    actions = {agent: np.array([1.0, 0.0, 1.0], np.float32) for agent in env.agents}
    shown, *_ = env.step(actions)
    assert shown["drone_0"]["allowed"].tolist() == [1, 1, 0, 0]  # 5 of 6 minutes are left
    shown, *_ = env.step(actions)
    assert shown["drone_0"]["allowed"].tolist() == [1, 1, 1, 0]
    shown, *_, infos = env.step(actions)
    assert shown["drone_0"]["allowed"].sum() == 1
    assert infos["drone_0"]["forced"] == 1


@pytest.mark.parametrize("engine", ENGINES)
def test_drones_observe_their_exact_place(engine):
    # In 60 s at 8.3 m/s and 4 m/s² they fly 480.7775 m at most, and upwards 5 * (60 - 2.5) m.
    env = UavParallelEnv({**scenario(3), "observation": {"kind": "local"}}, engine=engine)
    shown, _ = env.reset(seed=1)
    assert shown["drone_0"]["observation"][:3] == pytest.approx([1.5 / 4, 1.5 / 4, 0.5 / 3])
    shown, *_ = env.step(
        {
            "drone_0": np.array([0.0, 0.3, 0.0, -1.0], np.float32),
            "drone_1": np.array([0.0, 0.0, 0.1, -1.0], np.float32),
        }
    )
    north_m, up_m = 0.3 * (8.3 * 60 - 8.3**2 / 4), 0.1 * 5 * (60 - 2.5)
    assert shown["drone_0"]["observation"][1] == pytest.approx((300 + north_m) / 800)
    assert shown["drone_1"]["observation"][2] == pytest.approx((up_m / 20 + 0.5) / 3)


def test_position_errors_move_the_place_by_whole_cells():
    noisy = {"position_noise": {"probability": 1.0, "sigma_cells": 1.0}}
    env = UavParallelEnv({**scenario(), **noisy, "observation": {"kind": "local"}})
    env.reset(seed=1)
    wrong = set()
    for _ in range(7):
        actions = {agent: np.array([0.1, -0.2, -1.0], np.float32) for agent in env.agents}
        shown, *_ = env.step(actions)
        true = dict(zip(env.session.state_names, env.state(), strict=True))
        for drone, seen in shown.items():
            off = 4 * (seen["observation"][:2] - [true[f"{drone}_x"], true[f"{drone}_y"]])
            assert np.allclose(off, off.round(), atol=1e-5)
            wrong |= set(off.round().tolist())
    assert len(wrong) > 1


def test_wrong_actions_are_refused():
    env = UavEnv(scenario())
    env.reset(seed=1)
    for wrong in (np.zeros(5), np.full(6, np.nan), "east", np.zeros((2, 3))):
        with pytest.raises(ActionError):
            env.step(wrong)
    env.step(np.full(6, 3.0))  # which counts as 1
    drones = UavParallelEnv(scenario())
    drones.reset(seed=1)
    with pytest.raises(ActionError, match="drone_1"):
        drones.step({"drone_0": np.zeros(3), "drone_1": np.zeros(2)})


@pytest.mark.thorough
@pytest.mark.parametrize("make", [scenario, choosing])
@pytest.mark.parametrize("dimensions", [2, 3])
def test_all_environments_give_the_same_numbers(dimensions, make):
    rng = np.random.default_rng(dimensions)
    described = make(dimensions)
    numbers = dimensions + 1 + (make is choosing)
    slow, fast = UavEnv(described), UavEnv(described, engine="batch")
    drones = UavParallelEnv(described, engine="batch")
    many = UavVectorEnv(described, 2, world_seed=1)
    crowd = UavParallelVectorEnv(described, 2, world_seed=1)
    assert many.action_space.shape == (2, 2 * numbers)
    assert crowd.action_space.shape == (2, 2, numbers)
    first, _ = slow.reset(seed=1)
    np.testing.assert_array_equal(first, fast.reset(seed=1)[0])
    drones.reset(seed=1)
    many.reset(seed=[1, 5])
    crowd.reset(seed=[1, 5])
    for _ in range(8):
        action = rng.uniform(-1, 1, 2 * numbers).astype(np.float32)
        seen, reward, *_ = slow.step(action)
        other, others, *_ = fast.step(action)
        np.testing.assert_array_equal(seen, other)
        assert reward == others
        rows = np.stack([action, action])
        batch, rewards, *_ = many.step(rows)
        np.testing.assert_array_equal(batch[0], seen)
        assert rewards[0] == reward
        own, paid, *_ = crowd.step(rows.reshape(2, 2, numbers))
        np.testing.assert_array_equal(own[0].reshape(-1), seen)
        parts = dict(zip(drones.agents, action.reshape(2, numbers), strict=True))
        told, gains, *_ = drones.step(parts)
        np.testing.assert_array_equal(
            np.concatenate([each["observation"] for each in told.values()]), seen
        )
        assert list(gains.values()) == paid[0].tolist()


def test_forced_epochs_are_skipped():
    described = {**scenario(), "episode": {"steps": 12}}
    env = SkipForced(UavEnv(described))
    drones = SkipForcedParallel(UavParallelEnv(described))
    env.reset(seed=1)
    drones.reset(seed=1)
    action = np.array([1.0, 0.0, 1.0], np.float32)
    over, passed = False, 0
    while not over:
        _, _, _, over, info = env.step(np.tile(action, 2))
        assert over or not info["forced"]
        passed += 1
    assert passed < 12
    while drones.agents:
        *_, infos = drones.step(dict.fromkeys(drones.agents, action))
        assert not drones.agents or not all(each["forced"] for each in infos.values())


def test_drones_of_types_without_a_battery_have_no_wish():
    described = scenario()
    motion = {"space": "free"}
    described["drones"] = [
        {"name": "a", "count": 1, "motion": motion, "battery": {"autonomy_min": 6}},
        {"name": "b", "count": 1, "motion": motion, "battery": None},
    ]
    env = UavParallelEnv(described)
    assert (env.action_space("drone_0"), env.action_space("drone_1")) == (box(3), box(2))
    parallel_api_test(env, num_cycles=10)
    motion["cruise"] = [2, 8]
    env = UavParallelEnv(described)
    assert (env.action_space("drone_0"), env.action_space("drone_1")) == (box(4), box(3))
    parallel_api_test(env, num_cycles=10)
