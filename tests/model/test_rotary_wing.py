"""The battery of a rotary wing: what legs take, to the microjoule, and when it is empty."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from desim_uav.model.fixed_wing import FixedWing
from desim_uav.model.motion import REST, BangCoastBang, Transit
from desim_uav.model.propulsion.rotary_wing import ROTORS, powers_of
from desim_uav.model.rotary_wing import RotaryWing
from desim_uav.scenario.load import loads, to_plain
from tests.model.test_propulsion import integrated, power_w

ZENG = RotaryWing()
POWERS = powers_of(ROTORS["zeng2019"])
FAST = BangCoastBang().fastest_transit(240.0)
FILLING = BangCoastBang().epoch_transit(240.0, 60.0)
UP = BangCoastBang().fastest_transit(20.0)._replace(rises=1.0)
DOWN = UP._replace(rises=-1.0)
OBLIQUE = FAST._replace(rises=0.6)
FLIGHTS = (REST, FAST, FILLING, UP, DOWN, OBLIQUE)


def sampled_j(flight: Transit, elapsed_us: int, lifts_n: float = 20.0) -> float:
    """The energy of a flight from its speeds at many times; it has no formula of an integral."""
    total, elapsed_s = 0.0, elapsed_us / 1e6
    level = math.sqrt(1 - flight.rises**2)
    ends = [row[0] for row in flight.profile.tolist()] + [math.inf]
    for (start, _, speed, acceleration), end in zip(flight.profile.tolist(), ends[1:], strict=True):
        passed = min(end, elapsed_s) - start
        if passed > 0:

            def at(t, speed=speed, acceleration=acceleration):
                v = speed + acceleration * t
                return power_w(level * v, *POWERS) + lifts_n * max(0.0, flight.rises) * v

            total += integrated(at, 0.0, passed)
    return total


class TestTheFigures:
    def test_half_an_hour_of_hovering(self):
        assert ZENG.drains(REST, 1_800_000_000) / 3.6e9 == pytest.approx(84.242, abs=5e-4)
        assert ZENG.drains(REST, 1_800_000_000) / 1e6 == pytest.approx(303_272, abs=0.5)
        assert ZENG.autonomy_min == pytest.approx(30, abs=1e-4)

    def test_a_hop_of_240_m_in_a_step(self):
        rest = ZENG.drains(REST, 60_000_000 - FAST.duration_us)
        assert ZENG.drains(FAST, FAST.duration_us) / 1e6 == pytest.approx(4061.566, abs=5e-4)
        assert (ZENG.drains(FAST, FAST.duration_us) + rest) / 1e6 == pytest.approx(
            8949.182, abs=5e-4
        )
        assert ZENG.drains(FILLING, FILLING.duration_us) / 1e6 == pytest.approx(9031.517, abs=5e-4)

    @pytest.mark.parametrize(("speed", "joules"), [(6.0, 8874.89), (7.0, 8883.66)])
    def test_slower_cruises(self, speed, joules):
        hop = BangCoastBang(max_speed_mps=speed).fastest_transit(240.0)
        found = ZENG.drains(hop, hop.duration_us) + ZENG.drains(REST, 60_000_000 - hop.duration_us)
        assert found / 1e6 == pytest.approx(joules, abs=5e-3)

    @pytest.mark.parametrize(
        ("speed", "minutes"), [(8.3, 39.42), (10.21247, 40.11), (18.29513, 31.29)]
    )
    def test_how_long_the_battery_lasts_at_a_constant_speed(self, speed, minutes):
        cruise = Transit(np.array([(0.0, 0.0, speed, 0.0)]), 10**12, speed * 1e6)
        assert ZENG.lasts(cruise, 303_272_000_000) / 6e7 == pytest.approx(minutes, abs=5e-3)

    def test_the_first_parameters(self):
        first = RotaryWing(parameters="zeng2018")
        assert first.drains(REST, 1_000_000) == 1_371_321_522


class TestEnergy:
    @pytest.mark.parametrize("flight", FLIGHTS[1:])
    @pytest.mark.parametrize("share", [0.01, 0.05, 0.3, 0.7, 0.97, 1.0])
    def test_against_quadrature(self, flight, share):
        elapsed_us = round(share * flight.duration_us)
        expected = sampled_j(flight, elapsed_us)
        assert ZENG.drains(flight, elapsed_us) == pytest.approx(expected * 1e6, rel=1e-12, abs=1.0)

    def test_a_climb_lifts_the_weight(self):
        climb, descent = ZENG.drains(UP, UP.duration_us), ZENG.drains(DOWN, DOWN.duration_us)
        assert climb - descent == 20 * 20 * 10**6
        hover = ZENG.drains(REST, UP.duration_us)
        assert descent == hover
        flat = RotaryWing(climb=False)
        assert flat.drains(UP, UP.duration_us) == hover

    def test_electronics_take_power_all_the_time(self):
        heavy = RotaryWing(electronics_w=30.0)
        for flight in FLIGHTS:
            elapsed_us = flight.duration_us or 60_000_000
            more = heavy.drains(flight, elapsed_us) - ZENG.drains(flight, elapsed_us)
            assert more == pytest.approx(30 * elapsed_us, abs=2)
        assert heavy.autonomy_min < ZENG.autonomy_min

    @settings(deadline=None, max_examples=200)
    @given(st.sampled_from(FLIGHTS), st.integers(0, 60_000_000))
    def test_it_rises_with_every_microsecond(self, flight, at_us):
        at_us = min(at_us, flight.duration_us or at_us)
        assert ZENG.drains(flight, at_us) < ZENG.drains(flight, at_us + 1)

    def test_it_rises_across_the_borders_of_pieces(self):
        for flight in FLIGHTS[1:]:
            for start in flight.profile[:, 0]:
                around = range(max(0, round(start * 1e6) - 20), round(start * 1e6) + 20)
                used = [ZENG.drains(flight, us) for us in around]
                assert used == sorted(used)

    def test_it_is_never_more_than_whole_numbers_hold(self):
        rotor = ROTORS["zeng2019"]._replace(fuselage_drag=100.0, disc_area_m2=1e5)
        own = RotaryWing(parameters=rotor)
        fast = BangCoastBang(max_speed_mps=1000.0).fastest_transit(1e6)
        assert own.drains(fast, fast.duration_us) == 2**46
        lasts_us = own.lasts(fast, own.capacity_uj)
        assert own.drains(fast, lasts_us) >= own.capacity_uj > own.drains(fast, lasts_us - 1)


class TestDepletion:
    @settings(deadline=None, max_examples=300)
    @given(st.sampled_from(FLIGHTS), st.integers(1, 40_000_000_000), st.sampled_from((0.0, 55.5)))
    def test_it_lasts_until_just_when_all_is_drained(self, flight, battery, electronics_w):
        own = RotaryWing(electronics_w=electronics_w)
        lasts_us = own.lasts(flight, battery)
        assert own.drains(flight, lasts_us) >= battery > own.drains(flight, lasts_us - 1)

    def test_an_empty_battery_lasts_for_no_time(self):
        for flight in FLIGHTS:
            assert ZENG.lasts(flight, 0) <= 0

    def test_against_a_sampler_of_microseconds(self):
        begins_us = 7_456_000
        used = [ZENG.drains(FAST, us) for us in range(begins_us, begins_us + 1000)]
        for battery in (used[300], used[300] + 1, used[301] - 1):
            sampled = next(us for us, each in enumerate(used) if each >= battery)
            assert ZENG.lasts(FAST, battery) == begins_us + sampled


class TestFixedWingBattery:
    def test_loitering(self):
        wing = FixedWing(capacity_wh=50.0)
        assert wing.drains(REST, 3_600_000_000) / 3.6e9 == pytest.approx(100.002, abs=5e-4)
        assert wing.autonomy_min == pytest.approx(30, abs=1e-3)

    def test_a_flight_that_never_hovers(self):
        rows = [(0.0, 0.0, 20.0, 2.0), (5.0, 125.0, 30.0, 0.0), (15.0, 425.0, 30.0, -2.0)]
        flight = Transit(np.array([*rows, (20.0, 550.0, 0.0, 0.0)]), 20_000_000, 550.0)
        wing = FixedWing(electronics_w=5.0)
        ramp = integrated(lambda v: 9.26e-4 * v**3 + 2250.0 / v, 20.0, 30.0) / 2.0
        expected = 2 * ramp + 10 * (9.26e-4 * 30**3 + 75.0) + 20 * 5
        assert wing.drains(flight, 20_000_000) == pytest.approx(expected * 1e6, rel=1e-12, abs=1)
        for battery in (1, 10**6, 10**9, 10**10):
            lasts_us = wing.lasts(flight, battery)
            assert wing.drains(flight, lasts_us) >= battery > wing.drains(flight, lasts_us - 1)


def test_a_scenario_that_is_written_reads_the_same():
    scenario = loads("drones: {battery: {kind: rotary_wing, capacity_wh: 20, electronics_w: 3}}")
    plain = to_plain(scenario)["drones"]["battery"]
    assert plain == {
        "kind": "rotary_wing",
        "capacity_wh": 20.0,
        "parameters": "zeng2019",
        "climb": True,
        "electronics_w": 3.0,
        "return_below": 0.2,
        "on_crash": "respawn",
        "respawn_after_min": 10.0,
    }
    rotor = ROTORS["zeng2018"]._asdict()
    own = loads(f"drones: {{battery: {{kind: rotary_wing, parameters: {rotor}}}}}")
    assert own.drones.battery.hover_w == RotaryWing(parameters="zeng2018").hover_w
    assert to_plain(own)["drones"]["battery"]["parameters"] == rotor
