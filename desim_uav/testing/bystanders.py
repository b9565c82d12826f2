"""Checks of rewards and observations: they change nothing, and features are as declared."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from desim_uav.env import UavParallelEnv
from desim_uav.model.rewards import RowReward
from desim_uav.rules.observations import Position
from desim_uav.scenario.schema import Scenario
from desim_uav.spaces import features_of
from desim_uav.testing.exact import Frames, require, require_same_tables
from desim_uav.testing.memory import How, together
from desim_uav.testing.play import play


@dataclass(frozen=True)
class NoReward(RowReward):
    """Pays nothing, and writes nothing."""

    def pay(self, world: Any, state: Any, drone: Any) -> None:
        """Write no term."""


def require_no_effect(scenario: Scenario, seed: int, how: How) -> None:
    """Require that a reward and an observation change nothing of what happens."""
    own = _without_rewards(together(scenario, [seed], how))
    for key, plain in (("reward", NoReward()), ("observation", Position())):
        other = _without_rewards(together(scenario._with(**{key: plain}), [seed], how))
        names = f"with this {key}", "with another one; it must write its own numbers only"
        require_same_tables(own, other, names)


def _without_rewards(tables: Frames) -> Frames:
    return {
        name: frame[[column for column in frame if not str(column).startswith("reward")]]
        for name, frame in tables.items()
    }


def require_features(scenario: Scenario, seed: int) -> None:
    """Require of an episode's observations that all features are as they were declared."""
    env = UavParallelEnv(scenario, engine="des")
    seen, _ = env.reset(seed=seed)
    _check_features(env, 0)
    for step, _ in enumerate(play(env, np.random.default_rng(seed), seen), 1):
        _check_features(env, step)
    env.close()


def _check_features(env: UavParallelEnv, step: int) -> None:
    world, snapshot = env.session.world, env.session.snapshot
    for drone, observation in enumerate(snapshot.observations):
        where = f"observation of drone {drone} at step {step}"
        numbers = world.scenario.observation.encode(observation, world.facts_of(drone))
        features = features_of(world, drone)
        enough = len(numbers) == len(features)
        require(enough, f"{where}: {len(numbers)} numbers for {len(features)} features")
        for feature, number in zip(features, numbers, strict=True):
            what = f"{where}: {feature.name!r} is {number!r}"
            inside = feature.low <= number <= feature.high
            require(inside, f"{what}, which is not from {feature.low:g} to {feature.high:g}")
            whole = not feature.whole or int(number) == number
            require(whole, f"{what}, and was declared a whole number")
