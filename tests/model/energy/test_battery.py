"""Draining and charging, to the microsecond."""

from fractions import Fraction

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from desim_uav.errors import ScenarioError
from desim_uav.model.energy.battery import (
    LONGEST_MIN,
    Endurance,
    PerAction,
    charge_after,
    time_to_full_us,
)
from desim_uav.model.motion.motion import REST, BangCoastBang
from desim_uav.scenario.load import loads

CAPACITY_US = 1_800_000_000
FULL_CHARGE_US = 300_000_000
MONTH_US = 30 * 24 * 3600 * 1_000_000

capacities = st.integers(1, 10**13)
charge_times = st.integers(1, 10**13)


@st.composite
def batteries(draw):
    """(charge, capacity, time of a full charge)."""
    capacity = draw(capacities)
    return draw(st.integers(0, capacity)), capacity, draw(charge_times)


class TestEndurance:
    FLIGHTS = (REST, BangCoastBang().epoch_transit(240.0, 60.0))

    def test_the_paper(self):
        battery = Endurance()
        assert battery.autonomy_min * 60 == 1800
        assert battery.return_below * 1800 == 360
        assert (battery.on_crash, battery.respawn_after_min) == ("respawn", 10.0)

    @settings(deadline=None)
    @given(st.integers(0, CAPACITY_US), st.sampled_from(FLIGHTS))
    def test_a_second_a_second_whatever_it_does(self, elapsed_us, flight):
        assert Endurance().drain_of(flight, elapsed_us) == elapsed_us

    @settings(deadline=None)
    @given(st.integers(1, CAPACITY_US), st.sampled_from(FLIGHTS))
    def test_it_lasts_until_just_when_all_is_drained(self, charge, flight):
        lasts_us = Endurance().lasts_us(flight, charge)
        assert Endurance().drain_of(flight, lasts_us) >= charge
        assert Endurance().drain_of(flight, lasts_us - 1) < charge


class TestPerAction:
    FLIGHTS = (
        BangCoastBang().epoch_transit(240.0, 60.0),
        BangCoastBang().fastest_transit(240.0),
        BangCoastBang().fastest_transit(20.0),
    )

    @pytest.mark.parametrize("flight", FLIGHTS)
    def test_a_flight_takes_a_minute_however_long_it_lasts(self, flight):
        assert PerAction().drain_of(flight, 0) == 0
        assert PerAction().drain_of(flight, flight.duration_us // 2) == pytest.approx(30e6, abs=7)
        assert PerAction().drain_of(flight, flight.duration_us) == 60_000_000

    @settings(deadline=None)
    @given(st.integers(1, CAPACITY_US), st.sampled_from((REST, *FLIGHTS)))
    def test_it_lasts_until_just_when_all_is_drained(self, charge, flight):
        lasts_us = PerAction().lasts_us(flight, charge)
        if flight is not REST and lasts_us > flight.duration_us:
            assert charge > 60_000_000, "a flight does not empty it"
            return
        assert PerAction().drain_of(flight, lasts_us) >= charge
        assert PerAction().drain_of(flight, lasts_us - 1) < charge

    @pytest.mark.parametrize(
        ("text", "message"),
        [
            ("drones: {motion: {timing: minimum_time}, battery: {kind: per_action}}", "two act"),
            ("{episode: {step_s: 45}, drones: {battery: {kind: per_action}}}", "takes 0.75"),
            ("drones: {battery: {kind: per_action, action_min: 2}}", "takes 2 min, but a step"),
        ],
    )
    def test_it_is_refused_where_actions_would_differ(self, text, message):
        with pytest.raises(ScenarioError, match=message):
            loads(text)

    def test_a_step_of_two_minutes_needs_actions_of_two(self):
        scenario = loads(
            "{episode: {step_s: 120}, drones: {battery: {kind: per_action, action_min: 2}}}"
        )
        assert scenario.drones.battery == PerAction(action_min=2.0)


class TestCharging:
    def test_the_paper_charges_six_seconds_a_second(self):
        assert time_to_full_us(0, CAPACITY_US, FULL_CHARGE_US) == FULL_CHARGE_US
        assert time_to_full_us(360_000_000, CAPACITY_US, FULL_CHARGE_US) == 240_000_000
        assert charge_after(360_000_000, 60_000_000, CAPACITY_US, FULL_CHARGE_US) == 720_000_000

    def test_a_full_battery_is_full(self):
        assert time_to_full_us(CAPACITY_US, CAPACITY_US, FULL_CHARGE_US) == 0
        assert charge_after(CAPACITY_US, 10**9, CAPACITY_US, FULL_CHARGE_US) == CAPACITY_US

    def test_the_end_of_charging_is_rounded_up_and_the_charge_down(self):
        # 1 us of battery is a sixth of a microsecond of charging.
        for missing, takes in [(1, 1), (5, 1), (6, 1), (7, 2), (12, 2), (13, 3)]:
            battery = CAPACITY_US - missing
            assert time_to_full_us(battery, CAPACITY_US, FULL_CHARGE_US) == takes
        assert charge_after(0, 1, 7, 2) == 3
        assert charge_after(0, 1, 2, 7) == 0

    @settings(max_examples=500, deadline=None)
    @given(st.data())
    def test_thirty_days_are_as_exact_as_pythons_integers(self, data):
        times = st.integers(1, MONTH_US) | st.integers(MONTH_US - 9, MONTH_US) | st.integers(1, 9)
        capacity, full_charge = data.draw(times), data.draw(times)
        charge = data.draw(st.integers(0, capacity))
        elapsed = data.draw(st.integers(0, full_charge))
        gained = elapsed * capacity // full_charge
        assert charge_after(charge, elapsed, capacity, full_charge) == min(
            capacity, charge + gained
        )
        needed = -((charge - capacity) * full_charge // capacity)
        assert time_to_full_us(charge, capacity, full_charge) == needed

    def test_the_longest_battery_and_charge(self):
        longest = LONGEST_MIN * 60_000_000
        assert time_to_full_us(1, longest, longest) == longest - 1
        assert time_to_full_us(0, longest, longest - 1) == longest - 1
        assert charge_after(0, longest - 1, longest, longest) == longest - 1
        assert charge_after(0, longest - 2, longest, longest - 1) == longest - 2

    @settings(deadline=None)
    @given(batteries())
    def test_the_time_to_full_is_the_least_that_fills(self, battery):
        charge, capacity, full_charge = battery
        needed = time_to_full_us(charge, capacity, full_charge)
        assert 0 <= needed - Fraction((capacity - charge) * full_charge, capacity) < 1
        assert charge_after(charge, needed, capacity, full_charge) == capacity
        if needed > 0:
            assert charge_after(charge, needed - 1, capacity, full_charge) < capacity

    @settings(deadline=None)
    @given(batteries(), st.integers(0, 10**13), st.integers(0, 10**13))
    def test_the_charge_grows_and_stays_within_the_capacity(self, battery, first, more):
        charge, capacity, full_charge = battery
        then = charge_after(charge, first, capacity, full_charge)
        later = charge_after(charge, first + more, capacity, full_charge)
        assert charge <= then <= later <= capacity
        exact = charge + Fraction(first * capacity, full_charge)
        assert then == capacity or 0 <= exact - then < 1
