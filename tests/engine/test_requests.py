"""When requests come and end, and when users ask again: by hand."""

from __future__ import annotations

import pytest

from desim_uav.model.rules import Outcome
from tests.engine.helpers import US, Flight, before_end, events, fly, path_of, seen, strip, the

pytestmark = pytest.mark.usefixtures("every_engine")


def test_requests_at_the_start_meet_drones_that_are_there():
    # Everything of the start happens in phases 4, 5 and 7; ties go to the lowest drone.
    world = strip([(0, 0), (0, 0), (1, 0)], [(360, 120), (120, 120)], steps=1)
    log = fly(world, path_of(world, {0: [(0, 5, 0)], 1: [(0, 10, 0)]}))
    assert before_end(log) == events("""
               0  4  enter     0  1
               0  4  enter     1  1
               0  4  enter     2  0
               0  5  request   -  0  0
               0  5  request   -  1  1
               0  7  attach    0  1
               0  7  serve     0  1  1
               0  7  attach    2  0
               0  7  serve     2  0  0
         5000000  1  stop      2  0  0
         5000000  1  complete  2  0  0
        10000000  1  stop      0  1  1
        10000000  1  complete  0  1  1
    """)


def test_a_request_of_the_last_microsecond():
    world = strip(users=[(120, 120), (1000, 120)], steps=1)
    last_s = 60 - 1e-6
    log = fly(world, path_of(world, {0: [(last_s, 30, 0)], 1: [(last_s, 30, 0)]}))
    assert seen(log, "request", "serve", "stop", "close") == events("""
        59999999  5  request  -  0  0
        59999999  5  request  -  1  1
        59999999  7  serve    0  0  0
        60000000  8  close    -  1  1
        60000000  8  stop     0  0  0
        60000000  8  close    0  0  0
    """)
    covered, alone = log.requests
    assert (covered.served_us, covered.attached_us, covered.outcome) == (1, 1, Outcome.UNFINISHED)
    assert covered.interruptions == 0, "the end of the episode interrupts nobody"
    assert (alone.served_us, alone.outcome) == (0, Outcome.NEVER_SERVED)
    assert alone.t_end_us == 60 * US


def test_a_service_that_ends_with_the_episode_is_completed():
    world = strip(users=[(120, 120)], steps=1)
    log = fly(world, path_of(world, {0: [(0, 60, 0)]}))
    assert seen(log, "stop", "complete", "close") == events("""
        60000000  1  stop      0  0  0
        60000000  1  complete  0  0  0
    """)
    assert the(log).outcome is Outcome.COMPLETED


def test_users_think_between_the_end_of_a_request_and_the_next():
    # User 0: 0-60, thinks 30, 90-150, thinks 30: 180 s is the end, so it asks no more.
    # User 1: 1 µs less, and it asks in the last microsecond. User 2: first asks after 20 s.
    world = strip(users=[(120, 120)] * 3)
    asks = {
        0: [(0, 60, 0), (30, 60, 0), (30, 60, 0)],
        1: [(0, 60, 0), (30, 60, 0), (30 - 1e-6, 60, 0)],
        2: [(20, 60, 0), (40, 70, 0)],
    }
    log = fly(world, path_of(world, asks, thinking=True))
    assert seen(log, "request", "complete") == events("""
                0  5  request   -  0  0
                0  5  request   -  1  1
         20000000  5  request   -  2  2
         60000000  1  complete  0  0  0
         60000000  1  complete  0  1  1
         80000000  1  complete  0  2  2
         90000000  5  request   -  0  3
         90000000  5  request   -  1  4
        120000000  5  request   -  2  5
        150000000  1  complete  0  0  3
        150000000  1  complete  0  1  4
        179999999  5  request   -  1  6
    """)
    assert log.suppressed == 0


def test_a_user_thinks_only_once_its_request_is_done():
    # Covered from 80 s on: the footprint [260, 460] and the user from 180 at 1 m/s.
    world = strip([(1, 0)], [(180, 120)], steps=4)
    asks = {0: [(0, 60, 0), (15, 60, 0)]}
    path = path_of(world, asks, thinking=True, walks={0: [(0, 180, 120, 1, 0)]})
    log = fly(world, path)
    assert seen(log, "request", "serve", "complete") == events("""
                0  5  request   -  0  0
         80000000  7  serve     0  0  0
        140000000  1  complete  0  0  0
        155000000  5  request   -  0  1
        155000000  7  serve     0  0  1
        215000000  1  complete  0  0  1
    """)


def test_arrivals_during_an_open_request_are_dropped_and_counted():
    # At 60 s the first has just been completed: phase 1 comes before phase 5.
    world = strip(users=[(120, 120), (1000, 120)])
    asks = {
        0: [(0, 60, 0), (30, 60, 0), (60 - 1e-6, 60, 0), (60, 60, 0), (119, 60, 0), (120, 60, 0)],
        1: [(5, 60, 0), (6, 60, 0)],
    }
    log = fly(world, path_of(world, asks))
    assert seen(log, "request", "complete") == events("""
                0  5  request   -  0  0
          5000000  5  request   -  1  1
         60000000  1  complete  0  0  0
         60000000  5  request   -  0  2
        120000000  1  complete  0  0  2
        120000000  5  request   -  0  3
        180000000  1  complete  0  0  3
    """)
    assert log.suppressed == 4


def test_two_arrivals_of_one_instant_are_one_request():
    world = strip(users=[(120, 120)], steps=1)
    log = fly(world, path_of(world, {0: [(10, 20, 0), (10, 20, 0)]}))
    assert len(log.requests) == 1
    assert log.suppressed == 1


def test_an_episode_has_the_requests_of_its_own_path():
    world = strip(users=[(120, 120)], steps=1)
    engine = Flight(world).engine
    once, never = path_of(world, {0: [(0, 5, 0)]}), path_of(world, {})
    asked = [engine.reset(path).open_requests[0] for path in (once, once, never, once)]
    assert asked == [1, 1, 0, 1]
