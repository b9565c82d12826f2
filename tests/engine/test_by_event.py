"""Drones that are asked when they are free: worlds by hand, random scenarios, learning."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from desim_uav import UavEnv
from desim_uav.engine.base import RunSettings
from desim_uav.engine.choose import ENGINES, make_engine
from desim_uav.errors import ScenarioError
from desim_uav.learning.training import Training
from desim_uav.model.rules import Action, Mode
from desim_uav.sample_path import draw
from desim_uav.scenario.load import from_mapping
from desim_uav.world import World, build_world
from tests.engine import random_fleet
from tests.engine.helpers import HOP_US, US, Flight, path_of, scenarios, seen, strip
from tests.verification.engines import differences, engines

ASKED = {"kind": "event", "patience_s": 45}


def by_event(**changes: Any) -> World:
    return strip(**{"decisions": ASKED, **changes})


def times(flight: Flight) -> list[int]:
    return [snapshot.t_us for snapshot in flight.shown]


def asked(flight: Flight, drone: int) -> list[int]:
    """The times at which a drone has been asked."""
    return [event[0] for event in seen(flight.engine.log, "decide") if event[3] == drone]


# ---- by hand


@pytest.mark.usefixtures("every_engine")
def test_a_drone_is_asked_after_its_move_and_after_its_patience():
    flight = Flight(by_event())
    log = flight.episode(path_of(flight.world), "right hover right right hover")
    first, second = HOP_US, HOP_US + 45 * US
    moved = [second + HOP_US, second + 2 * HOP_US]
    assert times(flight) == [0, first, second, *moved, 180 * US]
    assert asked(flight, 0) == [0, first, second, *moved]
    assert [step.t_us for step in log.steps] == times(flight)[1:]
    assert log.distance_m == pytest.approx(3 * 240.0)


@pytest.mark.usefixtures("every_engine")
def test_only_a_free_drone_is_asked_and_the_other_goes_on():
    flight = Flight(by_event(starts=[(0, 0), (4, 0)], steps=2))
    flight.episode(path_of(flight.world), "right hover hover right", "hover hover left hover")
    assert asked(flight, 0) == [0, HOP_US, HOP_US + 45 * US, 2 * HOP_US + 45 * US]
    assert asked(flight, 1) == [0, 45 * US, 45 * US + HOP_US]
    first = flight.shown[1]
    assert first.t_us == HOP_US
    choices = [[action.name for action, may in zip(flight.world.actions, mask, strict=True) if may]
               for mask in first.masks]  # fmt: skip
    assert choices[1] == ["HOVER"]
    assert len(choices[0]) > 1
    second = [step for step in flight.engine.log.steps if step.t_us == HOP_US + 45 * US]
    assert [step.action is None for step in second] == [True, False]
    assert [step.action_taken.name for step in second] == ["HOVER", "LEFT"]


@pytest.mark.usefixtures("every_engine")
def test_a_drone_is_asked_when_it_is_charged():
    battery = {"autonomy_min": 10, "return_below": 1.0, "respawn_after_min": 10}
    stations = {"full_charge_min": 5}
    world = by_event(starts=[(4, 0)], battery=battery, stations=stations, steps=4)
    flight = Flight(world)
    log = flight.episode(path_of(world), "hover charge hover hover hover hover")
    charged_us = 45 * US + 45 * US // 2
    assert [event[0] for event in seen(log, "charged")] == [charged_us]
    assert asked(flight, 0)[:3] == [0, 45 * US, charged_us]
    goto = [action.name for action in world.actions].index("GOTO_CHARGING_STATION")
    masks = [snapshot.masks[0][goto] for snapshot in flight.shown[:4]]
    assert masks == [False, True, False, True]  # a full drone needs no station


@pytest.mark.usefixtures("every_engine")
def test_a_crashed_drone_is_replaced_as_soon_as_its_time_is_over():
    battery = {"autonomy_min": 1, "return_below": 0.1, "respawn_after_min": 0.75}
    world = by_event(starts=[(1, 0)], battery=battery, steps=4)
    flight = Flight(world)
    log = flight.episode(path_of(world), "hover hover hover hover hover")
    assert [event[0] for event in seen(log, "crash")] == [60 * US, 165 * US]
    assert [event[0] for event in seen(log, "respawn")] == [105 * US, 210 * US]
    assert asked(flight, 0) == [0, 45 * US, 105 * US, 150 * US, 210 * US]
    assert [step.mode for step in log.steps if step.t_us == 105 * US] == [Mode.CRASHED]


@pytest.mark.usefixtures("every_engine")
def test_a_battery_that_ends_with_the_move_ends_in_a_crash():
    battery = {"autonomy_min": HOP_US / US / 60, "respawn_after_min": 10}
    world = by_event(starts=[(1, 0)], battery=battery)
    flight = Flight(world)
    log = flight.episode(path_of(world), "right hover")
    assert [event[:3] for event in seen(log, "arrive", "crash")] == [
        (HOP_US, 3, "arrive"),
        (HOP_US, 6, "crash"),
    ]
    assert times(flight) == [0, HOP_US, 180 * US]


@pytest.mark.usefixtures("every_engine")
def test_rewards_are_weighed_by_the_time_between_epochs():
    world = by_event(users=[(120, 120)], reward={"kind": "coverage"})
    flight = Flight(world)
    flight.episode(path_of(world), "hover right hover hover")
    assert [snapshot.rewards[0] for snapshot in flight.shown[1:]] == [0.75, 0.0, 0.0, 0.0, 0.0]
    assert flight.engine.state.share == pytest.approx((180 - 45 - 31 - 90) / 60, abs=1e-3)


# ---- random scenarios


def asked_by_event(scenario: dict[str, Any], seed: int) -> World:
    """A random scenario, decided by event, as far as it can be."""
    rng = np.random.default_rng(seed)
    drones = {**scenario["drones"], "admission": {"kind": "first_come"}}
    patience_s = float(rng.choice([5, 17.5, 60, 200]))
    if drones["battery"] is not None:
        later_min = drones["battery"]["respawn_after_min"] + patience_s / 60
        drones["battery"] = {**drones["battery"], "respawn_after_min": later_min}
    made = {
        **scenario,
        "drones": drones,
        "decisions": {"kind": "event", "patience_s": patience_s},
        "episode": {**scenario["episode"], "carry_over": False},
    }
    return build_world(from_mapping(made), seed)


def play(scenario: dict[str, Any], seed: int) -> None:
    try:
        world = asked_by_event(scenario, seed)
    except ScenarioError:
        assume(False)
    one, other = engines(world, (True,) * world.scenario.drone_count)
    for episode in range(2):
        assert not differences(one, other, seed, episode)


@pytest.mark.thorough
def test_engines_agree_in_many_random_scenarios():
    settings(max_examples=100, deadline=None)(given(scenarios(), st.integers(0, 2**31))(play))()


def fleet_by_event(seed: int) -> World:
    """A random fleet that is asked by event, in a scenario that its checks accept."""
    for k in range(20):
        made = random_fleet.scenario(seed + 10_000 * k, graded=False)
        made["decisions"] = {"kind": "event", "patience_s": (20, 45, 90)[seed % 3]}
        made["episode"] = {**made["episode"], "carry_over": False}
        for drones in made["drones"]:
            if drones["battery"] is not None:
                drones["battery"]["respawn_after_min"] += 1.5
        try:
            return build_world(from_mapping(made), seed)
        except ScenarioError:
            continue
    raise AssertionError(f"no scenario from seed {seed} on is accepted")


@pytest.mark.thorough
@pytest.mark.parametrize("first", range(0, 60, 20))
def test_engines_agree_in_random_fleets(first: int):
    for seed in range(first, first + 20):
        world = fleet_by_event(seed)
        one, other = engines(world, (True,) * world.scenario.drone_count)
        assert not differences(one, other, seed, 0), seed


# ---- learning and copies


def learned(engine: str) -> np.ndarray[Any, Any]:
    world = build_world(
        from_mapping(
            {
                "map": {"size_m": [720, 720], "cells": [3, 3], "dimensions": 2},
                "drones": {"count": 2, "motion": {"timing": "minimum_time"}},
                "users": {"count": 6, "clusters": {"count": 1}},
                "decisions": {"kind": "event", "patience_s": 20},
                "episode": {"steps": 40},
            }
        ),
        0,
    )
    training = Training(world, 0, engine)
    while training.episode < 6:
        training.play(6 - training.episode)
    return training.q.copy()


@pytest.mark.thorough
def test_learners_learn_the_same_on_both_engines():
    one, other = map(learned, ENGINES)
    assert np.abs(one).sum() > 0
    assert (one == other).all()


@pytest.mark.parametrize("other", ENGINES)
def test_a_saved_state_goes_on(other: str):
    users = [(60.0 * k, 120.0) for k in range(36)]  # some of whom are to be passed on present legs
    world = by_event(starts=[(0, 0), (4, 0)], steps=6, users=users)
    told = RunSettings((True, True), carry_over=False, keep_events=True)
    path = draw(world, 0, 0)

    def go_on(engine: Any, epochs: int) -> Any:
        rng = np.random.default_rng(epochs)
        for _ in range(epochs):
            masks = engine.latest.masks
            shown = engine.step([int(rng.choice(np.flatnonzero(mask))) for mask in masks])
        return shown

    one, two = make_engine("des", world, told), make_engine(other, world, told)
    one.reset(path)
    hover, right = (world.actions.index(action) for action in (Action.HOVER, Action.RIGHT))
    for _ in range(2):
        one.step([hover, right])
    assert one.state.drones[1].ahead
    two.restore(one.save())
    assert go_on(one, 4) == go_on(two, 4)
    assert one.log.events == two.log.events


def test_a_state_file_may_have_more_epochs_than_the_episode_has_steps(tmp_path: Path):
    changes = {
        "decisions": {"kind": "event", "patience_s": 10},
        "episode": {"steps": 2, "carry_over": False},
    }
    env, other = (UavEnv("tiny", changes, world_seed=0) for _ in range(2))
    hover = np.full(env.drones, 4) if env.drones > 1 else 4
    env.reset(seed=1)
    for _ in range(6):
        env.step(hover)
    env.save().write(tmp_path / "state.npz")
    other.restore(tmp_path / "state.npz")
    assert other.step(hover)[4]["sim_time_s"] == env.step(hover)[4]["sim_time_s"] == 70.0
