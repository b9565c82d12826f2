"""The discount of each transition, where transitions take one step and three (by hand)."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from gymnasium.vector import AutoresetMode

from desim_uav.env import (
    SkipForced,
    SkipForcedParallel,
    UavEnv,
    UavMoEnv,
    UavParallelEnv,
    UavParallelVectorEnv,
    UavVectorEnv,
)
from tests.semi_markov import DISCOUNTS, DURATIONS, EAST, GAMMA, HOVER, REWARDS, TWO, WAY, WEST

Told = tuple[float, float, float]
"""The reward, the duration and the discount of a transition."""

BEGUN = (0.0, 1.0)
"""The duration and the discount before the first transition."""

PAIR: dict[str, Any] = {"drones.count": 2, "drones.start_cells": [[0, 0], [1, 0]]}
"""Another drone begins in the east."""


def of(info: dict[str, Any]) -> tuple[Any, Any]:
    return info["duration_steps"], info["discount"]


def flown(env: Any, name: str = "") -> list[Told]:
    """The transitions of an episode of one drone, in an environment of one controller or agent."""
    _, infos = env.reset(seed=0)
    assert of(infos[name] if name else infos) == BEGUN
    told = []
    for action in WAY:
        _, reward, _, _, info = env.step({name: action} if name else action)
        told.append((reward[name], *of(info[name])) if name else (np.sum(reward), *of(info)))
    return told


BY_HAND = list(zip(REWARDS, DURATIONS, DISCOUNTS, strict=True))


@pytest.mark.parametrize("engine", ["des", "batch"])
def test_each_transition_has_its_duration_and_its_discount(engine: str):
    assert flown(UavEnv(TWO, engine=engine)) == BY_HAND
    assert flown(UavMoEnv(TWO, engine=engine)) == BY_HAND
    assert flown(SkipForced(UavEnv(TWO, engine=engine), GAMMA)) == BY_HAND
    parallel = UavParallelEnv(TWO, engine=engine)
    assert flown(parallel, "drone_0") == BY_HAND
    assert flown(SkipForcedParallel(parallel, GAMMA), "drone_0") == BY_HAND


@pytest.mark.parametrize("mode", list(AutoresetMode))
@pytest.mark.parametrize("make", [UavVectorEnv, UavParallelVectorEnv])
def test_each_transition_of_many_environments_has_its_discount(make: Any, mode: AutoresetMode):
    env = make(TWO, 2, autoreset_mode=mode)
    _, infos = env.reset(seed=0)
    assert of_first(infos) == BEGUN
    told = []
    for action in WAY:
        _, rewards, *_, infos = env.step(np.full((2, 1), action))
        told.append((rewards.flat[0], *of_first(infos.get("final_info", infos))))
    assert told == BY_HAND
    if mode is AutoresetMode.SAME_STEP:
        assert of_first(infos) == BEGUN, "the infos beside those of the end are of a new episode"
    if mode is AutoresetMode.NEXT_STEP:
        infos = env.step(np.full((2, 1), HOVER))[-1]
        assert of_first(infos) == BEGUN, "this step has only begun an episode"
    env.close()


def of_first(infos: dict[str, Any]) -> tuple[float, float]:
    assert all(infos[key].shape == (2,) for key in ("duration_steps", "discount"))
    return infos["duration_steps"][0], infos["discount"][0]


def test_a_curriculum_may_change_the_discount():
    stages = [(0, {"learning.gamma": 0.25}), (1, {"learning.gamma": 0.5})]
    for env in (UavEnv(TWO, curriculum=stages), UavEnv(TWO, engine="batch", curriculum=stages)):
        for gamma in (0.25, 0.5):
            env.reset()
            assert of(env.step(HOVER)[-1]) == (3.0, gamma**3)


def test_by_clock_every_transition_is_a_step():
    for engine in ("des", "batch"):
        env = UavEnv("case8", {"learning.gamma": 0.97}, engine=engine)
        env.reset(seed=0)
        assert [of(env.step([4, 0, 1])[-1]) for _ in range(4)] == [(1.0, 0.97)] * 4


def test_an_agent_is_told_the_duration_of_what_it_is_paid_for():
    """Drone 0 hovers in the west for three steps; drone 1 flies west, east, and hovers until 5.

    Drone 1 has the user, which is paid with 1 a step, from 2 on.
    """
    plain = UavParallelEnv(TWO, PAIR, engine="batch")
    env = SkipForcedParallel(plain, GAMMA)
    _, infos = env.reset(seed=0)
    told = []
    for actions in ((HOVER, WEST), (HOVER, EAST), (HOVER, HOVER), (EAST, HOVER), (HOVER, HOVER)):
        _, paid, *_, infos = env.step(dict(zip(env.agents, actions, strict=True)))
        told.append([(paid[agent], *of(infos[agent])) for agent in plain.possible_agents])
    unpaid = (0.0, 0.0, 1.0)
    assert told == [
        [unpaid, (0.0, 1.0, 0.5)],  # at 1
        [unpaid, (1.0, 1.0, 0.5)],  # at 2, when drone 1 is in the east again
        [(0.0, 3.0, 0.125), unpaid],  # at 3
        [(0.0, 1.0, 0.5), unpaid],  # at 4, when drone 0 is in the east too
        [unpaid, (1 + 0.5 + 0.25, 3.0, 0.125)],  # at 5: drone 1 has got 1 at 3, at 4 and at 5
    ]
