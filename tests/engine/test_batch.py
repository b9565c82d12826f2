"""The compiled engine is the SimPy engine: every row, observation and float, bit for bit."""

from __future__ import annotations

import json
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from desim_uav.engine.base import RunSettings
from desim_uav.engine.choose import ENGINES, make_engine
from desim_uav.engine.compiled import BatchSimulation, simulation
from desim_uav.errors import ScenarioError, SimulationError
from desim_uav.model.rules import Action
from desim_uav.sample_path import draw
from desim_uav.scenario.load import from_mapping, load
from desim_uav.shipped import scenario_path
from desim_uav.world import World, build_world
from tests.engine.helpers import (
    ALL_DEMANDS,
    ALL_WALKS,
    all_models,
    path_of,
    scenarios,
    strip,
)
from tests.selection import by_default
from tests.verification.engines import differences, engines

CASES = [f"case{k}" for k in range(1, 10)]


@pytest.mark.parametrize("seed", [0, 1])
@pytest.mark.parametrize("case", CASES)
def test_the_nine_cases(case: str, seed: int):
    world = build_world(load(scenario_path(case)), seed)
    ceilings = tuple(bool((drone + seed) % 2) for drone in range(world.scenario.drones.count))
    one, other = engines(world, ceilings)
    for episode in range(3):
        assert not differences(one, other, seed, episode)


CHANGES = {
    "arrivals": ["demand={kind: poisson, rate_per_hour: 60}"],
    "crowded": ["users.count=200", "drones.bandwidth_kbps=1000", "demand.think_time_s=5"],
    "queues": ["stations.count=1", "drones.count=4", "drones.battery.return_below=1"],
    "crashes": [
        *("drones.count=6", "drones.battery.autonomy_min=6"),
        "drones.battery.respawn_after_min=0",
    ],
    "removed": ["drones.battery.autonomy_min=9", "drones.battery.on_crash=remove"],
    "ends": ["drones.battery.autonomy_min=9", "drones.battery.on_crash=end_episode"],
    "wide": [  # the map is worth buckets
        *("map.size_m=[7200, 4800]", "map.cells=[30, 20]", "users.count=150"),
        "drones.count=5",
    ],
    "an hour": ["drones.battery.autonomy_min=60", "drones.battery.return_below=1"],
    "a month": [
        *("drones.battery.autonomy_min=43200", "stations.full_charge_min=20001.7"),
        "drones.battery.return_below=1",
    ],
    "other readings": [
        *("drones.battery.kind=per_action", "drones.battery.return_below=0.5"),
        *("reward.capped=false", "reward.served_only=false", "stations.placement=equidistant"),
    ],
    "slow returns": ["drones.motion.return_timing=fill_epoch"],
    "fast": ["drones.motion.timing=minimum_time", "stations.pads=2"],
}


def changed(case: str, name: str) -> World:
    return build_world(load(scenario_path(case), CHANGES[name]), 3)


@pytest.mark.parametrize("case", by_default(["case8"], ["case8", "case9"]))
@pytest.mark.parametrize("name", CHANGES)
def test_changed_cases(case: str, name: str):
    world = changed(case, name)
    one, other = engines(world, (True,) * world.scenario.drones.count)
    for episode in range(4):
        assert not differences(one, other, 3, episode)


@pytest.mark.parametrize("kind", ["coverage_battery", "multi_service"])
@pytest.mark.parametrize("engine", ENGINES)
def test_a_battery_exactly_at_a_threshold_is_low(engine: str, kind: str):
    """After 21 of 50 minutes the battery holds exactly 0.58 of its capacity.

    The product 0.58 * 3000 s, taken in floats, is a little less than these 1740 s.
    """
    world = strip(
        users=[(120, 120)],
        battery={"autonomy_min": 50, "return_below": 0.58},
        reward={"kind": kind, "low_battery": 0.58},
        steps=21,
    )
    flight = make_engine(engine, world, RunSettings((True,), False))
    shown = [flight.reset(path_of(world))]
    goto, hover = (world.actions.index(a) for a in (Action.GOTO_CHARGING_STATION, Action.HOVER))
    while not shown[-1].truncated:
        shown.append(flight.step([hover]))
    assert shown[-1].observations[0].battery_s == 1740.0 > 0.58 * 3000.0
    assert [snapshot.masks[0][goto] for snapshot in shown[-2:]] == [False, True]
    assert [snapshot.reward_terms[0]["return"] == 0.0 for snapshot in shown[-2:]] == [True, False]


