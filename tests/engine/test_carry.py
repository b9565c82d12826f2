"""What drones carry from one episode into the next, in this engine or in another one."""

from __future__ import annotations

import pickle
from collections import Counter
from collections.abc import Iterator
from dataclasses import fields, replace
from itertools import groupby
from operator import itemgetter
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, assume, given, settings
from hypothesis import strategies as st

from desim_uav.engine.base import Carried, CarriedDrone, EpisodeLog, RunSettings, Step
from desim_uav.engine.des import Simulation
from desim_uav.errors import ScenarioError, SimulationError
from desim_uav.model.rules import Mode
from desim_uav.model.state import Snapshot
from desim_uav.sample_path import SamplePath, draw
from desim_uav.scenario.load import from_mapping, load
from desim_uav.shipped import scenario_path
from desim_uav.world import World, build_world
from tests.audit.invariants import audit
from tests.engine.helpers import (
    HOP_US,
    US,
    Flight,
    check_log,
    column,
    count,
    events,
    merged,
    path_of,
    returning,
    scenarios,
    seen,
    some_command,
    strip,
)
from tests.selection import at_length
from tests.verification.engines import row

CROWDED = (
    "stations.count=1",
    "stations.pads=1",
    "drones.count=6",
    "drones.start_cells=[[0, 9], [9, 9], [5, 5], [3, 9], [7, 9], [5, 7]]",
    "drones.battery.autonomy_min=9",
    "drones.battery.return_below=0.7",
    "drones.battery.respawn_after_min=3",
    "episode.steps=7",
)
"""Six drones around one pad, with batteries that do not last for two episodes."""


def engine_on(world: World, check: Any = None, ceilings: Any = None) -> Simulation:
    ceilings = ceilings or (True,) * world.scenario.drones.count
    return Simulation(world, RunSettings(ceilings, carry_over=True, keep_events=True), audit=check)


def commanded(engine: Simulation, shown: Snapshot, rng: np.random.Generator) -> list[Snapshot]:
    """Random commands, most of them allowed, up to the episode's end."""
    snapshots = [shown]
    while not (shown.terminated or shown.truncated):
        shown = engine.step([some_command(engine.world, mask, rng) for mask in shown.masks])
        snapshots.append(shown)
    return snapshots


def all_of(log: EpisodeLog) -> dict[str, Any]:
    """Everything a log tells, requests with all they have."""
    told = {field.name: getattr(log, field.name) for field in fields(log)}
    told["requests"] = [row(request) for request in log.requests]
    return told


def went_on(engine: Simulation, seed: int, episodes: range) -> Iterator[tuple[Any, ...]]:
    """All there is to see of some episodes, and what is carried out of each."""
    for episode in episodes:
        rng = np.random.default_rng([seed, episode])
        shown = engine.reset(draw(engine.world, seed, episode))
        snapshots = commanded(engine, shown, rng)
        yield snapshots, all_of(engine.log), engine.measures(), engine.carried()


def tell(carried: Carried | None, met: Counter[str]) -> None:
    """Note what was carried."""
    met["nothing"] += carried is None
    for drone in carried or ():
        met[drone.mode.name] += 1
        met["mid-hop"] += drone.hop is not None and 0 < drone.age_us < 100 * US
        met["hops to go"] += len(drone.route) > 1
        met["waits"] += drone.mode is Mode.QUEUED and drone.place > 0
        met["long ago"] += drone.age_us > 90 * US
    queue = [d for d in carried or () if d.mode in (Mode.QUEUED, Mode.CHARGING)]
    for _, together in groupby(sorted(queue, key=itemgetter(1)), key=itemgetter(1)):
        places = [drone.place for drone in together]
        assert sorted(places) == list(range(len(places)))
        met["not by index"] += places != sorted(places)


def check_another_goes_on(
    world: World, seed: int, episodes: int, met: Counter[str], **how: Any
) -> None:
    """After each episode a fresh engine takes over, and does what the first one itself does."""
    first = engine_on(world, **how)
    for episode in range(episodes):
        commanded(first, first.reset(draw(world, seed, episode)), np.random.default_rng(seed))
        carried = first.carried()
        assert carried == first.carried(), "to ask changes nothing"
        tell(carried, met)
        second = engine_on(world, **how)
        second.carry(pickle.loads(pickle.dumps(carried)))
        assert second.carried() == carried
        further = range(100 + 10 * episode, 103 + 10 * episode)
        for one, other in zip(
            went_on(first, seed, further), went_on(second, seed, further), strict=True
        ):
            assert one == other
        check_log(world, second.log)


