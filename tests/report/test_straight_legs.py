"""The legs of free flight whose energy is drawn, against runs of the same legs."""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import numpy as np
import pytest

from desim_uav.report.straight_legs import FreeLegs, Way
from desim_uav.world import World
from tests.engine.helpers import Flight, in_3d, path_of, strip

MOTION = {"space": "free", "max_speed_mps": 12, "max_acceleration_mps2": 4}
CHOICE = {**MOTION, "cruise": [6, 10]}
BATTERY = {"kind": "rotary_wing", "capacity_wh": 30.0, "return_below": 1.0}
STARTS = [(4, 4)]

in_every_engine = pytest.mark.parametrize(
    "engine", ["des", pytest.param("batch", marks=pytest.mark.thorough)]
)


def flat(motion: Any = MOTION, **changes: Any) -> World:
    return strip(STARTS, cells=(9, 9), battery=BATTERY, drones={"motion": motion}, **changes)


def hills(motion: Any = MOTION, **changes: Any) -> World:
    """Levels at 20, 40 and 60 m."""
    drones = {"motion": motion}
    return in_3d([[8, 8, 50]], STARTS, (9, 9), battery=BATTERY, drones=drones, **changes)


def used_j(world: World, commands: Any) -> list[float]:
    """What each step of a run with these commands takes from the battery."""
    flight = Flight(world, ceiling=False)
    shown = flight.engine.reset(path_of(world))
    for command in commands:
        shown = flight.engine.step([[*command, -1.0]])
    assert shown.truncated
    charges = [world.types[0].capacity, *(step.charge for step in flight.engine.log.steps)]
    return [(before - after) / 1e6 for before, after in pairwise(charges)]


def way_of(legs: FreeLegs, name: str) -> Way:
    return next(way for way in (*legs.ways, *legs.vertical_ways) if way.name.startswith(name))


@in_every_engine
@pytest.mark.parametrize(
    ("wind", "commands"),
    [
        ((0.0, 0.0), {"level": [1.0, 0.0]}),
        ((5.0, 0.0), {"tailwind": [1.0, 0.0], "headwind": [-1.0, 0.0], "crosswind": [0.0, 1.0]}),
    ],
)
def test_a_leg_takes_what_a_run_of_it_takes(monkeypatch, engine, wind, commands):
    monkeypatch.setattr(Flight, "flown_by", engine)
    world = flat(wind_mps=wind, steps=2 * len(commands))
    legs = FreeLegs(world.types[0])
    told = [0.5 * share * np.array(each) for each in commands.values() for share in (1.0, 0.5)]
    found = used_j(world, [each.tolist() for each in told])
    for k, name in enumerate(commands):
        way = way_of(legs, name)
        for n, share in enumerate((0.5, 0.25)):
            drawn = legs.step_j(way, share * way.longest_m)
            assert found[2 * k + n] == pytest.approx(drawn, abs=4e-6)


@in_every_engine
def test_climbs_and_descents_take_what_a_run_of_them_takes(monkeypatch, engine):
    # [s, 0, s] climbs s * 5 * (60 - 2.5) m, so 0.1 leads 28.75 m up.
    monkeypatch.setattr(Flight, "flown_by", engine)
    world = hills(wind_mps=(0.0, 5.0), steps=4)
    legs = FreeLegs(world.types[0])
    rises_m, falls_m = 0.1 * 5 * (60 - 2.5), 0.05 * 3 * (60 - 1.5)
    commands = [[0.1, 0, 0.1], [0.05, 0, -0.05], [0, 0, 0.01], [0, 0, -0.01]]
    found = used_j(world, commands)
    for joules, name, height_m in (
        (found[0], "climb", rises_m),
        (found[1], "descent", falls_m),
        (found[2], "up", 0.1 * rises_m),
        (found[3], "down", 0.2 * falls_m),
    ):
        way = way_of(legs, name)
        metres = height_m / abs(way.ahead[2])
        if name in ("climb", "descent"):  # the wind makes another speed the longest flight's
            metres = _reach(legs, way, 0.1 if name == "climb" else 0.05)
        assert joules == pytest.approx(legs.step_j(way, metres), abs=4e-6)


def _reach(legs: FreeLegs, way: Way, share: float) -> float:
    """The length of a leg that is a share of the longest one, if the map had no altitudes."""
    leg = legs.leg(way, 1e4)
    step_s = legs.own.scenario.episode.step_s
    return share * leg.speed_mps * (step_s - leg.speed_mps / leg.acceleration_mps2)


@in_every_engine
def test_the_lowest_speed_is_that_of_a_run(monkeypatch, engine):
    # 6 m/s reach 6 * (60 - 1.5) = 351 m in a step; commands reach 10 * (60 - 2.5) = 575 m.
    monkeypatch.setattr(Flight, "flown_by", engine)
    world = flat(CHOICE, steps=3)
    legs = FreeLegs(world.types[0])
    found = used_j(world, [[0.2, 0.0, -1.0], [0.9, 0.0, -1.0], [-0.9, 0.0, 1.0]])
    level, slow = legs.shown
    for joules, shown, share in zip(found, (slow, slow, level), (0.2, 0.9, 0.9), strict=True):
        leg = legs.leg(shown.way, share * 575.0, shown.cruise_mps)
        rest_us = 60_000_000 - leg.duration_us
        hover_j = legs.battery.drain_of(legs.own.rest, rest_us) / 1e6
        assert joules == pytest.approx(legs.energy_j(shown.way, leg) + hover_j, abs=4e-6)
    assert legs.leg(level.way, 0.9 * 575.0).duration_us < 55_000_000


def test_the_longest_legs():
    # 12 m/s for 60 s without half of each ramp of 3 s, or 40 m of altitude.
    calm = {way.name: way for way in FreeLegs(hills().types[0]).ways}
    assert [*calm] == ["level", "climb at 23°", "descent at 14°"]
    assert calm["level"].longest_m == pytest.approx(12 * 57)
    climb = np.hypot(12 * 57, 5 * 57.5)
    assert calm["climb at 23°"].longest_m == pytest.approx(40 * climb / (5 * 57.5))
    windy = FreeLegs(flat(wind_mps=(0.0, -5.0)).types[0])
    assert [round(way.longest_m, 6) for way in windy.ways[:2]] == [17 * 55.75, 7 * 58.25]
    assert windy.typical_m == 200.0  # half of 407.75 m, to two digits
    assert windy.vertical_ways == ()


def test_the_speeds_at_which_long_legs_cruise():
    assert FreeLegs(flat(CHOICE).types[0]).cruises_mps == [6.0, 10.0, 12.0]
    # Between two corners of a map of 2160 m by 2160 m, 0.01 m/s² lead to no more than this.
    slow = FreeLegs(flat({**CHOICE, "max_acceleration_mps2": 0.01}).types[0]).cruises_mps
    assert slow == pytest.approx([np.sqrt(0.01 * 2160 * np.sqrt(2))])
