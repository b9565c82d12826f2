"""Empty batteries, where drones fall, and the new ones that come: by hand."""

from __future__ import annotations

import pytest

from desim_uav.model.rules import Action, Mode, Outcome
from tests.engine.helpers import (
    HOP_US,
    US,
    Flight,
    before_end,
    column,
    events,
    fly,
    path_of,
    seen,
    strip,
    the,
)

pytestmark = pytest.mark.usefixtures("every_engine")


def test_an_empty_battery_is_a_crash_and_a_new_drone_comes():
    # Empty at 93 s; 87 s later is the decision epoch at 180 s; the drawn station is the second.
    world = column({"respawn_after_min": 1.45}, steps=4)
    asks = {0: [(0, 200, 0)], 1: [(0, 200, 0)]}
    flight = Flight(world)
    log = flight.episode(path_of(world, asks, respawn=[[1]]))
    assert seen(log) == events("""
                0   4  enter    0  0
                0   5  request  -  0  0
                0   5  request  -  1  1
                0   7  attach   0  0
                0   7  serve    0  0  0
         93000000   6  deplete  0
         93000000   6  crash    0
         93000000   6  exit     0  0
         93000000   6  stop     0  0  0
         93000000   6  detach   0  0
        180000000   9  respawn  0  -  -  1
        180000000  11  enter    0  1
        180000000  11  attach   0  1
        180000000  12  serve    0  1  1
        240000000   8  close    -  0  0
        240000000   8  stop     0  1  1
        240000000   8  close    0  1  1
        240000000   8  exit     0  1
        240000000   8  detach   0  1
    """)
    modes = [Mode.FLYING, Mode.CRASHED, Mode.CRASHED, Mode.FLYING]
    assert [step.mode for step in log.steps] == modes
    assert [step.charge for step in log.steps] == [33 * US, 0, 0, 33 * US]
    assert log.crashes == 1
    hover = tuple(action is Action.HOVER for action in world.actions)
    assert flight.shown[2].masks[0] == hover
    assert flight.shown[3].masks[0] != hover, "the new drone may be told where to go"
    assert flight.shown[3].observations[0].cell == (0, 1)
    assert flight.shown[3].observations[0].battery_s == 93.0
    assert [request.served_us for request in log.requests] == [93 * US, 60 * US]


@pytest.mark.parametrize(
    ("after_min", "epoch_s"), [(0.0, 120), (0.45, 120), (0.46, 180), (1.46, 240)]
)
def test_a_new_drone_comes_at_the_first_decision_epoch_after_the_downtime(
    after_min: float, epoch_s: int
):
    world = column({"respawn_after_min": after_min}, steps=5)
    log = fly(world, path_of(world, respawn=[[0, 0, 0]]))
    assert seen(log, "respawn")[0] == (epoch_s * US, 9, "respawn", 0, -1, -1, 0)


def test_a_crash_in_the_instant_of_a_decision_epoch_may_be_mended_in_it():
    world = column({"autonomy_min": 2.0, "respawn_after_min": 0.0}, steps=3)
    log = fly(world, path_of(world, respawn=[[1]]), "hover hover forward")
    assert [event for event in seen(log) if event[0] >= 120 * US] == events("""
        120000000   6  deplete  0
        120000000   6  crash    0
        120000000   6  exit     0  0
        120000000   6  detach   0  0
        120000000   9  respawn  0  -  -  1
        120000000  10  depart   0
        120000000  11  enter    0  1
        120000000  11  attach   0  1
        133085693   2  exit     0  1
        133085693   2  detach   0  1
        150990663   3  arrive   0
    """)
    assert [step.mode for step in log.steps] == [Mode.FLYING, Mode.CRASHED, Mode.FLYING]
    assert log.steps[1].charge == 0


def test_later_crashes_take_later_draws():
    world = column({"respawn_after_min": 0.0}, steps=6)
    log = fly(world, path_of(world, respawn=[[1, 0]]))
    assert seen(log, "crash", "respawn") == events("""
         93000000  6  crash    0
        120000000  9  respawn  0  -  -  1
        213000000  6  crash    0
        240000000  9  respawn  0  -  -  0
        333000000  6  crash    0
    """)


def test_a_removed_drone_stays_away():
    world = column({"on_crash": "remove", "respawn_after_min": 0.0}, steps=4)
    flight = Flight(world, carry_over=True)
    log = flight.episode(path_of(world))
    assert seen(log, "crash", "respawn") == events("93000000  6  crash  0")
    assert [step.mode for step in log.steps][1:] == [Mode.CRASHED] * 3
    assert seen(flight.episode(path_of(world, episode=1))) == []


