"""Transits: closed forms worked by hand, and what must hold for all of them."""

import math

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from desim_uav.model.motion.motion import (
    REST,
    BangCoastBang,
    TransitLeg,
    cruise_speed,
    travelled,
)
from tests.verification.figure import check
from tests.verification.transit import FAST, FILL, figures, flight_s, top_speed


def test_figures():
    check(figures())


class TestClosedForms:
    def test_a_cell_in_minimum_time(self):
        transit = FAST.fastest_transit(240.0)
        assert transit.duration_us == 30_990_663
        assert top_speed(transit) == 8.3
        assert transit.distance_m == 240.0
        # The ramps: v/a = 2.075 s and v²/2a = 8.61125 m each.
        assert transit.rows["start_s"] == pytest.approx([0, 2.075, 28.91566265, 30.99066265])
        assert transit.rows["from_m"] == pytest.approx([0, 8.61125, 231.38875, 240])
        assert transit.rows["acceleration_mps2"].tolist() == [4.0, 0.0, -4.0, 0.0]

    def test_a_short_hop_in_minimum_time_still_cruises(self):
        transit = FAST.fastest_transit(20.0)
        assert transit.duration_us == 4_484_639
        assert top_speed(transit) == 8.3

    def test_below_v_squared_over_a_the_profile_is_triangular(self):
        transit = FAST.fastest_transit(10.0)
        assert transit.profile[1, :3] == pytest.approx(transit.profile[2, :3])
        assert travelled(transit.rows, math.sqrt(2.5)) == pytest.approx(5.0, abs=1e-12)

    def test_both_forms_meet_at_v_squared_over_a(self):
        edge = 8.3**2 / 4.0
        for distance in (edge * (1 - 1e-12), edge, edge * (1 + 1e-12)):
            transit = FAST.fastest_transit(distance)
            assert flight_s(transit) == pytest.approx(2 * 8.3 / 4.0, rel=1e-9)
            assert top_speed(transit) == pytest.approx(8.3, rel=1e-9)

    def test_a_cell_that_fills_the_epoch(self):
        transit = FILL.epoch_transit(240.0, 60.0)
        assert flight_s(transit) == 60.0
        assert transit.duration_us == 60_000_000
        assert transit.rows["acceleration_mps2"].tolist() == [4.0, 0.0, -4.0, 0.0]

    def test_a_level_that_fills_the_epoch(self):
        assert FILL.epoch_transit(20.0, 60.0).duration_us == 60_000_000

    def test_the_cruise_speed_does_not_cancel(self):
        # (aT - sqrt(a²T² - 4ad)) / 2 loses all digits here; v = d / (T - v/a) does not.
        speed = cruise_speed(1e-9, 60.0, 4.0)
        assert speed == pytest.approx(1e-9 / 60.0, rel=1e-9)

    def test_minimum_time_in_an_epoch_leaves_the_rest_of_it(self):
        transit = FAST.epoch_transit(240.0, 60.0)
        assert transit.duration_us == 30_990_663
        assert travelled(transit.rows, 31.0) == 240.0
        assert travelled(transit.rows, 60.0) == 240.0

    def test_returns_are_flown_in_minimum_time_whatever_the_timing(self):
        assert FILL.fastest_transit(240.0).duration_us == 30_990_663

    def test_rest(self):
        assert REST.duration_us == 0
        assert travelled(REST.rows, 0.0) == 0.0
        assert travelled(REST.rows, 1e6) == 0.0


class TestErrors:
    def test_fill_epoch_above_the_speed_limit(self):
        with pytest.raises(ValueError, match=r"480 m in 60 s need a cruise speed of 8\.28"):
            BangCoastBang(8.0).epoch_transit(480.0, 60.0)
        assert top_speed(FILL.epoch_transit(480.0, 60.0)) < 8.3

    def test_fill_epoch_without_a_root(self):
        # Full throttle, then full brake: a T² / 4 = 100 m is the farthest in 10 s.
        quick = BangCoastBang(1000.0, 4.0)
        assert top_speed(quick.epoch_transit(100.0, 10.0)) == 20.0
        with pytest.raises(ValueError, match=r"100\.001 m cannot be flown in 10 s"):
            quick.epoch_transit(100.001, 10.0)

    def test_minimum_time_longer_than_the_step(self):
        with pytest.raises(ValueError, match=r"500 m take at least 62\.3\d* s"):
            FAST.epoch_transit(500.0, 60.0)
        with pytest.raises(ValueError, match="longer than the step of 30 s"):
            FAST.epoch_transit(240.0, 30.0)
        # To the microsecond: it takes 30.9906626506 s.
        assert FAST.epoch_transit(240.0, 30.990663).duration_us == 30_990_663
        with pytest.raises(ValueError, match="longer than the step"):
            FAST.epoch_transit(240.0, 30.990662)


