"""The ratio of signal to noise and interference: its thresholds against a sampler, its bound."""

import numpy as np
import pytest

from desim_uav.model.kernels import kernel
from desim_uav.model.radio.sinr import TOLERANCE_DB, steepness_of
from desim_uav.model.radio.slopes import log_distance_slope, logistic_slope
from tests.model.radio.looking import Loss, Scene, Seen, hold_classes, moving
from tests.model.radio.making import (
    START_US,
    flying,
    hovering,
    links_of,
    rows_of,
    sinr_changes,
    slope,
)
from tests.model.sampler import Walk

pytestmark = pytest.mark.thorough  # it is long to compile, and no engine uses it yet

TOWNS = [(0.0, 1.0, 1.0), (20.9, 4.88, 0.43), (19.0, 9.61, 0.16), (21.4, 12.08, 0.11)]
TOWNS.append((31.7, 27.23, 0.08))


steepness = steepness_of(slope)


@kernel
def slopes(own, distances_m, heights_m, withins_m, out):
    for k in range(len(out)):
        out[k, 0], out[k, 1] = slope(own, 0, distances_m[k], heights_m[k], withins_m[k])


@kernel
def most(links, since, until):
    return steepness(links, since, until)


def random_loss(rng):
    fall, a, b = TOWNS[rng.integers(5)]
    exponent = rng.uniform(1.8, 4.0) if fall == 0.0 else 2.0
    return Loss(rng.uniform(10.0, 33.0), rng.uniform(32.0, 40.0), exponent, fall, a, b)


def random_scene(rng, drones, alike):
    """(scene, legs): drones on oblique, level and vertical legs or at rest around a user."""
    span_s = round(rng.uniform(5.0, 70.0), 6)
    legs = []
    for _ in range(drones):
        start = np.array([*rng.uniform(-600.0, 600.0, 2), rng.uniform(25.0, 200.0)])
        stop = start + rng.uniform(-1.0, 1.0, 3) * (250.0, 250.0, 100.0)
        stop[2] = max(stop[2], 20.0)
        kind = rng.random()
        if kind < 0.2:
            stop[2] = start[2]
        elif kind < 0.4:
            stop[:2] = start[:2]
        legs.append(hovering(start) if kind > 0.85 else flying(rng, start, stop, span_s))
    loss = random_loss(rng)
    losses = [loss if alike else random_loss(rng) for _ in range(drones)]
    walk = moving(rng, span_s, 4)
    noise = -np.inf if drones == 2 and rng.random() < 0.3 else rng.uniform(-110.0, -90.0)
    trips = [leg.trip for leg in legs]
    return Scene(walk, 1.5, trips, losses, noise, span_s), legs


def survey(count, seed):
    """Random users with 1 to 5 drones, held against the sampler."""
    rng, seen = np.random.default_rng(seed), Seen()
    out = np.zeros((400, 2), np.int64)
    for number in range(count):
        scene, legs = random_scene(rng, 1 + number % 5, rng.random() < 0.7)
        span = (START_US, START_US + round(scene.span_s * 1e6))
        values = scene.ratio_db(np.linspace(0.0, scene.span_s, 200))
        thresholds = np.sort(rng.uniform(values.min() - 0.5, values.max() + 0.5, 14))
        links = links_of(legs, scene.walk, 1.5, scene.losses, scene.noise_dbm, span)
        count_, looked = sinr_changes(links, thresholds, TOLERANCE_DB, span, -1, out)
        rows = rows_of(out, count_)
        wrong, unclear = hold_classes(scene.ratio_db, thresholds, rows, span, TOLERANCE_DB)
        seen.add(rows[1:], wrong, unclear, (number, scene))
        seen.looked += looked
        seen.most = max(seen.most, looked)
    return seen


def check(seen):
    assert seen.wrong == []
    assert seen.rows > 3 * seen.legs and seen.unclear <= 0.02 * seen.rows
    assert seen.looked < 300 * (seen.legs + seen.rows)


def test_a_sampler_sees_the_same():
    check(survey(100, 1))


@pytest.mark.thorough
def test_a_sampler_sees_the_same_on_two_thousand_legs():
    check(survey(2000, 2))


