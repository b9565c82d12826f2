"""Policies that keep their promises, and some that break one each."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from desim_uav.testing import check_policy

FEW: dict[str, Any] = {"users.count": 6, "episode.steps": 6}


class Chosen:
    """Draws each action as ``draw`` says."""

    ceiling = True

    def begin(self, world: Any, streams: Any, carried: bool = False) -> None:
        self.chance = [streams.generator(drone) for drone in range(world.scenario.drone_count)]

    def draw(self, drone: int) -> np.random.Generator:
        return self.chance[drone]

    def act(self, observation: Any, mask: Any) -> int:
        return int(self.draw(observation.drone).choice(np.flatnonzero(mask)))


class Careless(Chosen):
    """Draws from a generator of its own, which begins once."""

    def __init__(self) -> None:
        self.own = np.random.default_rng(0)

    def draw(self, drone: int) -> np.random.Generator:
        return self.own


class Disobedient(Chosen):
    """Wants to fly forward all the time."""

    def act(self, observation: Any, mask: Any) -> int:
        return 0


def test_a_good_policy():
    check_policy(Chosen, overrides=FEW)


def test_one_that_remembers_earlier_runs():
    with pytest.raises(AssertionError, match=r"seed 1 alone"):
        check_policy(Careless(), overrides=FEW)


def test_one_that_disobeys():
    with pytest.raises(AssertionError, match=r"commands were not allowed, .*'forward', and did"):
        check_policy(Disobedient, overrides={**FEW, "episode.steps": 30})


@pytest.mark.thorough
@pytest.mark.parametrize("policy", ["baseline", "greedy", "rollout:baseline", "case8.npz"])
def test_policies_that_come_with_the_package(policy: str):
    check_policy(policy, overrides={"episode.steps": 12}, seeds=1, world_seed=0)
