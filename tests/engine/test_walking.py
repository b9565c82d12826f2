"""Random walks that the compiled engine walks on by itself: exactly the legs of the path."""

from __future__ import annotations

import ctypes
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from desim_uav.engine.base import RunSettings
from desim_uav.engine.compiled import BatchSimulation
from desim_uav.engine.des import Simulation
from desim_uav.model.geometry.coverage import WalkLeg
from desim_uav.model.mobility.mobility import RandomWalk, Static
from desim_uav.model.mobility.walks import Walking
from desim_uav.rowcode.views import records
from desim_uav.rules.rows import LookRow, State
from desim_uav.sample_path import SamplePath, draw
from desim_uav.scenario.load import from_mapping
from desim_uav.world import World, build_world
from tests.engine import random_all
from tests.verification.engines import differences, engines

HOVER = 4
WALKS = [
    pytest.param({"speed_mps": 1.4, "leg_s": 60.0}, 60, id="a turn at each epoch"),
    pytest.param({"speed_mps": 1.4, "leg_s": 7.3}, 60, id="many turns a step"),
    pytest.param({"speed_mps": 1.4, "leg_s": 250.0}, 60, id="a turn in some steps"),
    pytest.param({"speed_mps": 90.0, "leg_s": 45.0}, 60, id="many walls a step"),
    pytest.param({"speed_mps": 0.0, "leg_s": 60.0}, 60, id="no speed"),
    pytest.param({"speed_mps": 3.0, "leg_s": 1e6}, 60, id="never a turn"),
]


def walking(walk: dict[str, float], step_s: float) -> World:
    """Twelve users on a small map, and two drones without a battery."""
    scenario = {
        "name": "walking",
        "map": {"size_m": [960, 480], "cells": [4, 2], "dimensions": 2},
        "drones": {"count": 2, "start_cells": [[0, 0], [3, 1]], "battery": None},
        "stations": {"count": 0},
        "users": {"count": 12, "mobility": {"kind": "random_walk", **walk}},
        "episode": {"steps": 20, "step_s": step_s},
    }
    return build_world(from_mapping(scenario), 5)


def walked(engine: BatchSimulation, user: int) -> NDArray[np.float64]:
    """The legs of a user that the engine has in this step."""
    at = (State.byte_of["look"] + LookRow.byte_of["walking"]) // 8
    begins: Any = in_scratch(engine, at, Walking, "legs_at", ctypes.c_int64)
    legs = in_scratch(engine, at, Walking, "legs", WalkLeg.words * ctypes.c_double)
    return records(WalkLeg, legs[begins[user] : begins[user + 1]])


def in_scratch(
    engine: BatchSimulation, at: int, cls: Any, name: str, kind: Any
) -> NDArray[np.float64]:
    """The numbers of a table of the row at a word of the state, wherever they are in memory."""
    offset, count = engine.memory[at + cls.byte_of[name] // 8 :][:2].tolist()
    place = engine.state_at + 8 * at + offset
    return np.ctypeslib.as_array((kind * count).from_address(place)).copy()


def in_span(path: SamplePath, user: int, start_us: int, end_us: int) -> NDArray[np.float64]:
    """Those of the path that are under way in a span, its ends included."""
    legs, offsets = path.walks
    own = legs[offsets[user] : offsets[user + 1]]
    first = int(np.flatnonzero(own["begin_us"] <= start_us)[-1])
    return own[first:][own["begin_us"][first:] <= end_us]


@pytest.mark.parametrize(("walk", "step_s"), WALKS)
def test_the_legs_of_each_step_are_those_of_the_path(walk: dict[str, float], step_s: float):
    world = walking(walk, step_s)
    engine = BatchSimulation(world, RunSettings((True,) * 2, False))
    for episode in range(2):
        path = draw(world, 11, episode)
        shown = engine.reset(path)
        while not shown.truncated:
            shown = engine.step([HOVER] * 2)
            sky = engine.state.sky
            span = sky.from_us, sky.to_us
            assert span == (shown.t_us - world.step_us, shown.t_us)
            for user in range(12):
                assert np.array_equal(walked(engine, user), in_span(path, user, *span))


def test_room_is_made_for_more_legs_than_are_usual():
    world = walking({"speed_mps": 200.0, "leg_s": 2.0}, 60)
    settings = RunSettings((True,) * 2, False, keep_events=True)
    engine, reference = BatchSimulation(world, settings), Simulation(world, settings)
    room, engine.leg_buffer = engine.leg_buffer, 14
    engine._make_room()
    path = draw(world, 3, 0)
    assert engine.reset(path) == reference.reset(path)
    for _ in range(20):
        assert engine.step([HOVER] * 2) == reference.step([HOVER] * 2)
    assert 14 < engine.leg_buffer < 2 * room
    assert engine.log.events == reference.log.events


class Stopped(RandomWalk):
    """One's own kind of random walk."""

    def walks(self, *args):
        return Static().walks(*args)


def test_a_random_walk_of_ones_own_is_asked_for_its_walks():
    world = walking({"speed_mps": 1.4, "leg_s": 60.0}, 60)
    users = world.scenario.users.model_copy(update={"mobility": Stopped()})
    own = replace(world, scenario=world.scenario.model_copy(update={"users": users}))
    settings = RunSettings((True,) * 2, False, keep_events=True)
    engine, reference = BatchSimulation(own, settings), Simulation(own, settings)
    path = draw(own, 0, 0)
    assert engine.reset(path) == reference.reset(path)
    for _ in range(20):
        assert engine.step([HOVER] * 2) == reference.step([HOVER] * 2)
    assert np.array_equal(engine.positions_m()[1], own.homes)


class Strolling(Static):
    """One's own kind of walk, whose settings are called as those of a random one."""

    speed_mps, leg_s = "slow", "often"


def test_what_is_no_random_walk_is_not_taken_for_one():
    world = walking({"speed_mps": 1.4, "leg_s": 60.0}, 60)
    users = world.scenario.users.model_copy(update={"mobility": Strolling()})
    own = replace(world, scenario=world.scenario.model_copy(update={"users": users}))
    engine = BatchSimulation(own, RunSettings((True,) * 2, False))
    assert engine.reset(draw(own, 0, 0)).t_us == 0
    assert np.array_equal(engine.positions_m()[1], own.homes)


@pytest.mark.thorough
def test_room_is_made_where_links_have_to_know_the_walks():
    # Levy walks in the air, of drones and access points; a user without a leg has no walk at all.
    world = random_all.world_of(159)
    assert world.row_mobility and world.in_air and world.scenario.access_points
    one, other = engines(world, (True,) * world.scenario.drone_count)
    assert isinstance(other, BatchSimulation)
    other.leg_buffer = 16
    other._make_room()
    assert not differences(one, other, 159, 0)
    assert other.leg_buffer > 16
