"""Entries and exits: figures worked by hand, an independent sampler, and conservation."""

import math

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from desim_uav.model.geometry.coverage import (
    SEEN_ROWS,
    STRAY,
    Buckets,
    DroneLeg,
    Users,
    WalkLeg,
    bucket_grid,
    leg_at,
    look_around,
    sort_into_buckets,
    walked,
)
from desim_uav.model.geometry.crossings import crossings, crossings_near
from desim_uav.model.geometry.relative import Change
from desim_uav.model.mobility.mobility import Area, RandomWalk
from desim_uav.model.motion.motion import REST, BangCoastBang
from desim_uav.model.random.streams import Purpose, Streams
from desim_uav.model.rules import US
from desim_uav.rowcode.views import records, zeros
from tests.selection import by_default
from tests.verification.crossings import FAST, FILL, R, at, find, fly, hover, stated, survey
from tests.verification.figure import check


class TestWorkedByHand:
    def test_a_user_walks_through_the_footprint_of_a_hovering_drone(self):
        rows = hover((0, 2000 * US), [at(-1000, 300, 1.5)])
        assert rows == [(320_256_505, 0, True), (1_013_076_828, 0, False)]
        half = math.sqrt(R**2 - 300**2)
        assert rows[0][0] == pytest.approx((1000 - half) / 1.5 * 1e6, abs=1)
        assert rows[1][0] == pytest.approx((1000 + half) / 1.5 * 1e6, abs=1)

    def test_a_drone_flies_away_from_a_user(self):
        check(stated())
        ((_, user, enters),) = fly(FAST, [at(3 - R, 0)])
        assert (user, enters) == (0, False)

    @pytest.mark.parametrize("x", [1e-6, 0.5, 3.0, 100.0, 235.0, 239.99])
    @pytest.mark.parametrize("transit", [FAST, FILL])
    def test_a_drone_comes_when_its_mirror_image_leaves(self, transit, x):
        ((left_us, _, _),) = fly(transit, [at(x - R, 0)])
        ((came_us, _, enters),) = fly(transit, [at(240 - x + R, 0)])
        assert enters
        assert came_us + left_us == pytest.approx(transit.rows["start_s"][-1] * 1e6, abs=1)

    @pytest.mark.parametrize("heading", [(1, 0), (-1, 0), (0, 1), (0, -1)])
    def test_all_four_directions_are_alike(self, heading):
        ex, ey = heading
        route = (0, 0, 240 * ex, 240 * ey)
        user = at((100 - R) * ex, (100 - R) * ey)
        ((t_us, _, enters),) = find(FAST, route, (0, FAST.duration_us), [user])
        assert (t_us, enters) == (13_085_693, False)

    def test_the_leg_may_begin_at_any_time(self):
        start = 1_740_000_001
        rows = fly(FAST, [at(100 - R, 0)], span_us=(start, start + FAST.duration_us))
        assert rows == [(start + 13_085_693, 0, False)]

    def test_a_user_walks_along_with_the_clock_of_its_own_leg(self):
        # The leg began 100 s before the span: 150 m on by then.
        start = 500 * US
        rows = hover((start, 3000 * US), [at(-1000, 300, 1.5, t0=400 * US)])
        assert rows == [(720_256_505, 0, True), (1_413_076_828, 0, False)]

    def test_a_user_meets_a_coasting_drone_head_on(self):
        # 600 m apart when 8.3 (t - 1.0375) + 5 t = 800 - 600.
        seconds = (200 + 8.3 * 1.0375) / 13.3
        assert fly(FAST, [at(800, 0, -5)]) == [(round(seconds * 1e6), 0, True)]

    def test_nobody_crosses_who_stays_in_or_out(self):
        assert fly(FAST, [at(0, 0), at(120, 580), at(2000, 0), at(0, -601)]) == []

    def test_rows_stand_user_by_user_in_order_of_time(self):
        users = [at(100 - R, 0), at(0, 2000), at(-1000, 300, 1.5), at(3 - R, 0)]
        rows = hover((0, 2000 * US), users)
        assert [(u, e) for _, u, e in rows] == [(2, True), (2, False)]
        rows = fly(FAST, users)
        assert rows == [(13_085_693, 0, False), (1_224_745, 3, False)]


