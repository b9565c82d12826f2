"""Flight between cells in constant wind: by hand, and both engines against each other."""

from __future__ import annotations

import math
from itertools import pairwise
from typing import Any

import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from scipy.integrate import quad

from desim_uav.engine.base import RunSettings
from desim_uav.engine.des import Simulation
from desim_uav.errors import ScenarioError
from desim_uav.model.energy.propulsion.rotary_wing import ROTORS, powers_of
from desim_uav.model.motion.motion import REST, Transit
from desim_uav.model.rules import Action
from desim_uav.report.figures.energy import legs_j
from desim_uav.sample_path import draw
from desim_uav.scenario.load import from_mapping, loads, scenario_hash
from desim_uav.world import World, build_world
from tests.audit.invariants import audit
from tests.engine.helpers import US, Flight, events, fly, in_3d, path_of, scenarios, seen, strip
from tests.model.energy.test_propulsion import power_w
from tests.verification.engines import differences, engines

POWERS = powers_of(ROTORS["zeng2019"])
MOTION = {"kind": "bang_coast_bang", "max_speed_mps": 10, "max_acceleration_mps2": 4}
QUICK = {"motion": {**MOTION, "timing": "minimum_time"}}

every_engine = pytest.mark.usefixtures("every_engine")


def windy(wind: Any = (5, 0), battery: Any = None, timing: str = "minimum_time", **changes: Any):
    """A row of cells in a wind of 5 m/s to the east, with drones of 10 m/s and 4 m/s²."""
    motion = {"motion": {**MOTION, "timing": timing}}
    return strip(**{"wind_mps": wind, "battery": battery, "drones": motion, **changes})


def rotary(capacity_wh: float, **changes: Any) -> dict[str, Any]:
    return {"kind": "rotary_wing", "capacity_wh": capacity_wh, "return_below": 1.0, **changes}


def air_j(flight: Transit, wind: tuple[float, float], way: tuple[int, int, int], seconds: float):
    """The energy of a flight by quadrature of the power at its velocity less that of the wind."""
    rows = flight.profile.tolist()
    ends = [*(row[0] for row in rows[1:]), math.inf]
    total = 0.0
    for (start, _, speed, acceleration), end in zip(rows, ends, strict=True):
        if seconds <= start:
            break

        def power(t: float, speed: float = speed, acceleration: float = acceleration) -> float:
            v = speed + acceleration * t
            air = math.hypot(v * way[0] - wind[0], v * way[1] - wind[1])
            return float(power_w(air, *POWERS)) + 20.0 * max(0.0, way[2] * v)

        lasts = min(end, seconds) - start
        tail = wind[0] * way[0] + wind[1] * way[1]
        slowest = [(tail - speed) / acceleration] if acceleration else []
        inner = [t for t in slowest if 0.0 < t < lasts]
        total += quad(power, 0.0, lasts, points=inner or None, epsabs=0, epsrel=1e-11, limit=200)[0]
    return total


@every_engine
def test_there_and_back_along_the_wind():
    # Over the ground at 10 + 5 m/s: 240 / 15 + 15 / 4 = 19.75 s; back at 10 - 5: 48 + 1.25 s.
    world = windy([5, 0])
    log = fly(world, path_of(world), "right left")
    assert seen(log, "depart", "arrive") == events("""
                0  10  depart  0
         19750000   3  arrive  0
         60000000  10  depart  0
        109250000   3  arrive  0
    """)


@every_engine
def test_there_and_back_across_the_wind():
    # sqrt(10² - 6²) = 8 m/s over the ground both ways: 240 / 8 + 8 / 4 = 32 s.
    world = windy([0, -6])
    log = fly(world, path_of(world), "right left")
    assert [event[0] for event in seen(log, "arrive")] == [32 * US, 92 * US]


