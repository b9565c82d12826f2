"""Free flight whose commands choose a cruise speed: worlds by hand, a sampler, and both engines."""

from __future__ import annotations

import math
from dataclasses import replace
from itertools import pairwise
from typing import Any

import numpy as np
import pytest

from desim_uav import load_policy
from desim_uav.engine.base import EpisodeLog, RunSettings
from desim_uav.engine.des import Simulation
from desim_uav.errors import ScenarioError
from desim_uav.experiment import tables
from desim_uav.experiment.run import play
from desim_uav.model.motion.limits import Limits
from desim_uav.model.rules import Mode
from desim_uav.report.tracks import Track
from desim_uav.sample_path import draw
from desim_uav.scenario.load import from_mapping, scenario_hash
from desim_uav.world import World
from tests.engine.helpers import (
    US,
    Flight,
    check_that_the_other_engine_goes_on,
    events,
    in_3d,
    path_of,
    seen,
    some_command,
    strip,
)
from tests.engine.random_free import choosing
from tests.engine.replay import check_log
from tests.model.energy.test_energy_of_legs import along, space_of
from tests.reference.energy import Rotor
from tests.reference.flight import filling
from tests.selection import by_default
from tests.verification.engines import differences, engines

MOTION = {
    "space": "free",
    "cruise": [4, 10],
    "max_speed_mps": 10,
    "max_acceleration_mps2": 5,
    "margin_m": 10,
}
"""In a step of 60 s, 10 * (60 - 2) = 580 m. At the speed v, d metres take d / v + v / 5 s."""

SLOW, MIDDLE, QUICK = -1.0, 0.0, 1.0

every_engine = pytest.mark.usefixtures("every_engine")


def freely(motion: dict[str, Any] | None = None, **changes: Any) -> World:
    """A row of nine cells of 240 m, over which drones choose from 4 to 10 m/s."""
    return strip(**{"steps": 1, **changes, "drones": {"motion": {**MOTION, **(motion or {})}}})


def fly(world: World, *told: Any) -> tuple[Flight, EpisodeLog]:
    """An episode of one drone, which hears these commands and then hovers."""
    flight = Flight(world)
    shown, heard = flight.engine.reset(path_of(world)), iter(told)
    while not (shown.terminated or shown.truncated):
        flight.shown.append(shown)
        now = next(heard, "hover")
        shown = flight.engine.step([flight.command(now) if isinstance(now, str) else now])
    check_log(world, flight.engine.log)
    return flight, flight.engine.log


def flown_s(log: EpisodeLog) -> list[float]:
    """The durations of the legs, in seconds."""
    return [leg.duration_us / US for leg in log.legs if leg.duration_us]


# ---- by hand


@every_engine
def test_a_leg_is_flown_at_the_speed_that_was_chosen():
    # 58 m at 4, 7 and 10 m/s: 58 / 4 + 4 / 5 s, 58 / 7 + 7 / 5 s, and 58 / 10 + 2 s. The user at
    # 240 m is 100 m away when the slow drone has flown 20 m: after 0.8 s for 1.6 m, and 4.6 s.
    world = freely(users=[(240, 120)], steps=3)
    _, log = fly(world, [0.1, 0.0, SLOW], [-0.1, 0.0, MIDDLE], [0.1, 0.0, QUICK])
    assert seen(log, "depart", "enter", "arrive")[:3] == events("""
               0  10  depart  0
         5400000   4  enter   0  0
        15300000   3  arrive  0
    """)
    assert flown_s(log) == [15.3, 9.685714, 7.8]
    assert [leg.to_m[0] for leg in log.legs[1:]] == pytest.approx([178, 120, 178])


