"""What is not foreseen again while a drone hovers over users who stand: nothing may differ."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import pytest

from desim_uav.engine.base import RunSettings
from desim_uav.engine.choose import make_engine
from desim_uav.engine.des import Simulation
from desim_uav.model.rules import Action
from desim_uav.sample_path import SamplePath, draw
from desim_uav.scenario.load import from_mapping
from desim_uav.world import World, build_world
from tests.engine.helpers import merged
from tests.engine.test_cities import ITU, mapping
from tests.engine.towns import RADIO, told

pytestmark = pytest.mark.thorough
"""Both engines compile the kernels of lines of sight, which takes long."""

STANDING = {"users": {"count": 30, "mobility": {"kind": "static"}}, "episode": {"steps": 12}}
PAST_BUILDINGS = {**RADIO, "line_of_sight": "buildings"}


def standing(**changes: Any) -> dict[str, Any]:
    return merged(STANDING, changes)


def by_radio(**radio: Any) -> dict[str, Any]:
    return standing(drones={"radio": {**PAST_BUILDINGS, **radio}})


POINT = {"at_m": [250, 200], "height_m": 25, "radio": PAST_BUILDINGS}
WORLDS: Mapping[str, Mapping[str, Any]] = {
    "standing": STANDING,
    "charging": standing(
        drones={"battery": {"autonomy_min": 7}},
        stations={"count": 1, "radius_m": 0},
        episode={"steps": 30},
    ),
    "levels": standing(map={"levels": {"min_altitude_m": 30, "step_m": 20}}),
    "strongest": standing(association="strongest"),
    "a3 and points": standing(association={"kind": "a3"}, access_points=[POINT]),
    "drawn": by_radio(line_of_sight="drawn"),
    "interference": by_radio(interference="co_channel"),
    "walking": {"users": {"count": 30, "mobility": {"kind": "random_walk"}}},
}


def world_of(name: str, seed: int) -> World:
    return build_world(from_mapping(merged(mapping(**ITU), WORLDS[name])), seed)


def flown(engine: Any, path: SamplePath, anew: bool = False) -> tuple[list[Any], int]:
    """The events of an episode with many hovers, and how often a drone was steady at an epoch.

    It never is after a step in which it has moved.
    """
    world, rng, steady = engine.world, np.random.default_rng(3), 0
    stay = world.actions.index(Action.HOVER)
    shown = engine.reset(path)
    while not (shown.terminated or shown.truncated):
        if anew:
            engine.state.look.still = engine.state.look.stand = 0
            for sender in engine.state.senders:
                sender.steady = 0
        steady += sum(sender.steady for sender in engine.state.senders)
        chosen = [
            stay if mask[stay] and rng.random() < 0.6 else int(rng.choice(np.flatnonzero(mask)))
            for mask in shown.masks
        ]
        before = _places(engine)
        shown = engine.step(chosen)
        moved = [one != other for one, other in zip(before, _places(engine), strict=True)]
        for drone, moves in zip(engine.state.drones, moved, strict=True):
            assert not (moves and drone.serving and drone.steady)
    return [tuple(event) for event in engine.log.events or ()], steady


def _places(engine: Any) -> list[tuple[int, int, int]]:
    return [(drone.x, drone.y, drone.level) for drone in engine.state.drones]


@pytest.mark.parametrize("name", WORLDS)
def test_hovers_are_as_if_they_were_foreseen_anew(name: str) -> None:
    for seed in range(2):
        world = world_of(name, seed)
        path, settings = draw(world, seed, 0), told(world)
        anew, never = flown(Simulation(world, settings), path, anew=True)
        kept, steady = flown(Simulation(world, settings), path)
        assert never == 0 and len(anew) > 100
        assert (steady > 5) == (name not in ("walking", "interference"))
        assert kept == anew
        assert flown(make_engine("batch", world, settings), path) == (anew, steady)


def test_a_state_is_restored_with_what_is_known_of_hovers() -> None:
    world = world_of("charging", 1)
    settings = RunSettings((True,) * 2, carry_over=False, keep_events=True)
    stay = [world.actions.index(Action.HOVER)] * 2
    engines = [make_engine(name, world, settings) for name in ("des", "batch")]
    for engine in engines:
        engine.reset(draw(world, 0, 0))
        for _ in range(3):
            engine.step(stay)
    for engine in engines:
        saved, ends = engine.save(), []
        for _ in range(2):
            engine.restore(saved)
            ends.append([engine.step(stay) for _ in range(3)])
        assert ends[0] == ends[1]