class TestTheEdge:
    @pytest.mark.parametrize("transit", [FAST, FILL])
    @pytest.mark.parametrize("x", [1.0, 120.0, 238.0])
    @pytest.mark.parametrize("fresh", [False, True])
    def test_a_tangent_covers_for_no_time(self, transit, x, fresh):
        for y in (R, -R):
            rows = fly(transit, [at(x, y)], fresh=fresh)
            assert len(rows) in (0, 2)
            assert [e for *_, e in rows] == [True, False][: len(rows)]
            assert all(rows[0][0] == t for t, *_ in rows)

    @pytest.mark.parametrize("transit", [FAST, FILL])
    def test_a_drone_at_rest_leaves_a_user_on_the_circle_at_once(self, transit):
        # Sideways of the flight: the distance grows with the fourth power of the time.
        ((t_us, _, enters),) = fly(transit, [at(0, R)])
        assert (t_us <= 1, enters) == (True, False)
        assert sum(1 if e else -1 for *_, e in fly(transit, [at(0, R)], fresh=True)) == 0

    @pytest.mark.parametrize("transit", [FAST, FILL])
    def test_a_drone_comes_to_rest_where_a_user_is_on_the_circle(self, transit):
        ((t_us, _, enters),) = fly(transit, [at(240, R)])
        assert (abs(t_us - transit.duration_us) <= 1, enters) == (True, True)

    @pytest.mark.parametrize("x", [1.0, 120.0, 238.0])
    @pytest.mark.parametrize("outside", [1e-9, 1e-6, 1e-3])
    def test_a_near_tangent_outside_is_nothing(self, x, outside):
        assert fly(FAST, [at(x, R + outside)]) == []

    @pytest.mark.parametrize("inside", [1e-9, 1e-6, 1e-3])
    def test_a_near_tangent_inside_is_an_entry_and_an_exit(self, inside):
        half = math.sqrt(R**2 - (R - inside) ** 2)
        middle = 2.075 + (120.0 - 8.61125) / 8.3
        rows = fly(FAST, [at(120, R - inside)])
        assert [e for *_, e in rows] == [True, False]
        assert rows[0][0] == pytest.approx((middle - half / 8.3) * 1e6, abs=1.5)
        assert rows[1][0] == pytest.approx((middle + half / 8.3) * 1e6, abs=1.5)

    @pytest.mark.parametrize("inside", [1e-9, 1e-6, 1e-3])
    def test_a_near_tangent_while_accelerating(self, inside):
        half = math.sqrt(R**2 - (R - inside) ** 2)
        rows = fly(FAST, [at(3, R - inside)])
        assert [e for *_, e in rows] == [True, False]
        assert rows[0][0] == pytest.approx(math.sqrt((3 - half) / 2.0) * 1e6, abs=1.5)
        assert rows[1][0] == pytest.approx(math.sqrt((3 + half) / 2.0) * 1e6, abs=1.5)

    def test_entry_and_exit_in_one_microsecond_are_nothing(self):
        # At 1000 m/s a chord of 0.2 mm takes 0.2 us, around t = 1 s.
        y = math.sqrt(R**2 - 1e-4**2)
        assert hover((0, 2 * US), [at(-1000, y, 1000.0)]) == []
        y = math.sqrt(R**2 - 1e-3**2)
        assert hover((0, 2 * US), [at(-1000, y, 1000.0)]) == [
            (999_999, 0, True),
            (1_000_001, 0, False),
        ]

    @pytest.mark.parametrize(("metres", "t_us"), [(0.5, 0), (1.5, 2), (2.5, 2), (3.5, 4)])
    def test_a_half_microsecond_is_rounded_to_the_even_one(self, metres, t_us):
        # A metre a microsecond: exactly half-way between two of them.
        assert hover((0, US), [at(R - metres, 0, 1e6)]) == [(t_us, 0, False)]

    def test_exit_and_entry_in_one_microsecond_are_nothing(self):
        # Out by 0.2 um at the turn, and back in.
        t = 10 * US
        beyond = 2e-7
        walk = [(0, R - 10 + beyond, 0, 1.0, 0), (t, R + beyond, 0, -1.0, 0)]
        assert hover((0, 2 * t), [walk]) == []
        assert hover((0, 2 * t), [walk], fresh=True) == [(0, 0, True)]
        beyond = 3e-6
        walk = [(0, R - 10 + beyond, 0, 1.0, 0), (t, R + beyond, 0, -1.0, 0)]
        assert hover((0, 2 * t), [walk]) == [(t - 3, 0, False), (t + 3, 0, True)]

    def test_an_exit_at_the_start_cancels_the_entry_at_the_start(self):
        assert hover((5 * US, 6 * US), [at(R, 0, 1.0, t0=5 * US)], fresh=True) == []
        assert hover((5 * US, 6 * US), [at(R, 0, 1.0, t0=5 * US)]) == [(5 * US, 0, False)]

    def test_the_footprint_is_closed(self):
        assert hover((0, US), [at(R, 0)], fresh=True) == [(0, 0, True)]
        assert hover((0, US), [at(math.nextafter(R, 1e3), 0)], fresh=True) == []

    def test_arriving_on_the_circle_is_an_entry_and_going_back_an_exit(self):
        ((there, _, enters),) = fly(FAST, [at(240 + R, 0)])
        assert enters
        assert there == pytest.approx(FAST.duration_us, abs=1)
        back = (FAST.duration_us, 2 * FAST.duration_us)
        ((left, _, enters),) = find(FAST, (240, 0, 0, 0), back, [at(240 + R, 0)])
        assert not enters
        assert left == pytest.approx(FAST.duration_us, abs=1)

    def test_an_empty_leg(self):
        assert hover((US, US), [at(0, 0), at(2 * R, 0)], fresh=True) == [(US, 0, True)]
        assert hover((US, US), [at(0, 0)]) == []