def play_random(scenario: dict[str, Any], seed: int) -> None:
    with_kernels = {**scenario["drones"], "admission": {"kind": "first_come"}}
    try:
        world = build_world(from_mapping({**scenario, "drones": with_kernels}), seed)
    except ScenarioError:
        assume(False)
    rng = np.random.default_rng(seed)
    ceilings = tuple((rng.random(world.scenario.drones.count) < 0.5).tolist())
    one, other = engines(world, ceilings)
    for episode in range(3):
        assert not differences(one, other, seed, episode)


@pytest.mark.thorough
@settings(max_examples=40, deadline=None)
@given(scenarios(), st.integers(0, 2**31))
def test_random_scenarios(scenario: dict[str, Any], seed: int):
    play_random(scenario, seed)


@pytest.mark.thorough
def test_random_scenarios_with_all_models():
    with all_models():
        given_scenarios(40)()


@pytest.mark.slow
def test_many_random_scenarios():
    with all_models():
        given_scenarios(400)()


def given_scenarios(count: int) -> Callable[[], None]:
    """A test that plays random scenarios."""

    @settings(max_examples=count, deadline=None)
    @given(scenarios(), st.integers(0, 2**31))
    def play(scenario: dict[str, Any], seed: int) -> None:
        play_random(scenario, seed)

    return play


@pytest.mark.thorough
@pytest.mark.parametrize("mobility", ALL_WALKS, ids=str)
def test_each_mobility(mobility: dict[str, Any]):
    play_with(f"users.mobility={json.dumps(mobility)}")


@pytest.mark.thorough
@pytest.mark.parametrize("demand", ALL_DEMANDS, ids=str)
def test_each_demand(demand: dict[str, Any]):
    play_with(f"demand={json.dumps(demand)}")


def play_with(change: str) -> None:
    """Play case 8 with a change, on both engines."""
    world = build_world(load(scenario_path("case8"), [change]), 3)
    one, other = engines(world, (True,) * world.scenario.drones.count)
    for episode in range(3):
        assert not differences(one, other, 3, episode)


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(20))
def test_five_hundred_users(seed: int):
    world = build_world(load(scenario_path("case9"), ["users.count=500"]), seed)
    one, other = engines(world, (True,) * world.scenario.drones.count)
    for episode in range(2):
        assert not differences(one, other, seed, episode)


def test_an_episode_may_begin_in_the_other_engine():
    world = changed("case9", "crashes")
    one, other = engines(world, (True,) * 6)
    for episode in range(6):
        assert not differences(one, other, 5, episode)
        if episode % 2:  # each goes on from what the other has told
            from_one, from_other = one.carried(), other.carried()
            one.carry(from_other)
            other.carry(from_one)


def without_room(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(simulation, "BUFFER", 1)
    monkeypatch.setattr(simulation, "REQUESTS_A_USER", 0)
    monkeypatch.setattr(simulation, "CROSSINGS_A_USER", 0)


@pytest.mark.parametrize("name", ["crowded", "crashes"])
def test_room_is_made_where_something_does_not_fit(name: str, monkeypatch: pytest.MonkeyPatch):
    without_room(monkeypatch)
    world = changed("case8", name)
    one, other = engines(world, (True,) * world.scenario.drones.count)
    for episode in range(2):
        assert not differences(one, other, 1, episode)


def test_no_step_outside_an_episode():
    world = build_world(load(scenario_path("case1"), ["episode.steps=1"]), 0)
    engine = BatchSimulation(world, RunSettings((True,), False))
    with pytest.raises(SimulationError, match="call reset first"):
        engine.step([4])
    engine.reset(draw(world, 0, 0))
    engine.step([4])
    with pytest.raises(SimulationError, match="call reset first"):
        engine.step([4])


class Flat:
    """A reward of one's own."""

    def terms(self, *_: Any) -> dict[str, float]:
        return {"flat": 1.0}


@pytest.mark.parametrize(
    ("changes", "told"),
    [
        ({"drones": {"admission": {"kind": "tests.engine.helpers:Loss"}}}, "drones.admission"),
        ({"reward": {"kind": "tests.engine.test_batch:Flat"}}, "reward"),
    ],
)
def test_a_component_without_a_kernel_is_refused_by_name(changes: dict[str, Any], told: str):
    world = build_world(from_mapping(changes), 0)
    with pytest.raises(
        ScenarioError, match=rf"{told}: '\w+' is not compiled: .* rows; --engine des runs it"
    ):
        BatchSimulation(world, RunSettings((True,) * 3, False))
