"""Who is served with a drone's bandwidth, and who waits: by hand."""

from __future__ import annotations

import pytest

from desim_uav.model.rules import Outcome
from tests.engine.helpers import US, events, fly, path_of, seen, strip, the

pytestmark = pytest.mark.usefixtures("every_engine")


def test_who_fits_is_served_and_nobody_waits_behind_who_does_not():
    # 1000 kbit/s. User 1 (600) waits behind user 0 (600) but not user 2 (300); when user 0 has
    # done, at 60 s, user 1 is before user 3, who asks in that very instant.
    world = strip(users=[(120, 120)] * 4, bandwidth_kbps=1000, steps=2)
    asks = {
        0: [(0, 60, 600)],
        1: [(1, 30, 600)],
        2: [(2, 100, 300)],
        3: [(60, 10, 200)],
    }
    log = fly(world, path_of(world, asks))
    assert seen(log, "request", "serve", "stop", "complete") == events("""
                0  5  request   -  0  0
                0  7  serve     0  0  0
          1000000  5  request   -  1  1
          2000000  5  request   -  2  2
          2000000  7  serve     0  2  2
         60000000  1  stop      0  0  0
         60000000  1  complete  0  0  0
         60000000  5  request   -  3  3
         60000000  7  serve     0  1  1
         90000000  1  stop      0  1  1
         90000000  1  complete  0  1  1
         90000000  7  serve     0  3  3
        100000000  1  stop      0  3  3
        100000000  1  complete  0  3  3
        102000000  1  stop      0  2  2
        102000000  1  complete  0  2  2
    """)
    assert [r.t_first_us - r.t_request_us for r in log.requests] == [0, 59 * US, 0, 30 * US]
    assert log.bandwidth_us_hz == (60 * 600 + 30 * 600 + 100 * 300 + 10 * 200) * 1000 * US
    assert not any(request.interruptions for request in log.requests)


def test_requests_of_one_instant_are_admitted_by_user():
    world = strip(users=[(120, 120)] * 3, bandwidth_kbps=1000, steps=1)
    asks = {0: [(1, 9, 600)], 1: [(1, 9, 400)], 2: [(1, 9, 400)]}
    log = fly(world, path_of(world, asks))
    assert seen(log, "serve") == events("""
         1000000  7  serve  0  0  0
         1000000  7  serve  0  1  1
        10000000  7  serve  0  2  2
    """)


def test_who_comes_back_waits_at_the_place_of_its_request_time():
    # User 0 is out of the footprint [20, 220] from 40 to 60 s; user 2, asked at 5 s, is served
    # from 40 to 90 s; then user 0 (0 s) goes before user 1 (10 s).
    world = strip(users=[(180, 120), (120, 120), (120, 120)], bandwidth_kbps=100, steps=4)
    asks = {0: [(0, 100, 100)], 1: [(10, 60, 100)], 2: [(5, 50, 100)]}
    walks = {0: [(0, 180, 120, 1, 0), (50, 230, 120, -1, 0), (70, 210, 120, 0, 0)]}
    log = fly(world, path_of(world, asks, walks=walks))
    assert seen(log, "serve", "stop", "complete") == events("""
                0  7  serve     0  0  0
         40000000  2  stop      0  0  0
         40000000  7  serve     0  2  1
         90000000  1  stop      0  2  1
         90000000  1  complete  0  2  1
         90000000  7  serve     0  0  0
        150000000  1  stop      0  0  0
        150000000  1  complete  0  0  0
        150000000  7  serve     0  1  2
        210000000  1  stop      0  1  2
        210000000  1  complete  0  1  2
    """)
    first = log.requests[0]
    assert (first.interruptions, first.drones) == (1, [0])
    assert first.attached_us == 130 * US


def test_an_attachment_frees_nothing_and_bandwidth_belongs_to_a_drone():
    # Two drones with 100 kbit/s each over the same three users: all attach to drone 0.
    world = strip([(0, 0), (0, 0)], [(120, 120)] * 2, bandwidth_kbps=100, steps=1)
    log = fly(world, path_of(world, {0: [(0, 40, 100)], 1: [(0, 40, 100)]}))
    assert seen(log, "serve") == events("""
               0  7  serve  0  0  0
        40000000  7  serve  0  1  1
    """)


def test_a_service_of_no_time_leaves_no_trace():
    # Asked at 60 s and served at once, in phase 7, by a drone that is then told to return.
    world = strip(
        [(3, 0)], [(840, 120)], steps=2, battery={"autonomy_min": 30, "return_below": 1.0}
    )
    log = fly(world, path_of(world, {0: [(60, 30, 0)]}), "hover goto")
    assert [event for event in seen(log) if event[0] == 60 * US] == events("""
        60000000   5  request  -  0  0
        60000000   7  serve    0  0  0
        60000000  10  depart   0
        60000000  11  exit     0  0
        60000000  11  stop     0  0  0
        60000000  11  detach   0  0
    """)
    request = the(log)
    assert (request.served_us, request.t_first_us, request.drones) == (0, None, [])
    assert (request.interruptions, request.outcome) == (0, Outcome.NEVER_SERVED)
