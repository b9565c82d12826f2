"""Batteries in microjoules: what flights take, crashes, returns and charges, by hand."""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import pytest

from desim_uav.experiment import tables
from desim_uav.model.energy.charging import RowCharging
from desim_uav.model.motion.motion import REST, BangCoastBang
from desim_uav.model.rules import Action, Mode
from tests.audit.invariants import audit
from tests.engine.helpers import HOP_US, US, Flight, fly, in_3d, path_of, seen, strip
from tests.model.energy.test_rotary_wing import sampled_j

HOVER_W = 168.48421774108203
HOP = BangCoastBang().fastest_transit(240.0)
UP = BangCoastBang().fastest_transit(20.0)._replace(rises=1.0)
DOWN = UP._replace(rises=-1.0)
STEP_US = 60 * US

every_engine = pytest.mark.usefixtures("every_engine")


def rotary(capacity_wh: float, **changes: Any) -> dict[str, Any]:
    return {"kind": "rotary_wing", "capacity_wh": capacity_wh, "return_below": 1.0, **changes}


def uj(*legs: tuple[Any, int]) -> float:
    """The energy of some legs, by quadrature."""
    return 1e6 * sum(sampled_j(flight, elapsed_us) for flight, elapsed_us in legs)


HOP_UJ = uj((HOP, HOP_US))
STEP_UJ = HOP_UJ + uj((REST, STEP_US - HOP_US))
"""A move in minimum time, and the hover after it."""


@every_engine
def test_hovers_and_moves():
    world = strip(steps=4, battery=rotary(30.0))
    log = fly(world, path_of(world), "hover right left hover")
    full, hover = 30 * 3.6e9, uj((REST, STEP_US))
    left = [full - hover, full - hover - STEP_UJ]
    left += [left[-1] - STEP_UJ, left[-1] - STEP_UJ - hover]
    assert [step.charge for step in log.steps] == pytest.approx(left, abs=8)
    assert log.used == sum([round(full), -log.steps[-1].charge])
    assert log.gained == 0
    steps = tables.steps_table([log], world)
    assert steps["battery_wh"].tolist() == [step.charge / 3.6e9 for step in log.steps]
    used = [hover / 3.6e9, STEP_UJ / 3.6e9, STEP_UJ / 3.6e9, hover / 3.6e9]
    assert steps["energy_wh"].tolist() == pytest.approx(used, abs=1e-8)
    lasts_s = [charge / 1e6 / HOVER_W for charge in left]
    assert steps["battery_s"].tolist() == pytest.approx(lasts_s, rel=1e-8)


@every_engine
def test_a_climb_takes_more_than_a_descent():
    world = in_3d([[0, 1, 25.0]], [(0, 0)], steps=4, battery=rotary(30.0))
    log = fly(world, path_of(world), "up down hover down", ceiling=False)
    rest = uj((REST, STEP_US - UP.duration_us))
    used = [uj((UP, UP.duration_us)) + rest, uj((DOWN, DOWN.duration_us)) + rest]
    charges = [30 * 3_600_000_000, *(step.charge for step in log.steps)]
    found = [before - after for before, after in pairwise(charges)]
    assert found == pytest.approx([*used, uj((REST, STEP_US)), uj((REST, STEP_US))], abs=8)
    assert found[0] - found[1] == pytest.approx(20 * 20 * 1e6, abs=8)


@every_engine
def test_a_hover_ends_with_the_microsecond_of_the_last_joule():
    world = strip(steps=3, battery=rotary(4.0, on_crash="remove"))
    log = fly(world, path_of(world))
    empty_us = math.ceil(4 * 3.6e9 / HOVER_W)
    assert [event[0] for event in seen(log, "crash")] == [empty_us]
    assert log.used == 4 * 3_600_000_000
    assert [step.charge for step in log.steps][1:] == [0, 0]


@every_engine
@pytest.mark.parametrize("capacity_wh", [0.2, 0.35, 0.4, 1.1])
def test_a_crash_on_the_way_is_where_a_sampler_finds_it(capacity_wh: float):
    world = strip(steps=1, battery=rotary(capacity_wh, on_crash="remove"))
    (t_us,) = [event[0] for event in seen(fly(world, path_of(world), "right"), "crash")]
    assert t_us < HOP_US
    full = capacity_wh * 3.6e9
    assert uj((HOP, t_us)) >= full - 2 > uj((HOP, t_us - 1)) - 4
    steepest = 250 / 1e6
    assert uj((HOP, t_us)) - full < 1e6 * steepest


@every_engine
def test_n_b_and_the_return():
    world = strip([(2, 0)], steps=3, battery=rotary(30.0), timing="minimum_time")
    flight = Flight(world)
    log = flight.episode(path_of(world), "hover goto")
    assert [event[0] for event in seen(log, "land")] == [STEP_US + 2 * HOP_US]
    seconds = 2 * HOP_UJ / 1e6 / HOVER_W
    assert flight.shown[0].observations[0].return_s == pytest.approx(seconds, rel=1e-8)
    assert flight.shown[0].observations[0].capacity_s == pytest.approx(
        30 * 3600 / HOVER_W, rel=1e-8
    )
    assert log.steps[0].return_drain == pytest.approx(2 * HOP_UJ, abs=3)