@every_engine
def test_the_ground_speed_that_is_left_at_an_angle():
    # 4 m/s along and 6 m/s across: 8 + 4 = 12 m/s there, 8 - 4 = 4 m/s back over the ground.
    world = windy([4, 6], steps=4, episode={"steps": 2, "step_s": 90})
    log = fly(world, path_of(world), "right left")
    assert [event[0] for event in seen(log, "arrive")] == [23 * US, 90 * US + 61 * US]


@every_engine
def test_climbs_keep_their_speed():
    calm = in_3d([[0, 1, 25.0]], [(0, 0)], drones=QUICK)
    blown = in_3d([[0, 1, 25.0]], [(0, 0)], drones=QUICK, wind_mps=[3, 4])
    found = [
        [event[0] for event in seen(fly(w, path_of(w), "up down", ceiling=False), "arrive")]
        for w in (calm, blown)
    ]
    assert found[0] == found[1] != []


@every_engine
def test_moves_that_fill_a_step_are_the_same_over_the_ground():
    world = windy([4, 0], timing="fill_epoch", users=[(200, 120)])
    calm = windy([0, 0], timing="fill_epoch", users=[(200, 120)])
    logs = [fly(w, path_of(w), "right left hover") for w in (world, calm)]
    assert logs[0].events == logs[1].events
    assert [(s.x_m, s.y_m) for s in logs[0].steps] == [(s.x_m, s.y_m) for s in logs[1].steps]


@every_engine
def test_an_autonomy_in_time_knows_of_durations_only():
    world = windy([5, 0], {"autonomy_min": 10, "return_below": 1.0}, starts=[(5, 0)])
    flight = Flight(world)
    log = flight.episode(path_of(world), "left goto")
    assert next(step.charge for step in log.steps) == 540 * US
    assert flight.shown[0].observations[0].return_s == 49.25
    assert flight.shown[1].observations[0].return_s == 0.0


@every_engine
@pytest.mark.parametrize("wind", [(5.0, 0.0), (-2.0, 4.5), (0.0, 3.0)])
def test_energy_of_moves_and_hovers(wind: tuple[float, float]):
    world = windy(wind, rotary(30.0), steps=4)
    log = fly(world, path_of(world), "hover right left hover")
    hover_w = float(power_w(math.hypot(*wind), *POWERS))
    right, left = (world.only_type.epoch_transits[a] for a in (Action.RIGHT, Action.LEFT))
    used_j = [
        60 * hover_w,
        air_j(right, wind, (1, 0, 0), 60.0),
        air_j(left, wind, (-1, 0, 0), 60.0),
        60 * hover_w,
    ]
    charges = [30 * 3_600_000_000, *(step.charge for step in log.steps)]
    found = [before - after for before, after in pairwise(charges)]
    assert found == pytest.approx([1e6 * joules for joules in used_j], abs=4)
    assert log.used == charges[0] - charges[-1]


@every_engine
def test_energy_of_a_climb():
    battery, wind = rotary(30.0), (3.0, 4.0)
    world = in_3d([[0, 1, 25.0]], [(0, 0)], battery=battery, wind_mps=wind, drones=QUICK)
    log = fly(world, path_of(world), "up down hover", ceiling=False)
    hover_j = 60 * float(power_w(5.0, *POWERS))
    charges = [30 * 3_600_000_000, *(step.charge for step in log.steps)]
    found = [before - after for before, after in pairwise(charges)]
    assert found == pytest.approx([1e6 * (hover_j + 20 * 20), 1e6 * hover_j, 1e6 * hover_j], abs=4)


