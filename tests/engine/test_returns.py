"""The way back to a station, landing there and taking off again: by hand."""

from __future__ import annotations

import pytest

from desim_uav.model.rules import Action, Mode
from tests.engine.helpers import (
    HOP_US,
    US,
    Flight,
    before_end,
    events,
    fly,
    in_3d,
    path_of,
    returning,
    seen,
    strip,
)

pytestmark = pytest.mark.usefixtures("every_engine")


def test_a_return_lands_charges_waits_and_takes_off():
    # 80 m into the first hop the user at 300 is entered: 80 / 8.3 + 1.0375 = 10.676054 s. Three
    # hops from x = 360 end at 60 + 92.971989 s; that long the battery has drained, and it takes
    # half of it, 76.4859945 s, rounded up, to fill. The user at 840 is flown over unserved.
    world = returning(users=[(300, 120), (840, 120), (1080, 60)])
    flight = Flight(world)
    log = flight.episode(path_of(world, {u: [(0, 300, 0)] for u in range(3)}), "right goto")
    assert before_end(log) == events("""
                0   5  request  -  0  0
                0   5  request  -  1  1
                0   5  request  -  2  2
                0  10  depart   0
         10676054   4  enter    0  0
         10676054   7  attach   0  0
         10676054   7  serve    0  0  0
         30990663   3  arrive   0
         60000000  10  depart   0
         60000000  11  exit     0  0
         60000000  11  stop     0  0  0
         60000000  11  detach   0  0
         90990663   3  arrive   0
         90990663   3  depart   0
        121981326   3  arrive   0
        121981326   3  depart   0
        152971989   3  arrive   0
        152971989   3  land     0  -  -  0
        152971989   3  charge   0  -  -  0
        229457984   3  charged  0  -  -  0
        240000000  11  enter    0  2
        240000000  11  attach   0  2
        240000000  12  serve    0  2  2
    """)
    modes = [Mode.FLYING, Mode.RETURNING, Mode.CHARGING, Mode.CHARGED, Mode.FLYING]
    assert [step.mode for step in log.steps] == modes
    assert [step.charge for step in log.steps] == [
        540 * US, 480 * US, 501_084_033, 600 * US, 540 * US,
    ]  # fmt: skip
    taken = [Action.RIGHT, *[Action.GOTO_CHARGING_STATION] * 2, Action.CHARGE, Action.HOVER]
    assert [step.action_taken for step in log.steps] == taken
    # On the way: 0.093674 s into the braking of the second hop.
    assert log.steps[1].x_m == pytest.approx(600 + 231.38875 + 0.777497 - 0.017550, abs=1e-4)
    assert [step.return_drain for step in log.steps] == [3 * HOP_US, HOP_US, 0, 0, 0]
    assert (log.charges, log.queueing_us, log.crashes, log.distance_m) == (1, 0, 0, 960.0)
    only = {Action.GOTO_CHARGING_STATION: [2], Action.CHARGE: [3]}
    for action, epochs in only.items():
        for epoch in epochs:
            assert flight.shown[epoch].masks[0] == tuple(a is action for a in world.actions)


def test_a_return_hops_in_minimum_time_though_steps_are_filled():
    world = returning(steps=3, timing="fill_epoch", starts=[(2, 0)])
    log = fly(world, path_of(world), "right goto")
    assert seen(log, "depart", "arrive", "land") == events("""
               0  10  depart  0
        60000000   3  arrive  0
        60000000  10  depart  0
        90990663   3  arrive  0
        90990663   3  land    0  -  -  0
    """)


def test_on_a_station_a_return_lands_at_once():
    # 60 s of 600 are missing: 30 s to charge; it waits for the decision epoch at 120 s.
    world = returning(steps=3, starts=[(4, 0)], users=[(1080, 120)])
    log = fly(world, path_of(world), "hover goto right")
    assert seen(log) == events("""
                0   4  enter    0  0
                0   7  attach   0  0
         60000000  10  land     0  -  -  0
         60000000  10  charge   0  -  -  0
         60000000  11  exit     0  0
         60000000  11  detach   0  0
         90000000   3  charged  0  -  -  0
        120000000  10  depart   0
        120000000  11  enter    0  0
        120000000  11  attach   0  0
        133085693   2  exit     0  0
        133085693   2  detach   0  0
        150990663   3  arrive   0
    """)


def test_a_drone_charged_at_a_decision_epoch_acts_in_it():
    # 60 s missing of 600, full in 600 s: 60 s.
    world = returning(steps=3, starts=[(4, 0)], stations={"full_charge_min": 10})
    log = fly(world, path_of(world), "hover charge right")
    assert seen(log) == events("""
         60000000  10  land     0  -  -  0
         60000000  10  charge   0  -  -  0
        120000000   3  charged  0  -  -  0
        120000000  10  depart   0
        150990663   3  arrive   0
    """)


def test_the_nearest_station_and_of_two_the_first():
    # On a column of nine: station 0 on (0, 7), station 1 on (0, 1); (0, 4) is 3 hops from both.
    stations = {"count": 2, "radius_m": 720}
    world = returning(cells=(1, 9), starts=[(0, 4), (0, 3)], stations=stations, steps=2)
    log = fly(world, path_of(world), "goto", "goto")
    assert seen(log, "land") == events("""
        61981326  3  land  1  -  -  1
        92971989  3  land  0  -  -  0
    """)


