"""Seeds, episodes and worlds: the same seed gives the same run, and a run goes on."""

from __future__ import annotations

import hashlib
import subprocess
import sys
from collections.abc import Iterable
from typing import Any

import gymnasium
import numpy as np
import pytest

from desim_uav.env import UavEnv, UavParallelEnv
from desim_uav.experiment.run import play
from desim_uav.model.random.streams import Streams
from desim_uav.model.rules import Mode
from desim_uav.model.state import Observation
from desim_uav.rules.observations import Position
from desim_uav.world import World, build_world
from tests.env.helpers import BRITTLE, log_steps, play_parallel, play_single, some_actions

NOISE = {"position_noise": {"probability": 0.2}}


def digest(told: Iterable[Any]) -> str:
    """A hash of all that was told, to the last bit."""
    summary = hashlib.sha256()

    def add(value: Any) -> None:
        if isinstance(value, dict):
            for key in value:
                add(key)
                add(value[key])
        elif isinstance(value, tuple):
            for item in value:
                add(item)
        elif isinstance(value, np.ndarray):
            summary.update(str((value.dtype, value.shape)).encode() + value.tobytes())
        else:
            summary.update(repr(value).encode())

    for part in told:
        add(part)
    return summary.hexdigest()


def digests(case: str) -> list[str]:
    config = {**BRITTLE, **NOISE} if case > "case3" else {}
    return [
        digest(play_parallel(UavParallelEnv(case, config), 4, seed=7)),
        digest(play_single(UavEnv(case, {**config, "observation.kind": "local"}), 4, seed=7)),
    ]


@pytest.mark.thorough
@pytest.mark.parametrize("case", ["case1", "case5", "case7", "case8", "case9"])
def test_the_same_seed_gives_the_same_run(case: str):
    assert digests(case) == digests(case)


@pytest.mark.thorough
def test_the_same_seed_gives_the_same_run_in_another_process():
    script = "from tests.env.test_runs import digests; print(digests('case8'))"
    told = subprocess.run([sys.executable, "-c", script], capture_output=True, check=True)
    assert told.stdout.decode().strip() == str(digests("case8"))


def test_a_seed_starts_over():
    env = UavEnv("case8")
    first = digest(play_single(env, 2, seed=3))
    assert digest(play_single(env, 2, seed=4)) != first
    assert digest(play_single(env, 2, seed=3)) == first
    assert digest(play_single(env, 2)) != first


def test_without_a_seed_the_run_goes_on():
    env = UavParallelEnv("case8", BRITTLE, engine="des")
    rng = np.random.default_rng(0)
    _, infos = env.reset(seed=11)
    log_steps(env)
    world, engine = env.session.world, env.session.engine
    for episode in range(1, 4):
        while env.agents:
            env.step(dict(zip(env.agents, some_actions(env, rng), strict=True)))
        before = engine.log.steps[-3:]
        _, infos = env.reset()
        assert infos["drone_0"]["episode_number"] == episode
        assert {info["seed"] for info in infos.values()} == {11}
        assert env.session.world is world
        after, _ = engine.positions_m()
        for step, seen, place in zip(before, env.session.snapshot.observations, after, strict=True):
            if step.mode is not Mode.CRASHED:  # which may be replaced in this very instant
                assert (step.x_m, step.y_m, step.z_m) == tuple(place)
                assert seen.mode is step.mode
                assert seen.battery_s == step.charge / 1e6


def test_an_episode_that_is_broken_off_is_followed_by_a_fresh_start():
    env = UavEnv("case8")
    env.reset(seed=0)
    env.step([0, 0, 0])
    env.reset()
    assert env.session.episode == 1
    assert [seen.battery_s for seen in env.session.snapshot.observations] == [1800.0] * 3


def test_without_carry_over_drones_begin_anew():
    env = UavEnv("case8", {"episode.carry_over": False})
    list(play_single(env, 1, seed=0))
    env.reset()
    assert [seen.battery_s for seen in env.session.snapshot.observations] == [1800.0] * 3


def test_a_seed_draws_the_world_too():
    env = UavEnv("case8")
    _, info = env.reset(seed=1)
    assert (info["seed"], info["world_seed"]) == (1, 1)
    homes = env.session.world.homes
    env.reset(seed=2)
    assert (env.session.world.homes != homes).any()
    env.reset(seed=1)
    assert (env.session.world.homes == homes).all()


def test_a_world_of_its_own_seed_stays():
    env = UavEnv("case8", {"world_seed": 5})
    _, info = env.reset(seed=1)
    assert (info["seed"], info["world_seed"]) == (1, 5)
    homes, requests = env.session.world.homes, env.session.engine.drawn.requests.rows
    env.reset(seed=2)
    assert (env.session.world.homes == homes).all()
    assert not np.array_equal(env.session.engine.drawn.requests.rows, requests)