@every_engine
def test_a_leg_that_would_not_end_in_the_step_is_flown_as_slowly_as_it_can_be():
    # 290 m take 73.3 s at 4 m/s. At (300 - sqrt(300² - 20 * 290)) / 2 m/s they take 60 s; that far,
    # the command of 580 m leads whatever its speed is.
    world = freely(steps=3)
    _, log = fly(world, [0.5, 0.0, SLOW], [1.0, 0.0, SLOW], [-0.5, 0.0, QUICK])
    assert flown_s(log) == [60.0, 60.0, 31.0]
    assert log.legs[2].to_m[0] == pytest.approx(120 + 290 + 580)


@every_engine
def test_commands_reach_as_far_as_the_highest_speed_and_returns_are_quicker():
    # At 8 of 10 m/s they reach 8 * (60 - 1.6) m. To the station, 492.8 m are flown at 10 m/s.
    world = freely({"cruise": [4, 8]}, battery={"autonomy_min": 10, "return_below": 1}, steps=3)
    _, log = fly(world, [1.0, 0.0, QUICK, -1.0], "goto")
    assert log.legs[1].to_m[0] == pytest.approx(120 + 467.2)
    assert flown_s(log)[:2] == [60.0, round(492.8 / 10 + 2, 6)]


@every_engine
def test_a_zone_before_the_end_leaves_time_for_a_slower_flight():
    # The zone ends the leg of 580 m after 270 m: 10 m/s take 29 s, and 4 m/s would take 68.3 s.
    zone = {"polygon_m": [[400, 0], [500, 0], [500, 240], [400, 240]]}
    legs = [fly(freely(map={"no_fly": [zone]}), [1.0, 0.0, v])[1].legs[1] for v in (SLOW, QUICK)]
    assert [leg.to_m[0] for leg in legs] == pytest.approx([390, 390])
    assert [leg.duration_us for leg in legs] == [60 * US, 29 * US]


@every_engine
def test_the_speed_is_one_through_the_air():
    # A wind of 3 m/s: 4 m/s through the air are 7 with it and 1 against it. With it 13 m/s reach
    # 13 * (60 - 2.6) = 746.2 m, against it 7 * (60 - 1.4) = 410.2 m.
    world = freely(wind_mps=[3, 0], steps=2)
    _, log = fly(world, [0.1, 0.0, SLOW], [-0.1, 0.0, SLOW])
    assert flown_s(log) == [round(74.62 / 7 + 7 / 5, 6), round(41.02 / 1 + 1 / 5, 6)]


@every_engine
def test_climbs_keep_their_own_speed():
    # 14.375 m up at 5 m/s and 2 m/s²: 14.375 / 5 + 5 / 2 s. At an angle, the slower one counts.
    world = in_3d([[2, 1, 50]], [(0, 0)], drones={"motion": MOTION}, steps=2)
    _, log = fly(world, [0.0, 0.0, 0.05, SLOW], [0.1, 0.0, -0.05, SLOW])
    up, down = (leg for leg in log.legs if leg.duration_us)
    assert up.duration_us == 5_375_000
    level_m, falls_m = down.to_m[0] - down.from_m[0], down.from_m[2] - down.to_m[2]
    length = math.hypot(level_m, falls_m)
    speed = min(4 * length / level_m, 3 * length / falls_m)
    pull = min(5 * length / level_m, 2 * length / falls_m)
    assert down.duration_us == pytest.approx((length / speed + speed / pull) * US, abs=1)


@every_engine
def test_numbers_beyond_the_ends_are_the_ends():
    world = freely(steps=2)
    _, log = fly(world, [0.1, 0.0, -7.0], [-0.1, 0.0, 1.5])
    assert flown_s(log) == [15.3, 7.8]


@every_engine
def test_a_drone_that_is_asked_by_event_is_asked_later_after_a_slow_leg():
    world = freely(decisions={"kind": "event", "patience_s": 10})
    flight, _ = fly(world, [0.1, 0.0, SLOW], [-0.1, 0.0, QUICK])
    assert [shown.t_us / US for shown in flight.shown][:3] == [0, 15.3, 25.3]