@every_engine
@pytest.mark.parametrize("told", ["hover", "right", "left"])
@pytest.mark.parametrize("wind", [(5.0, 0.0), (-2.0, 4.5)])
def test_a_battery_ends_with_the_microsecond_of_its_last_joule(told: str, wind: Any):
    world = windy(wind, rotary(0.8, on_crash="remove"), starts=[(3, 0)], steps=1)
    (t_us,) = [event[0] for event in seen(fly(world, path_of(world), told), "crash")]
    way = {"hover": (0, 0, 0), "right": (1, 0, 0), "left": (-1, 0, 0)}[told]
    flight = world.only_type.epoch_transits.get(Action[told.upper()], REST)
    before, after = (air_j(flight, wind, way, t / 1e6) for t in (t_us - 1, t_us))
    assert 1e6 * before - 2 < 0.8 * 3.6e9 <= 1e6 * after + 2


@every_engine
def test_n_b_is_that_of_the_direction():
    # Two cells against the wind, which is 2 * 49.25 s; after two moves with it from the other side.
    world = windy([5, 0], rotary(30.0), starts=[(6, 0)])
    flight = Flight(world)
    log = flight.episode(path_of(world), "goto")
    assert [event[0] for event in seen(log, "land")] == [98_500_000]
    hop_j = air_j(world.only_type.return_transits[-1, 0, 0], (5.0, 0.0), (-1, 0, 0), 49.25)
    hover_w = float(power_w(5.0, *POWERS))
    assert flight.shown[0].observations[0].return_s == pytest.approx(2 * hop_j / hover_w, rel=1e-8)
    other = windy([-5, 0], rotary(30.0), starts=[(6, 0)])
    log = fly(other, path_of(other), "goto")
    assert [event[0] for event in seen(log, "land")] == [39_500_000]


def test_a_return_goes_where_the_wind_leads_it():
    # Stations two cells to the south and four to the north: 98.5 s against 79 s.
    def world(wind: Any) -> World:
        stations = {"count": 2, "radius_m": 720}
        return windy(wind, rotary(30.0), starts=[(0, 3)], stations=stations, cells=(1, 9))

    calm, blown = world([0, 0]), world([0, 5])
    assert calm.stations == ((0, 7), (0, 1))
    south, north = (each.only_type.planner.plan((0, 3, 0)) for each in (calm, blown))
    assert south is not None and north is not None
    assert south.hops == 2 * ((0, -1, 0),)
    assert (north.hops, north.duration_us) == (4 * ((0, 1, 0),), 79 * US)


def test_the_table_of_legs_has_both_directions():
    world = windy([5, 0], rotary(30.0))
    found = legs_j(world.type_of(0))
    assert found["right, 60 s"] != found["left, 60 s"]
    assert {"return along x, 19.8 s", "return along -x, 49.2 s"} <= set(found)


def test_a_scenario_without_wind_has_the_hash_that_it_had():
    assert scenario_hash(loads("wind_mps: [0, 0]")) == scenario_hash(loads("{}"))
    assert scenario_hash(loads("wind_mps: [0, 1]")) != scenario_hash(loads("{}"))


# ---- both engines


def play(scenario: dict[str, Any], wind: list[float], seed: int) -> None:
    with_kernels = {**scenario["drones"], "admission": {"kind": "first_come"}}
    try:
        world = build_world(
            from_mapping({**scenario, "drones": with_kernels, "wind_mps": wind}), seed
        )
    except ScenarioError:
        assume(False)
    one, other = engines(world, (True,) * world.scenario.drones.count)
    for episode in range(2):
        assert not differences(one, other, seed, episode)
    settings_ = RunSettings((True,) * world.scenario.drones.count, False, keep_events=True)
    audited = Simulation(world, settings_, audit=audit)
    shown = audited.reset(draw(world, seed, 0))
    while not (shown.terminated or shown.truncated):
        shown = audited.step([seed % len(world.actions)] * world.scenario.drones.count)


@pytest.mark.thorough
@settings(max_examples=10, deadline=None)
@given(scenarios(), st.sampled_from([[3.1, 0.0], [-1.5, 2.75], [0.0, -3.4]]), st.integers(0, 999))
def test_both_engines_are_equal(scenario: dict[str, Any], wind: list[float], seed: int):
    play(scenario, wind, seed)
