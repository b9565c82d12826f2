"""Free flight in wind with batteries of energy: times, energy and depletion, against a sampler.

The sampler is that of ``tests/model/energy/test_energy_of_legs.py``.
"""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import numpy as np
import pytest

from desim_uav.engine.base import EpisodeLog, FlownLeg, RunSettings
from desim_uav.engine.des import Simulation
from desim_uav.model.energy.battery import in_joules
from desim_uav.model.motion.limits import Limits
from desim_uav.model.rules import Mode
from desim_uav.sample_path import draw
from desim_uav.world import World
from tests.engine.helpers import US, Flight, in_3d, path_of, seen, some_command, strip
from tests.engine.random_free import world_of
from tests.engine.replay import check_log
from tests.model.energy.test_energy_of_legs import along, space_of
from tests.reference.energy import Rotor
from tests.reference.free import Space
from tests.selection import by_default

MOTION = {"space": "free", "max_speed_mps": 10, "max_acceleration_mps2": 4}
WINDS = [(5.0, 0.0), (-2.0, 4.5), (0.0, -6.0)]
UJ_WH = 3_600_000_000

every_engine = pytest.mark.usefixtures("every_engine")


def rotary(capacity_wh: float, **changes: Any) -> dict[str, Any]:
    return {"kind": "rotary_wing", "capacity_wh": capacity_wh, "return_below": 1.0, **changes}


# ---- by hand


def windy(wind: Any, battery: Any = None, cells: Any = (9, 9), **changes: Any) -> World:
    return strip(wind_mps=wind, battery=battery, cells=cells, drones={"motion": MOTION}, **changes)


def fly(world: World, *told: Any) -> tuple[Flight, EpisodeLog]:
    """An episode of one drone, which hears these commands and then hovers."""
    flight = Flight(world)
    shown = flight.engine.reset(path_of(world))
    while not (shown.terminated or shown.truncated):
        flight.shown.append(shown)
        now = told[shown.step] if shown.step < len(told) else "hover"
        shown = flight.engine.step([flight.command(now) if isinstance(now, str) else now])
    check_log(world, flight.engine.log)
    return flight, flight.engine.log


@every_engine
def test_there_and_back_along_the_wind():
    # 15 m/s over the ground with the wind: 15 * (60 - 15 / 4) m. Back, at 5 m/s: 5 * (60 - 5 / 4).
    _, log = fly(windy([5, 0]), [1.0, 0.0], [-1.0, 0.0])
    legs = [leg for leg in log.legs if leg.duration_us]
    assert [round(leg.to_m[0] - leg.from_m[0], 6) for leg in legs] == [843.75, -293.75]


@every_engine
@pytest.mark.parametrize("wind", WINDS)
def test_energy_of_steps(wind: tuple[float, float]):
    told = [[0.6, 0.3], [-0.2, 0.7], "hover", [-0.9, -0.9]]
    world = windy(wind, rotary(30.0), steps=5)
    _, log = fly(world, *([*one, -1.0] if one != "hover" else one for one in told))
    charges = [30 * UJ_WH, *(step.charge for step in log.steps)]
    found = [before - after for before, after in pairwise(charges)]
    space = space_of(Limits(10, 4, 5, 3, 2), wind)
    assert found == pytest.approx([1e6 * j for j in _by_steps(space, log, 5)], abs=4)
    assert log.used == charges[0] - charges[-1]


def _by_steps(space: Space, log: EpisodeLog, steps: int) -> list[float]:
    """What each step of 60 s takes by the sampler."""
    starts = {leg.t_us: leg for leg in log.legs if leg.duration_us}
    still = ((0.0,) * 3, (0.0,) * 3)
    ways = [starts.get(step * 60 * US) for step in range(steps)]
    ends = [still if leg is None else (leg.from_m, leg.to_m) for leg in ways]
    return [along(space, *each, Rotor(), 60.0) for each in ends]


@every_engine
def test_energy_of_a_climb():
    wind, battery = (3.0, 4.0), rotary(30.0)
    world = in_3d(
        [[2, 1, 50]], [(0, 0)], battery=battery, wind_mps=wind, drones={"motion": MOTION}, steps=3
    )
    flight = Flight(world, ceiling=False)
    flight.engine.reset(path_of(world))
    for command in ([0.03, 0.02, 0.05, -1.0], [0.0, 0.0, 0.06, -1.0], [0.0, 0.03, -0.1, -1.0]):
        flight.engine.step([command])
    log = flight.engine.log
    rises = [leg.to_m[2] - leg.from_m[2] for leg in log.legs if leg.duration_us]
    assert rises[0] > 0 < rises[1] and rises[2] < 0
    charges = [30 * UJ_WH, *(step.charge for step in log.steps)]
    found = [before - after for before, after in pairwise(charges)]
    space = space_of(Limits(10, 4, 5, 3, 2), wind)
    assert found == pytest.approx([1e6 * j for j in _by_steps(space, log, 3)], abs=4)