# ---- another engine goes on as the one that was carried from


@pytest.mark.thorough
@pytest.mark.parametrize("case", ["case4", "case8", "case9"])
def test_another_engine_goes_on_in_a_case(case: str):
    met: Counter[str] = Counter()
    for seed in range(2):
        world = build_world(load(scenario_path(case)), seed)
        check_another_goes_on(world, seed, 2, met)
    assert met["nothing"] == 0
    assert met["FLYING"] < sum(met[mode.name] for mode in Mode)


@pytest.mark.thorough
@pytest.mark.parametrize("case", ["case4", "case9"])
def test_another_engine_goes_on_in_a_crowded_case(case: str):
    met: Counter[str] = Counter()
    for seed in range(6):
        world = build_world(load(scenario_path(case), CROWDED), seed)
        check_another_goes_on(world, seed, 2, met, check=audit)
    wanted = {mode.name for mode in Mode} | {"mid-hop", "hops to go", "waits", "not by index"}
    assert min(met[what] for what in wanted) > 0, met


MANY = 200
"""Examples among which everything that the random scenarios are for is met."""

PLACES = st.lists(st.tuples(st.integers(0, 6), st.integers(0, 6)), min_size=2, max_size=6)


def crowd(scenario: dict[str, Any], places: list[Any], steps: int) -> dict[str, Any]:
    """A random scenario, made one in which drones have to return, far, and to wait for others."""
    cell_m = scenario["map"]["size_m"][0] / scenario["map"]["cells"][0]
    battery = scenario["drones"]["battery"] or {"kind": "endurance"}
    battery = {**battery, "autonomy_min": 3 + 2 * (steps % 3), "return_below": 1.0}
    return merged(
        scenario,
        {
            "map": {"size_m": [7 * cell_m, 7 * cell_m], "cells": [7, 7]},
            "drones": {"count": len(places), "start_cells": places, "battery": battery},
            "stations": {"count": 1, "radius_m": 0, "pads": 1, "full_charge_min": 4},
            "episode": {"steps": steps, "carry_over": True},
        },
    )


@pytest.mark.thorough
@pytest.mark.parametrize("examples", at_length(25, MANY))
def test_another_engine_goes_on_in_random_scenarios(examples: int):
    met: Counter[str] = Counter()

    @settings(
        max_examples=examples,
        deadline=None,
        derandomize=True,
        suppress_health_check=[HealthCheck.too_slow, HealthCheck.filter_too_much],
    )
    @given(
        scenario=scenarios(),
        places=PLACES,
        steps=st.integers(1, 7),
        crowded=st.sampled_from([True, True, True, False]),
        seed=st.integers(0, 10**6),
    )
    def check(
        scenario: dict[str, Any], places: list[Any], steps: int, crowded: bool, seed: int
    ) -> None:
        try:
            told = crowd(scenario, places, steps) if crowded else scenario
            world = build_world(from_mapping(told), seed)
        except ScenarioError:
            assume(False)
        rng = np.random.default_rng(seed)
        ceilings = tuple(bool(rng.random() < 0.6) for _ in world.starts)
        check_another_goes_on(world, seed, 2, met, ceilings=ceilings)

    check()
    wanted = {mode.name for mode in Mode} | {"nothing", "long ago"}
    wanted |= {"mid-hop", "hops to go", "waits", "not by index"}
    assert examples < MANY or min(met[what] for what in wanted) > 0, met


# ---- when nothing is carried


def played(engine: Simulation, episodes: range) -> list[Any]:
    return list(went_on(engine, 7, episodes))


def crowded_world() -> World:
    return build_world(load(scenario_path("case9"), CROWDED), 3)


def test_to_carry_none_is_a_fresh_start():
    world = crowded_world()
    used = engine_on(world)
    played(used, range(2))
    assert used.carried() is not None
    used.carry(None)
    assert used.carried() is None
    assert played(used, range(5, 7)) == played(engine_on(world), range(5, 7))


def test_an_engine_in_the_middle_of_an_episode_can_be_given_other_drones():
    world = crowded_world()
    first, second = engine_on(world), engine_on(world)
    played(first, range(2))
    shown = second.reset(draw(world, 1, 1))
    for _ in range(3):
        shown = second.step([some_command(world, m, np.random.default_rng(1)) for m in shown.masks])
    assert second.carried() is None, "broken off here, the next one would start afresh"
    second.carry(first.carried())
    with pytest.raises(SimulationError, match="call reset first"):
        second.step([4] * 6)
    assert played(second, range(5, 7)) == played(first, range(5, 7))


