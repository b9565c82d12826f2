"""Classes with interference, on legs that climb, and pairs of levels, against a sampler."""

from dataclasses import dataclass, replace

import numpy as np
import pytest

from desim_uav.model.motion.motion import BangCoastBang
from desim_uav.model.radio.search import (
    TOLERANCE_DB,
)
from tests.model.radio.airs import (
    RADIOS,
    Radio,
    TwoSlopes,
    class_rows,
    pair_rows,
    plain,
    random_sky,
    sky_of,
    stroll,
)
from tests.model.radio.looking import Loss, Seen, hold_classes
from tests.model.radio.making import START_US, Leg, hovering
from tests.model.sampler import Flight


def climbing(start, stop):
    """A leg in minimum time at 4 m/s and 1 m/s²."""
    distance = float(np.linalg.norm(np.subtract(stop, start)))
    transit = BangCoastBang(4.0, 1.0, "minimum_time").fastest_transit(distance)
    return Leg(start, stop, transit, Flight.minimum_time(distance, 4.0, 1.0))


LOG = plain(2.0, 0.0)  # -20 log10(d)


class TestByHand:
    def test_a_drone_that_climbs_away(self):
        # 100 m above the user, it reaches 150 m after 8 m in 4 s and 42 m at 4 m/s.
        sky = sky_of(
            [climbing((0, 0, 101.5), (0, 0, 201.5))],
            [stroll(0, 0)],
            LOG,
            [-20 * np.log10(150.0)],
            noise_dbm=30.0,
        )
        assert class_rows(sky, 0) == [[(START_US, 1), (START_US + 14_500_000, 0)]]

    def test_two_equal_interferers_are_three_decibels_more_than_one(self):
        drones = [hovering((0, 0, 101.5)), hovering((1000, 0, 101.5)), hovering((1000, 0, 101.5))]
        gain = 10 * np.log10((950.0**2 + 100**2) / (50.0**2 + 100**2) / 2)
        sky = sky_of(drones, [stroll(0, 0, 1.0)], LOG, [gain], noise_dbm=-300.0, span_s=100.0)
        ((_, after),) = class_rows(sky, 0)
        assert after == (pytest.approx(START_US + 50_000_000, abs=2), 0)
        for change in ({"bands": [0, 1, 1]}, {"serves": [1, 0, 0]}):
            assert class_rows(replace(sky, **change), 0) == [[(START_US, 1)]]

    def test_a_fall_is_not_above_zero_and_a_rise_is(self):
        sky = sky_of([hovering((0, 0, 601.5))], [stroll(0, 0, 10.0)], LOG, [-60.0, -56.0], 30.0)
        sky = replace(sky, span_s=100.0)
        out = np.zeros((9, 3), np.int64)
        air = sky.air()
        assert air.classes(0, sky.span_us, 0, out) == 3
        assert out[0].tolist() == [START_US, 0, 2] and out[1, 2] == -1
        assert out[2].tolist() == [START_US + 80_000_000, 0, 0]
        assert air.classes(0, sky.span_us, 2, out) == 2
        assert air.classes(0, sky.span_us, 1, out) == 3

    def test_a_mark_changes_the_class_when_it_begins(self):
        town = RADIOS[1]
        sky = sky_of([hovering((0, 0, 101.5))], [stroll(300, 0)], town, noise_dbm=-90.0)
        states = ((0, 0.0), (1, 0.0), (2, 0.0), (1, 12.5))
        skies = [replace(sky, marks={(0, 0): [(0.0, *state)]}) for state in states]
        levels = [float(one.ratio_db(0, 0, [0.0])[0]) for one in skies]
        assert levels[1] - levels[2] == pytest.approx(19.0) and levels[1] > levels[0] > levels[2]
        assert levels[1] - levels[3] == pytest.approx(12.5)
        marks = [(0.0, 1, 0.0), (10.0, 2, 0.0), (20.0, 0, 0.0), (30.5, 1, 12.5)]
        sky = replace(
            sky, marks={(0, 0): marks}, thresholds=np.sort(levels) - 0.01, noise_dbm=-90.0
        )
        states = np.searchsorted(sky.thresholds, [levels[k] for k in (1, 2, 0, 3)])
        times = [START_US, START_US + 10_000_000, START_US + 20_000_000, START_US + 30_500_000]
        assert class_rows(sky, 0) == [list(zip(times, states.tolist(), strict=True))]

    def test_a_user_who_walks_into_a_drone_is_found(self):
        # The level has no bound there: the search goes on in steps of 0.1 us.
        sky = sky_of([hovering((20, 0, 1.5))], [stroll(0, 0, 10.0)], LOG, [-6.0, 0.0, 6.0], 30.0)
        (rows,) = class_rows(replace(sky, span_s=4.0), 0)
        assert [state for _, state in rows] == [0, 1, 2, 3, 2, 1, 0]
        near = [2 - 10 ** (level / -20) / 10 for level in (-6, 0, 6)]
        times = [(t_us - START_US) * 1e-6 for t_us, _ in rows[1:4]]
        assert times == pytest.approx(near, abs=1e-6)

    def test_a_graze_ends(self):
        # The level turns within the tolerance of a threshold, and then just beyond it.
        sky = sky_of([hovering((0, 0, 101.5))], [stroll(-100, 0, 10.0)], LOG, [0.0], 30.0)
        for beyond in (-1e-6, 0.0, 1e-6):
            found = class_rows(replace(sky, span_s=20.0, thresholds=np.array([beyond - 40.0])), 0)
            assert [state for _, state in found[0]] in ([0], [0, 1, 0])
        (rows,) = class_rows(replace(sky, span_s=20.0, thresholds=np.array([-40.0 - 2e-4])), 0)
        half = 100.0 * np.sqrt(10**2e-5 - 1.0) / 10.0
        times = [(t_us - START_US) * 1e-6 for t_us, _ in rows]
        assert times == pytest.approx([0.0, 10.0 - half, 10.0 + half], abs=2e-6)

    def test_a_climb_through_all_three_turns_of_the_high_rise(self):
        # At 100 m, the level falls, rises, falls and rises.
        transit = BangCoastBang().fastest_transit(600.0)
        leg = Leg((100, 0, 2.0), (100, 0, 602.0), transit, Flight.minimum_time(600.0, 8.3, 4.0))
        sky = replace(sky_of([leg], [stroll(0, 0)], RADIOS[3], noise_dbm=30.0), span_s=75.0)
        turns = 100.0 * np.tan(np.radians([6.669199, 23.731943, 75.518762]))
        at = np.interp(turns + 1.5, leg.trip.at(t := np.linspace(0, 75, 100_000))[:, 2], t)
        levels = sky.ratio_db(0, 0, at)
        assert levels[1] < levels[0] < levels[2]
        # Just below the first turn, between both, just above the second one.
        between = np.sort([levels[0] - 1e-4, (levels[0] + levels[1]) / 2, levels[1] + 1e-4])
        (rows,) = class_rows(replace(sky, thresholds=between), 0)
        assert [state for _, state in rows[:8]] == [2, 3, 2, 1, 0, 1, 2, 3]

    def test_memory_that_is_too_short_is_said(self):
        sky = sky_of([hovering((0, 0, 601.5))] * 2, [stroll(0, 0, 10.0)], LOG, [-99.0, -9.0])
        sky = replace(sky, bands=[0, 1], noise_dbm=30.0)
        assert sky.air().classes(0, sky.span_us, 0, np.zeros((0, 3), np.int64)) == 1


