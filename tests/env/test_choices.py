"""What may be chosen: masks in all their forms, and actions that are none."""

from __future__ import annotations

from typing import Any

import gymnasium
import numpy as np
import pytest

from desim_uav.env import UavEnv, UavParallelEnv
from desim_uav.model.rules import Action, Mode
from tests.env.helpers import BRITTLE, CASES, log_steps, play_parallel, play_single


@pytest.mark.parametrize(
    ("case", "config"),
    [(case, {}) for case in CASES] + [(case, BRITTLE) for case in CASES[3:]],
    ids=[*CASES, *(f"{case}-brittle" for case in CASES[3:])],
)
def test_masks_agree_and_always_leave_a_choice(case: str, config: dict[str, Any]):
    joint, each = UavEnv(case, config), UavParallelEnv(case, config)
    actions = len(joint.session.world.actions)
    for one, many in zip(play_single(joint, 3, 2), play_parallel(each, 3, 2), strict=True):
        flat = joint.action_masks()
        assert flat.dtype == np.bool_
        assert flat.shape == (joint.drones * actions,)
        assert flat.reshape(-1, actions).any(axis=1).all()
        mask = one[-1]["action_mask"]
        assert mask.dtype == np.int8
        assert np.array_equal(mask, flat)
        assert np.array_equal(each.action_masks(), flat)
        for agent, own in zip(each.possible_agents, flat.reshape(-1, actions), strict=True):
            assert many[0][agent]["action_mask"].dtype == np.int8
            assert np.array_equal(many[0][agent]["action_mask"], own)


def test_what_is_told_is_the_users_own():
    env = UavParallelEnv("case8")
    seen, _ = env.reset(seed=0)
    seen["drone_0"]["action_mask"][:] = 0
    assert env.action_masks().reshape(3, 9).any(axis=1).all()
    assert env.reset(seed=0)[0]["drone_0"]["action_mask"].any()


def test_a_drone_that_cannot_choose_has_one_action():
    env = UavParallelEnv("case8", BRITTLE)
    met = set()
    forced = {
        Mode.RETURNING: Action.GOTO_CHARGING_STATION,
        Mode.QUEUED: Action.CHARGE,
        Mode.CHARGING: Action.CHARGE,
        Mode.CRASHED: Action.HOVER,
    }
    for told in play_parallel(env, 6, seed=0):
        assert list(told[0]) == env.possible_agents
        for seen, one in zip(env.session.snapshot.observations, told[0].values(), strict=True):
            met.add(seen.mode)
            if seen.mode in forced:
                assert np.flatnonzero(one["action_mask"]).tolist() == [forced[seen.mode]]
    assert met == set(Mode)


def test_a_masked_action_is_obeyed_as_the_engine_does():
    env = UavEnv("case8", engine="des")
    env.reset(seed=0)
    log_steps(env)
    env.step([8, 7, 0])
    taken = [step.action_taken for step in env.session.engine.log.steps]
    assert taken == [Action.HOVER, Action.HOVER, Action.FORWARD]


@pytest.mark.parametrize(
    "action",
    [[0, 0, 9], [0, -1, 0], [0, 0], [0, 0, 0, 0], [0.5, 0, 0], np.zeros(3), 0, None, "abc"],
)
def test_what_is_no_joint_action(action: Any):
    env = UavEnv("case8")
    env.reset(seed=0)
    with pytest.raises(ValueError, match="action") as caught:
        env.step(action)
    assert isinstance(caught.value, gymnasium.error.InvalidAction)
    env.step(np.array([0, 1, 2]))


@pytest.mark.parametrize("action", [5, -1, 0.0, [0], np.array([0, 1])])
def test_what_is_no_action_of_a_single_drone(action: Any):
    env = UavEnv("case1")
    env.reset(seed=0)
    with pytest.raises(gymnasium.error.InvalidAction, match="action"):
        env.step(action)
    for good in (0, np.int64(1), np.array(2)):
        env.step(good)


@pytest.mark.parametrize(
    "actions",
    [{}, {"drone_0": 0}, {"drone_0": 0, "drone_1": 0, "drone_9": 0},
     {"drone_0": 0, "drone_1": 0, "drone_2": 9}, {"drone_0": 0, "drone_1": 0, "drone_2": 0.5}],
)  # fmt: skip
def test_what_are_no_actions_of_agents(actions: dict[str, Any]):
    env = UavParallelEnv("case8")
    env.reset(seed=0)
    with pytest.raises(gymnasium.error.InvalidAction, match="action"):
        env.step(actions)
    assert env.session.snapshot.step == 0


@pytest.mark.parametrize(("make", "action"), [(UavEnv, 0), (UavParallelEnv, {"drone_0": 0})])
def test_nothing_happens_outside_an_episode(make: type, action: Any):
    env = make("case1")
    with pytest.raises(gymnasium.error.ResetNeeded, match="call reset first"):
        env.step(action)
    with pytest.raises(gymnasium.error.ResetNeeded, match="call reset first"):
        env.action_masks()
    env.reset(seed=0)
    for _ in range(30):
        env.step(action)
    with pytest.raises(gymnasium.error.ResetNeeded, match="the episode is over"):
        env.step(action)
    assert env.action_masks().all()