class TestFresh:
    def test_a_drone_that_begins_to_serve_takes_in_those_inside(self):
        users = [at(0, 0), at(2000, 0), at(100 - R, 0)]
        rows = fly(FAST, users, span_us=(7, 7 + FAST.duration_us), fresh=True)
        assert rows == [(7, 0, True), (7, 2, True), (7 + 13_085_693, 2, False)]

    def test_a_drone_that_serves_on_does_not(self):
        rows = fly(FAST, [at(0, 0), at(2000, 0), at(100 - R, 0)])
        assert rows == [(13_085_693, 2, False)]


def test_what_does_not_fit_is_counted_and_not_written():
    users = [at(-1000, 300, 1.5)] * 3
    whole = hover((0, 2000 * US), users)
    assert len(whole) == 6
    legs = records(WalkLeg, [leg for user in users for leg in user])
    walking, span = Users(legs, np.arange(4), np.zeros((SEEN_ROWS, 3))), (0, 2000 * US)
    look_around(walking, *span)
    for room in range(7):
        out = records(Change, np.full((room + 2, 3), -7))
        leg = DroneLeg(REST.rows, (0.0, 0.0, 0.0, 0.0), span, R, False)
        assert crossings(leg, walking, out[:room]) == 6
        assert out[:room].tolist() == whole[:room]
        assert set(out[room:].tolist()) == {(-7, -7, -7)}


class TestLegs:
    LEGS = records(
        WalkLeg, [(0, 1, 2, 0, 0), (5, 3, 4, 1e6, 0), (0, 7, 7, 0, 0), (9, 8, 8, 0, -2e6)]
    )

    @pytest.mark.parametrize(("t_us", "leg"), [(0, 0), (4, 0), (5, 1), (100, 1)])
    def test_the_last_leg_that_has_begun(self, t_us, leg):
        assert leg_at(self.LEGS, 0, 2, t_us) == leg

    @pytest.mark.parametrize(("t_us", "leg"), [(8, 2), (9, 3), (11, 3)])
    def test_only_among_the_users_own(self, t_us, leg):
        assert leg_at(self.LEGS, 2, 4, t_us) == leg

    def test_walked(self):
        assert walked(self.LEGS[1], 7) == (5.0, 4.0)
        assert walked(self.LEGS[3], 10) == (8.0, 6.0)