@every_engine
@pytest.mark.parametrize("wind", [(0.0, 0.0), (3.0, 1.5)])
def test_energy_of_the_speed_that_was_chosen(wind: tuple[float, float]):
    # The sampler flies at the limit that it is told: the highest speed is that of the command.
    battery = {"kind": "rotary_wing", "capacity_wh": 90.0, "return_below": 1.0}
    motion = {"max_acceleration_mps2": 4}
    world = freely(motion, cells=(9, 9), battery=battery, wind_mps=wind, steps=3)
    told = [([0.2, 0.1], 4.0), ([0.3, -0.1], 7.0), ([-0.2, 0.2], 10.0)]
    number = {4.0: SLOW, 7.0: MIDDLE, 10.0: QUICK}
    _, log = fly(world, *([*way, number[v], -1.0] for way, v in told))
    charges = [90 * 3_600_000_000, *(step.charge for step in log.steps)]
    used = [before - after for before, after in pairwise(charges)]
    legs = [leg for leg in log.legs if leg.duration_us]
    space = space_of(Limits(10.0, 4.0, 5.0, 3.0, 2.0), wind)
    expected = [
        1e6 * along(replace(space, level_mps=v), leg.from_m, leg.to_m, Rotor(), 60.0)
        for leg, (_, v) in zip(legs, told, strict=True)
    ]
    assert used == pytest.approx(expected, abs=4)


def test_energy_in_joules_of_a_leg_between_two_cells():
    # 240 m at 8.3 m/s take 30.990663 s, and with the hover after them 8,949.181 J in a step, as
    # docs/explanation/energy.md says.
    battery = {"kind": "rotary_wing", "capacity_wh": 90.0, "return_below": 1.0}
    motion = {"cruise": [4, 18], "max_speed_mps": 18, "max_acceleration_mps2": 4}
    world = freely(motion, battery=battery, steps=2)
    reach_m = 18 * (60 - 18 / 4)
    share = 240 / reach_m
    v = 2 * (8.3 - 4) / (18 - 4) - 1  # 8.3 m/s
    _, log = fly(world, [share, 0.0, v, -1.0])
    leg = log.legs[1]
    assert leg.duration_us == 30_990_663
    used = 90 * 3_600_000_000 - log.steps[0].charge
    assert used / 1e6 == pytest.approx(8949.181, abs=1e-3)


# ---- who chooses, and what is told


def test_the_number_of_the_speed_stands_before_the_wish_to_charge():
    world = freely(battery={"autonomy_min": 10, "return_below": 1.0}, steps=2)
    assert world.commands.names == ("aim_x", "aim_y", "aim_cruise", "aim_charge")
    assert freely().commands.names == ("aim_x", "aim_y", "aim_cruise")
    _, log = fly(world, [0.5, -0.25, 0.75, -1.0], [0.1, 0.2, 0.3, 1.0])
    first, second = log.steps
    assert (first.aim_x, first.aim_y, first.aim_z, first.aim_cruise) == (0.5, -0.25, 0.0, 0.75)
    assert second.action_taken.name == "GOTO_CHARGING_STATION"
    assert tables.steps_table([log], world)["aim_cruise"].tolist() == [0.75, 0.3]


def test_a_command_without_the_number_is_refused():
    flight = Flight(freely())
    flight.engine.reset(path_of(flight.world))
    with pytest.raises(ValueError, match="3 finite numbers"):
        flight.engine.step([[0.1, 0.0]])


@pytest.mark.parametrize("policy", ["baseline", "random", "hover"])
def test_policies_fly_with_it(policy: str):
    world = freely({"cruise": [4, 8]}, steps=4)
    ((log, _),) = play(world, load_policy(policy), policy, seed=0, keep_events=True)
    legs = [leg for leg in log.legs if leg.duration_us]
    assert bool(legs) == (policy != "hover")
    if policy == "baseline":  # a cell of 240 m, at the highest speed
        assert [leg.duration_us for leg in legs] == [round((240 / 8 + 8 / 5) * US)] * 4
    if policy == "random":
        assert len({step.aim_cruise for step in log.steps}) == 4


