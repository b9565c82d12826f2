"""The sky, whose memory grows in the SimPy engine, and forgets what it knew in a restored one."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from desim_uav.engine.base import RunSettings
from desim_uav.engine.des import Simulation, skies
from desim_uav.sample_path import draw
from desim_uav.world import World
from tests.engine.helpers import path_of, strip
from tests.engine.test_free_flight import free

CROWD = [(300.0 + 7.0 * k, 100.0 + k % 9) for k in range(60)]


def crowded(**changes: Any) -> World:
    return strip(users=CROWD, steps=3, **changes)


def played(world: World, path: Any, room: int, monkeypatch: Any) -> tuple[Any, int]:
    """The events of an episode, and for how many changes on a leg there is memory after it."""
    monkeypatch.setattr(skies, "CHANGES", room)
    engine = Simulation(world, RunSettings((True,), False, keep_events=True))
    rng = np.random.default_rng(0)
    right = [action.name for action in world.actions].index("RIGHT") if not world.free else -1
    shown = engine.reset(path)
    while not (shown.terminated or shown.truncated):
        told = rng.uniform(-1, 1, world.commands.of(0).numbers(0)).tolist() if world.free else right
        shown = engine.step([told])
    return engine.log.events, len(engine.state.sky.changes)


@pytest.mark.parametrize("kind", ["cells", "free"])
def test_a_leg_has_more_changes_than_there_was_memory_for(kind: str, monkeypatch: Any):
    world = crowded() if kind == "cells" else free(users=CROWD, steps=3)
    path = path_of(world) if kind == "cells" else draw(world, 0, 0)
    known, room = played(world, path, 1, monkeypatch)
    assert room > 1
    assert (known, 500) == played(world, path, 500, monkeypatch)
