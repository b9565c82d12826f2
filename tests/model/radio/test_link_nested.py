"""Classes of a link while the drone keeps its altitude: nested circles, and a sampler."""

import numpy as np
import pytest

from desim_uav.model.geometry.coverage import SEEN_ROWS, DroneLeg, Users, look_around
from desim_uav.model.geometry.crossings import crossings
from desim_uav.model.geometry.relative import Change
from desim_uav.model.radio.nested import class_changes
from desim_uav.rowcode.views import zeros
from tests.model.radio.looking import Scene, Seen, hold_classes, moving
from tests.model.radio.making import START_US, flying, hovering, walks
from tests.model.sampler import Walk


def changes(leg, walking, radii, span_s, *, fresh=True, room=500):
    """(time, user, class) of all users; ``radii``: those of each user."""
    span = (START_US, START_US + round(span_s * 1e6))
    legs = [walks(one) for one in walking]
    users = Users(
        np.concatenate(legs),
        np.cumsum([0, *map(len, legs)]),
        np.zeros((SEEN_ROWS, len(walking))),
    )
    look_around(users, *span)
    route = (*leg.route[:2], *leg.route[3:5])
    climb = leg.route[5] - leg.route[2]
    drone, out = DroneLeg(leg.profile, route, span, -1.0, fresh, climb), zeros(Change, room)
    count = class_changes(drone, users, np.array(radii, float), np.arange(len(walking)), out)
    plain = [(t, u, abs(c)) for t, u, c in out[:count].tolist()] if count <= room else count
    return plain, drone, users


def stroll(x, y, vx, vy):
    return Walk(np.zeros(1), np.array([(x, y)], float), np.array([(vx, vy)], float))


def times_of(leg, walk, radii, span_s, **options):
    rows, _, _ = changes(leg, [walk], [radii], span_s, **options)
    return [((t - START_US) * 1e-6, state) for t, _, state in rows]


REST_LEG = hovering((0, 0, 100))


class TestByHand:
    def test_a_user_walks_through_three_circles(self):
        rows = times_of(REST_LEG, stroll(-100, 0, 1, 0), [50, 40, 20], 300.0)
        assert rows == [(50, 1), (60, 2), (80, 3), (120, 2), (140, 1), (150, 0)]

    def test_a_drone_that_begins_to_serve_says_the_class_at_once(self):
        for fresh, first in ((True, [(0, 2)]), (False, [])):
            rows = times_of(REST_LEG, stroll(-30, 0, 1, 0), [50, 40, 20], 60.0, fresh=fresh)
            assert rows == [*first, (10, 3), (50, 2)]

    def test_circles_crossed_in_one_microsecond_are_one_change(self):
        # A kilometre a second passes 0.2 mm in 0.2 us.
        rows = times_of(REST_LEG, stroll(-1000, 0, 1e3, 0), [500, 500 - 2e-4, 400], 0.95)
        assert rows == [(0.5, 2), (0.6, 3)]

    def test_circles_left_and_entered_in_one_microsecond_cancel(self):
        # At the turn the user is out of the inner circle by 0.2 um, and inside the wide one.
        walk = Walk(
            np.array([0.0, 10.0]),
            np.array([(30.0, 0.0), (40.0 + 2e-7, 0.0)]),
            np.array([(1.0, 0.0), (-1.0, 0.0)]),
        )
        assert times_of(REST_LEG, walk, [50, 40, 20], 19.0) == [(0, 2)]

    def test_equal_circles_are_passed_together(self):
        assert times_of(REST_LEG, stroll(-100, 0, 1, 0), [50, 50, 50], 60.0) == [(50, 3)]

    def test_a_class_that_holds_nowhere_is_never_reached(self):
        rows = times_of(REST_LEG, stroll(-100, 0, 1, 0), [50, 40, -1, -1], 100.0)
        assert rows == [(50, 1), (60, 2)]
        assert times_of(REST_LEG, stroll(-100, 0, 1, 0), [-1, -1], 100.0) == []

    def test_users_have_circles_of_their_own(self):
        walking = [stroll(-100, 0, 1, 0), stroll(-100, 0, 1, 0), stroll(0, 500, 0, 1)]
        rows, _, _ = changes(REST_LEG, walking, [[50, 40], [30, -1], [50, 40]], 65.0)
        assert rows == [(START_US + 50_000_000, 0, 1), (START_US + 60_000_000, 0, 2)]

    def test_room_that_is_too_short_is_said(self):
        walking = [stroll(-100, 0, 1, 0), stroll(-100, 10, 1, 0)]
        radii = [[50, 40, 20]] * 2
        whole, _, _ = changes(REST_LEG, walking, radii, 300.0)
        assert len(whole) == 12
        for room in range(12):
            count, _, _ = changes(REST_LEG, walking, radii, 300.0, room=room)
            assert count > room
            assert changes(REST_LEG, walking, radii, 300.0, room=count)[0] == whole


def survey(count, seed, oblique=False):
    """Random users of legs, each with 14 circles, held against the sampler."""
    rng, seen = np.random.default_rng(seed), Seen()
    for number in range(count):
        span_s = round(rng.uniform(5.0, 70.0), 6)
        start = np.array([*rng.uniform(-400.0, 400.0, 2), 100.0])
        ahead = np.eye(3)[rng.integers(2)] * rng.choice([-1.0, 1.0])
        if oblique:
            ahead = rng.normal(size=3) * (1.0, 1.0, rng.choice([0.0, 0.5]))
            ahead /= np.linalg.norm(ahead)
        stop = start + ahead * rng.uniform(5.0, 400.0)
        leg = hovering(start) if rng.random() < 0.2 else flying(rng, start, stop, span_s)
        if leg.before_us:
            continue  # a leg of the crossings begins with its span, and does not end after it
        if leg.trip.flight is not None:
            span_s = max(span_s, round(leg.profile["start_s"][-1], 6))
        span = (START_US, START_US + round(span_s * 1e6))
        walk = moving(rng, span_s, 5)
        scene = Scene(walk, 0.0, [leg.trip], [], 0.0, span_s)

        def apart(t, scene=scene):
            return -np.hypot(*scene.apart(0, np.atleast_1d(np.asarray(t, float)))[:, :2].T)

        values = apart(np.linspace(0.0, span_s, 300))
        circles = np.sort(rng.uniform(values.min() - 5.0, min(values.max() + 5.0, 0.0), 14))
        rows, drone, users = changes(leg, [walk], [-circles], span_s)
        own = [(t, state) for t, _, state in rows]
        if not own or own[0][0] > START_US:
            own.insert(0, (START_US, 0))
        wrong, unclear = hold_classes(apart, circles, own, span, 1e-9)
        one, out = drone._replace(radius_m=-circles[5]), zeros(Change, 99)
        single = crossings(one, users, out)
        alone, _, _ = changes(leg, [walk], [-circles[5:6]], span_s)
        if alone != [tuple(map(int, row)) for row in out[:single]]:
            wrong.append(("one circle", alone))
        seen.add(own[1:], wrong, unclear, (number, scene))
    return seen


def check(seen):
    assert seen.wrong == []
    assert seen.rows > 5 * seen.legs and seen.unclear <= 0.01 * seen.rows


def test_a_sampler_sees_the_same():
    check(survey(120, 1))


@pytest.mark.slow
def test_a_sampler_sees_the_same_on_two_thousand_legs():
    check(survey(2500, 2))
