"""What is known beforehand of users who stand still."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from desim_uav.engine.base import RunSettings
from desim_uav.engine.compiled import BatchSimulation, standing
from desim_uav.engine.des import Simulation
from desim_uav.model.mobility.mobility import Walks
from desim_uav.model.rules import MOVES
from desim_uav.rules.classes import foresee_rings
from desim_uav.rules.standing import COURSES
from desim_uav.sample_path import draw
from desim_uav.scenario.load import load
from desim_uav.shipped import scenario_path
from desim_uav.world import World, build_world


def world_of(case: str, *overrides: str) -> World:
    return build_world(load(scenario_path(case), overrides), 0)


@pytest.mark.parametrize("case", ["case1", "case2", "case7"])
def test_every_leg_is_as_it_is_foreseen(case: str):
    world = world_of(case)
    known, array_of_rows = standing.tabulate(world)
    grid, (nx, ny) = world.grid, world.grid.cells
    engine = Simulation(world, RunSettings((True,) * len(world.type_numbers), False))
    engine.reset(draw(world, 0, 0))
    constants, state = engine.constants, engine.state
    transits = {id(transit): number for number, transit in enumerate(engine.transits)}
    drone, legs = state.drones[0], 0
    drone.serving, drone.level, drone.to_level = 1, 0, 0
    state.now_us = drone.since_us = 0
    for x, y in np.ndindex(nx, ny):
        for action, transit in world.only_type.epoch_transits.items():
            dx, dy, dlevel = MOVES[action]
            if dlevel != 0 or not grid.can_enter(x + dx, y + dy, 0, True):
                continue
            at = (x * ny + y) * 5 + COURSES.index((dx, dy))
            drone.x, drone.y, drone.to_x, drone.to_y = x, y, x + dx, y + dy
            drone.transit = transits[id(transit)]
            foresee_rings(constants, engine.own_path, state, drone, world.step_us)
            rows = array_of_rows[known[at] : known[at + 1]].tolist()
            assert rows == [tuple(change) for change in drone.ahead]
            legs += len(rows) > 0
    assert legs > nx * ny


def test_nothing_is_known_of_users_who_walk():
    known, rows = standing.tabulate(world_of("case8"))
    assert len(known) == len(rows) == 0


def test_nothing_is_tabulated_that_would_be_too_long(monkeypatch):
    monkeypatch.setattr(standing, "MOST_LOOKS", 100)
    assert len(standing.tabulate(world_of("case1"))[0]) == 0


@pytest.mark.parametrize("how", ["elsewhere", "walking"])
def test_users_who_are_not_at_home_are_looked_at(how: str):
    """A sample path of one's own, of other places or of walks, is not what the table knows."""
    world = world_of("case1")
    path = draw(world, 0, 0)
    legs = path.walks.legs.copy()
    if how == "elsewhere":
        legs["x_m"], legs["y_m"] = legs["x_m"] * 0.5 + 300.0, legs["y_m"] * 0.5 + 300.0
    else:
        legs["vx_mps"] = 0.2
    moved = replace(path, walking=Walks(legs, path.walks.offsets))
    settings = RunSettings((True,), False, keep_events=True)
    one, other = Simulation(world, settings), BatchSimulation(world, settings)
    rng = np.random.default_rng(0)
    for engine in (one, other):
        assert engine.reset(path)
    assert other.state.look.stand == 1
    shown, seen = one.reset(moved), other.reset(moved)
    assert other.state.look.stand == 0
    while not shown.truncated:
        told = rng.integers(0, len(world.actions), 1).tolist()
        shown, seen = one.step(told), other.step(told)
        assert shown == seen
    assert one.log.events == other.log.events