@every_engine
@pytest.mark.parametrize("wind", WINDS)
@pytest.mark.parametrize("told", ["hover", [0.8, 0.5, -1.0], [-0.4, 0.6, -1.0]])
def test_a_battery_ends_with_the_microsecond_of_its_last_joule(told: Any, wind: Any):
    world = windy(wind, rotary(0.8, on_crash="remove"), starts=[(3, 3)], steps=1)
    _, log = fly(world, told)
    (t_us,) = [event[0] for event in seen(log, "crash")]
    space = space_of(Limits(10, 4, 5, 3, 2), wind)
    start, stop = (840.0, 840.0, 20.0), (840.0, 840.0, 20.0)
    if told != "hover":  # the leg in the log ends at the crash
        stop = space_with(space, world).target(start, [*told[:2], 0.0], 20.0, 60.0)
    before, after = (along(space, start, stop, Rotor(), t / US) for t in (t_us - 1, t_us))
    assert 1e6 * before - 2 < 0.8 * UJ_WH <= 1e6 * after + 2


def space_with(space: Space, world: World) -> Space:
    """The limits on the map of a world without levels."""
    fields = vars(space) | {"size_m": tuple(world.scenario.map.size_m), "levels_m": (20.0,)}
    return Space(**fields)


@every_engine
def test_n_b_is_that_of_the_way():
    # 960 m against 5 m/s: 960 / 5 + 5 / 4 s.
    world = windy([5, 0], rotary(30.0), cells=(9, 1), starts=[(8, 0)], steps=4)
    flight, log = fly(world, "goto")
    assert [event[0] for event in seen(log, "land")] == [193_250_000]
    space = space_of(Limits(10, 4, 5, 3, 2), (5.0, 0.0))
    joules = along(space, (2040.0, 120, 20), (1080.0, 120, 20), Rotor(), 193.25)
    hover_w = Rotor().power_w(5.0, 0.0)
    seen_s = flight.shown[0].observations[0].return_s
    assert seen_s == pytest.approx(joules / hover_w, rel=1e-8)


# ---- random scenarios


@pytest.mark.parametrize("seed", by_default(range(3), range(40)))
def test_batteries_are_what_the_sampler_has_left(seed: int):
    world = world_of(seed, windy=True)
    assert world.scenario.wind_mps != (0.0, 0.0)
    told = RunSettings((False,) * world.scenario.drone_count, False, keep_events=True)
    engine, rng = Simulation(world, told), np.random.default_rng(seed)
    shown = engine.reset(draw(world, seed, 0))
    checked = 0
    while not (shown.terminated or shown.truncated):
        shown = engine.step([some_command(world, mask, rng) for mask in shown.masks])
    log = engine.log
    for drone in range(world.scenario.drone_count):
        own = world.type_of(drone)
        battery: Any = own.drones.battery
        if not in_joules(battery):
            continue
        rotor = Rotor(climbs=battery.climb, electronics_w=battery.electronics_w)
        space = space_of(own.space.limits, world.scenario.wind_mps)
        held: dict[int, int] = {s.t_us: s.charge for s in log.steps if s.drone == drone}
        modes = {s.t_us: s.mode for s in log.steps if s.drone == drone}
        legs = [leg for leg in log.legs if leg.drone == drone]
        lands = [e[0] for e in log.events or () if e[3] == drone and e[2] in ("land", "crash")]
        held[0], modes[0] = battery.capacity_uj, Mode.FLYING
        for begin, end in pairwise(sorted(held)):
            flew = {Mode.FLYING, Mode.RETURNING}
            if not {modes[begin], modes[end]} <= flew or any(begin < t <= end for t in lands):
                continue
            joules = 0.0
            for leg, until in _pieces(legs, begin, end):
                t0, t1 = ((t - leg.t_us) / US for t in (max(begin, leg.t_us), until))
                joules += along(space, leg.from_m, leg.to_m, rotor, t1)
                joules -= along(space, leg.from_m, leg.to_m, rotor, t0)
            assert held[begin] - held[end] == pytest.approx(1e6 * joules, abs=20), (begin, drone)
            checked += 1
    if any(in_joules(own.drones.battery) for own in world.types):
        assert checked


def _pieces(legs: list[FlownLeg], begin: int, end: int) -> list[tuple[FlownLeg, int]]:
    """The legs of a drone in a span, each with the time until which it counts."""
    for leg, following in pairwise([*legs, None]):
        until = end if following is None else min(end, following.t_us)
        if leg.t_us < end and until > begin:
            yield leg, until
