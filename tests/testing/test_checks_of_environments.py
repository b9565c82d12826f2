"""Environments that keep their promises, and some that break one each."""

from __future__ import annotations

from typing import Any

import gymnasium
import numpy as np
import pytest

from desim_uav.env import InTurn, JointActions, UavEnv, UavParallelEnv
from desim_uav.testing import check_environment

FEW: dict[str, Any] = {"users.count": 6, "episode.steps": 6}


@pytest.mark.parametrize(
    "make",
    [
        lambda: UavEnv("case8", FEW, engine="des"),
        lambda: UavParallelEnv("case8", FEW, engine="des"),
        lambda: JointActions(UavEnv("case8", FEW, engine="des")),
        lambda: InTurn(UavEnv("case8", FEW, engine="des")),
        lambda: gymnasium.wrappers.RecordEpisodeStatistics(
            gymnasium.make("desim_uav/Case4-v0", config=FEW, engine="des")
        ),
    ],
    ids=["single", "parallel", "joint", "in turn", "statistics"],
)
def test_good_environments(make: Any):
    check_environment(make())


class Broken(UavEnv):
    """Returns what ``spoil`` makes of what a late step returns."""

    def __init__(self) -> None:
        super().__init__("case8", FEW, engine="des")
        self.taken = 0

    def reset(self, seed: int | None = None, options: Any = None) -> Any:
        self.taken = 0
        return super().reset(seed=seed)

    def step(self, action: Any) -> Any:
        self.taken += 1
        shown = super().step(action)
        return self.spoil(*shown) if self.taken == 5 else shown

    def spoil(self, *shown: Any) -> Any:
        raise NotImplementedError


class Outside(Broken):
    def spoil(self, seen: Any, *others: Any) -> Any:
        return (seen + 1000, *others)


class Boundless(Broken):
    def spoil(self, seen: Any, reward: Any, *others: Any) -> Any:
        return (seen, float("inf"), *others)


class Unlike(Broken):
    def spoil(self, seen: Any, reward: Any, *others: Any) -> Any:
        return (seen, float(np.random.default_rng().random()), *others)


class Endless(Broken):
    def step(self, action: Any) -> Any:
        seen, reward, _, _, info = super().step(action) if self.taken < 5 else self.last
        self.last = seen, reward, False, False, info
        return self.last

    def spoil(self, *shown: Any) -> Any:
        return shown


class Unsure(Broken):
    def action_masks(self) -> Any:
        return super().action_masks() & (self.taken < 5)

    def spoil(self, *shown: Any) -> Any:
        return shown


@pytest.mark.parametrize(
    ("kind", "message"),
    [
        (Outside, r"episode 0, step 5: (?s:.*) is not in MultiDiscrete"),
        (Boundless, r"episode 0, step 5: the reward is inf"),
        (Unlike, r"the same seed and actions, turn 5 differs: \[1\]: 0\.\d+ is not 0\.\d+"),
        (Endless, r"episode 0 has not ended after 50 steps"),
        (Unsure, r"episode 0, step 5: the mask allows no action"),
    ],
)
def test_a_promise_that_is_broken_after_some_steps(kind: type[Broken], message: str):
    with pytest.raises(AssertionError, match=message):
        check_environment(kind(), most_steps=50)


def test_what_is_no_environment():
    with pytest.raises(TypeError, match="neither an Env of Gymnasium nor a ParallelEnv"):
        check_environment("case8")  # type: ignore[arg-type]