@pytest.mark.parametrize("config", [{"seed": 0}, {"seed": 42}])
def test_the_scenario_may_give_the_seed(config: dict[str, int]):
    for _ in range(2):
        _, info = UavEnv("case1", config).reset()
        assert info["seed"] == info["world_seed"] == config["seed"]
        assert info["episode_number"] == 0


def test_a_seed_nobody_gave_is_drawn_and_told():
    first, second = UavEnv("case8"), UavEnv("case8")
    told = list(play_single(first, 2))
    _, info = second.reset()
    assert told[0][1]["seed"] != info["seed"]
    assert digest(play_single(second, 2, seed=told[0][1]["seed"])) == digest(told)


@pytest.mark.parametrize("seed", [2**63, -1])
def test_seeds_out_of_range(seed: int):
    for env in (UavEnv("case1"), UavParallelEnv("case1")):
        with pytest.raises(gymnasium.error.Error, match=r"[Ss]eed"):
            env.reset(seed=seed)
        env.reset(seed=2**63 - 1)


class Recorded:
    """Gives the commands it is given, and keeps what it sees."""

    ceiling = True

    def __init__(self, commands: Iterable[list[int]]) -> None:
        self.commands = [command for epoch in commands for command in epoch]
        self.seen: list[Observation] = []

    def begin(self, world: World, streams: Streams, carried: bool = False) -> None:
        pass

    def act(self, observation: Observation, mask: object) -> int:
        self.seen.append(observation)
        return self.commands[len(self.seen) - 1]


@pytest.mark.parametrize("config", [{}, {**BRITTLE, **NOISE}], ids=["case8", "brittle"])
def test_an_environment_is_a_run_of_the_simulator(config: dict[str, Any]):
    env = UavParallelEnv("case8", config)
    rng = np.random.default_rng(3)
    told, commands = [], []
    for episode in range(3):
        told.append(env.reset(seed=9 if episode == 0 else None)[0])
        while env.agents:
            commands.append(some_actions(env, rng))
            told.append(env.step(dict(zip(env.agents, commands[-1], strict=True))))
    policy = Recorded(commands)
    world = build_world(env.session.scenario, 9)
    logs = [log for log, _ in play(world, policy, "recorded", 9, episodes=3)]

    shown = [part for part in told if isinstance(part, dict)]
    steps = [part for part in told if isinstance(part, tuple)]
    expected = [step.reward for log in logs for step in log.steps]
    assert [reward for _, rewards, *_ in steps for reward in rewards.values()] == expected
    ends = [part for part in steps if part[3]["drone_0"]]
    assert len(shown) == len(ends) == 3
    decisions = [part if isinstance(part, dict) else part[0] for part in told]
    decisions = [part for part in decisions if all(part is not end[0] for end in ends)]
    encoded = [each["observation"].tolist() for part in decisions for each in part.values()]
    assert encoded == [list(Position().encode(seen, world.facts)) for seen in policy.seen]
    for log, (*_, infos) in zip(logs, ends, strict=True):
        assert sum(info["crashes"] for info in infos.values()) == log.crashes
        qoe3 = 100 * log.attached_us / log.duration_us / 48
        assert infos["drone_2"]["qoe3_percent"] == pytest.approx(qoe3)


def test_the_joint_environment_tells_what_the_agents_are_told():
    joint = list(play_single(UavEnv("case9", BRITTLE), 2, seed=1))
    each = list(play_parallel(UavParallelEnv("case9", BRITTLE), 2, seed=1))
    for one, many in zip(joint, each, strict=True):
        seen = [told["observation"] for told in many[0].values()]
        assert np.array_equal(one[0], np.concatenate(seen))
        infos = list(many[-1].values())
        assert one[-1]["attached_users"] == sum(info["attached_users"] for info in infos)
        assert one[-1]["crashes"] == sum(info["crashes"] for info in infos)
        assert one[-1]["qoe1_percent"] == infos[0]["qoe1_percent"]
        for term in (key for key in one[-1] if key.startswith("reward_")):
            assert one[-1][term] == pytest.approx(np.mean([info[term] for info in infos]))
        if len(one) == 5:
            assert one[1] == pytest.approx(np.mean(list(many[1].values())))
            assert one[1] == pytest.approx(sum(one[-1][k] for k in one[-1] if "reward_" in k))
            assert {one[2]} == set(many[2].values())
            assert {one[3]} == set(many[3].values())


def test_a_crash_may_end_an_episode():
    battery = {"kind": "endurance", "autonomy_min": 3, "return_below": 0.1}
    config = {"drones.battery": {**battery, "on_crash": "end_episode"}}
    env = UavParallelEnv("case8", config)
    *_, (_, _, terminated, truncated, infos) = play_parallel(env, 1, seed=0)
    assert set(terminated.values()) == {True}
    assert set(truncated.values()) == {False}
    assert env.agents == []
    assert sum(info["crashes"] for info in infos.values()) > 0
    env.reset()
    assert env.agents == ["drone_0", "drone_1", "drone_2"]
    assert [seen.battery_s for seen in env.session.snapshot.observations] == [180.0] * 3
