"""Environments of drones of several types: spaces, masks and saved states, on both engines."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from pettingzoo.test import parallel_api_test

from desim_uav.engine.base import RunSettings
from desim_uav.engine.choose import make_engine
from desim_uav.env import UavEnv, UavParallelEnv, UavParallelVectorEnv, UavVectorEnv
from desim_uav.env.session import ActionError
from desim_uav.learning.training import Training
from desim_uav.sample_path import draw
from desim_uav.scenario.load import from_mapping
from desim_uav.spaces import features
from desim_uav.world import build_world

FLEET: dict[str, Any] = {
    "seed": 5,
    "world_seed": 5,
    "drones": [
        {"name": "scout", "count": 2, "battery": {"autonomy_min": 5, "return_below": 1.0}},
        {"name": "relay", "count": 1, "battery": {"autonomy_min": 9}, "bandwidth_kbps": 900},
        {"name": "tethered", "count": 1, "battery": None, "footprint_radius_m": 300},
    ],
    "users": {"count": 12},
    "episode": {"steps": 12, "carry_over": True},
    "observation": {"kind": "position"},
}


@pytest.mark.parametrize("engine", ["des", "batch"])
class TestAgents:
    def test_each_agent_has_the_spaces_of_its_type(self, engine: str):
        env = UavParallelEnv(FLEET, engine=engine)
        parallel_api_test(env, num_cycles=30)
        actions = [space.n for space in env.action_spaces.values()]
        assert actions == [9, 9, 9, 7]
        highest = [
            (space["observation"].start + space["observation"].nvec - 1).tolist()
            for space in env.observation_spaces.values()
        ]
        assert [each[-1] for each in highest[:3]] == [5, 5, 9]  # minutes left
        assert [len(each) for each in highest] == [4, 4, 4, 3]
        shown, _ = env.reset(seed=1)
        assert [len(each["action_mask"]) for each in shown.values()] == actions
        assert [len(each["observation"]) for each in shown.values()] == [4, 4, 4, 3]

    def test_actions_of_another_type_are_refused(self, engine: str):
        env = UavParallelEnv(FLEET, engine=engine)
        env.reset(seed=1)
        told = dict.fromkeys(env.agents, 4)
        with pytest.raises(ActionError, match=r"drone_3: actions must be from 0 to 6, not 7"):
            env.step(told | {"drone_3": 7})
        env.step(told | {"drone_2": 7})

    def test_one_controller_sees_all_with_zeros_behind(self, engine: str):
        env = UavEnv(FLEET, engine=engine)
        shown, info = env.reset(seed=1)
        assert shown.shape == (16,) and env.observation_space.contains(shown)
        assert shown.reshape(4, 4)[3, 3] == 0
        masks = info["action_mask"].reshape(4, 9)
        assert not masks[3, 7:].any() and masks[0, 7]
        assert env.action_space.nvec.tolist() == [9] * 4
        env.step([0, 1, 2, 7])  # a masked action is a hover


def test_engines_and_arrays_show_the_same():
    kinds = ("local", "team")
    for kind in kinds:
        changes = {"observation.kind": kind}
        one, other = (UavParallelEnv(FLEET, changes, engine=e) for e in ("des", "batch"))
        many = UavParallelVectorEnv(FLEET, 2, changes)
        joint = UavVectorEnv(FLEET, 2, changes)
        seen, _ = one.reset(seed=1)
        alike, _ = other.reset(seed=1)
        rows, _ = many.reset(seed=[1, 2])
        flat, _ = joint.reset(seed=[1, 2])
        rng = np.random.default_rng(0)
        for _ in range(8):
            assert many.observation_space.contains(rows)
            assert (flat.reshape(rows.shape) == rows).all()
            for d, agent in enumerate(one.agents):
                own = seen[agent]["observation"]
                assert (own == alike[agent]["observation"]).all()
                assert (rows[0, d, : len(own)] == own).all() and not rows[0, d, len(own) :].any()
            masks = [each["action_mask"] for each in seen.values()]
            told = [int(rng.choice(np.flatnonzero(mask))) for mask in masks]
            seen = one.step(dict(zip(one.agents, told, strict=True)))[0]
            alike = other.step(dict(zip(other.agents, told, strict=True)))[0]
            rows = many.step(np.array([told, told]))[0]
            flat = joint.step(np.array([told, told]))[0]


def test_features_in_arrays_have_the_bounds_of_all_types():
    world = build_world(from_mapping(FLEET), 5)
    assert [feature.name for feature in features(world)][-1] == "battery_min"
    assert [feature.high for feature in features(world)][-1] == 9


@pytest.mark.parametrize(("first", "second"), [("des", "batch"), ("batch", "des")])
def test_either_engine_goes_on_from_a_state_of_the_other(first: str, second: str):
    world = build_world(from_mapping(FLEET), 5)
    told = RunSettings((True,) * 4, carry_over=True)
    one, other = (make_engine(name, world, told) for name in (first, second))
    for episode in range(2):
        shown = one.reset(draw(world, 5, episode))
        while not (shown.terminated or shown.truncated):
            commands = [
                int(np.flatnonzero(mask)[(k + shown.step) % sum(mask)])
                for k, mask in enumerate(shown.masks)
            ]
            saved = one.save() if shown.step % 4 == 3 else None
            shown = one.step(commands)
            if saved is not None:
                other.restore(saved)
                assert other.step(commands) == shown


def test_both_trainings_learn_the_same_tables():
    world = build_world(from_mapping(FLEET), 5)
    tables = []
    for engine in ("des", "batch"):
        training = Training(world, 5, engine)
        while training.episode < 6:
            training.play(6 - training.episode)
        tables.append(training.q)
    assert tables[0].shape[-1] == 9
    assert (tables[0] == tables[1]).all()