def test_hops_of_a_return_can_fill_a_step_each():
    # Two hops of 60 s; then 120 s of battery are missing, and 2 s are charged a second. In 90 s it
    # is half-way between cells 3 and 4, where it is told in vain to hover.
    motion = {"kind": "bang_coast_bang", "timing": "minimum_time", "return_timing": "fill_epoch"}
    world = returning(starts=[(2, 0)], steps=4, drones={"motion": motion})
    flight = Flight(world)
    log = flight.episode(path_of(world), "goto hover hover left")
    assert flight.shown[0].observations[0].return_s == 120.0
    assert seen(log) == events("""
                0  10  depart   0
         60000000   3  arrive   0
         60000000   3  depart   0
        120000000   3  arrive   0
        120000000   3  land     0  -  -  0
        120000000   3  charge   0  -  -  0
        180000000   3  charged  0  -  -  0
        180000000  10  depart   0
        210990663   3  arrive   0
    """)
    assert [step.charge for step in log.steps] == [540 * US, 480 * US, 600 * US, 540 * US]
    assert [(leg.duration_us, leg.mode) for leg in log.legs[1:]] == [
        (60 * US, Mode.RETURNING), (60 * US, Mode.RETURNING), (HOP_US, Mode.FLYING),
    ]  # fmt: skip


def test_a_drone_that_returns_at_its_leisure_falls_on_the_way():
    # Empty after 90 s, half-way through its second hop from cell 2 (x = 600) to cell 4.
    motion = {"kind": "bang_coast_bang", "return_timing": "fill_epoch"}
    battery = {"autonomy_min": 1.5, "return_below": 1.0}
    world = strip([(2, 0)], battery=battery, steps=2, drones={"motion": motion})
    log = fly(world, path_of(world), "goto")
    assert seen(log, "crash") == events("90000000  6  crash  0")
    assert (log.steps[1].x_m, log.steps[1].y_m) == pytest.approx((600 + 240 + 120, 120))
    assert log.distance_m == pytest.approx(360)


PER_ACTION = {"kind": "per_action", "autonomy_min": 10, "return_below": 1.0}


def test_a_minute_for_each_action():
    # A move, a blocked move and a hover take a minute each, and so does each of the three hops of
    # the return from 180 s on, though it lasts 30.990663 s. At 240 s the second hop has lasted
    # 29.009337 s: 56.164 s of its minute are gone, rounded down. The battery holds 240 s on landing
    # at 272.971989 s, and gains 2 s a second.
    world = strip(battery=PER_ACTION, steps=5, timing="fill_epoch")
    flight = Flight(world)
    log = flight.episode(path_of(world), "right forward hover goto")
    assert flight.shown[3].observations[0].return_s == 180.0
    assert seen(log, "land") == [(180 * US + 3 * HOP_US, 3, "land", 0, -1, -1, 0)]
    on_the_way_us = 60 * US * (60 * US - HOP_US) // HOP_US
    charged_us = 2 * (300 * US - 180 * US - 3 * HOP_US)
    assert [step.charge for step in log.steps] == [
        540 * US, 480 * US, 420 * US, 360 * US - on_the_way_us, 240 * US + charged_us,
    ]  # fmt: skip


def test_a_battery_of_actions_is_empty_within_a_hop():
    # A minute and 2 us: the second hop takes 60 / 30.990663 us a us, 1 after one and 3 after two.
    battery = PER_ACTION | {"autonomy_min": 60_000_002 / 60e6}
    world = strip([(2, 0)], battery=battery, steps=1, timing="fill_epoch")
    assert world.only_type.capacity == 60_000_002
    log = fly(world, path_of(world), "goto")
    assert seen(log, "crash") == [(HOP_US + 2, 6, "crash", 0, -1, -1, -1)]
    assert log.steps[0].charge == 0


def test_landing_is_at_the_lowest_level():
    # Up over the station on (1, 1): no charging there; a return flies down and lands.
    battery = {"autonomy_min": 10, "return_below": 1.0}
    world = in_3d([[0, 0, 50]], [(1, 1)], cells=(3, 3), steps=3, battery=battery)
    flight = Flight(world)
    log = flight.episode(path_of(world), "up charge goto")
    charge = world.actions.index(Action.CHARGE)
    assert [shown.masks[0][charge] for shown in flight.shown[:3]] == [False, False, False]
    assert flight.shown[1].observations[0].return_s == pytest.approx(4.484639, abs=1e-9)
    assert [step.action_taken for step in log.steps[:2]] == [Action.UP, Action.HOVER]
    assert seen(log, "depart", "arrive", "land") == events("""
                0  10  depart  0
          4484639   3  arrive  0
        120000000  10  depart  0
        124484639   3  arrive  0
        124484639   3  land    0  -  -  0
    """)


@pytest.mark.parametrize(("ceiling", "home_us"), [(True, 4 * HOP_US), (False, 79_919_882)])
def test_a_wall_is_flown_around_under_the_ceiling_and_over_without_it(ceiling: bool, home_us: int):
    # The station is on (2, 1), two cells to the left, behind a wall of 50 m that is open at (3, 2).
    # Around it there are 4 hops of 30.990663 s; over it 2 of these, and 4 of 4.484639 s up to
    # 60 m and down again.
    battery = {"autonomy_min": 10, "return_below": 1.0}
    wall = [[3, 0, 50], [3, 1, 50]]
    world = in_3d(wall, [(4, 1)], cells=(5, 3), steps=3, battery=battery)
    log = fly(world, path_of(world), "goto", ceiling=ceiling)
    assert seen(log, "land") == [(home_us, 3, "land", 0, -1, -1, 0)]