def test_a_crash_can_end_the_episode():
    world = column({"on_crash": "end_episode"}, steps=5)
    flight = Flight(world, carry_over=True)
    asks = {0: [(0, 200, 0), (100, 1, 0)], 1: [(0, 50, 0)]}
    log = flight.episode(path_of(world, asks))
    assert (flight.shown[-1].terminated, flight.shown[-1].truncated) == (True, False)
    assert flight.shown[-1].t_us == log.duration_us == 120 * US
    assert [step.t_us for step in log.steps] == [60 * US, 120 * US]
    assert [request.t_end_us for request in log.requests] == [120 * US] * 2
    assert log.suppressed == 1
    assert seen(log, "close") == events("""
        120000000  8  close  -  0  0
        120000000  8  close  -  1  1
    """)
    log = flight.episode(path_of(world, episode=1))
    assert seen(log, "crash", "respawn") == events("93000000  6  crash  0")


def test_no_crash_no_early_end():
    world = column({"on_crash": "end_episode", "autonomy_min": 30.0}, steps=2)
    flight = Flight(world)
    flight.episode(path_of(world))
    assert (flight.shown[-1].terminated, flight.shown[-1].truncated) == (False, True)


def test_a_drone_falls_where_it_is():
    # 54 s into a hop of 60 s: 6 s before its end, of which 1.017247 s braking, so 6 x 4.068986
    # - 4.068986²/8 = 22.344332 m short of it; that is in the next cell.
    world = strip(steps=1, timing="fill_epoch", battery={"autonomy_min": 0.9})
    log = fly(world, path_of(world), "right")
    assert seen(log) == events("""
               0  10  depart   0
        54000000   6  deplete  0
        54000000   6  crash    0
    """)
    flown_m = 240 - 22.344332
    assert log.distance_m == pytest.approx(flown_m, abs=1e-5)
    assert (log.steps[0].x_m, log.steps[0].y_m) == pytest.approx((120 + flown_m, 120), abs=1e-5)


def test_a_fallen_drone_reaches_nobody():
    # 220 m into the hop, at 27.5 s, it would enter the user at 440; it is empty at 21 s.
    world = strip(users=[(440, 120)], steps=1, battery={"autonomy_min": 0.35})
    log = fly(world, path_of(world, {0: [(0, 30, 0)]}), "right")
    assert before_end(log) == events("""
               0   5  request  -  0  0
               0  10  depart   0
        21000000   6  deplete  0
        21000000   6  crash    0
    """)
    assert the(log).outcome is Outcome.NEVER_SERVED


def test_a_fallen_drone_knows_where_it_is():
    # As above, in the cell after the one it began in: the same with noise (of no size) as without.
    battery = {"autonomy_min": 0.9}
    world = strip(steps=1, timing="fill_epoch", battery=battery)
    flight, noisy = Flight(world), Flight(world)
    flight.episode(path_of(world), "right")
    noisy.episode(path_of(world, error=[[(0, 0)]]), "right")
    assert noisy.shown[-1].observations[0].cell == (1, 0)
    assert flight.shown[-1].observations[0].cell == (1, 0)
    assert flight.engine.log.steps[-1].return_drain == 3 * HOP_US


@pytest.mark.parametrize("hops", [1, 2])
def test_reaching_a_station_with_the_last_of_the_battery_is_an_arrival(hops: int):
    battery = {"autonomy_min": hops * HOP_US / 60e6, "return_below": 1.0}
    world = strip([(4 - hops, 0)], battery=battery, steps=3)
    assert world.only_type.capacity == hops * HOP_US
    log = fly(world, path_of(world), "goto")
    assert seen(log, "land", "charge", "deplete", "crash") == events(f"""
        {hops * HOP_US}  3  land    0  -  -  0
        {hops * HOP_US}  3  charge  0  -  -  0
    """)
    assert log.steps[-1].charge == (180 * US - hops * HOP_US) * world.only_type.capacity // (
        300 * US
    )


@pytest.mark.parametrize("short_us", [1, HOP_US])
def test_a_drone_that_is_empty_before_its_station_falls(short_us: int):
    # One microsecond too little; or just enough for the first of two hops.
    capacity = 2 * HOP_US - short_us
    world = strip([(2, 0)], battery={"autonomy_min": capacity / 60e6, "return_below": 1.0}, steps=2)
    assert world.only_type.capacity == capacity
    log = fly(world, path_of(world), "goto")
    assert seen(log, "arrive", "land", "deplete", "crash") == events(f"""
        {HOP_US}       3  arrive   0
        {capacity}  6  deplete  0
        {capacity}  6  crash    0
    """)