def test_tracks_follow_the_speed_that_was_chosen():
    world = freely(steps=3)
    _, log = fly(world, [0.1, 0.0, SLOW], [0.5, 0.0, SLOW], [-0.1, 0.0, QUICK])

    class Run:
        """A run that has only what a track reads."""

        scenario = world.scenario

    Run.world = world  # type: ignore[attr-defined]
    track = Track(tables.legs_table([log]), Run, 0)  # type: ignore[arg-type]
    assert track.position_m(10 * US)[0] == pytest.approx(120 + 1.6 + 9.2 * 4, abs=1e-5)
    hop = filling(290.0, 60.0, 5.0)
    assert track.position_m(80 * US)[0] == pytest.approx(178 + hop.flown_m(20.0), abs=1e-5)
    assert track.position_m(124 * US)[0] == pytest.approx(468 - 10 - 2 * 10, abs=1e-5)


def test_a_scenario_without_it_keeps_its_hash():
    plain = {"map": {"dimensions": 2}, "drones": {"motion": {"space": "free"}}}
    told = {"map": {"dimensions": 2}, "drones": {"motion": {"space": "free", "cruise": None}}}
    assert scenario_hash(from_mapping(plain)) == scenario_hash(from_mapping(told))


def test_types_may_have_bounds_of_their_own():
    types = [
        {"name": "slow", "motion": {"space": "free", "cruise": [2, 5]}},
        {"name": "quick", "motion": {"space": "free", "cruise": [4, 8]}},
    ]
    assert from_mapping({"map": {"dimensions": 2}, "drones": types}).free
    del types[0]["motion"]["cruise"]  # type: ignore[attr-defined]
    with pytest.raises(ScenarioError, match=r"drones\.1\.motion\.cruise.*same numbers"):
        from_mapping({"map": {"dimensions": 2}, "drones": types})


# ---- random scenarios


@pytest.mark.parametrize("seed", by_default(range(3), range(40)))
def test_no_leg_is_longer_than_a_step_or_slower_than_it_may_be(seed: int):
    world = choosing(seed)
    told = RunSettings((False,) * world.scenario.drone_count, False, keep_events=True)
    engine, rng = Simulation(world, told), np.random.default_rng(seed)
    shown, lasted, slower = engine.reset(draw(world, seed, 0)), 0, 0
    while not (shown.terminated or shown.truncated):
        shown = engine.step([some_command(world, mask, rng) for mask in shown.masks])
    check_log(world, engine.log)
    for leg in engine.log.legs:
        if leg.mode is not Mode.FLYING or not leg.duration_us:
            continue
        own = world.type_of(leg.drone).space
        lowest, highest = own.cruise_mps
        space = space_of(own.limits, world.scenario.wind_mps)
        ends = tuple(leg.from_m), tuple(leg.to_m)
        quick_us, slow_us = (
            round(replace(space, level_mps=v).leg(*ends).duration_s * US) for v in (highest, lowest)
        )
        assert quick_us - 1 <= leg.duration_us <= max(min(slow_us, world.step_us), quick_us) + 1
        again = own.leg(*ends, leg.duration_us)
        assert abs(again.duration_us - leg.duration_us) <= 1
        lasted += leg.duration_us == world.step_us
        slower += leg.duration_us > quick_us + 1
    assert slower


@pytest.mark.parametrize("seed", by_default([], range(40)))
def test_both_engines_are_equal(seed: int):
    world = choosing(seed)
    one, other = engines(world, (bool(seed % 2),) * world.scenario.drone_count)
    for episode in range(3):
        assert differences(one, other, seed, episode) == []


@pytest.mark.thorough
@pytest.mark.parametrize("name", ["des", "batch"])
@pytest.mark.parametrize("seed", range(3))
def test_saved_states_go_on_as_the_original(seed: int, name: str):
    check_that_the_other_engine_goes_on(choosing(seed), name, seed)