class TestPairs:
    PAIR = (hovering((500, 0, 101.5)), hovering((-500, 0, 101.5)))

    def rows(self, walk, legs=PAIR, one=0, other=1, threshold_db=0.0, **options):
        sky = sky_of(list(legs), [walk], **options)
        rows = pair_rows(sky, 0, one, other, threshold_db)
        return [((t_us - START_US) * 1e-6, state) for t_us, state in rows]

    def test_the_bisector(self):
        assert self.rows(stroll(-50, 30, 2, 1)) == [(0.0, 0), (25.0, 1)]
        assert self.rows(stroll(50, 30, -2, 1)) == [(0.0, 1), (25.0, 0)]

    def test_the_first_is_as_strong_on_the_bisector(self):
        assert self.rows(stroll(0, 30, 0, 1)) == [(0.0, 1)]
        assert self.rows(stroll(0, 30, 0, 1), self.PAIR[::-1]) == [(0.0, 1)]

    def test_a_state_before_is_no_row(self):
        sky = sky_of(list(self.PAIR), [stroll(-50, 30, 2, 1)])
        assert pair_rows(sky, 0, 0, 1, 0.0, held=0) == [(START_US + 25_000_000, 1)]

    @pytest.mark.parametrize(("exponent", "metres"), [(3.76, 272.9002), (2.0, 292.7493)])
    def test_circles_of_apollonius(self, exponent, metres):
        legs = [hovering((500, 0, 1.5)), hovering((0, 0, 1.5))]
        radio = plain(exponent, 30.0)
        found = self.rows(stroll(100, 0, 1.0), legs, radio=radio, threshold_db=3.0, span_s=300.0)
        assert [state for _, state in found] == [0, 1]
        assert found[1][0] == pytest.approx(metres - 100.0, abs=5e-5)

    def test_an_advantage_in_power(self):
        # Twice the distance on the ground: |u - 500| = 2 |u + 500| at u = -500 / 3.
        legs = [hovering((500, 0, 1.5)), hovering((-500, 0, 1.5))]
        power = {"powers_dbm": [30.0 + 20 * np.log10(2.0), 30.0], "span_s": 100.0}
        found = self.rows(stroll(-200, 0, 1.0), legs, **power)
        assert [state for _, state in found] == [0, 1]
        assert found[1][0] == pytest.approx(200.0 - 500.0 / 3.0, abs=2e-6)
        less = self.rows(stroll(-200, 0, 1.0), legs, threshold_db=-20 * np.log10(2.0), span_s=100.0)
        assert np.array(less) == pytest.approx(np.array(found), abs=2e-6)

    def test_a_line_of_sight_that_ends(self):
        marks = {(0, 0): [(0.0, 1, 0.0), (20.0, 2, 0.0)], (1, 0): [(0.0, 1, 0.0)]}
        found = self.rows(stroll(10, 0), radio=RADIOS[1], marks=marks)
        assert found == [(0.0, 1), (20.0, 0)]


