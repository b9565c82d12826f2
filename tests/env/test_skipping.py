"""Time of a decision: forced steps, the steps since the last free decision, and skipping them."""

from __future__ import annotations

import copy
from collections.abc import Iterator
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from pettingzoo.test import parallel_api_test

from desim_uav.env import SkipForced, SkipForcedParallel, UavEnv, UavParallelEnv
from desim_uav.model.rules import Mode
from tests.env.helpers import BRITTLE, play_parallel

FREE = {Mode.FLYING, Mode.CHARGED}
ALONE = {**BRITTLE, "drones.count": 1}
ENDS = {**BRITTLE["drones.battery"], "on_crash": "end_episode"}
GAMMA = 0.9


def rounds(told: list[tuple[Any, ...]]) -> Iterator[list[tuple[Any, ...]]]:
    """The resets and steps of each episode."""
    starts = [k for k, one in enumerate(told) if len(one) == 2]
    for start, end in zip(starts, [*starts[1:], len(told)], strict=True):
        yield told[start:end]


@pytest.mark.parametrize("engine", [pytest.param("des", marks=pytest.mark.thorough), "batch"])
@pytest.mark.parametrize("respawns", [True, False])
def test_forced_steps_and_the_time_since_a_free_decision(engine: str, respawns: bool):
    """Counted here from modes, for whole episodes that carry over."""
    config = BRITTLE if respawns else {**BRITTLE, "drones.battery": ENDS}
    env = UavParallelEnv("case8", config, engine=engine)
    told, modes = [], []
    for one in play_parallel(env, 4, seed=1):
        told.append(one)
        modes.append([seen.mode for seen in env.session.snapshot.observations])
    longest, at = 0, 0
    for episode in rounds(told):
        for d, agent in enumerate(env.possible_agents):
            free = [0]
            for step, one in enumerate(episode):
                info, mode = one[-1][agent], modes[at + step][d]
                assert info["forced"] == int(mode not in FREE)
                assert info["forced"] == int(one[0][agent]["action_mask"].sum() == 1)
                assert info["elapsed_steps"] == step - max(t for t in free if t < max(step, 1))
                longest = max(longest, info["elapsed_steps"])
                if mode in FREE:
                    free.append(step)
        at += len(episode)
    assert longest > (5 if respawns else 1)


@pytest.mark.parametrize("config", [BRITTLE, ALONE], ids=["three drones", "one drone"])
def test_forced_epochs_are_skipped_in_the_joint_environment(config: dict[str, Any]):
    """Against the same flight without the wrapper: the same decisions, and sums worked out here."""
    plain = UavEnv("case8", config, engine="batch")
    skipping = SkipForced(UavEnv("case8", config, engine="batch"), GAMMA)
    rng, skipped = np.random.default_rng(0), 0
    for seed in (5, None, None, None):
        _, info = plain.reset(seed=seed)
        _, info_of_other = skipping.reset(seed=seed)
        over = False
        while not over:
            action = some_actions(info, rng, plain.drones)
            seen, reward, terminated, truncated, info = plain.step(action)
            rewards = [reward]
            while info["forced"] and not (terminated or truncated):
                only = some_actions(info, rng, plain.drones)
                seen, reward, terminated, truncated, info = plain.step(only)
                rewards.append(reward)
            told = skipping.step(action)
            over = terminated or truncated
            assert (seen == told[0]).all() and told[2:4] == (terminated, truncated)
            assert told[1] == pytest.approx(sum(r * GAMMA**k for k, r in enumerate(rewards)))
            info_of_other = told[4]
            way = {"duration_steps": len(rewards), "discount": pytest.approx(GAMMA ** len(rewards))}
            assert way.items() <= info_of_other.items()
            assert repr(info) == repr(info_of_other | {key: info[key] for key in way})
            if not info_of_other["forced"]:
                assert info["elapsed_steps"] >= len(rewards)
            skipped += len(rewards) - 1
    assert skipped > (2 if plain.drones > 1 else 20)


