"""The record of a step, the end of an episode, and what the next one begins with: by hand."""

from __future__ import annotations

import pytest

from desim_uav.model.rules import Action, Mode
from tests.engine.helpers import (
    US,
    Flight,
    before_end,
    column,
    events,
    fly,
    path_of,
    returning,
    seen,
    strip,
    the,
)

pytestmark = pytest.mark.usefixtures("every_engine")


def test_what_a_step_records():
    # Phase 8 comes before the commands: two users attached, one of them served with 300 kbit/s.
    world = strip(users=[(120, 120), (120, 100), (500, 120)], steps=2, bandwidth_kbps=400)
    asks = {0: [(0, 100, 300)], 1: [(10, 100, 200)]}
    log = fly(world, path_of(world, asks), "hover right")
    first, second = log.steps
    assert (first.attached_users, first.served_requests, first.used_hz) == (2, 1, 300_000)
    assert (first.x_m, first.charge, first.return_drain) == (120.0, None, None)
    assert (second.attached_users, second.served_requests, second.used_hz) == (0, 0, 0)
    assert second.x_m == 360.0


# ---- the end of an episode


def test_the_end_lets_go_of_who_is_served_who_waits_and_who_is_alone():
    # User 0 takes all the bandwidth, user 1 waits for it, user 2 is covered by nobody.
    world = strip(users=[(120, 120), (120, 100), (1000, 120)], steps=1, bandwidth_kbps=100)
    log = fly(world, path_of(world, {user: [(0, 90, 100)] for user in range(3)}))
    assert seen(log) == events("""
               0   4  enter    0  0
               0   4  enter    0  1
               0   5  request  -  0  0
               0   5  request  -  1  1
               0   5  request  -  2  2
               0   7  attach   0  0
               0   7  serve    0  0  0
               0   7  attach   0  1
        60000000   8  close    -  2  2
        60000000   8  stop     0  0  0
        60000000   8  close    0  0  0
        60000000   8  exit     0  0
        60000000   8  detach   0  0
        60000000   8  close    0  1  1
        60000000   8  exit     0  1
        60000000   8  detach   0  1
    """)
    served, waiting, alone = log.requests
    assert (served.served_us, served.attached_us) == (60 * US, 60 * US)
    assert (waiting.served_us, waiting.attached_us) == (0, 60 * US)
    assert (alone.served_us, alone.attached_us) == (0, 0)
    assert (log.attached_us, log.bandwidth_us_hz) == (2 * 60 * US, 60 * US * 100_000)


def test_the_end_hands_nobody_over():
    # Two drones on one cell: its drone lets the user go, and the other one does not take it.
    world = strip([(0, 0), (0, 0)], [(120, 120)], steps=1)
    log = fly(world, path_of(world, {0: [(10, 90, 0)]}))
    assert seen(log) == events("""
               0   4  enter    0  0
               0   4  enter    1  0
               0   7  attach   0  0
        10000000   5  request  -  0  0
        10000000   7  serve    0  0  0
        60000000   8  stop     0  0  0
        60000000   8  close    0  0  0
        60000000   8  exit     0  0
        60000000   8  detach   0  0
        60000000   8  exit     1  0
    """)
    request = the(log)
    assert (request.interruptions, request.drones) == (0, [0])


def test_a_crash_in_the_last_instant_comes_before_the_end():
    # Empty at 120 s, in phase 6: it drops its user, whose request closes in phase 8.
    world = column({"autonomy_min": 2.0}, steps=2)
    log = fly(world, path_of(world, {0: [(0, 200, 0)]}))
    assert [event for event in seen(log) if event[0] == 120 * US] == events("""
        120000000   6  deplete  0
        120000000   6  crash    0
        120000000   6  exit     0  0
        120000000   6  stop     0  0  0
        120000000   6  detach   0  0
        120000000   8  close    -  0  0
    """)
    assert the(log).interruptions == 0, "the end of the episode interrupts nobody"


# ---- from one episode into the next


