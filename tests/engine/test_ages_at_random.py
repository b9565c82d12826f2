"""Random scenarios with sensors: the tables of both engines agree with that of the updates."""

from __future__ import annotations

from collections import Counter
from typing import Any

import numpy as np
import pytest

from desim_uav.engine.base import EpisodeLog
from desim_uav.engine.episode import Engine
from desim_uav.sample_path import draw
from desim_uav.world import World
from tests.audit.ages import audit_logs
from tests.engine import random_sensors, random_tasks
from tests.engine.helpers import some_command
from tests.engine.random_parts import Dice, accepted
from tests.selection import by_default
from tests.verification.engines import engines

MANY = 400


def with_tasks(seed: int) -> dict[str, Any]:
    """A random scenario with tasks at processors, and with a group of sensors or two."""
    made, dice = random_tasks.scenario(seed), Dice(seed + 1_500_000)
    senders = [*made["drones"], *made["access_points"]]
    held = any(each.get("radio", {}).get("sharing", "held") == "held" for each in senders)
    made["users"] = [{"name": "phones", **made["users"]}]
    for name in dice.of(["reading"], ["reading", "picture"]):
        group = dict(made["users"][0]) | {"name": name, "count": dice.of(1, 3, 8)}
        group["demand"] = {"kind": "sensing", "service": name}
        made["users"].append(group)
        made["services"] = {**made["services"], name: random_sensors.updates(dice, held)}
    return made


def world_of(seed: int) -> World:
    """The world of a random scenario, every second one with tasks."""
    return accepted(with_tasks if seed % 2 else random_sensors.scenario, seed)


def flown(engine: Engine) -> list[EpisodeLog]:
    """Return the logs of two episodes under random commands."""
    logs = []
    for episode in range(2):
        rng = np.random.default_rng(episode)
        shown = engine.reset(draw(engine.world, 1, episode))
        while not (shown.terminated or shown.truncated):
            shown = engine.step([some_command(engine.world, mask, rng) for mask in shown.masks])
        logs.append(engine.log)
    return logs


def both(world: World) -> list[EpisodeLog]:
    """Return the logs of the SimPy engine, after an audit of those of both engines."""
    found = [flown(engine) for engine in engines(world, (True,) * world.scenario.drone_count)]
    for logs in found:
        audit_logs(logs, world)
    return found[0]


@pytest.mark.parametrize("first", by_default([], range(3000, 3000 + MANY, 10), at_most=1))
def test_all_that_is_said_of_sensors_follows_from_their_updates(first: int) -> None:
    for seed in range(first, first + 10):
        both(world_of(seed))


@pytest.mark.thorough
def test_much_happens_to_updates() -> None:
    counted: Counter[str] = Counter()
    for seed in range(4000, 4004):
        for log in both(world_of(seed)):
            counted.update(event[2] for event in log.events or ())
    kinds = ("generate", "drop", "deliver", "handover", "crash")
    assert all(counted[kind] >= 5 for kind in kinds), counted