def some_actions(info: dict[str, Any], rng: np.random.Generator, drones: int) -> Any:
    masks = info["action_mask"].reshape(drones, -1)
    actions = [int(rng.choice(np.flatnonzero(mask))) for mask in masks]
    return actions if drones > 1 else actions[0]


@pytest.mark.parametrize("config", [BRITTLE, ALONE], ids=["three drones", "one drone"])
@pytest.mark.parametrize("gamma", [1.0, GAMMA])
def test_each_agent_is_paid_when_it_decides_again(config: dict[str, Any], gamma: float):
    plain = UavParallelEnv("case8", config, engine="batch")
    env = SkipForcedParallel(UavParallelEnv("case8", config, engine="batch"), gamma)
    rng = np.random.default_rng(2)
    steps = epochs = 0
    for seed in (3, None, None, None):
        seen, infos = plain.reset(seed=seed)
        others, _ = env.reset(seed=seed)
        owed = {agent: [] for agent in plain.agents}
        while env.agents:
            assert repr(seen) == repr(others)
            actions = choice(others, rng)
            others, paid, ends, cuts, told = env.step(actions)
            epochs += 1
            while True:
                seen, rewards, *over, infos = plain.step(actions)
                steps += 1
                for agent, reward in rewards.items():
                    owed[agent].append(reward)
                if not plain.agents or not all(info["forced"] for info in infos.values()):
                    break
                actions = choice(seen, rng)
            assert (over[0], over[1]) == (ends, cuts)
            for agent, info in infos.items():
                lasted, discount = (told[agent].pop(key) for key in ("duration_steps", "discount"))
                assert told[agent].items() <= info.items()
                expected = sum(reward * gamma**k for k, reward in enumerate(owed[agent]))
                if info["forced"] and plain.agents:
                    assert (paid[agent], lasted, discount) == (0.0, 0.0, 1.0)
                else:
                    assert paid[agent] == pytest.approx(expected)
                    assert lasted == len(owed[agent]) and discount == pytest.approx(gamma**lasted)
                    assert info["elapsed_steps"] == len(owed[agent]) or not plain.agents
                    owed[agent] = []
    assert epochs < steps == 120


def choice(seen: dict[str, Any], rng: np.random.Generator) -> dict[str, int]:
    """The same draws for the same masks; the only action where there is one."""
    return {
        agent: int((rng.random(9) * one["action_mask"]).argmax())
        if one["action_mask"].sum() > 1
        else int(one["action_mask"].argmax())
        for agent, one in seen.items()
    }


@pytest.mark.filterwarnings("ignore:.*different from the unwrapped version")  # It is a wrapper.
def test_the_libraries_accept_the_wrappers(capsys: pytest.CaptureFixture[str]):
    check_env(SkipForced(UavEnv("case8", BRITTLE, engine="batch"), GAMMA), skip_render_check=True)
    parallel_api_test(SkipForcedParallel(UavParallelEnv("case8", BRITTLE), GAMMA), num_cycles=100)
    assert "Passed" in capsys.readouterr().out
    made = gymnasium.make("desim_uav/Case8-v0", config=BRITTLE)
    wrapped = SkipForced(made, GAMMA)
    wrapped.reset(seed=0)
    wrapped.step([0, 1, 2])


@pytest.mark.parametrize("gamma", [0.0, 1.5, -1.0, float("nan")])
def test_discounts_that_are_refused(gamma: float):
    for make in (
        lambda: SkipForced(UavEnv("case8"), gamma),
        lambda: SkipForcedParallel(UavParallelEnv("case8"), gamma),
    ):
        with pytest.raises(gymnasium.error.Error, match="above 0 and at most 1"):
            make()


def test_copies_of_wrappers_are_independent():
    env = SkipForcedParallel(UavParallelEnv("case8", BRITTLE, engine="batch"), GAMMA)
    env.reset(seed=0)
    other = copy.copy(env)
    other.step(dict.fromkeys(other.agents, 0))
    rng = np.random.default_rng(0)
    twin = copy.deepcopy(env)
    actions = choice(env.reset()[0], rng)
    twin.reset()
    assert repr(env.step(actions)) == repr(twin.step(actions))
