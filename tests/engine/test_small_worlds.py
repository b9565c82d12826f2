"""Small worlds worked by hand, and the exact log of every event in them."""

from __future__ import annotations

from typing import Any

import pytest

from desim_uav.engine.base import ClosedRequest, EpisodeLog
from desim_uav.model.rules import Action, Mode, Outcome
from tests.engine.helpers import HOP_US, US, Flight, check_log, events, fly, path_of, seen, strip


def the(log: EpisodeLog) -> ClosedRequest:
    """The one request of an episode."""
    (request,) = log.requests
    return request


# ---- a footprint passes


def test_a_passing_drone_serves_a_user_from_entry_to_exit():
    # The second hop begins at x = 360. The user at 480 is inside from 20 to 220 m of it, while the
    # drone coasts: t = s / 8.3 + 8.3 / 8.
    world = strip(users=[(480, 120)])
    log = fly(world, path_of(world, {0: [(0, 60, 100)]}), "right right right")
    assert seen(log, *{event[2] for event in log.events}) == events("""
                0   5  request  -  0  0
                0  10  decide   0
                0  10  depart   0
         30990663   3  arrive   0
         60000000  10  decide   0
         60000000  10  depart   0
         63447139   4  enter    0  0
         63447139   7  attach   0  0
         63447139   7  serve    0  0  0
         87543524   2  exit     0  0
         87543524   2  stop     0  0  0
         87543524   2  detach   0  0
         90990663   3  arrive   0
        120000000  10  decide   0
        120000000  10  depart   0
        150990663   3  arrive   0
    """)
    request = the(log)
    assert request.served_us == request.attached_us == 24_096_385
    assert (request.t_request_us, request.t_first_us, request.t_end_us) == (0, 63_447_139, 180 * US)
    assert request.interruptions == 1, "it goes unserved from the exit on"
    assert request.outcome is Outcome.UNFINISHED
    assert log.attached_us == 24_096_385
    assert log.bandwidth_us_bps == 24_096_385 * 100_000
    assert log.distance_m == 720.0


def test_a_drone_that_fills_the_epoch_passes_more_slowly():
    # 80 m beside the line the chord is 2 x 60 m. At 4.068986030484 m/s, reached after
    # 1.017246508 s: s / v + 0.508623254 for s = 60 and 180.
    world = strip(users=[(480, 200)], timing="fill_epoch")
    log = fly(world, path_of(world), "right right")
    assert seen(log) == events("""
                0  10  depart   0
         60000000   3  arrive   0
         60000000  10  depart   0
         75254312   4  enter    0  0
         75254312   7  attach   0  0
        104745688   2  exit     0  0
        104745688   2  detach   0  0
        120000000   3  arrive   0
    """)


def test_a_tangent_is_no_entry():
    world = strip(users=[(480, 220)])
    log = fly(world, path_of(world), "right right right")
    assert not seen(log, "enter", "exit", "attach")


def test_a_walker_crosses_the_footprint_of_a_hovering_drone():
    # From 1000 m west and 300 m north of the drone at 1.5 m/s:
    # (1000 -+ sqrt(600² - 300²)) / 1.5 = 320.256505 and 1013.076828 s.
    world = strip([(5, 2)], [(320, 900)], cells=(17, 5), radius_m=600, steps=30)
    walks = {0: [(0, 320, 900, 1.5, 0)]}
    log = fly(world, path_of(world, {0: [(0, 1800, 0)]}, walks=walks))
    assert seen(log) == events("""
                 0  5  request  -  0  0
         320256505  4  enter    0  0
         320256505  7  attach   0  0
         320256505  7  serve    0  0  0
        1013076828  2  exit     0  0
        1013076828  2  stop     0  0  0
        1013076828  2  detach   0  0
    """)
    assert the(log).served_us == 692_820_323