distances = st.floats(0.01, 5000.0)
speeds = st.floats(0.1, 100.0)
accelerations = st.floats(0.05, 50.0)


@st.composite
def transits(draw):
    """(transit, highest speed, highest acceleration) of either kind."""
    distance, v, a = draw(distances), draw(speeds), draw(accelerations)
    if draw(st.booleans()):
        return BangCoastBang(v, a, "minimum_time").fastest_transit(distance), v, a
    least_s = 2.0 * math.sqrt(distance / a)
    step_s = least_s * draw(st.floats(1.0001, 50.0))
    assume(cruise_speed(distance, step_s, a) <= v)
    return BangCoastBang(v, a, "fill_epoch").epoch_transit(distance, step_s), v, a


@given(transits())
@settings(max_examples=150, deadline=None)
def test_the_limits_hold_and_the_flight_ends_exactly_at_its_distance(drawn):
    transit, v, a = drawn
    profile = transit.rows
    assert top_speed(transit) <= v * (1 + 1e-12)
    assert np.abs(profile["acceleration_mps2"]).max() <= a
    assert np.all(np.diff(profile["start_s"]) >= -1e-9 * flight_s(transit))
    assert travelled(profile, flight_s(transit)) == transit.distance_m
    assert travelled(profile, 2.0 * flight_s(transit)) == transit.distance_m
    assert transit.duration_us == round(flight_s(transit) * 1e6)
    # An engine's last look is at the rounded duration, half a microsecond away at most.
    late = travelled(profile, transit.duration_us * 1e-6)
    assert late == pytest.approx(transit.distance_m, abs=1e-6)


@given(transits())
@settings(max_examples=100, deadline=None)
def test_position_is_continuous_and_never_goes_back(drawn):
    transit, v, _ = drawn
    times = np.linspace(0.0, flight_s(transit), 2001)
    joints = transit.rows["start_s"]
    times = np.sort(np.concatenate([times, joints, np.nextafter(joints[1:], 0.0)]))
    flown = np.array([travelled(transit.rows, t) for t in times])
    steps = np.diff(flown)
    slack = 1e-9 * transit.distance_m
    assert flown[0] == 0.0
    assert steps.min() >= -slack
    assert np.all(steps <= v * np.diff(times) + slack)


@given(transits())
@settings(max_examples=60, deadline=None)
def test_position_is_the_acceleration_integrated_twice(drawn):
    transit, _, _ = drawn
    profile = transit.rows
    dt = flight_s(transit) / 20_000
    middles = (np.arange(20_000) + 0.5) * dt
    phase = np.searchsorted(profile["start_s"][:-1], middles, side="right") - 1
    speed = np.concatenate([[0.0], np.cumsum(profile["acceleration_mps2"][phase]) * dt])
    position = np.concatenate([[0.0], np.cumsum(0.5 * (speed[1:] + speed[:-1])) * dt])
    # A phase that ends within a cell of the integration costs at most a dt of speed, for all of T.
    error = 4.0 * np.abs(profile["acceleration_mps2"]).max() * dt * flight_s(transit)
    for k in range(0, 20_001, 1000):
        assert travelled(profile, k * dt) == pytest.approx(position[k], abs=error)
    assert speed[-1] == pytest.approx(0.0, abs=4.0 * profile["acceleration_mps2"][0] * dt)


@given(distances, speeds, accelerations, st.floats(0.0, 1.0))
@settings(max_examples=100, deadline=None)
def test_the_second_half_mirrors_the_first(distance, v, a, share):
    transit = BangCoastBang(v, a, "minimum_time").fastest_transit(distance)
    t = share * flight_s(transit)
    there = travelled(transit.rows, t)
    back = travelled(transit.rows, flight_s(transit) - t)
    assert there + back == pytest.approx(distance, rel=1e-9)


@given(distances, speeds, accelerations)
@settings(max_examples=200, deadline=None)
def test_minimum_time_formula(distance, v, a):
    transit = BangCoastBang(v, a).fastest_transit(distance)
    if distance >= v * v / a:
        assert flight_s(transit) == pytest.approx(distance / v + v / a, rel=1e-12)
    else:
        assert flight_s(transit) == pytest.approx(2.0 * math.sqrt(distance / a), rel=1e-12)
    # To fill that very time needs the same speed: the two timings are one family.
    slower = BangCoastBang(v, a, "fill_epoch")
    if top_speed(transit) < v:
        return
    filled = slower.epoch_transit(distance, flight_s(transit) * (1 + 1e-9))
    assert top_speed(filled) == pytest.approx(v, rel=1e-3)


def test_a_leg_that_leads_nowhere_is_where_it_begins():
    resting = TransitLeg(REST, (120.0, 360.0), (120.0, 360.0), 40.0, 40.0)
    assert resting.position_m(17.0) == (120.0, 360.0, 40.0)
