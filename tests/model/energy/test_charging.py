"""Charging in closed form: against the formulas of its model, and inverted to the microsecond."""

import math

import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from desim_uav.errors import ScenarioError
from desim_uav.model.energy.battery import charge_after, time_to_full_us
from desim_uav.model.energy.charging import MOST_US, Constant, Swap, Tapered, until_tapered
from desim_uav.scenario.load import loads, scenario_hash, to_plain
from desim_uav.world import build_world

CAPACITY = 303_271_200_000
"""The µJ of 84.242 Wh."""

BEFORE = "35c38c2992e718a12c613913a3b763288c29d9b25df534a58a0c1b82bc8c8053"
"""The hash of a scenario with a seed of 3 in the version before there was `stations.charging`."""


def share_by_steps(share, minutes, power_w, taper_from):
    """The share of CAPACITY after some minutes, by the differential equation in small steps."""
    steps = 200_000
    dt_s = minutes * 60 / steps
    joules = CAPACITY / 1e6
    for _ in range(steps):
        slowed = min(1.0, (1 - share) / (1 - taper_from))
        middle = share + 0.5 * dt_s * power_w * slowed / joules
        share += dt_s * power_w * min(1.0, (1 - middle) / (1 - taper_from)) / joules
    return share


class TestTapered:
    @pytest.mark.parametrize("minutes", [1.0, 7.0, 9.0, 20.0])
    @pytest.mark.parametrize("begins", [0.0, 0.3, 0.85])
    def test_against_the_differential_equation(self, minutes, begins):
        own = Tapered(power_w=500.0, full_at=0.9999)
        found = own.charged(round(begins * CAPACITY), round(minutes * 6e7), CAPACITY) / CAPACITY
        assert found == pytest.approx(
            min(0.9999, share_by_steps(begins, minutes, 500.0, 0.8)), abs=1e-6
        )

    def test_the_closed_form(self):
        own = Tapered(power_w=500.0)
        rate = 500.0 / (CAPACITY / 1e6)
        expected_s = 0.8 / rate + 0.2 / rate * math.log(0.2 / 0.01)
        assert own.until_full_us(0, CAPACITY) == pytest.approx(expected_s * 1e6, abs=2)
        assert own.until_full_us(round(0.9 * CAPACITY), CAPACITY) == pytest.approx(
            0.2 / rate * math.log(0.1 / 0.01) * 1e6, abs=2
        )

    def test_by_the_time_of_a_full_charge(self):
        for taper_from, full_at in ((0.8, 0.99), (0.0, 0.5), (0.9, 0.6), (0.5, 0.5)):
            own = Tapered(full_charge_min=12.0, taper_from=taper_from, full_at=full_at)
            assert own.until_full_us(0, CAPACITY) == pytest.approx(720e6, abs=2)
            assert own.until_full_us(0, 1_800_000_000) == pytest.approx(720e6, abs=20)

    @settings(deadline=None, max_examples=300)
    @given(
        st.integers(0, CAPACITY),
        st.floats(1.0, 5000.0),
        st.sampled_from((0.0, 0.5, 0.8, 0.95)),
        st.sampled_from((0.5, 0.9, 0.99, 0.9999)),
    )
    def test_full_at_just_that_time(self, battery, power_w, taper_from, full_at):
        own = Tapered(power_w=power_w, taper_from=taper_from, full_at=full_at)
        full = own.full(CAPACITY)
        assume(battery < full)
        takes_us = own.until_full_us(battery, CAPACITY)
        assert own.charged(battery, takes_us, CAPACITY) == full
        assert own.charged(battery, takes_us - 1, CAPACITY) < full
        assert own.charged(battery, 0, CAPACITY) == battery

    @pytest.mark.parametrize("power", [1e-9, 1e-12, 6e-20, 1e-300])
    def test_a_charge_without_end_is_found_at_once(self, power):
        """It was counted microsecond by microsecond, for ever."""
        assert until_tapered(0, CAPACITY, power, 0.8, round(0.9999 * CAPACITY)) == MOST_US

    @settings(deadline=None, max_examples=200)
    @given(st.integers(0, CAPACITY), st.integers(0, 2 * 10**9), st.integers(0, 10**6))
    def test_it_never_falls(self, battery, elapsed_us, more_us):
        own = Tapered(power_w=400.0)
        before = own.charged(battery, elapsed_us, CAPACITY)
        assert before <= own.charged(battery, elapsed_us + more_us, CAPACITY)

    def test_more_than_full_stays(self):
        own = Tapered(power_w=400.0)
        assert own.charged(CAPACITY, 10**9, CAPACITY) == CAPACITY
        assert own.until_full_us(CAPACITY, CAPACITY) == 0

    @pytest.mark.parametrize("given_both", [{}, {"power_w": 10.0, "full_charge_min": 3.0}])
    def test_either_a_power_or_a_time(self, given_both):
        with pytest.raises(ValueError, match="give either power_w or full_charge_min"):
            Tapered(**given_both)


class TestConstant:
    @settings(deadline=None)
    @given(st.integers(0, CAPACITY), st.integers(0, 10**9))
    def test_it_is_the_linear_charge(self, battery, elapsed_us):
        own = Constant(full_charge_min=5.0)
        assert own.charged(battery, elapsed_us, CAPACITY) == charge_after(
            battery, elapsed_us, CAPACITY, 300_000_000
        )
        assert own.until_full_us(battery, CAPACITY) == time_to_full_us(
            battery, CAPACITY, 300_000_000
        )
        assert own.full(CAPACITY) == CAPACITY


class TestSwap:
    def test_full_after_the_minutes(self):
        own = Swap(minutes=2.0)
        for battery in (0, 17, CAPACITY - 1):
            assert own.until_full_us(battery, CAPACITY) == 120_000_000
            assert own.charged(battery, 119_999_999, CAPACITY) == battery
            assert own.charged(battery, 120_000_000, CAPACITY) == CAPACITY
        assert own.until_full_us(CAPACITY, CAPACITY) == 0


class TestInAScenario:
    def test_the_key_of_today_means_a_constant_rate(self):
        plain, named = (
            loads("stations: {full_charge_min: 7}"),
            loads("stations: {charging: {kind: constant, full_charge_min: 7}}"),
        )
        worlds = [build_world(scenario, 0) for scenario in (plain, named)]
        assert worlds[0].charging == worlds[1].charging == Constant(7.0)
        assert worlds[0].only_type.full_charge_us == 420_000_000
        assert "charging" not in to_plain(plain)["stations"]
        assert "full_charge_min" not in to_plain(named)["stations"]

    def test_what_is_written_reads_the_same(self):
        scenario = loads("stations: {charging: {kind: swap, minutes: 2}}")
        assert to_plain(scenario)["stations"]["charging"] == {"kind": "swap", "minutes": 2.0}
        assert scenario_hash(scenario) != scenario_hash(loads("seed: 0"))

    def test_a_scenario_without_the_key_has_the_hash_of_before(self):
        assert scenario_hash(loads("{seed: 3, reward: {kind: multi_service}}")) == BEFORE

    def test_a_power_needs_a_battery_in_watt_hours(self):
        with pytest.raises(ScenarioError, match="measured in Wh, which 'endurance' is not"):
            loads("stations: {charging: {kind: cc_cv, power_w: 100}}")