def test_spans_that_meet_agree():
    rng = np.random.default_rng(7)
    for number in range(30):
        sky = replace(random_sky(rng, 1 + number % 4, 1), marks={})
        values = sky.ratio_db(0, 0, np.linspace(0.0, sky.span_s, 200))
        sky = replace(sky, thresholds=np.sort(rng.uniform(values.min(), values.max(), 8)))
        whole = class_rows(sky, 0)[0]
        start_us, end_us = sky.span_us
        middle_us = int(rng.integers(start_us + 1, end_us))
        air, out, found, state = sky.air(), np.zeros((99, 3), np.int64), [], 0
        for span in ((start_us, middle_us), (middle_us, end_us)):
            count = air.classes(0, span, state, out)
            found += [(t_us, abs(change)) for t_us, _, change in out[:count].tolist()]
            state = found[-1][1] if found else 0
        if found[:1] != whole[:1]:
            found.insert(0, (START_US, 0))
        assert [state for _, state in found] == [state for _, state in whole]
        assert [t for t, _ in found] == pytest.approx([t for t, _ in whole], abs=1)


@dataclass(frozen=True)
class Kinked(Loss):
    """The same for the sampler."""

    def level(self, apart):
        slant = np.linalg.norm(apart, axis=-1)
        return -40.0 - 20.0 * np.log10(slant) - 15.0 * np.log10(np.maximum(slant / 250.0, 1.0))


def test_a_path_loss_of_ones_own():
    rng, seen = np.random.default_rng(9), Seen()
    own = Radio(TwoSlopes(250.0), Kinked(0.0, 0.0, 2.0, 0.0, 1.0, 1.0))
    for number in range(4):
        sky = random_sky(rng, 1 + number % 3, 1)
        sky = replace(sky, radios=[own] * len(sky.legs), marks={})
        values = sky.ratio_db(0, 0, np.linspace(0.0, sky.span_s, 200))
        thresholds = np.sort(rng.uniform(values.min() - 0.5, values.max() + 0.5, 10))
        sky = replace(sky, thresholds=thresholds)
        (rows,) = class_rows(sky, 0)

        def value(t, sky=sky):
            return sky.ratio_db(0, 0, t)

        wrong, unclear = hold_classes(value, thresholds, rows, sky.span_us, TOLERANCE_DB)
        seen.add(rows[1:], wrong, unclear, number)
    check(seen, 2)


def survey_classes(count, seed, oblique=False):
    """Random drones and users, held against the sampler."""
    rng, seen = np.random.default_rng(seed), Seen()
    for number in range(count):
        sky = random_sky(rng, 1 + number % 4, 2, oblique)
        times = np.linspace(0.0, sky.span_s, 200)
        values = np.concatenate([sky.ratio_db(0, user, times) for user in range(2)])
        low, high = values.min() - 0.5, values.max() + 0.5
        if number % 5 == 0:
            low = high - 1.5  # most users are in no class
        sky = replace(sky, thresholds=np.sort(rng.uniform(low, high, 14)))
        for user, rows in enumerate(class_rows(sky, 0)):

            def value(t, sky=sky, user=user):
                return sky.ratio_db(0, user, t)

            wrong, unclear = hold_classes(value, sky.thresholds, rows, sky.span_us, TOLERANCE_DB)
            seen.add(rows[1:], wrong, unclear, (number, user))
    return seen


def survey_pairs(count, seed, oblique=False):
    rng, seen = np.random.default_rng(seed), Seen()
    for number in range(count):
        sky = random_sky(rng, 2, 1, oblique)
        at = rng.uniform(0.0, sky.span_s - 0.1)
        passes, soon = sky.gain_db(0, 1, 0, [at, at + 0.1])
        threshold = float(passes) + (abs(soon - passes) < 1e-6)  # then hardly anything moves
        rows = pair_rows(sky, 0, 0, 1, threshold)

        def value(t, sky=sky):
            return sky.gain_db(0, 1, 0, t)

        wrong, unclear = hold_classes(value, np.array([threshold]), rows, sky.span_us, TOLERANCE_DB)
        seen.add(rows[1:], wrong, unclear, number)
    return seen


def check(seen, most_rows):
    assert seen.wrong == []
    assert seen.rows > most_rows * seen.legs and seen.unclear <= 0.02 * seen.rows


def test_classes_are_those_of_a_sampler():
    check(survey_classes(15, 1), 3)


@pytest.mark.slow
def test_classes_are_those_of_a_sampler_on_two_thousand_legs():
    check(survey_classes(2000, 2), 3)


def test_pairs_are_those_of_a_sampler():
    check(survey_pairs(20, 1), 0.5)


@pytest.mark.slow
def test_pairs_are_those_of_a_sampler_on_two_thousand_legs():
    check(survey_pairs(2000, 2), 0.5)
