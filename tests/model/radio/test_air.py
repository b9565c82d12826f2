"""Classes with interference, on legs that climb, and pairs of levels, against a sampler."""

from dataclasses import dataclass, replace

import numpy as np
import pytest

from desim_uav.errors import ScenarioError
from desim_uav.model.compiled_rows import call
from desim_uav.model.kernels import kernel
from desim_uav.model.motion import BangCoastBang
from desim_uav.model.radio.air import class_changes_in_air, pair_changes
from desim_uav.model.radio.functions import log10, slant_range_m
from desim_uav.model.radio.levels import RATES, compiled_loss
from desim_uav.model.radio.path_loss import AlHourani, FreeSpace, RowPathLoss
from desim_uav.model.radio.sinr import TOLERANCE_DB
from tests.model.radio.airs import (
    FREE,
    RADIOS,
    Radio,
    Sky,
    class_rows,
    kept_loss,
    pair_rows,
    plain,
    random_sky,
)
from tests.model.radio.looking import Loss, Seen, hold_classes
from tests.model.radio.making import START_US, Leg, hovering
from tests.model.sampler import Flight, Walk


def survey_classes(count, seed):
    """Random drones and users, held against the sampler."""
    rng, seen = np.random.default_rng(seed), Seen()
    for number in range(count):
        sky = random_sky(rng, 1 + number % 4, 2)
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


def survey_pairs(count, seed):
    rng, seen = np.random.default_rng(seed), Seen()
    for number in range(count):
        sky = random_sky(rng, 2, 1)
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


@pytest.mark.thorough
def test_classes_are_those_of_a_sampler_on_two_thousand_legs():
    check(survey_classes(2000, 2), 3)


def test_pairs_are_those_of_a_sampler():
    check(survey_pairs(20, 1), 0.5)


@pytest.mark.thorough
def test_pairs_are_those_of_a_sampler_on_two_thousand_legs():
    check(survey_pairs(2000, 2), 0.5)


@kernel
def write_rates(at, values, branch, distances_m, heights_m, withins_m, rates):
    for k in range(len(rates)):
        row = rates.ctypes.data + 8 * RATES * k
        call(at, (values, branch, distances_m[k], heights_m[k], withins_m[k], row))


def nearby(rng, centres, withins):
    """Random places, each at most so far away from a centre."""
    off = rng.normal(size=centres.shape)
    off /= np.linalg.norm(off, axis=1)[:, None]
    return centres + off * (withins * rng.random(len(withins)) ** 0.2)[:, None]


@pytest.mark.parametrize("radio", RADIOS)
def test_no_level_changes_faster_between_two_places(radio):
    rng, count, loss = np.random.default_rng(3), 20_000, kept_loss(radio.path_loss)
    centres = rng.normal(size=(count, 3)) * 10 ** rng.uniform(0.0, 3.5, (count, 1))
    withins = np.linalg.norm(centres, axis=1) * 10 ** rng.uniform(-4.0, 0.0, count) * 0.999
    one, other = nearby(rng, centres, withins), nearby(rng, centres, withins)
    away = np.hypot(*other.T[:2]) - np.hypot(*one.T[:2])
    moved = np.column_stack([away, other[:, 2] - one[:, 2]])
    for branch in range(3):
        rates = np.empty((count, RATES))
        distances, heights = np.hypot(*centres.T[:2]), centres[:, 2].copy()
        write_rates(loss.rates, loss.values, branch, distances, heights, withins, rates)
        products = np.stack([rates[:, 0::2] * moved, rates[:, 1::2] * moved])
        low, high = products.min(axis=0).sum(axis=1), products.max(axis=0).sum(axis=1)
        change = radio.level(other, np.full(count, branch))
        change -= radio.level(one, np.full(count, branch))
        assert (change >= low - 1e-9).all() and (change <= high + 1e-9).all()
        assert ((change - low) < 0.25 * (high - low)).any()
        write_rates(loss.rates, loss.values, branch, distances, heights, 0.0 * withins, rates)
        assert np.allclose(rates[:, 1::2], rates[:, 0::2], rtol=1e-12, atol=0.0)
        step = 1e-6 * np.linalg.norm(centres, axis=1)
        for column, along in enumerate(((1.0, 0.0, 0.0), (0.0, 0.0, 1.0))):
            places = np.column_stack([distances, np.zeros(count), heights])
            ends = [places + sign * step[:, None] * np.array(along) for sign in (-1.0, 1.0)]
            below, above = (radio.level(end, np.full(count, branch)) for end in ends)
            steepness = (above - below) / (2.0 * step)
            assert np.allclose(rates[:, 2 * column], steepness, rtol=1e-4, atol=1e-6)


def sky_of(legs, walks, radio=FREE, thresholds=(0.0,), noise_dbm=-90.0, span_s=60.0, **options):
    """A sky of drones that all serve in one band."""
    count = len(legs)
    same = {"powers_dbm": [30.0] * count, "bands": [0] * count, "serves": [1] * count, **options}
    return Sky(
        legs,
        [radio] * count,
        walks=walks,
        noise_dbm=noise_dbm,
        thresholds=np.array(thresholds, float),
        span_s=span_s,
        **same,
    )