@pytest.mark.parametrize("leaver", [0, 1])
def test_an_exit_makes_room_for_an_entry_of_the_same_microsecond(leaver: int):
    # 100 m into the hop, at 100 / 8.3 + 1.0375 s, one user is 100 m behind and one 100 m ahead.
    users = [(560, 120), (560, 120)]
    users[leaver] = (360, 120)
    world = strip([(1, 0)], users, steps=1, bandwidth_kbps=100)
    asks = {0: [(0, 50, 100)], 1: [(0, 50, 100)]}
    log = fly(world, path_of(world, asks), "right")
    u, v = leaver, 1 - leaver
    assert seen(log) == events(f"""
               0   4  enter    0  {u}
               0   5  request  -  0  0
               0   5  request  -  1  1
               0   7  attach   0  {u}
               0   7  serve    0  {u}  {u}
               0  10  depart   0
        13085693   2  exit     0  {u}
        13085693   2  stop     0  {u}  {u}
        13085693   2  detach   0  {u}
        13085693   4  enter    0  {v}
        13085693   7  attach   0  {v}
        13085693   7  serve    0  {v}  {v}
        30990663   3  arrive   0
        60000000   8  stop     0  {v}  {v}
    """)


# ---- who holds a user


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
    # Footprints [-180, 420], [60, 660] and [300, 900]; at 2 m/s from 200 to 700 and back.
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


def test_drones_that_come_from_both_sides_reach_a_user_together():
    # Mirror images of one another: 360 - s and 840 + ... both 100 m from the user at s = 140.
    world = strip([(3, 0), (1, 0)], [(600, 120)], steps=1)
    log = fly(world, path_of(world), "left", "right")
    entries = seen(log, "enter", "attach")
    assert entries == events("""
        17904970  4  enter   0  0
        17904970  4  enter   1  0
        17904970  7  attach  0  0
    """)


# ---- admission


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
    assert log.bandwidth_us_bps == (60 * 600 + 30 * 600 + 100 * 300 + 10 * 200) * 1000 * US
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
        60000000  11  stop     0  0  0
        60000000  11  detach   0  0
    """)
    request = the(log)
    assert (request.served_us, request.t_first_us, request.drones) == (0, None, [])
    assert (request.interruptions, request.outcome) == (0, Outcome.NEVER_SERVED)


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
        60000000  11  stop     0  0  0
        60000000  11  detach   0  0
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


# ---- requests and their times


def test_requests_at_the_start_meet_drones_that_are_there():
    # Everything of the start happens in phases 4, 5 and 7; ties go to the lowest drone.
    world = strip([(0, 0), (0, 0), (1, 0)], [(360, 120), (120, 120)], steps=1)
    log = fly(world, path_of(world, {0: [(0, 5, 0)], 1: [(0, 10, 0)]}))
    assert seen(log) == events("""
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
    assert seen(log, "request", "serve", "stop") == events("""
        59999999  5  request  -  0  0
        59999999  5  request  -  1  1
        59999999  7  serve    0  0  0
        60000000  8  stop     0  0  0
    """)
    covered, alone = log.requests
    assert (covered.served_us, covered.attached_us, covered.outcome) == (1, 1, Outcome.UNFINISHED)
    assert covered.interruptions == 0, "the end of the episode interrupts nobody"
    assert (alone.served_us, alone.outcome) == (0, Outcome.NEVER_SERVED)
    assert alone.t_end_us == 60 * US


