"""What can be asked of an engine in between: the quality of experience so far, and positions."""

from __future__ import annotations

import math
from collections import Counter
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, assume, example, given, settings
from hypothesis import strategies as st

from desim_uav.engine.base import EpisodeLog, Measures, RunSettings
from desim_uav.engine.des import Simulation
from desim_uav.errors import ScenarioError
from desim_uav.experiment import tables
from desim_uav.model.geometry.coverage import walked
from desim_uav.rules import episode as rules_of_episodes
from desim_uav.rules.requests import measures
from desim_uav.sample_path import draw
from desim_uav.scenario.load import from_mapping, load
from desim_uav.shipped import scenario_path
from desim_uav.world import World, build_world
from tests.engine.helpers import Flight, path_of, scenarios, some_command, strip

NAMES = Measures._fields


@pytest.fixture
def before_the_end(monkeypatch: pytest.MonkeyPatch) -> list[Measures]:
    """What is measured at each episode's end just before its requests are closed."""
    measured = []

    def close_all(world: Any, path: Any, state: Any) -> None:
        found = measures(world, state)
        measured.append(Measures(*(None if math.isnan(value) else value for value in found)))
        plain(world, path, state)

    plain = rules_of_episodes.close_all
    monkeypatch.setattr(rules_of_episodes, "close_all", close_all)
    return measured


def measured_along(world: World, asks: dict[int, Any], told: str) -> list[Measures]:
    """The measures at each decision epoch of a flight."""
    measured = []
    flight = Flight(world)
    step, reset = flight.engine.step, flight.engine.reset

    def stepped(commands: Any) -> Any:
        shown = step(commands)
        measured.append(flight.engine.measures())
        return shown

    def begun(path: Any) -> Any:
        shown = reset(path)
        measured.append(flight.engine.measures())
        return shown

    flight.engine.step, flight.engine.reset = stepped, begun
    flight.episode(path_of(world, asks), told)
    return measured


@pytest.mark.usefixtures("every_engine")
def test_by_hand():
    # User 0 is served from 0 s on, user 1 out of reach asks at 90 s, user 2 never asks and is
    # attached. At 120 s the drone leaves its cell: its users are out of its 100 m at 136.5 s.
    world = strip(users=[(120, 120), (2000, 120), (120, 100)], steps=3)
    asks = {0: [(0, 60, 0)], 1: [(90, 40, 0)]}
    start, first, second, third = measured_along(world, asks, "hover hover right")
    assert start == (0.0, 0.0, None)
    assert first == (pytest.approx(100.0), pytest.approx(0.0), pytest.approx(200 / 3))
    assert second == (pytest.approx(50.0), pytest.approx(0.5 / 2), pytest.approx(200 / 3))
    assert third[:2] == (pytest.approx(50.0), pytest.approx(1.5 / 2))
    # 100 m out: 1.0375 s to cruise at 8.3 m/s, 100 / 8.3 + 1.0375 s in all.
    gone_s = 120 + 100 / 8.3 + 8.3 / 8
    other_s = 120 + (100**2 - 20**2) ** 0.5 / 8.3 + 8.3 / 8
    assert third[2] == pytest.approx(100 * (gone_s + other_s) / (3 * 180), abs=1e-6)


@pytest.mark.usefixtures("every_engine")
def test_an_open_request_counts_by_what_it_has_had():
    # 45 of 90 s served at the first decision epoch, when it has waited 15 s.
    world = strip(users=[(120, 120)], steps=2, bandwidth_kbps=100)
    (before, after, end) = measured_along(world, {0: [(15, 90, 50)]}, "hover")
    assert before == (None, None, None)
    assert after == (pytest.approx(50.0), pytest.approx(0.0), pytest.approx(100.0))
    assert end == (pytest.approx(100.0), pytest.approx(0.0), pytest.approx(100.0))


@pytest.mark.usefixtures("every_engine")
def test_where_nothing_is_asked_for_there_is_no_quality_but_coverage():
    world = strip(users=[(120, 120)], steps=1)
    assert measured_along(world, {}, "hover") == [(None, None, None), (None, None, 100.0)]


def tabulated(log: EpisodeLog, world: World) -> tuple[float | None, ...]:
    """The same of a finished episode, from its tables."""
    row = tables.episodes_table([log], world, tables.requests_table([log], world)).iloc[0]
    return tuple(None if np.isnan(row[name]) else float(row[name]) for name in NAMES)


def agree(measured: Measures, others: tuple[float | None, ...]) -> bool:
    return measured == tuple(
        None if other is None else pytest.approx(other, abs=1e-9, rel=1e-12) for other in others
    )


