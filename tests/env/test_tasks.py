"""Sets of worlds, of which each episode draws one, and curricula over keys of the scenario."""

from __future__ import annotations

import copy
import pickle
from typing import Any

import numpy as np
import pytest

from desim_uav.env import Curriculum, UavEnv, UavParallelEnv, UavParallelVectorEnv, UavVectorEnv
from desim_uav.env import tasks as module
from desim_uav.env.tasks import WORLDS
from desim_uav.errors import ScenarioError
from tests.env.helpers import BRITTLE
from tests.env.test_parallel_vector import random_actions
from tests.env.test_vector import assert_same

SHORT = {**BRITTLE, "episode.steps": 4}


def worlds_of(env: Any, episodes: int, seed: int) -> list[int]:
    """The world of each episode."""
    infos = [env.reset(seed=seed if k == 0 else None)[1] for k in range(episodes)]
    return [info.get("drone_0", info)["world_seed"] for info in infos]


def test_the_sets_of_worlds_are_disjoint():
    seeds = [seed for worlds in WORLDS.values() for seed in worlds]
    assert len(set(seeds)) == len(seeds) == 1024 + 128 + 128
    assert all(max(worlds) < 2**32 for worlds in WORLDS.values())


@pytest.mark.parametrize("name", ["train", pytest.param("test", marks=pytest.mark.thorough)])
def test_each_episode_draws_a_world_of_the_set(name: str):
    drawn = worlds_of(UavEnv("case1", SHORT_OF_ONE, world_seed=name), 12, seed=3)
    assert set(drawn) <= set(WORLDS[name]) and len(set(drawn)) > 8
    assert drawn == worlds_of(UavParallelEnv("case1", world_seed=name, engine="batch"), 12, seed=3)
    assert drawn != worlds_of(UavEnv("case1", world_seed=name), 12, seed=4)


SHORT_OF_ONE = {"episode.steps": 4}


def test_all_worlds_of_a_set_are_drawn_equally_often():
    tasks = module.tasks_of("case1", world_seed=range(10, 14))
    drawn = [tasks.world_seed(0, 0, episode) for episode in range(4000)]
    counts = [drawn.count(seed) for seed in range(10, 14)]
    assert sum(counts) == 4000 and max(abs(count - 1000) for count in counts) < 110  # 4 σ


@pytest.mark.parametrize("kind", [pytest.param("position", marks=pytest.mark.thorough), "local"])
def test_episodes_in_a_set_of_worlds_are_those_in_its_worlds(kind: str):
    """Every environment: drones begin afresh, and the numbers are those of that world alone."""
    config = {**SHORT, "observation.kind": kind}
    worlds = range(20, 23)
    one = UavParallelEnv("case8", config, world_seed=worlds)
    other = UavParallelEnv("case8", config, world_seed=worlds, engine="batch")
    many = UavParallelVectorEnv("case8", 2, config, "Disabled", world_seed=worlds)
    joint = UavVectorEnv("case8", 2, config, "Disabled", world_seed=worlds)
    rng = np.random.default_rng(0)
    seen = set()
    for episode in range(5):
        seed = 6 if episode == 0 else None
        first, told = one.reset(seed=seed)
        begins = [env.reset(seed=seed) for env in (other, many, joint)]
        world = told["drone_0"]["world_seed"]
        seen.add(world)
        alone = UavParallelEnv("case8", {**config, "episode.carry_over": False}, world_seed=world)
        alone.reset(seed=6)
        for _ in range(episode):
            alone.reset()
        assert repr(begins[0]) == repr((first, told))
        assert [info["world_seed"][0] for _, info in begins[1:]] == [world] * 2
        while one.agents:
            actions = random_actions(many.action_masks(), rng)
            of_each = dict(zip(one.agents, actions[0].tolist(), strict=True))
            steps = [env.step(of_each) for env in (one, other)]
            assert repr(steps[0]) == repr(steps[1])
            assert repr(alone.step(of_each)) == repr(steps[0])
            observations, rewards, *_ = many.step(actions)
            assert_same(rewards[0], np.array(list(steps[0][1].values())))
            own = np.array([part["observation"] for part in steps[0][0].values()])
            assert_same(observations[0], own)
            assert_same(joint.step(actions)[0], observations.reshape(2, -1))
    assert len(seen) > 1


def test_a_copy_draws_the_same_worlds():
    env = UavParallelVectorEnv("case8", 2, SHORT, "SameStep", world_seed="train")
    env.reset(seed=0)
    env.step(np.zeros((2, 3), int))
    others = [copy.deepcopy(env), pickle.loads(pickle.dumps(env))]
    for _ in range(10):
        told = env.step(np.zeros((2, 3), int))
        for other in others:
            for part, same in zip(told, other.step(np.zeros((2, 3), int)), strict=True):
                assert_same(part, same)


