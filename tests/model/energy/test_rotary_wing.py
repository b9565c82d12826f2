"""The battery of a rotary wing: what legs take, to the microjoule, and when it is empty."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from desim_uav.errors import ScenarioError
from desim_uav.model.energy.fixed_wing import FixedWing
from desim_uav.model.energy.propulsion.rotary_wing import (
    ROTORS,
    derived,
    powers_of,
    rotor_of,
    whole,
)
from desim_uav.model.energy.rotary_wing import RotaryWing
from desim_uav.model.motion.motion import REST, BangCoastBang, Transit
from desim_uav.scenario.doubts import doubts
from desim_uav.scenario.load import dump, loads, to_plain
from tests.model.energy.test_propulsion import integrated, power_w

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
            for start in flight.rows["start_s"]:
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
        "mass_kg": None,
        "hover_w": None,
        "hover_min": None,
        "return_below": 0.2,
        "on_crash": "respawn",
        "respawn_after_min": 10.0,
    }
    rotor = ROTORS["zeng2018"]._asdict()
    own = loads(f"drones: {{battery: {{kind: rotary_wing, parameters: {rotor}}}}}")
    assert own.drones.battery.rest_w == RotaryWing(parameters="zeng2018").rest_w
    assert to_plain(own)["drones"]["battery"]["parameters"] == rotor


NOT_GIVEN = {"disc_area_m2": None, "tip_speed_mps": None, "induced_speed_mps": None}


def test_what_follows_from_other_parameters_is_derived():
    short = ROTORS["zeng2018"]._replace(**NOT_GIVEN)
    rotor = whole(short)
    assert rotor.disc_area_m2 == pytest.approx(math.pi * 0.25)
    assert rotor.tip_speed_mps == 200.0
    assert rotor.induced_speed_mps == pytest.approx(math.sqrt(100 / (2.45 * rotor.disc_area_m2)))
    assert powers_of(short) == powers_of(rotor)
    text = {key: value for key, value in short._asdict().items() if key not in NOT_GIVEN}
    own = loads(f"drones: {{battery: {{kind: rotary_wing, parameters: {text}}}}}").drones.battery
    assert own.powers == powers_of(short)
    assert loads(dump(loads(f"drones: {{battery: {{kind: rotary_wing, parameters: {text}}}}}")))
    for named in ROTORS.values():
        assert whole(named) == named
        assert derived(named) == pytest.approx(named[-3:], rel=0.01)


def test_a_rotor_from_a_datasheet():
    """Its hover takes the power that was given; that of Table I comes out of its own numbers."""
    like = whole(ROTORS["zeng2019"]._replace(**NOT_GIVEN))
    assert rotor_of(20.0 / 9.81, sum(powers_of(like)[:2])) == pytest.approx(like, rel=1e-12)
    for mass_kg, hover_w in ((0.249, 40.0), (0.895, 115.5), (6.3, 700.0)):
        rotor = rotor_of(mass_kg, hover_w)
        assert sum(powers_of(rotor)[:2]) == pytest.approx(hover_w, rel=1e-12)
        assert rotor[-3:] == pytest.approx(derived(rotor), rel=1e-12)
        battery = RotaryWing(
            capacity_wh=77.0, mass_kg=mass_kg, hover_w=hover_w + 5, electronics_w=5
        )
        assert battery.rest_w == pytest.approx(hover_w + 5, rel=1e-12)
        assert battery.lifts_n == pytest.approx(9.81 * mass_kg)
        assert list(battery.doubts(0.0)) == []
    battery = RotaryWing(capacity_wh=77.0, mass_kg=0.895, hover_min=40.0)
    assert battery.autonomy_min == pytest.approx(40.0, rel=1e-12)
    assert battery.lasts(REST, battery.capacity_uj) == pytest.approx(2.4e9, abs=2)


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ("mass_kg: 1", "mass_kg needs either hover_w or hover_min"),
        ("hover_w: 100", "hover_w needs mass_kg"),
        ("hover_min: 30", "hover_min needs mass_kg"),
        ("mass_kg: 1, hover_w: 100, hover_min: 30", "mass_kg needs either hover_w or hover_min"),
        ("mass_kg: 1, hover_w: 100, parameters: zeng2018", "give parameters, or mass_kg"),
        ("mass_kg: 1, hover_w: 100, electronics_w: 100", "must be more than electronics_w, 100"),
        ("mass_kg: 0, hover_w: 100", "mass_kg: 0: must be at least 0.001"),
        ("mass_kg: 1, hover_w: -5", "hover_w: -5: must be at least 0.001"),
        ("mass_kg: 1, hover_min: long", 'hover_min: "long": must be a number'),
    ],
)
def test_datasheets_that_are_refused(given, words):
    with pytest.raises(ScenarioError, match=r"^mine:1:") as refused:
        loads(f"drones: {{battery: {{kind: rotary_wing, {given}}}}}", source="mine")
    assert words in str(refused.value)


def test_parameters_that_contradict_each_other_are_told_with_both_numbers():
    """A tip speed of 500 m/s with a rotor that gives 84 m/s was taken without a word."""
    rotor = whole(ROTORS["zeng2019"]._replace(**NOT_GIVEN, rotor_radius_m=0.28))
    wrong = rotor._replace(tip_speed_mps=500.0, induced_speed_mps=4.03)
    tip, flow = RotaryWing(parameters=wrong).doubts(0.0)
    assert tip.startswith("parameters.tip_speed_mps: 500: Ω R = 84 by the other parameters")
    assert flow.startswith("parameters.induced_speed_mps: 4.03: sqrt(W / 2 ρ A) = 5.757")
    scenario = loads(f"drones: {{battery: {{kind: rotary_wing, parameters: {wrong._asdict()}}}}}")
    assert [doubt.split(": ")[0] for doubt in doubts(scenario)] == [
        "drones.battery",
        "drones.battery",
    ]


def test_a_hover_in_wind_is_told_if_it_lasts_much_longer():
    (doubt,) = ZENG.doubts(12.0)
    assert "in the wind of 12 m/s a hover takes 127.8 W instead of 168.5 W" in doubt
    assert "32 % longer" in doubt
    assert list(ZENG.doubts(6.0)) == []
    (doubt,) = ZENG.doubts(25.0)
    assert "less long" in doubt