def stroll(x, y, vx=0.0, vy=0.0):
    return Walk(np.zeros(1), np.array([(x, y)], float), np.array([(vx, vy)], float))


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
        arguments = (sky.air(), 0, sky.span_us)
        assert class_changes_in_air(*arguments, np.array([0]), True, out) == 3
        assert out[0].tolist() == [START_US, 0, 2] and out[1, 2] == -1
        assert out[2].tolist() == [START_US + 80_000_000, 0, 0]
        assert class_changes_in_air(*arguments, np.array([2]), False, out) == 2
        assert class_changes_in_air(*arguments, np.array([1]), False, out) == 3
        # What is held counts for nothing where a drone begins to serve.
        assert class_changes_in_air(*arguments, np.array([2]), True, out) == 3

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

    def test_memory_that_is_too_short_is_said(self):
        sky = sky_of([hovering((0, 0, 601.5))] * 2, [stroll(0, 0, 10.0)], LOG, [-99.0, -9.0])
        sky = replace(sky, bands=[0, 1], noise_dbm=30.0)
        air, held = sky.air(), np.zeros(1, np.int64)
        none = np.zeros((0, 3), np.int64)
        assert class_changes_in_air(air, 0, sky.span_us, held, True, none) == 1
        short = air._replace(tracks=air.tracks[:3])
        pair = np.zeros((5, 2), np.int64)
        assert class_changes_in_air(short, 0, sky.span_us, held, True, none) == 1
        assert pair_changes(short, 0, 0, 1, 0.0, sky.span_us, -1, pair) == -4
        short = short._replace(senders=air.senders * [1, 1, 1, 0, 1])
        assert class_changes_in_air(short, 0, sky.span_us, held, True, none) == -4


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
            count = class_changes_in_air(air, 0, span, np.array([state]), False, out)
            found += [(t_us, abs(change)) for t_us, _, change in out[:count].tolist()]
            state = found[-1][1] if found else 0
        if found[:1] != whole[:1]:
            found.insert(0, (START_US, 0))
        assert [state for _, state in found] == [state for _, state in whole]
        assert [t for t, _ in found] == pytest.approx([t for t, _ in whole], abs=1)


@kernel
def in_compiled_code(air, span_us, held, out, pairs):
    counts = 0
    for transmitter in range(2):
        counts = 100 * counts + class_changes_in_air(
            air, transmitter, span_us, held, True, out[transmitter]
        )
    return 100 * counts + pair_changes(air, 0, 0, 1, 0.0, span_us, -1, pairs)


def test_compiled_code_gets_the_same_rows_as_python():
    rng = np.random.default_rng(8)
    sky = replace(random_sky(rng, 3, 2), thresholds=np.arange(-10.0, 20.0), serves=[1] * 3)
    air, held, blank = sky.air(), np.zeros(2, np.int64), np.zeros((2, 99, 3), np.int64)
    one, other = (
        (blank.copy(), np.zeros((9, 2), np.int64)),
        (blank.copy(), np.zeros((9, 2), np.int64)),
    )
    counts = in_compiled_code(air, sky.span_us, held, *one)
    found = [class_changes_in_air(air, k, sky.span_us, held, True, other[0][k]) for k in range(2)]
    found.append(pair_changes(air, 0, 0, 1, 0.0, sky.span_us, -1, other[1]))
    assert counts == 10_000 * found[0] + 100 * found[1] + found[2] and min(found) > 0
    for mine, theirs in zip(one, other, strict=True):
        assert (mine == theirs).all()


@dataclass(frozen=True)
class TwoSlopes(RowPathLoss):
    """A loss that rises with the distance, and faster beyond a kink."""

    kink_m: float

    def los_db(self, distance_m, height_m, carrier_ghz):
        slant_m = slant_range_m(distance_m, height_m)
        return 40.0 + 20.0 * log10(slant_m) + max(15.0 * log10(slant_m / self.kink_m), 0.0)

    def slope(self, distance_m, height_m, within_m):
        nearest = slant_range_m(distance_m, height_m) - within_m
        return (15.3 / nearest, 15.3 / nearest) if nearest > 0.0 else (np.inf, np.inf)


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


class Steeper(AlHourani):
    """A loss whose bounds are not those of the class that it is derived from."""

    def nlos_db(self, distance_m, height_m, carrier_ghz):
        return 2.0 * super().nlos_db(distance_m, height_m, carrier_ghz)


def test_a_path_loss_without_bounds_is_refused():
    assert AlHourani.is_bounded() and TwoSlopes.is_bounded() and not Steeper.is_bounded()
    with pytest.raises(ScenarioError, match="test_air:Steeper' needs a method slope"):
        compiled_loss(Steeper("urban"))


@dataclass(frozen=True)
class NotCompiled(FreeSpace):
    """A loss that only Python can compute."""

    def los_db(self, distance_m, height_m, carrier_ghz):
        return {"m": 40.0 + 20.0 * log10(distance_m)}["m"].__float__()

    def slope(self, distance_m, height_m, within_m):
        return 1.0, 1.0


def test_a_path_loss_that_cannot_be_compiled_is_refused():
    with pytest.raises(ScenarioError, match="test_air:NotCompiled' must be compiled where"):
        compiled_loss(NotCompiled())


def test_python_has_the_same_bounds():
    own, place = np.empty((1, RATES)), (np.array([600.0]), np.array([100.0]), np.array([50.0]))
    for path_loss in (AlHourani("urban"), TwoSlopes(250.0)):
        loss = compiled_loss(path_loss)
        for branch in range(3):
            write_rates(loss.rates, loss.values, branch, *place, own)
            assert tuple(own[0]) == path_loss.rates(branch, 600.0, 100.0, 50.0)
