"""The baseline in free flight: the routes of flight by cells, worked by hand, on both engines."""

from __future__ import annotations

from typing import Any

import pytest

from desim_uav.engine.base import EpisodeLog
from desim_uav.engine.choose import ENGINES
from desim_uav.experiment.run import play
from desim_uav.model.rules import Action, Mode
from desim_uav.policies import load_policy
from desim_uav.world import World
from tests.engine.helpers import in_3d, strip

FREE = {"space": "free", "max_speed_mps": 8.3, "max_acceleration_mps2": 4.0, "margin_m": 10}
EACH = [one if one == "des" else pytest.param(one, marks=pytest.mark.thorough) for one in ENGINES]


def square(starts: Any, *zones: Any, cells: Any = (10, 10), **changes: Any) -> World:
    """Cells of 240 m, on which drones fly freely round zones."""
    map_ = {"no_fly": [{"polygon_m": zone} for zone in zones], **changes.pop("map", {})}
    motion = {**FREE, **changes.pop("motion", {})}
    return strip(starts, cells=cells, map=map_, drones={"motion": motion}, **changes)


def box(west: float, south: float, east: float, north: float) -> list[list[float]]:
    """A rectangle over cells, given in cells: a sixth of a cell smaller on each side."""
    inner = [(west + 1 / 6, south + 1 / 6), (east - 1 / 6, north - 1 / 6)]
    (x0, y0), (x1, y1) = [(240 * x, 240 * y) for x, y in inner]
    return [[x0, y0], [x1, y0], [x1, y1], [x0, y1]]


def flown(world: World, engine: str = "des", **settings: Any) -> EpisodeLog:
    (log, _), *_ = play(
        world, load_policy("baseline"), "mine", 0, engine=engine, keep_events=True, **settings
    )
    return log


def places(log: EpisodeLog, drone: int = 0) -> list[tuple[float, ...]]:
    """Where a drone is after each step, in sides of cells from the centre of cell (0, 0)."""
    own = [step for step in log.steps if step.drone == drone]
    return [(round(s.x_m / 240 - 0.5, 6), round(s.y_m / 240 - 0.5, 6)) for s in own]


@pytest.mark.parametrize("engine", EACH)
def test_without_obstacles_it_flies_as_between_cells(engine: str):
    """With the same limits and in minimum time: each event at the same time, to a microsecond."""
    users = [(x, y) for x in (300, 1210, 2000) for y in (480, 1300, 1900)]
    starts = [(5, 9), (8, 3), (1, 3), (0, 0), (9, 9)]
    changes = {"steps": 45, "users": users, "radius_m": 300.0}
    cells = flown(strip(starts, cells=(10, 10), timing="minimum_time", **changes), engine)
    freely = flown(square(starts, **changes), engine)
    assert len(cells.events) == len(freely.events) > 500
    one, other = (sorted((e[2:], e[1], e[0]) for e in log.events) for log in (cells, freely))
    for before, after in zip(one, other, strict=True):
        assert before[:2] == after[:2] and abs(before[2] - after[2]) <= 1, (before, after)
    assert all(places(cells, d) == places(freely, d) for d in range(len(starts)))


@pytest.mark.parametrize("engine", EACH)
def test_it_turns_back_at_a_zone_and_goes_round_one_on_its_way(engine: str):
    # The zone lies over the cells (4, 7) and (4, 8): drone 0 finds no way down to (4, 7) of the
    # ring, and the nearest cells of it beside it are (3, 7) and (5, 7). On the ring it turns back
    # before the zone, and again on its other side. Drone 1 flies in column 4.
    world = square([(4, 9), (4, 9)], box(4, 7, 5, 9), steps=24)
    log = flown(world, engine)
    assert places(log)[:4] == [(3, 9), (3, 8), (3, 7), (2, 7)]
    onward = [(2, 6), (2, 5), (2, 4), (2, 3), (2, 2), (3, 2), (4, 2), (5, 2), (6, 2), (7, 2)]
    assert places(log)[4:14] == onward
    assert places(log)[14:24] == [(7, y) for y in (3, 4, 5, 6, 7)] + [
        (6, 7), (5, 7), (6, 7), (7, 7), (7, 6),
    ]  # fmt: skip
    assert set(places(log, 1)) == {(4, 9)}, "there is no other cell on its side"
    assert not any(step.action_taken is Action.FLY for step in log.steps if step.drone == 1)


@pytest.mark.parametrize("engine", EACH)
def test_a_way_to_a_line_that_is_closed_is_sought_further_on(engine: str):
    # Drone 1 begins on column 1. It is put to (0, 1), beside a zone over (1, 0) to (1, 2).
    log = flown(square([(8, 8), (2, 0)], box(2, 2, 3, 4), steps=12), engine)
    assert places(log, 1)[:4] == [(2, 1), (2, 0), (2, 1), (2, 0)]


@pytest.mark.parametrize("engine", EACH)
def test_it_climbs_over_a_building_and_its_margin(engine: str):
    # 15 m and a margin of 10 m reach above the level of 20 m, which flight by cells does not mind.
    # Over the building of 35 m, which is beside the row, there is a level of 40 m.
    buildings, changes = [[1, 0, 15], [3, 1, 35]], {"cells": (4, 2), "drones": {"motion": FREE}}
    log = flown(in_3d(buildings, [(0, 0)] * 3, steps=6, **changes), engine)
    assert places(log, 2) == [(0, 0), (1, 0), (2, 0), (3, 0), (2, 0), (1, 0)]
    assert [step.z_m for step in log.steps if step.drone == 2] == [40.0] * 6


@pytest.mark.parametrize("engine", EACH)
def test_it_turns_back_at_a_building_that_no_level_is_above(engine: str):
    # The only level is at 20 m, above 15 m but not above the margin of 10 m.
    world = in_3d([[2, 0, 15]], [(0, 0)], cells=(4, 1), drones={"motion": FREE}, steps=4)
    assert [x for x, _ in places(flown(world, engine))] == [1, 0, 1, 0]


@pytest.mark.parametrize("engine", EACH)
def test_a_move_that_is_longer_than_a_step_takes_several(engine: str):
    # A step of 20 s leads 8.3 * 20 - 8.3 ** 2 / 4 = 148.8 m: half of 240 m is flown in each.
    log = flown(square([(0, 0)], cells=(4, 1), steps=8, episode={"step_s": 20}), engine)
    assert [x for x, _ in places(log)] == [0.5, 1, 1.5, 2, 2.5, 3, 2.5, 2]


@pytest.mark.parametrize("engine", EACH)
def test_it_returns_at_15_percent_and_goes_on(engine: str):
    battery = {"autonomy_min": 30, "return_below": 1.0}
    world = square([(0, 4)], steps=40, battery=battery, cells=(9, 9))
    log = flown(world, engine)
    taken = [step.action_taken for step in log.steps]
    assert taken.index(Action.GOTO_CHARGING_STATION) == 26, "240 of 1800 s are left"
    assert log.charges == 1 and all(step.mode is not Mode.CRASHED for step in log.steps)
    assert places(log)[-1] in [(x, y) for x in range(9) for y in range(9)]


def test_it_remembers_a_move_that_is_not_complete():
    world = square([(0, 0)], cells=(4, 1), steps=8, episode={"step_s": 20})
    policy: Any = load_policy("baseline")
    list(play(world, policy, "mine", 0))
    memory = policy.memory()
    policy._ahead = [[[0.25, 0.0]]]
    kept = policy.memory()
    assert memory == [[-1], [[]]] and kept == [[-1], [[[0.25, 0.0]]]]
    policy.remember(memory)
    assert policy.memory() == memory
