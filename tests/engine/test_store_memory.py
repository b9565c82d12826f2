"""The memory of stores in compiled code, which are kept without a log if they have a backhaul."""

from __future__ import annotations

from typing import Any

import numpy as np

from desim_uav.engine.base import RunSettings
from desim_uav.engine.choose import ENGINES, make_engine
from desim_uav.engine.compiled.forks import Forks
from desim_uav.sample_path import draw
from desim_uav.scenario.load import from_mapping
from desim_uav.world import World, build_world
from tests.engine.helpers import radio


def filling(**learning: Any) -> World:
    """Two drones whose stores get more updates than there is memory for at first.

    Four sensors send all the time, so that the links leave nothing of the backhaul.
    """
    updates = {"kind": "poisson", "mean_s": 0.2}
    reading = {"kind": "collect", "updates": updates, "size_mbit": [0.03], "delivered": "ground"}
    backhaul = {"kind": "capacity", "kbps": 500}
    scenario = {
        "map": {"size_m": [400, 400], "cells": [2, 2], "dimensions": 2},
        "drones": {"count": 2, "radio": radio(), "battery": None, "backhaul": backhaul},
        "stations": {"count": 0},
        "users": {"count": 4, "mobility": {"kind": "static"}},
        "services": {"reading": reading},
        "demand": {"kind": "sensing", "service": "reading"},
        "reward": {"kind": "age"},
        "episode": {"steps": 2, "step_s": 40, "carry_over": True},
        "learning": learning,
    }
    return build_world(from_mapping(scenario), 0)


def test_a_store_outgrows_its_memory_without_a_log() -> None:
    """The compiled engine runs the step again, and forks are taken anew in more memory."""
    world = filling()
    given = RunSettings((True,) * 2, True, keep_steps=False)
    own: list[Any] = [make_engine(name, world, given) for name in (*ENGINES, "batch")]
    _, compiled, planner = own
    room, forks = compiled.buffers.log, Forks(planner, 1)
    for episode in range(2):
        path = draw(world, 0, episode)
        shown = [engine.reset(path) for engine in own]
        for _ in range(2):
            forks.take()
            while forks.step(np.array([[4, 4]])) > 0:
                forks.more_room()
                forks.take()
            shown = [engine.step([4, 4]) for engine in own]
            assert shown[0] == shown[1] == shown[2]
            assert forks.outputs.rewards[0].tolist() == list(shown[0].rewards)
    assert own[0].save().digest() == compiled.save().digest()
    assert min(compiled.buffers.log, planner.buffers.log) > room