# Crossings at random, against the sampler.


@pytest.mark.thorough
def test_an_independent_sampler_sees_the_same_crossings():
    seen = survey()
    check(seen.figures())
    found = seen.accelerating + seen.coasting + seen.resting
    assert seen.by_roots.sum() >= 1000
    assert seen.unclear <= 0.05 * seen.pairs
    assert seen.accelerating >= 0.3 * found
    assert seen.coasting >= 0.2 * found
    assert seen.resting >= 20
    assert 150 <= seen.standing <= 600
    assert (seen.by_roots[:4] >= 20).all(), seen.by_roots


# Conservation: entries and exits alternate, and the state they carry is the geometry's.

MOVES = [(0, 0), (1, 0), (-1, 0), (0, 1), (0, -1)]
CELL_M, STEP_US = 240.0, 60 * US


def drone_legs(moves, timing):
    """(transit, route, span) of a drone from (0, 0), a step each."""
    motion = BangCoastBang(timing=timing)
    transit = motion.epoch_transit(CELL_M, 60.0)
    x = y = 0.0
    for k, (dx, dy) in enumerate(moves):
        route = (x, y, x + dx * CELL_M, y + dy * CELL_M)
        yield (transit if dx or dy else REST), route, (k * STEP_US, (k + 1) * STEP_US)
        x, y = route[2:]


def gap_m(drone, walk, t_us):
    """How far outside the circle the user is; its leg looked up by hand."""
    t0, x, y, vx, vy = [leg for leg in walk if leg[0] <= t_us][-1]
    t = (t_us - t0) * 1e-6
    return math.hypot(drone[0] - x - vx * t, drone[1] - y - vy * t) - R


def check_chain(legs, walks):
    """Follow each user through the drone's legs: no lost crossing, no doubled one."""
    inside = dict.fromkeys(range(len(walks)), False)
    latest = dict.fromkeys(range(len(walks)), 0)
    for k, (transit, route, span) in enumerate(legs):
        for t_us, user, enters in find(transit, route, span, walks, fresh=k == 0):
            assert enters != inside[user], (user, t_us)
            assert span[0] <= t_us <= span[1]
            assert t_us >= latest[user]
            inside[user], latest[user] = enters, t_us
        for user, walk in enumerate(walks):
            gap = gap_m(route[2:], walk, span[1])
            assert abs(gap) < 1e-6 or inside[user] == (gap < 0.0), (user, span, gap)


# Multiples of 120 m put users on the circle around a cell's centre: 600 m are 2.5 cells.
places = st.one_of(st.integers(-8, 8).map(lambda k: k * 120.0), st.floats(-1200.0, 1200.0))
velocities = st.sampled_from([0.0, 2.0, -2.0, 4.0, -4.0, 8.3, -1.4, 1e-9]) | st.floats(-12.0, 12.0)


@st.composite
def walks_of(draw):
    t, x, y = 0, draw(places), draw(places)
    walk = []
    for _ in range(draw(st.integers(1, 5))):
        vx, vy = draw(velocities), draw(velocities)
        walk.append((t, x, y, vx, vy))
        lasts = draw(st.sampled_from([30 * US, STEP_US, 1]) | st.integers(1, 100 * US))
        t, x, y = t + lasts, x + vx * lasts * 1e-6, y + vy * lasts * 1e-6
    return walk


@pytest.mark.thorough
@given(
    st.lists(st.sampled_from(MOVES), min_size=1, max_size=5),
    st.sampled_from(["fill_epoch", "minimum_time"]),
    st.lists(walks_of(), min_size=1, max_size=5),
)
@example([(1, 0), (-1, 0)] * 2, "minimum_time", [at(-600, 0), at(600, 0), at(840, 0), at(-360, 0)])
@example([(0, 1), (0, 0), (0, -1)], "fill_epoch", [at(600, 0), at(480, 360), at(-480, 600)])
@settings(max_examples=300, deadline=None)
def test_entries_and_exits_alternate_and_agree_with_the_geometry(moves, timing, walks):
    check_chain(drone_legs(moves, timing), walks)