def test_what_is_carried_is_used_once():
    world = crowded_world()
    engine = engine_on(world)
    played(engine, range(1))
    engine.carry(engine.carried())
    engine.reset(draw(world, 7, 1))
    engine.step([4] * 6)
    assert engine.carried() is None
    fresh = engine_on(world)
    assert engine.reset(draw(world, 7, 2)) == fresh.reset(draw(world, 7, 2))


def test_nothing_is_carried_unless_the_settings_say_so():
    world = crowded_world()
    engine = Simulation(world, RunSettings((True,) * 6, carry_over=False, keep_events=True))
    assert engine.carried() is None
    first, second = played(engine, range(5, 6)), played(engine, range(5, 6))
    assert first == second
    assert engine.carried() is None


@pytest.mark.usefixtures("every_engine")
def test_a_crash_that_ends_an_episode_carries_nothing():
    world = column({"on_crash": "end_episode"}, steps=2)
    flight = Flight(world, carry_over=True)
    flight.episode(path_of(world))
    assert flight.shown[-1].terminated and flight.shown[-1].truncated
    assert flight.engine.carried() is None


# ---- three episodes are, to the drones, one of three times the length

PARTS = 3
"""Then the same hop, charge or downtime can be carried twice."""


def whole_and_parts(world: World, long: World, seed: int) -> tuple[SamplePath, list[SamplePath]]:
    """The sample path of a long episode and those of its parts, as far as drones are concerned.

    The error at the end of a part is that at the start of the next; a drone's respawns all draw
    one station.
    """
    steps, drones = world.scenario.episode.steps, world.scenario.drones.count
    places = np.random.default_rng(seed).integers(len(world.stations), size=(drones, 1))
    whole = draw(long, seed, 0)
    error = whole.position_error
    whole = replace(whole, respawn=np.repeat(places, PARTS * steps + 1, axis=1))
    parts = [
        replace(
            draw(world, seed, part),
            position_error=None if error is None else error[:, part * steps :][:, : steps + 1],
            respawn=np.repeat(places, steps + 1, axis=1),
        )
        for part in range(PARTS)
    ]
    return whole, parts


FLOWN = {"depart", "blocked", "arrive", "land", "charge", "charged", "deplete", "crash", "respawn"}


def flown(log: EpisodeLog, since_us: int = 0) -> list[tuple[Any, ...]]:
    """What drones did, at times from ``since_us`` on."""
    assert log.events is not None
    return [(e[0] + since_us, *e[1:]) for e in log.events if e[2] in FLOWN]


def of_drone(step: Step, since: int, since_us: int) -> tuple[Any, ...]:
    """What a record says of the drone alone."""
    return (
        *(step.step + since, step.t_us + since_us, step.drone, step.x_m, step.y_m, step.z_m),
        *(step.charge, step.mode, step.action, step.action_taken, step.return_drain),
    )


def known(shown: Snapshot) -> list[Any]:
    """What drones know of themselves, and may do."""
    alone = {"step": 0, "steps": 0, "attached_users": 0, "served_requests": 0, "bandwidth_khz": 0}
    return [
        (drone._replace(**alone, served=(), asking=()), mask)
        for drone, mask in zip(shown.observations, shown.masks, strict=True)
    ]