def test_a_service_that_ends_with_the_episode_is_completed():
    world = strip(users=[(120, 120)], steps=1)
    log = fly(world, path_of(world, {0: [(0, 60, 0)]}))
    assert seen(log, "stop", "complete") == events("""
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


# ---- flying


def test_a_move_off_the_map_is_a_hover_that_counts_and_costs():
    world = strip(users=[(120, 120)], steps=2, battery={"autonomy_min": 10})
    flight = Flight(world)
    log = flight.episode(path_of(world, {0: [(0, 90, 0)]}), "left forward")
    assert seen(log) == events("""
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
    assert (first.battery_us, second.battery_us) == (540 * US, 480 * US)
    assert (second.x_m, second.y_m) == (120.0, 120.0)
    assert log.distance_m == 0.0
    legal = dict(zip(world.actions, flight.shown[0].masks[0], strict=True))
    assert legal[Action.LEFT] and legal[Action.FORWARD], "the drone has no map"


def test_the_four_directions():
    world = strip([(1, 1)], cells=(3, 3), steps=4)
    log = fly(world, path_of(world), "forward right backward left")
    assert [(s.x_m, s.y_m) for s in log.steps] == [(360, 600), (600, 600), (600, 360), (360, 360)]


def test_a_command_that_is_masked_or_unknown_becomes_hover():
    world = strip(steps=5, battery={"autonomy_min": 30, "return_below": 0.2})
    flight = Flight(world)
    log = flight.episode(path_of(world), "goto charge 99 -1 right")
    assert [step.action for step in log.steps] == [
        Action.GOTO_CHARGING_STATION, Action.CHARGE, None, None, Action.RIGHT,
    ]  # fmt: skip
    assert [step.action_taken for step in log.steps] == [Action.HOVER] * 4 + [Action.RIGHT]
    for shown in flight.shown:
        assert shown.masks[0] == (True,) * 5 + (False, False)


@pytest.mark.parametrize(
    ("autonomy_min", "return_below", "epoch"),
    [(30, 0.2, 24), (10, 0.5, 5), (100, 0.7, 30), (50, 0.58, 21), (20, 0.35, 13)],
)
def test_a_return_is_allowed_at_the_limit_and_below(
    autonomy_min: float, return_below: float, epoch: int
):
    # At this decision epoch the battery holds exactly that part of its capacity.
    world = strip(
        steps=epoch + 1, battery={"autonomy_min": autonomy_min, "return_below": return_below}
    )
    flight = Flight(world)
    flight.episode(path_of(world))
    goto = world.actions.index(Action.GOTO_CHARGING_STATION)
    assert [shown.masks[0][goto] for shown in flight.shown[:-1]] == [False] * epoch + [True]


def test_charge_is_allowed_on_a_station_when_not_full():
    world = strip([(4, 0)], steps=4, battery={"autonomy_min": 30})
    flight = Flight(world)
    flight.episode(path_of(world), "charge right left hover")
    charge = world.actions.index(Action.CHARGE)
    assert [shown.masks[0][charge] for shown in flight.shown] == [False, True, False, True, True]


# ---- returns


def returning(steps: int = 5, **changes: Any) -> Any:
    """A station on cell 4 (x = 1080), 600 s of battery, 2 s charged a second."""
    battery = {"autonomy_min": 10, "return_below": 1.0}
    return strip(steps=steps, battery=battery, **changes)


def test_a_return_lands_charges_waits_and_takes_off():
    # 80 m into the first hop the user at 300 is entered: 80 / 8.3 + 1.0375 = 10.676054 s. Three
    # hops from x = 360 end at 60 + 92.971989 s; that long the battery has drained, and it takes
    # half of it, 76.4859945 s, rounded up, to fill. The user at 840 is flown over unserved.
    world = returning(users=[(300, 120), (840, 120), (1080, 60)])
    flight = Flight(world)
    log = flight.episode(path_of(world, {u: [(0, 300, 0)] for u in range(3)}), "right goto")
    assert seen(log) == events("""
                0   5  request  -  0  0
                0   5  request  -  1  1
                0   5  request  -  2  2
                0  10  depart   0
         10676054   4  enter    0  0
         10676054   7  attach   0  0
         10676054   7  serve    0  0  0
         30990663   3  arrive   0
         60000000  10  depart   0
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
        300000000   8  stop     0  2  2
    """)
    modes = [Mode.FLYING, Mode.RETURNING, Mode.CHARGING, Mode.CHARGED, Mode.FLYING]
    assert [step.mode for step in log.steps] == modes
    assert [step.battery_us for step in log.steps] == [
        540 * US, 480 * US, 501_084_033, 600 * US, 540 * US,
    ]  # fmt: skip
    taken = [Action.RIGHT, *[Action.GOTO_CHARGING_STATION] * 2, Action.CHARGE, Action.HOVER]
    assert [step.action_taken for step in log.steps] == taken
    # On the way: 0.093674 s into the braking of the second hop.
    assert log.steps[1].x_m == pytest.approx(600 + 231.38875 + 0.777497 - 0.017550, abs=1e-4)
    assert [step.return_us for step in log.steps] == [3 * HOP_US, HOP_US, 0, 0, 0]
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


# ---- empty batteries


def column(battery: dict[str, Any], **changes: Any) -> Any:
    """A column of nine with stations 0 on (0, 7) and 1 on (0, 1); 93 s of battery."""
    battery = {"autonomy_min": 1.55, "return_below": 1.0, **battery}
    changes = {"starts": [(0, 4)], "users": [(120, 1080), (120, 360)], **changes}
    return strip(cells=(1, 9), battery=battery, stations={"count": 2, "radius_m": 720}, **changes)


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
         93000000   6  stop     0  0  0
         93000000   6  detach   0  0
        180000000   9  respawn  0  -  -  1
        180000000  11  enter    0  1
        180000000  11  attach   0  1
        180000000  12  serve    0  1  1
        240000000   8  stop     0  1  1
    """)
    modes = [Mode.FLYING, Mode.CRASHED, Mode.CRASHED, Mode.FLYING]
    assert [step.mode for step in log.steps] == modes
    assert [step.battery_us for step in log.steps] == [33 * US, 0, 0, 33 * US]
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
    assert log.steps[1].battery_us == 0


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
    assert seen(log) == events("""
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
    assert flight.engine.log.steps[-1].return_us == 3 * HOP_US


@pytest.mark.parametrize("hops", [1, 2])
def test_reaching_a_station_with_the_last_of_the_battery_is_an_arrival(hops: int):
    battery = {"autonomy_min": hops * HOP_US / 60e6, "return_below": 1.0}
    world = strip([(4 - hops, 0)], battery=battery, steps=3)
    assert world.capacity_us == hops * HOP_US
    log = fly(world, path_of(world), "goto")
    assert seen(log, "land", "charge", "deplete", "crash") == events(f"""
        {hops * HOP_US}  3  land    0  -  -  0
        {hops * HOP_US}  3  charge  0  -  -  0
    """)
    assert log.steps[-1].battery_us == (180 * US - hops * HOP_US) * world.capacity_us // (300 * US)


@pytest.mark.parametrize("short_us", [1, HOP_US])
def test_a_drone_that_is_empty_before_its_station_falls(short_us: int):
    # One microsecond too little; or just enough for the first of two hops.
    capacity_us = 2 * HOP_US - short_us
    world = strip(
        [(2, 0)], battery={"autonomy_min": capacity_us / 60e6, "return_below": 1.0}, steps=2
    )
    assert world.capacity_us == capacity_us
    log = fly(world, path_of(world), "goto")
    assert seen(log, "arrive", "land", "deplete", "crash") == events(f"""
        {HOP_US}       3  arrive   0
        {capacity_us}  6  deplete  0
        {capacity_us}  6  crash    0
    """)


# ---- wrong about where it is


def test_a_return_from_a_mistaken_place_is_flown_as_relative_hops():
    # True cell 2, believed 0: four hops right end on cell 6, beyond the station on 4; two back.
    world = returning(starts=[(2, 0)], steps=4)
    flight = Flight(world)
    log = flight.episode(path_of(world, error=[[(-2, 0)]]), "goto")
    assert seen(log, "arrive", "blocked", "land") == events("""
         30990663  3  arrive  0
         61981326  3  arrive  0
         92971989  3  arrive  0
        123962652  3  arrive  0
        154953315  3  arrive  0
        185943978  3  arrive  0
        185943978  3  land    0  -  -  0
    """)
    assert flight.shown[0].observations[0].cell == (0, 0)
    assert flight.shown[0].observations[0].return_s == pytest.approx(4 * HOP_US / US, abs=1e-9)
    assert log.distance_m == 6 * 240


def test_a_hop_off_the_map_ends_a_mistaken_path_at_no_cost():
    # True cell 7, believed 0: one of four hops right, and then four left from cell 8. Mistakes of
    # later decision epochs change nothing.
    world = returning(starts=[(7, 0)], steps=4)
    log = fly(world, path_of(world, error=[[(-7, 0), (3, 0), (-8, 0)]]), "goto")
    assert seen(log) == events("""
                0  10  depart   0
         30990663   3  arrive   0
         30990663   3  blocked  0
         30990663   3  depart   0
         61981326   3  arrive   0
         61981326   3  depart   0
         92971989   3  arrive   0
         92971989   3  depart   0
        123962652   3  arrive   0
        123962652   3  depart   0
        154953315   3  arrive   0
        154953315   3  land     0  -  -  0
        154953315   3  charge   0  -  -  0
        232429973   3  charged  0  -  -  0
    """)


def test_a_drone_that_believes_it_is_on_a_station_looks_again():
    world = returning(starts=[(3, 0)], steps=1)
    flight = Flight(world)
    log = flight.episode(path_of(world, error=[[(1, 0)]]), "goto")
    assert flight.shown[0].observations[0].return_s == 0.0
    assert seen(log, "depart", "land") == events("""
               0  10  depart  0
        30990663   3  land    0  -  -  0
    """)


@pytest.mark.parametrize(
    ("error", "cell"), [(0.49, 7), (0.51, 8), (-0.51, 6), (40.0, 8), (-40.0, 0), (-1.6, 5)]
)
def test_a_belief_is_a_cell_of_the_map(error: float, cell: int):
    world = returning(starts=[(7, 0)], steps=1)
    flight = Flight(world)
    flight.episode(path_of(world, error=[[(error, 0.3)]]))
    assert flight.shown[0].observations[0].cell == (cell, 0)
    assert flight.shown[1].observations[0].cell == (7, 0)


def test_masks_go_by_where_a_drone_is():
    # On the station but thinking it is elsewhere, and the other way round.
    world = returning(starts=[(4, 0), (3, 0)], steps=2)
    flight = Flight(world)
    error = [[(0, 0), (-1, 0)], [(0, 0), (1, 0)]]
    log = flight.episode(path_of(world, error=error), "hover charge", "hover charge")
    charge = world.actions.index(Action.CHARGE)
    assert [mask[charge] for mask in flight.shown[1].masks] == [True, False]
    assert seen(log, "land") == events("60000000  10  land  0  -  -  0")


def test_a_hop_into_a_building_ends_a_mistaken_path():
    # Station on (2, 1); a building on (1, 0). True cell (0, 0), believed (0, 1): right is blocked
    # at once; from (0, 0) the one way of three hops goes forward first.
    world = in_3d([[1, 0, 30]], [(0, 0)], cells=(5, 2), steps=2, battery={"return_below": 1.0})
    flight = Flight(world)
    log = flight.episode(path_of(world, error=[[(0, 1)]]), "goto")
    assert flight.shown[0].observations[0].return_s == pytest.approx(2 * HOP_US / US, abs=1e-9)
    assert seen(log) == events("""
               0  10  blocked  0
               0  10  depart   0
        30990663   3  arrive   0
        30990663   3  depart   0
        61981326   3  arrive   0
        61981326   3  depart   0
        92971989   3  arrive   0
        92971989   3  land     0  -  -  0
        92971989   3  charge   0  -  -  0
        108467321  3  charged  0  -  -  0
    """)


# ---- up and down


def in_3d(buildings: list[list[float]], starts: Any, cells: Any = (3, 2), **changes: Any) -> Any:
    size_m = [240 * cells[0], 240 * cells[1]]
    levels = {"min_altitude_m": 20, "step_m": 20}
    relief = {"dimensions": 3, "levels": levels, "obstacles": {"cells": buildings}}
    map_ = {"size_m": size_m, "cells": cells, **relief}
    return strip(starts, cells=cells, map=map_, **changes)


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
    assert seen(log) == events("""
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


# ---- from one episode into the next


def test_a_return_goes_on_in_the_next_episode():
    # Two hops done or begun at 120 s; the users of the new episode are asked anew.
    world = returning(steps=2, users=[(300, 120), (1080, 120)])
    flight = Flight(world, carry_over=True)
    asks = {0: [(0, 500, 0)], 1: [(0, 500, 0)]}
    before = flight.episode(path_of(world, asks), "right goto")
    assert [r.t_end_us for r in before.requests] == [120 * US] * 2
    after = flight.episode(path_of(world, asks, episode=1), "right right")
    assert seen(after) == events("""
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


# ---- the step record


def test_what_a_step_records():
    # Phase 8 comes before the commands: two users attached, one of them served with 300 kbit/s.
    world = strip(users=[(120, 120), (120, 100), (500, 120)], steps=2, bandwidth_kbps=400)
    asks = {0: [(0, 100, 300)], 1: [(10, 100, 200)]}
    log = fly(world, path_of(world, asks), "hover right")
    first, second = log.steps
    assert (first.attached_users, first.served_requests, first.bandwidth_bps) == (2, 1, 300_000)
    assert (first.x_m, first.battery_us, first.return_us) == (120.0, None, None)
    assert (second.attached_users, second.served_requests, second.bandwidth_bps) == (0, 0, 0)
    assert second.x_m == 360.0
    check_log(world, log)
