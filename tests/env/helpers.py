"""Environments driven by random allowed actions."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from desim_uav.env import UavEnv, UavParallelEnv
from desim_uav.env.registration import register_envs
from desim_uav.rowcode.rows import Table, blank
from desim_uav.rules import rows

register_envs()

CASES = [f"case{number}" for number in range(1, 10)]

BRITTLE: dict[str, Any] = {
    "drones.battery": {"autonomy_min": 7, "return_below": 0.6, "respawn_after_min": 3},
    "stations.count": 2,
}
"""Drones that often return, queue, charge and crash."""


def log_steps(env: UavEnv | UavParallelEnv) -> None:
    """Let the engine of this run keep steps and requests, which nobody who learns looks at."""
    engine = env.session.engine
    state = engine.state
    state.keeps_requests = 1
    state.records = Table(blank(rows.Record) for _ in state.drones)
    engine.settings = engine.settings._replace(keep_steps=True)


def some_actions(env: UavEnv | UavParallelEnv, rng: np.random.Generator) -> list[int]:
    """An allowed action for each drone."""
    env = env.unwrapped
    masks = env.action_masks().reshape(env.session.scenario.drones.count, -1)
    return [int(rng.choice(np.flatnonzero(mask))) for mask in masks]


def play_parallel(
    env: UavParallelEnv, episodes: int, seed: int | None = None, actions_seed: int = 0
) -> Iterator[tuple[Any, ...]]:
    """All that reset and step return over whole episodes; only the first reset is seeded."""
    rng = np.random.default_rng(actions_seed)
    for episode in range(episodes):
        yield env.reset(seed=seed if episode == 0 else None)
        while env.agents:
            yield env.step(dict(zip(env.agents, some_actions(env, rng), strict=True)))


def play_single(
    env: UavEnv, episodes: int, seed: int | None = None, actions_seed: int = 0
) -> Iterator[tuple[Any, ...]]:
    """The same, of the joint environment."""
    rng = np.random.default_rng(actions_seed)
    for episode in range(episodes):
        yield env.reset(seed=seed if episode == 0 else None)
        over = False
        while not over:
            actions = some_actions(env, rng)
            told = env.step(actions if len(actions) > 1 else actions[0])
            over = told[2] or told[3]
            yield told
