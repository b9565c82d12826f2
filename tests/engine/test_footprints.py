"""A footprint passes over users, or users through it: entries and exits by hand."""

from __future__ import annotations

import pytest

from desim_uav.model.rules import Outcome
from tests.engine.helpers import US, before_end, events, fly, path_of, seen, strip, the

pytestmark = pytest.mark.usefixtures("every_engine")


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
        180000000   8  close    -  0  0
    """)
    request = the(log)
    assert request.served_us == request.attached_us == 24_096_385
    assert (request.t_request_us, request.t_first_us, request.t_end_us) == (0, 63_447_139, 180 * US)
    assert request.interruptions == 1, "it goes unserved from the exit on"
    assert request.outcome is Outcome.UNFINISHED
    assert log.attached_us == 24_096_385
    assert log.bandwidth_us_hz == 24_096_385 * 100_000
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
    assert before_end(log) == events("""
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
    assert before_end(log) == events(f"""
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