@pytest.mark.parametrize("case", [f"case{k}" for k in range(1, 10)])
def test_at_the_end_they_are_those_of_the_tables(case: str, before_the_end: list[Measures]):
    world = build_world(load(scenario_path(case)), 5)
    rng = np.random.default_rng(5)
    engine = Simulation(world, RunSettings((True,) * len(world.starts), True))
    for episode in range(2):
        shown = engine.reset(draw(world, 5, episode))
        while not shown.truncated:
            shown = engine.step([some_command(world, mask, rng) for mask in shown.masks])
        expected = tabulated(engine.log, world)
        assert agree(before_the_end[-1], expected)
        assert agree(engine.measures(), expected)
        assert None not in expected


ENDED_BY_A_CRASH = {
    "users": {"count": 6},
    "map": {"size_m": [480, 480], "cells": [2, 2], "dimensions": 2},
    "drones": {"count": 2, "battery": {"autonomy_min": 2.2, "on_crash": "end_episode"}},
    "stations": {"count": 1},
    "episode": {"steps": 6},
}


@pytest.mark.thorough
def test_in_random_scenarios_closing_adds_nothing(before_the_end: list[Measures]):
    seen: Counter[str] = Counter()

    @settings(
        max_examples=80,
        deadline=None,
        derandomize=True,
        suppress_health_check=[HealthCheck.too_slow, HealthCheck.filter_too_much],
    )
    @example(scenario=ENDED_BY_A_CRASH, seed=0)
    @given(scenario=scenarios(), seed=st.integers(0, 10**6))
    def check(scenario: dict[str, Any], seed: int) -> None:
        try:
            world = build_world(from_mapping(scenario), seed)
        except ScenarioError:
            assume(False)
        rng = np.random.default_rng(seed)
        engine = Simulation(world, RunSettings((True,) * len(world.starts), True))
        shown = engine.reset(draw(world, seed, 0))
        while not (shown.terminated or shown.truncated):
            shown = engine.step([some_command(world, mask, rng) for mask in shown.masks])
        expected = tabulated(engine.log, world)
        assert agree(before_the_end[-1], expected)
        assert agree(engine.measures(), expected)
        seen["partly"] += expected[0] is not None and 0 < expected[0] < 100
        seen["terminated"] += shown.terminated

    check()
    assert seen["partly"] > 20 and seen["terminated"] > 0, seen


def test_along_the_way_they_are_those_of_an_episode_that_ends_there():
    world = build_world(load(scenario_path("case9")), 3)
    engine = Simulation(world, RunSettings((True,) * 3, False))
    for steps in (1, 7, 18, 29):
        rng = np.random.default_rng(3)
        shown = engine.reset(draw(world, 3, 0))
        for _ in range(steps):
            shown = engine.step([some_command(world, mask, rng) for mask in shown.masks])
        measured = engine.measures()
        engine.state.truncated = 1
        engine.state.closed.clear()
        engine.state.handovers.clear()
        rules_of_episodes._end_episode(engine.constants, engine.own_path, engine.state)
        engine.drain_log()
        assert agree(measured, tabulated(engine.log, world))


# ---- positions


def test_positions_are_those_of_the_record_and_of_the_walks():
    world = build_world(load(scenario_path("case9")), 4)
    path = draw(world, 4, 0)
    engine = Simulation(world, RunSettings((True,) * 3, False))
    rng = np.random.default_rng(4)
    shown = engine.reset(path)
    drones, users = engine.positions_m()
    assert users.tolist() == world.homes.tolist()
    centres = [(*world.grid.centre(*cell), world.grid.levels_m[0]) for cell in world.starts]
    assert drones.tolist() == [list(centre) for centre in centres]
    moved = world.homes.copy()
    while not shown.truncated:
        shown = engine.step([some_command(world, mask, rng) for mask in shown.masks])
        drones, users = engine.positions_m()
        records = engine.log.steps[-3:]
        assert drones.tolist() == [[step.x_m, step.y_m, step.z_m] for step in records]
        for user, (first, last) in enumerate(
            zip(path.walks.offsets, path.walks.offsets[1:], strict=False)
        ):
            legs = path.walks.legs[first:last]
            leg = legs[legs["begin_us"] <= shown.t_us][-1]
            moved[user, :2] = walked(leg, shown.t_us)
        assert users == pytest.approx(moved, abs=1e-9)
    assert not np.allclose(users, world.homes, atol=100), "they walk"
    users[:] = 0
    assert engine.positions_m()[1].any(), "a copy"
