"""Moves in the plane and between levels, and what stands in their way: by hand."""

from __future__ import annotations

import pytest

from desim_uav.model.rules import Action
from tests.engine.helpers import US, Flight, before_end, events, fly, in_3d, path_of, seen, strip

pytestmark = pytest.mark.usefixtures("every_engine")


def test_a_move_off_the_map_is_a_hover_that_counts_and_costs():
    world = strip(users=[(120, 120)], steps=2, battery={"autonomy_min": 10})
    flight = Flight(world)
    log = flight.episode(path_of(world, {0: [(0, 90, 0)]}), "left forward")
    assert before_end(log) == events("""
                0   4  enter     0  0
                0   5  request   -  0  0
                0   7  attach    0  0
                0   7  serve     0  0  0
                0  10  blocked   0
         60000000  10  blocked   0
         90000000   1  stop      0  0  0
         90000000   1  complete  0  0  0
    """)
    first, second = log.steps
    assert (first.action, first.action_taken) == (Action.LEFT, Action.LEFT)
    assert (second.action, second.action_taken) == (Action.FORWARD, Action.FORWARD)
    assert (first.charge, second.charge) == (540 * US, 480 * US)
    assert (second.x_m, second.y_m) == (120.0, 120.0)
    assert log.distance_m == 0.0
    legal = dict(zip(world.actions, flight.shown[0].masks[0], strict=True))
    assert legal[Action.LEFT] and legal[Action.FORWARD], "the drone has no map"


def test_the_four_directions():
    world = strip([(1, 1)], cells=(3, 3), steps=4)
    log = fly(world, path_of(world), "forward right backward left")
    assert [(s.x_m, s.y_m) for s in log.steps] == [(360, 600), (600, 600), (600, 360), (360, 360)]


@pytest.mark.parametrize("height_m", [50, 40])
@pytest.mark.parametrize("ceiling", [True, False])
def test_over_a_building_if_there_is_no_ceiling(height_m: float, ceiling: bool):
    # Levels of 20 and 40 m, and 60 m without a ceiling; a building of 40 m is as bad as of 50.
    world = in_3d([[1, 0, height_m]], [(0, 0)], steps=7)
    log = fly(world, path_of(world), "right up right up right down right", ceiling=ceiling)
    places = [(step.x_m, step.z_m) for step in log.steps]
    start, risen = (120, 20), (120, 40)
    if ceiling:
        assert places == [start, risen, risen, risen, risen, start, start]
        blocked = [0, 120, 180, 240, 360]
    else:
        over, beyond = (360, 60), (600, 60)
        assert places == [start, risen, risen, (120, 60), over, over, beyond]
        blocked = [0, 120, 300]
    assert seen(log, "blocked") == [(t * US, 10, "blocked", 0, -1, -1, -1) for t in blocked]
    assert log.distance_m == (40 if ceiling else 40 + 480)


def test_a_hop_between_levels():
    # 20 m: 2 sqrt(20 / 4) = 4.472136 s would need 8.94 m/s; so 20 / 8.3 + 8.3 / 4 = 4.484639 s.
    # The footprint stays where it is.
    world = in_3d([[1, 0, 50]], [(0, 0)], users=[(120, 120)], steps=2)
    log = fly(world, path_of(world, {0: [(0, 120, 0)]}), "up down")
    assert before_end(log) == events("""
                0   4  enter     0  0
                0   5  request   -  0  0
                0   7  attach    0  0
                0   7  serve     0  0  0
                0  10  depart    0
          4484639   3  arrive    0
         60000000  10  depart    0
         64484639   3  arrive    0
        120000000   1  stop      0  0  0
        120000000   1  complete  0  0  0
    """)