@pytest.mark.thorough
@given(st.lists(st.sampled_from(MOVES), min_size=2, max_size=8), st.integers(0, 2**32))
@settings(max_examples=40, deadline=None)
def test_so_they_do_for_random_walks_mirrored_at_the_edge(moves, seed):
    # Quick users on a small map: several mirrors a leg.
    rng = np.random.default_rng(seed)
    homes = rng.uniform(0.0, 400.0, (20, 2))
    walk = RandomWalk(speed_mps=20.0, leg_s=7.0)
    drawn = walk.walks(homes, Streams(seed, Purpose.MOBILITY), Area(400.0, 400.0), 8 * STEP_US)
    own = [
        [tuple(leg) for leg in drawn.legs[first:stop]]
        for first, stop in zip(drawn.offsets[:-1], drawn.offsets[1:], strict=True)
    ]
    assert max(map(len, own)) > 70
    check_chain(drone_legs(moves, "minimum_time"), own)


def test_a_walk_cut_in_pieces_is_the_same_walk():
    rng = np.random.default_rng(5)
    for _ in range(200):
        x, y = rng.uniform(-900.0, 900.0, 2)
        vx, vy = rng.uniform(-8.0, 8.0, 2)
        whole = [(0, x, y, vx, vy)]
        cuts = [0, *np.sort(rng.integers(1, 60 * US, 3)).tolist()]
        pieces = [(t, x + vx * t * 1e-6, y + vy * t * 1e-6, vx, vy) for t in cuts]
        one, other = fly(FILL, [whole]), fly(FILL, [pieces])
        assert [row[1:] for row in one] == [row[1:] for row in other]
        assert all(abs(a[0] - b[0]) <= 1 for a, b in zip(one, other, strict=True))


@pytest.mark.parametrize("seed", by_default(range(1), range(20)))
def test_users_in_buckets_cross_as_all_users_do(seed):
    """A wide map, a drone anywhere (and off its edge): nobody is overlooked by either pass."""
    rng = np.random.default_rng(seed)
    area = Area(*rng.uniform(5000, 12000, 2))
    homes = rng.uniform(0, 1, (400, 2)) * area
    walk = RandomWalk(
        speed_mps=float(rng.choice([0.0, 1.4, 60.0])), leg_s=float(rng.uniform(5, 90))
    )
    legs, offsets = walk.walks(homes, Streams(seed, Purpose.MOBILITY), area, 600 * US)
    radius = float(rng.uniform(200, 700))
    shape = bucket_grid(*area, radius)
    assert shape[0] * shape[1] >= 48
    side = (area.width_m / shape[0], area.depth_m / shape[1])
    heads, following = np.empty(shape[0] * shape[1], np.int64), np.empty(400, np.int64)
    buckets = Buckets(shape, side, heads, following)
    users, found = Users(legs, offsets, np.zeros((SEEN_ROWS, 400))), 0
    out, near = zeros(Change, 5000), zeros(Change, 5000)
    for _ in range(40):
        start = int(rng.integers(0, 540)) * US
        span = (start, start + 60 * US)
        look_around(users, *span)
        far = sort_into_buckets(users.seen, buckets)
        x, y = rng.uniform(-0.02, 1.02, 2) * area
        route = (x, y, x + 240.0, y) if rng.random() < 0.5 else (x, y, x, y - 240.0)
        profile = (FILL if rng.random() < 0.5 else FAST).rows
        leg = DroneLeg(profile, route, span, radius, bool(rng.random() < 0.5))
        count = crossings(leg, users, out)
        assert crossings_near(leg, users, buckets, far, near) == count
        assert sorted(map(tuple, out[:count])) == sorted(map(tuple, near[:count]))
        users.seen[STRAY] = 1e6  # then everybody may be near
        assert crossings(leg, users, near) == count
        assert (out[:count] == near[:count]).all()
        found += count
    assert found > 20


def test_a_small_map_is_worth_no_buckets():
    assert bucket_grid(2400.0, 2400.0, 600.0) == (0, 0)
    assert bucket_grid(100.0, 1e6, 600.0) == (0, 0)
