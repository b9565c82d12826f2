"""Which drone holds a user whom several cover: by hand."""

from __future__ import annotations

import pytest

from desim_uav.model.rules import Outcome
from tests.engine.helpers import US, events, fly, path_of, seen, strip, the

pytestmark = pytest.mark.usefixtures("every_engine")


def test_a_handover_between_overlapping_footprints_is_no_interruption():
    # Footprints of 150 m around x = 120 and 360; the user walks from 140 at 1 m/s.
    world = strip([(0, 0), (1, 0)], [(140, 120)], radius_m=150, steps=6)
    log = fly(world, path_of(world, {0: [(0, 400, 0)]}, walks={0: [(0, 140, 120, 1, 0)]}))
    assert seen(log) == events("""
                0  4  enter    0  0
                0  5  request  -  0  0
                0  7  attach   0  0
                0  7  serve    0  0  0
         70000000  4  enter    1  0
        130000000  2  exit     0  0
        130000000  2  stop     0  0  0
        130000000  2  detach   0  0
        130000000  7  attach   1  0
        130000000  7  serve    1  0  0
        360000000  8  stop     1  0  0
        360000000  8  close    1  0  0
        360000000  8  exit     1  0
        360000000  8  detach   1  0
    """)
    request = the(log)
    assert request.served_us == request.attached_us == 360 * US
    assert (request.interruptions, request.drones) == (0, [0, 1])
    assert log.attached_us == 360 * US


def test_footprints_that_touch_hand_over_within_a_microsecond():
    # Of 120 m: both discs are closed and share the point x = 240.
    world = strip([(0, 0), (1, 0)], [(140, 120)], radius_m=120, steps=3)
    log = fly(world, path_of(world, {0: [(0, 180, 0)]}, walks={0: [(0, 140, 120, 1, 0)]}))
    assert [event for event in seen(log) if event[0] == 100 * US] == events("""
        100000000  2  exit    0  0
        100000000  2  stop    0  0  0
        100000000  2  detach  0  0
        100000000  4  enter   1  0
        100000000  7  attach  1  0
        100000000  7  serve   1  0  0
    """)
    request = the(log)
    assert (request.interruptions, request.drones) == (0, [0, 1])
    assert (request.served_us, request.outcome) == (180 * US, Outcome.COMPLETED)


def test_a_gap_is_an_interruption_and_completion_comes_before_the_exit():
    # Of 100 m: out of the first at 80 s, in the second from 120 to 320 s: 80 + 200 s.
    world = strip([(0, 0), (1, 0)], [(140, 120)], steps=6)
    log = fly(world, path_of(world, {0: [(0, 280, 0)]}, walks={0: [(0, 140, 120, 1, 0)]}))
    assert seen(log) == events("""
                0  4  enter     0  0
                0  5  request   -  0  0
                0  7  attach    0  0
                0  7  serve     0  0  0
         80000000  2  exit      0  0
         80000000  2  stop      0  0  0
         80000000  2  detach    0  0
        120000000  4  enter     1  0
        120000000  7  attach    1  0
        120000000  7  serve     1  0  0
        320000000  1  stop      1  0  0
        320000000  1  complete  1  0  0
        320000000  2  exit      1  0
        320000000  2  detach    1  0
    """)
    request = the(log)
    assert (request.interruptions, request.drones) == (1, [0, 1])
    assert (request.outcome, request.t_end_us) == (Outcome.COMPLETED, 320 * US)


def test_a_user_stays_with_its_drone_and_then_goes_to_the_one_entered_first():
    # Footprints [-180, 420], [60, 660] and [300, 900]; at 2 m/s from 200 to 700 and back to 240,
    # where the episode ends, in two of them.
    world = strip([(0, 0), (1, 0), (2, 0)], [(200, 120)], radius_m=300, steps=8)
    walks = {0: [(0, 200, 120, 2, 0), (250, 700, 120, -2, 0)]}
    log = fly(world, path_of(world, walks=walks))
    assert seen(log) == events("""
                0  4  enter   0  0
                0  4  enter   1  0
                0  7  attach  0  0
         50000000  4  enter   2  0
        110000000  2  exit    0  0
        110000000  2  detach  0  0
        110000000  7  attach  1  0
        230000000  2  exit    1  0
        230000000  2  detach  1  0
        230000000  7  attach  2  0
        270000000  4  enter   1  0
        390000000  4  enter   0  0
        450000000  2  exit    2  0
        450000000  2  detach  2  0
        450000000  7  attach  1  0
        480000000  8  exit    0  0
        480000000  8  exit    1  0
        480000000  8  detach  1  0
    """)


def test_footprints_entered_together_go_to_the_lowest_drone():
    # From x = 200 at 1 m/s: into two footprints around 360 at once, both left at once.
    world = strip([(1, 0), (1, 0)], [(200, 120)], steps=5)
    log = fly(world, path_of(world, walks={0: [(0, 200, 120, 1, 0)]}))
    assert seen(log) == events("""
         60000000  4  enter   0  0
         60000000  4  enter   1  0
         60000000  7  attach  0  0
        260000000  2  exit    0  0
        260000000  2  detach  0  0
        260000000  2  exit    1  0
    """)


def test_a_landing_hands_its_users_over_in_the_same_instant():
    # Drone 0 lands on the station; drone 1, on the same cell, has its user from phase 11 on, and
    # serves it from phase 12 on. A first service of no time by drone 0 is no handover.
    world = strip([(4, 0), (4, 0)], [(1080, 120)] * 2, steps=2, battery={"autonomy_min": 30})
    asks = {0: [(0, 100, 0)], 1: [(60, 30, 0)]}
    log = fly(world, path_of(world, asks), "hover charge")
    assert [event for event in seen(log) if event[0] == 60 * US] == events("""
        60000000   5  request  -  1  1
        60000000   7  serve    0  1  1
        60000000  10  land     0  -  -  0
        60000000  10  charge   0  -  -  0
        60000000  11  exit     0  0
        60000000  11  stop     0  0  0
        60000000  11  detach   0  0
        60000000  11  exit     0  1
        60000000  11  stop     0  1  1
        60000000  11  detach   0  1
        60000000  11  attach   1  0
        60000000  11  attach   1  1
        60000000  12  serve    1  0  0
        60000000  12  serve    1  1  1
    """)
    long, short = log.requests
    assert (long.drones, long.interruptions, long.served_us) == ([0, 1], 0, 100 * US)
    assert (short.drones, short.interruptions, short.served_us) == ([1], 0, 30 * US)
    assert short.t_first_us == short.t_request_us == 60 * US