def look(legs, losses, noise_dbm, thresholds, walk, span_s, held=-1, tolerance_db=TOLERANCE_DB):
    """The rows of a user on the ground, in seconds, and how often the search looked."""
    span = (START_US, START_US + round(span_s * 1e6))
    out = np.zeros((50, 2), np.int64)
    links = links_of(legs, walk, 0.0, losses, noise_dbm, span)
    count, looked = sinr_changes(links, np.array(thresholds, float), tolerance_db, span, held, out)
    return [((t - START_US) * 1e-6, state) for t, state in rows_of(out, count)], looked


def along(speed, y=0.0):
    return Walk(np.zeros(1), np.array([(0.0, y)]), np.array([(speed, 0.0)]))


PLAIN = Loss(0.0, 0.0, 2.0, 0.0, 1.0, 1.0)


def steep(exponent, power=0.0):
    return Loss(power, 0.0, exponent, 0.0, 1.0, 1.0)


class TestByHand:
    def test_a_level_is_the_ratio_to_noise_of_0_dbm(self):
        # -20 log10(d) = -60 dB at 1000 m: a user who walks off from below 600 m, after 800 m.
        rows, _ = look([hovering((0, 0, 600))], [PLAIN], 0.0, [-60.0], along(10.0), 100.0)
        assert rows == [(0.0, 1), (80.0, 0)]

    @pytest.mark.parametrize(("exponent", "metres"), [(3.76, 272.9002), (2.0, 292.7493)])
    def test_one_level_exceeds_another_by_three_decibels(self, exponent, metres):
        drones = [hovering((500, 0, 0)), hovering((0, 0, 0))]
        losses = [steep(exponent)] * 2
        walk = Walk(np.zeros(1), np.array([(100.0, 0.0)]), np.array([(1.0, 0.0)]))
        rows, _ = look(drones, losses, -np.inf, [3.0], walk, 300.0)
        assert [state for _, state in rows] == [0, 1]
        assert rows[1][0] == pytest.approx(metres - 100.0, abs=5e-5)

    def test_equal_levels_are_no_change(self):
        drones = [hovering((500, 0, 100)), hovering((-500, 0, 100))]
        walk = Walk(np.zeros(1), np.zeros((1, 2)), np.array([(0.0, 2.0)]))
        rows, _ = look(drones, [PLAIN] * 2, -np.inf, [0.0], walk, 0.01)
        assert rows == [(0.0, 1)]

    def test_two_equal_interferers_are_three_decibels_more_than_one(self):
        # (d2/d1)^2 = 2 where the user is as far from both others: 10 log10 2 = 3.0103 dB.
        drones = [hovering((0, 0, 100)), hovering((1000, 0, 100)), hovering((1000, 0, 100))]
        gain = 10 * np.log10((950.0**2 + 100**2) / (50.0**2 + 100**2) / 2)
        rows, _ = look(drones, [PLAIN] * 3, -np.inf, [gain], along(1.0), 100.0)
        assert [state for _, state in rows] == [1, 0]
        assert rows[1][0] == pytest.approx(50.0, abs=2e-6)

    def test_a_class_held_before_is_no_row(self):
        legs, walk = [hovering((0, 0, 600))], along(10.0)
        assert look(legs, [PLAIN], 0.0, [-60.0], walk, 50.0, held=1)[0] == []
        assert look(legs, [PLAIN], 0.0, [-60.0], walk, 50.0, held=0)[0] == [(0.0, 1)]

    def test_a_user_below_a_drone_that_lands_on_it_is_found(self):
        # The level has no bound there: the search goes on in steps of 0.1 us.
        legs = [hovering((20.0, 0.0, 0.0))]
        rows, looked = look(legs, [PLAIN], 0.0, [-6.0, 0.0, 6.0], along(10.0), 4.0)
        assert [state for _, state in rows] == [0, 1, 2, 3, 2, 1, 0]
        near = [2 - 10 ** (level / -20) / 10 for level in (-6, 0, 6)]
        assert [t for t, _ in rows[1:4]] == pytest.approx(near, abs=1e-6)
        assert looked < 3000

    def test_a_graze_ends(self):
        # The level turns within the tolerance of a threshold.
        walk = Walk(np.zeros(1), np.array([(-100.0, 0.0)]), np.array([(10.0, 0.0)]))
        for beyond in (-1e-6, 0.0, 1e-6):
            rows, looked = look([hovering((0, 0, 100))], [PLAIN], 0.0, [-40.0 + beyond], walk, 20.0)
            assert [state for _, state in rows] in ([0], [0, 1, 0])
            assert looked < 4000
        rows, _ = look([hovering((0, 0, 100))], [PLAIN], 0.0, [-40.0 - 2e-4], walk, 20.0)
        half = 100.0 * np.sqrt(10**2e-5 - 1.0) / 10.0
        assert [t for t, _ in rows] == pytest.approx([0.0, 10.0 - half, 10.0 + half], abs=2e-6)

    def test_room_that_is_too_short_is_said(self):
        span = (START_US, START_US + 100_000_000)
        links = links_of([hovering((0, 0, 600))], along(10.0), 0.0, [PLAIN], 0.0, span)
        out = np.full((2, 2), -7, np.int64)
        assert sinr_changes(links, np.array([-60.0]), 1e-4, span, -1, out[:1])[0] > 1
        assert out.tolist() == [[START_US, 1], [-7, -7]]