def test_only_so_many_worlds_are_kept(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(module, "MOST_WORLDS", 3)
    module._KEPT.clear()
    env = UavEnv("case1", SHORT_OF_ONE, world_seed="train", engine="batch")
    built = set(worlds_of(env, 6, seed=0))
    assert len(built) > 3 and len(module._KEPT) == 3
    world = env.session.world
    assert module._kept_world(env.session.scenario, world.seed) is world


def test_a_world_seed_of_the_configuration_takes_precedence():
    env = UavEnv("case1", {"world_seed": 5}, world_seed="train")
    assert worlds_of(env, 3, seed=0) == [5, 5, 5]


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ("trian", r"'trian' \(did you mean 'train'\?\); allowed: .*'validation', 'test'"),
        (range(3, 3), "has no world seeds"),
        (range(-2, 3), "has no world seeds"),
    ],
)
def test_sets_that_do_not_exist(wrong: Any, message: str):
    for make in (UavEnv, UavParallelEnv):
        with pytest.raises(ScenarioError, match=message):
            make("case1", world_seed=wrong)


# ---- curricula

RATE = "demand.rate_per_hour"
BUSIER = [(2, {RATE: 20.0}), (3, {"users.mobility.speed_mps": 3.0})]


def rates(env: Any, episodes: int) -> list[tuple[float, float]]:
    """The rate of requests and the speed of users in each episode."""
    found = []
    for k in range(episodes):
        env.reset(seed=1 if k == 0 else None)
        scenario = env.session.scenario
        assert env.session.world.scenario is scenario
        found.append((scenario.demand.rate_per_hour, scenario.users.mobility.speed_mps))
        for _ in range(4):
            env.step([4, 4, 4])
    return found


@pytest.mark.parametrize("engine", ["des", "batch"])
def test_stages_by_episodes_and_by_steps(engine: str):
    config = {"demand": {"kind": "poisson", "rate_per_hour": 5.0}, "episode.steps": 4}
    expected = [(5.0, 1.4), (5.0, 1.4), (20.0, 1.4), (5.0, 3.0), (5.0, 3.0)]
    env = UavEnv("case8", config, engine=engine, curriculum=BUSIER)
    assert rates(env, 5) == expected
    assert rates(env, 5) == expected  # from the beginning
    by_steps = Curriculum([(begin * 4 - 1, keys) for begin, keys in BUSIER], "steps")
    assert rates(UavEnv("case8", config, engine=engine, curriculum=by_steps), 5) == expected


def test_episodes_of_a_stage_are_those_of_its_scenario():
    config = {"episode.steps": 4, "demand": {"kind": "poisson", "rate_per_hour": 5.0}}
    many = UavParallelVectorEnv("case8", 2, config, "SameStep", world_seed=2, curriculum=BUSIER)
    alone = [
        UavParallelEnv("case8", {**config, "episode.carry_over": False, **keys}, world_seed=2)
        for keys in ({}, {}, {RATE: 20.0}, {"users.mobility.speed_mps": 3.0})
    ]
    for env in alone:  # the first two episodes carry over, and are compared by their requests only
        env.reset(seed=0)
    many.reset(seed=0)
    for episode, env in enumerate(alone):
        for _ in range(episode):
            env.reset()
        while env.agents:
            actions = np.full((2, 3), 4)
            _, rewards, _, _, infos = many.step(actions)
            infos = infos.get("final_info", infos)
            _, paid, _, _, told = env.step(dict.fromkeys(env.agents, 4))
            assert infos["requests"][0] == told["drone_0"]["requests"]
            assert infos["episode_number"][0] == episode
            if episode != 1:
                assert_same(rewards[0], np.array(list(paid.values())))


@pytest.mark.parametrize(
    ("stages", "problems"),
    [
        ([(5, {"drones.count": 2})], ["drones.count: changes the number of drones"]),
        (
            [(5, {RATE: 2.0, "observation": {"kind": "local"}})],
            ["observation: changes the observation space, which must stay the same"],
        ),
        ([(5, {"reward": {"kind": "coverage"}})], ["reward: changes the terms of the reward"]),
        (
            [(0, {"users.count": -1}), (3, {"usres.count": 4}), (2, {}), (4,), (2.5, {})],
            ["users.count", "usres", "curriculum[2]", "curriculum[3]", "curriculum[4]"],
        ),
    ],
)
def test_all_problems_are_named_at_once(stages: Any, problems: list[str]):
    config = {"demand": {"kind": "poisson", "rate_per_hour": 5.0}}
    with pytest.raises(ScenarioError) as caught:
        UavParallelEnv("case8", config, curriculum=stages)
    assert len(caught.value.problems) >= len(problems)
    for problem in problems:
        assert any(problem in line for line in caught.value.problems), caught.value.problems
    assert all(line.startswith("curriculum[") for line in caught.value.problems)


def test_units_that_do_not_exist():
    with pytest.raises(ScenarioError, match="unit 'days': must be 'episodes' or 'steps'"):
        UavEnv("case8", curriculum=Curriculum([(1, {"users.count": 20})], "days"))