def test_a_return_goes_on_in_the_next_episode():
    # Two hops done or begun at 120 s; the users of the new episode are asked anew.
    world = returning(steps=2, users=[(300, 120), (1080, 120)])
    flight = Flight(world, carry_over=True)
    asks = {0: [(0, 500, 0)], 1: [(0, 500, 0)]}
    before = flight.episode(path_of(world, asks), "right goto")
    assert [r.t_end_us for r in before.requests] == [120 * US] * 2
    after = flight.episode(path_of(world, asks, episode=1), "right right")
    assert before_end(after) == events("""
                0   5  request  -  0  0
                0   5  request  -  1  1
          1981326   3  arrive   0
          1981326   3  depart   0
         32971989   3  arrive   0
         32971989   3  land     0  -  -  0
         32971989   3  charge   0  -  -  0
        109457984   3  charged  0  -  -  0
    """)
    goto = tuple(action is Action.GOTO_CHARGING_STATION for action in world.actions)
    assert flight.shown[0].masks[0] == goto
    assert flight.shown[0].observations[0].battery_s == 480.0
    assert before.distance_m + after.distance_m == 240 * 4
    assert after.steps[-1].mode is Mode.CHARGED
    third = flight.episode(path_of(world, asks, episode=2))
    assert seen(third)[:4] == events("""
                0   5  request  -  0  0
                0   5  request  -  1  1
                0  11  enter    0  1
                0  11  attach   0  1
    """)


def test_without_carry_over_an_episode_begins_afresh():
    world = returning(steps=2, users=[(300, 120)])
    flight = Flight(world, carry_over=False)
    first = flight.episode(path_of(world), "right goto")
    second = flight.episode(path_of(world, episode=1), "right goto")
    assert first.events == second.events
    assert flight.shown[0].observations[0].cell == (0, 0)
    assert flight.shown[0].observations[0].battery_s == 600.0


def test_a_serving_drone_is_carried_over_with_its_place_and_battery():
    # It begins with its users of the first instant, in phase 4.
    world = returning(steps=1, users=[(600, 120)])
    flight = Flight(world, carry_over=True)
    flight.episode(path_of(world), "right")
    log = flight.episode(path_of(world, episode=1), "right")
    assert flight.shown[0].observations[0].cell == (1, 0)
    assert flight.shown[0].observations[0].battery_s == 540.0
    assert seen(log, "enter", "arrive") == events("""
        17904970  4  enter   0  0
        30990663  3  arrive  0
    """)
    log = flight.episode(path_of(world, {0: [(0, 60, 0)]}, episode=2))
    assert seen(log) == events("""
               0  4  enter     0  0
               0  5  request   -  0  0
               0  7  attach    0  0
               0  7  serve     0  0  0
        60000000  1  stop      0  0  0
        60000000  1  complete  0  0  0
        60000000  8  exit      0  0
        60000000  8  detach    0  0
    """)


def test_downtime_is_carried_over():
    # Down at 93 s of 120; 87 s later is 60 s into the next episode, whose first draw it takes.
    world = column({"respawn_after_min": 1.45}, steps=2)
    flight = Flight(world, carry_over=True)
    first = flight.episode(path_of(world, respawn=[[0]]))
    second = flight.episode(path_of(world, respawn=[[1]], episode=1))
    assert seen(first, "crash", "respawn") == events("93000000  6  crash  0")
    assert seen(second, "crash", "respawn") == events("60000000  9  respawn  0  -  -  1")
    assert (first.crashes, second.crashes) == (1, 0)


def test_a_new_drone_may_come_with_the_first_decision_epoch():
    world = column({"respawn_after_min": 0.45}, steps=2)
    flight = Flight(world, carry_over=True)
    flight.episode(path_of(world, respawn=[[0]]))
    second = flight.episode(path_of(world, respawn=[[1]], episode=1))
    assert seen(second)[:3] == events("""
        0   9  respawn  0  -  -  1
        0  11  enter    0  1
        0  11  attach   0  1
    """)