class TestTheBound:
    def test_no_level_changes_faster_between_any_two_of_a_million_places(self):
        rng, count = np.random.default_rng(3), 200_000
        for loss in [steep(3.76), *(Loss(0.0, 0.0, 2.0, *town) for town in TOWNS[1:])]:
            centre = rng.normal(size=(count, 3)) * 10 ** rng.uniform(0.0, 3.5, (count, 1))
            far = np.linalg.norm(centre, axis=1)
            within = far * 10 ** rng.uniform(-4.0, 0.0, count) * 0.999
            places = []
            for _ in range(2):
                off = rng.normal(size=(count, 3))
                off /= np.linalg.norm(off, axis=1)[:, None]
                places.append(centre + off * (within * rng.random(count) ** 0.2)[:, None])
            ground = [np.hypot(one[:, 0], one[:, 1]) for one in places]
            own = np.array([(0.0, 0.0, loss.exponent, loss.fall_db, loss.a, loss.b)])
            bounds = np.empty((count, 2))
            slopes(own, np.hypot(centre[:, 0], centre[:, 1]), centre[:, 2], within, bounds)
            moved = np.column_stack([ground[0] - ground[1], places[0][:, 2] - places[1][:, 2]])
            change = np.abs(loss.level(places[0]) - loss.level(places[1]))
            share = change / (np.abs(moved) * bounds).sum(axis=1)
            assert share.max() <= 1.0 + 1e-9
            assert share.max() > 0.9

    def test_no_ratio_changes_faster_between_any_two_of_a_million_times(self):
        rng, largest = np.random.default_rng(4), 0.0
        for number in range(200):
            scene, legs = random_scene(rng, 1 + number % 5, rng.random() < 0.7)
            span = (START_US, START_US + round(scene.span_s * 1e6))
            links = links_of(legs, scene.walk, 1.5, scene.losses, scene.noise_dbm, span)
            for window in 10.0 ** rng.uniform(-2.0, 1.5, 5):
                since = rng.uniform(0.0, scene.span_s)
                until = min(since + window, scene.span_s)
                bound = most(links, since, until)
                t = rng.uniform(since, until, (2, 1000))
                values = scene.ratio_db(t.ravel()).reshape(2, 1000)
                change = np.abs(values[0] - values[1])
                assert (change <= bound * np.abs(t[0] - t[1]) + 1e-11).all()
                if 0.0 < bound < np.inf:
                    largest = max(largest, (change / (bound * np.abs(t[0] - t[1]))).max())
        assert largest > 0.5

    def test_where_there_is_none_it_says_so(self):
        assert log_distance_slope(2.0, 30.0, 40.0, 50.0) == (np.inf, np.inf)
        assert logistic_slope(2.0, 19.0, 9.61, 0.16, 30.0, 40.0, 50.0) == (np.inf, np.inf)

    def test_at_a_place_it_is_the_slope(self):
        # 20 / ln 10 dB a relative change of the distance of 50 m, of which 3/5 are horizontal.
        per_m = 20.0 / np.log(10.0) / 50.0
        found = log_distance_slope(2.0, 30.0, 40.0, 0.0)
        assert found == pytest.approx((0.6 * per_m, 0.8 * per_m), rel=1e-14)
        town, step = Loss(0.0, 0.0, 2.0, *TOWNS[2]), 1e-4
        near = town.level(np.array([(30.0 - step, 0.0, 40.0), (30.0 + step, 0.0, 40.0)]))
        found = logistic_slope(2.0, *TOWNS[2], 30.0, 40.0, 0.0)
        assert found[0] == pytest.approx((near[0] - near[1]) / (2.0 * step), rel=1e-6)