@pytest.mark.thorough
@pytest.mark.parametrize("examples", at_length(25, MANY))
def test_three_episodes_are_to_drones_one_of_three_times_the_length(examples: int):
    met: Counter[str] = Counter()

    @settings(
        max_examples=examples,
        deadline=None,
        derandomize=True,
        suppress_health_check=[HealthCheck.too_slow, HealthCheck.filter_too_much],
    )
    @given(
        scenario=scenarios(),
        places=PLACES,
        steps=st.integers(1, 6),
        seed=st.integers(0, 10**6),
    )
    def check(scenario: dict[str, Any], places: list[Any], steps: int, seed: int) -> None:
        told = crowd(scenario, places, steps)
        try:
            world = build_world(from_mapping(told), seed)
            longer = merged(told, {"episode": {"steps": PARTS * steps}})
            long = build_world(from_mapping(longer), seed)
        except ScenarioError:
            assume(False)
        whole, parts = whole_and_parts(world, long, seed)
        one, rng = engine_on(long), np.random.default_rng(seed)
        shown = commanded(one, one.reset(whole), rng)
        assume(not shown[-1].terminated)
        other, rng = engine_on(world), np.random.default_rng(seed)
        logs, flights, records = [], [], []
        for part, path in enumerate(parts):
            snapshots = commanded(other, other.reset(path), rng)
            # Where a part ends, crashed drones of the whole have been replaced already.
            for k, snapshot in enumerate(snapshots[:-1]):
                assert known(snapshot) == known(shown[k + part * steps])
            since_us = part * world.horizon_us
            flights += flown(other.log, since_us)
            records += [of_drone(step, part * steps, since_us) for step in other.log.steps]
            logs.append(other.log)
            tell(other.carried(), met)
        assert flights == flown(one.log)
        assert records == [of_drone(step, 0, 0) for step in one.log.steps]
        for name in ("crashes", "charges", "queueing_us"):
            assert sum(getattr(log, name) for log in logs) == getattr(one.log, name)
        distance_m = sum(log.distance_m for log in logs)
        assert distance_m == pytest.approx(one.log.distance_m, rel=1e-12, abs=1e-9)
        met["charged later"] += any(log.charges and not count(log, "land") for log in logs)
        met["replaced later"] += any(count(log, "respawn") > log.crashes for log in logs)

    check()
    wanted = {mode.name for mode in Mode} | {"charged later", "replaced later"}
    wanted |= {"mid-hop", "hops to go", "waits", "not by index", "long ago"}
    assert examples < MANY or min(met[what] for what in wanted) > 0, met


# ---- by hand


@pytest.mark.usefixtures("every_engine")
def test_what_a_returning_drone_carries():
    # Told at 60 s to return over four hops: at 120 s it is 29.009337 s into the second one.
    world = returning(steps=2)
    flight = Flight(world, carry_over=True)
    flight.episode(path_of(world), "hover goto")
    (drone,) = flight.engine.carried() or ()
    assert drone == CarriedDrone(
        mode=Mode.RETURNING,
        node=(1, 0, 0),
        charge=600 * US - 60 * US - HOP_US,
        age_us=60 * US - HOP_US,
        hop=(1, 0, 0),
        route=((1, 0, 0), (1, 0, 0)),
        counted_m=pytest.approx(240 - 2 * 1.981326**2),  # it brakes at 4 m/s², 1.981326 s to go
        place=0,
        fallen_m=None,
    )


@pytest.mark.usefixtures("every_engine")
def test_what_a_queue_carries_is_its_order():
    # Drone 2 lands first, then 0, then 1: one charges, two wait; drone 3 stays in the air.
    starts = [(3, 0), (2, 0), (4, 0), (0, 0)]
    world = strip(
        starts,
        battery={"autonomy_min": 10, "return_below": 1.0},
        stations={"full_charge_min": 60},
        steps=2,
    )
    flight = Flight(world, carry_over=True)
    flight.episode(path_of(world), "goto", "goto", "hover charge", "hover")
    carried = flight.engine.carried() or ()
    assert [drone.mode for drone in carried] == [
        *(Mode.CHARGING, Mode.QUEUED, Mode.QUEUED, Mode.FLYING)
    ]
    assert [drone.place for drone in carried] == [0, 2, 1, 0]
    assert [drone.age_us for drone in carried] == [
        120 * US - HOP_US,
        120 * US - 2 * HOP_US,
        60 * US,
        60 * US,
    ]


@pytest.mark.usefixtures("every_engine")
def test_a_battery_may_run_out_in_a_hop_that_was_carried():
    # 61.2 s of battery for three hops: it falls 0.781326 s before the end of the second one.
    world = column({"autonomy_min": 1.02}, steps=1)
    flight = Flight(world, carry_over=True)
    before = flight.episode(path_of(world), "goto")
    after = flight.episode(path_of(world, episode=1))
    assert seen(after, "arrive", "deplete", "crash") == events("""
        1200000  6  deplete  0
        1200000  6  crash    0
    """)
    fallen_m = 480 - 2 * 0.781326**2
    assert after.steps[0].y_m == pytest.approx(1080 + fallen_m)
    assert before.distance_m + after.distance_m == pytest.approx(fallen_m)
    (drone,) = flight.engine.carried() or ()
    assert (drone.mode, drone.node, drone.age_us) == (Mode.CRASHED, (0, 6, 0), 58_800_000)
    assert drone.fallen_m == (120.0, after.steps[0].y_m)
    third = flight.episode(path_of(world, episode=2))
    assert third.steps[0].y_m == after.steps[0].y_m
    assert third.distance_m == 0