@every_engine
def test_n_b_of_a_return_that_descends():
    world = in_3d([[0, 1, 25.0]], [(0, 0)], steps=3, battery=rotary(30.0))
    flight = Flight(world, ceiling=False)
    flight.episode(path_of(world), "up")
    station = world.stations[0]
    hops = abs(station[0]) + abs(station[1])
    back_j = hops * HOP_UJ / 1e6 + sampled_j(DOWN, DOWN.duration_us)
    found = flight.shown[1].observations[0].return_s
    assert found == pytest.approx(back_j / HOVER_W, rel=1e-8)


CHARGES = [
    ({"full_charge_min": 10}, lambda missing, full: 600e6 * missing / full),
    ({"charging": {"kind": "swap", "minutes": 1.5}}, lambda missing, full: 90e6),
    (
        {"charging": {"kind": "cc_cv", "power_w": 150.0}},
        lambda missing, full: (
            (missing - 0.2 * full) / 150 + 0.2 * full / 150 * math.log(0.2 / 0.01)
        ),
    ),
]
"""Charging at stations, and how many microseconds it takes to replace so many µJ."""


@every_engine
@pytest.mark.parametrize(("stations", "takes_us"), CHARGES)
def test_charging(stations: Any, takes_us: Any):
    world = strip([(4, 0)], steps=10, battery=rotary(10.0), stations=stations)
    flight = Flight(world)
    log = flight.episode(path_of(world), "hover hover charge")
    used = uj((REST, 2 * STEP_US))
    (charged_us,) = [event[0] for event in seen(log, "charged")]
    full = 10 * 3.6e9
    assert charged_us - 2 * STEP_US == pytest.approx(takes_us(used, full), abs=3)
    at = next(step for step in log.steps if step.mode is Mode.CHARGED)
    share = 0.99 if "charging" in stations and stations["charging"]["kind"] == "cc_cv" else 1.0
    assert at.charge == share * full
    assert log.gained == pytest.approx(share * full - full + used, abs=3)
    number = world.actions.index(Action.CHARGE)
    assert not flight.shown[at.step + 1].masks[0][number], "what is full is not charged"


@every_engine
def test_energy_is_counted_across_episodes_and_replacements():
    world = strip(
        [(4, 0)],
        steps=5,
        battery=rotary(5.0, respawn_after_min=0.0),
        stations={"full_charge_min": 2},
        episode={"carry_over": True},
    )
    flight, full = Flight(world, carry_over=True), 5 * 3_600_000_000
    path = path_of(world, respawn=[[0, 0, 0]])
    first = flight.episode(path, "hover")
    second = flight.episode(path, "charge charge")
    end, begin = second.steps[-1].charge, first.steps[-1].charge
    assert first.crashes == 2
    assert first.used == 2 * full + (full - begin)
    assert second.crashes == 1, "and a replacement with a full battery"
    assert second.used - second.gained == begin + full - end
    assert second.gained > 0


def test_measures_of_energy():
    world = strip(users=[(120, 120)], steps=2, battery=rotary(30.0), bandwidth_kbps=1000)
    log = fly(world, path_of(world, {0: [(0, 60, 500)]}))
    requests = tables.requests_table([log], world)
    episodes = tables.episodes_table([log], world, requests).iloc[0]
    assert episodes["energy_wh"] == pytest.approx(2 * 60 * HOVER_W / 3600, abs=1e-8)
    assert episodes["served_mbit"] == pytest.approx(30.0)
    assert episodes["j_per_mbit"] == pytest.approx(120 * HOVER_W / 30, rel=1e-8)
    assert episodes["charged_wh"] == 0.0


def test_without_such_a_battery_there_are_no_columns_of_energy():
    world = strip(steps=1, battery={"autonomy_min": 10})
    log = fly(world, path_of(world))
    assert not {"battery_wh", "energy_wh"} & {*tables.steps_table([log], world)}
    requests = tables.requests_table([log], world)
    assert "energy_wh" not in tables.episodes_table([log], world, requests)


def test_the_audit_notices_energy_that_is_lost():
    def leak(simulation: Any) -> None:
        drone = simulation.state.drones[0]
        if simulation.state.now_us == STEP_US and drone.used:
            drone.used += 1
        audit(simulation)

    world = strip(steps=3, battery=rotary(30.0))
    with pytest.raises(AssertionError, match="what it used and gained"):
        fly(world, path_of(world), "right hover", check=leak)


@dataclass(frozen=True)
class Halving(RowCharging):
    """A model of one's own: each ``half_s`` halves what is missing; full at 7/8 of the capacity."""

    half_s: float = 20.0

    def charged(self, battery: int, elapsed_us: int, capacity: int) -> int:
        halves = elapsed_us // round(self.half_s * 1e6)
        held = battery
        for _ in range(halves):
            held += (capacity - held) // 2
        return max(battery, min(held, capacity * 7 // 8))

    def until_full_us(self, battery: int, capacity: int) -> int:
        halves, held = 0, battery
        while held < capacity * 7 // 8:
            held += (capacity - held) // 2
            halves += 1
        return halves * round(self.half_s * 1e6)

    def full(self, capacity: int) -> int:
        return capacity * 7 // 8


@every_engine
def test_charging_of_ones_own():
    stations = {"charging": {"kind": f"{__name__}:Halving", "half_s": 25.0}}
    world = strip([(4, 0)], steps=8, battery=rotary(10.0), stations=stations)
    log = fly(world, path_of(world), "hover hover charge")
    # 5.6 Wh are missing of 10; after two halvings 1.4, which is more than 1.25.
    assert [event[0] for event in seen(log, "charged")] == [2 * STEP_US + 3 * 25 * US]
    assert log.charges == 1
