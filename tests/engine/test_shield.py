"""Shielded drones: masks by hand, and no crash under random commands in any scenario."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from itertools import count, islice
from typing import Any

import numpy as np
import pytest

from desim_uav.engine.base import RunSettings
from desim_uav.engine.choose import make_engine
from desim_uav.errors import ScenarioError, SimulationError
from desim_uav.model.rules import Action
from desim_uav.optimum.paper_model import refuse_other_models
from desim_uav.sample_path import draw
from desim_uav.scenario.load import from_mapping, load
from desim_uav.scenario.schema import Scenario
from desim_uav.shipped import scenario_path
from desim_uav.world import World, build_world
from tests.engine import random_all, random_free, random_tasks
from tests.engine.helpers import US, Flight, path_of, some_command, strip
from tests.verification.engines import differences, engines

SHIELDED = {"drones": {"shielded": True}}


def allowed(flight: Flight, epoch: int) -> list[str]:
    """What the mask of drone 0 allows at an epoch, by name."""
    pairs = zip(flight.world.actions, flight.shown[epoch].masks[0], strict=True)
    return [action.name for action, may in pairs if may]


def shielded_strip(minutes: float, start: int, **changes: Any) -> World:
    """A station on cell 4 of a row of nine; a hop takes 30.99 s, and a move a step of 60 s."""
    battery = {"autonomy_min": minutes, "return_below": 0.1}
    return strip([(start, 0)], battery=battery, **{**SHIELDED, **changes})


# ---- by hand


@pytest.mark.usefixtures("every_engine")
def test_a_drone_hovers_while_it_reaches_a_station_after_it():
    # From cell 0 a return takes 123.96 s, and a step 60 s: it may hover with more than 183.96 s.
    world = shielded_strip(10, 0, steps=9)
    flight = Flight(world)
    log = flight.episode(path_of(world))
    everything = ["FORWARD", "BACKWARD", "RIGHT", "LEFT", "HOVER"]
    assert [allowed(flight, epoch) for epoch in range(7)] == [everything] * 7
    assert [step.charge for step in log.steps[5:7]] == [240 * US, 180 * US]
    assert allowed(flight, 7) == ["RIGHT", "GOTO_CHARGING_STATION"], "above its return_below"
    assert log.steps[7].action is Action.HOVER
    assert log.steps[7].action_taken is Action.GOTO_CHARGING_STATION
    assert log.crashes == 0
    assert log.charges == 0 and log.steps[-1].mode.name == "RETURNING"


@pytest.mark.usefixtures("every_engine")
def test_without_a_shield_the_same_drone_may_do_everything():
    world = shielded_strip(10, 0, steps=11, drones={"shielded": False})
    flight = Flight(world)
    assert flight.episode(path_of(world)).crashes == 1
    assert allowed(flight, 7) == ["FORWARD", "BACKWARD", "RIGHT", "LEFT", "HOVER"]


@pytest.mark.usefixtures("every_engine")
def test_a_return_that_would_lead_astray_is_forbidden_and_a_move_is_not():
    # From cell 5 to the station on 4 it is one hop. A drone that believes to be on 3 hops to 6
    # first: 92.97 s. With 80 s left it has to move: a step of 60 s. Where it may err, only moves
    # count, so that from cell 5 it needs 60 s after a hover of 60 s.
    noise = {"position_noise": {"probability": 0.1, "sigma_cells": 1.0}}
    world = shielded_strip(200 / 60, 5, steps=4, **noise)
    astray = path_of(world, error=[[(0, 0), (0, 0), (-2, 0), (0, 0), (0, 0)]])
    flight = Flight(world)
    log = flight.episode(astray, "hover hover goto")
    assert allowed(flight, 1) == ["FORWARD", "BACKWARD", "LEFT", "HOVER"]
    assert allowed(flight, 2) == ["LEFT"]
    assert log.steps[2].action_taken is Action.LEFT
    assert log.crashes == 0
    right = Flight(world)
    right.episode(path_of(world, error=[[(0, 0)] * 5]), "hover hover goto")
    assert allowed(right, 2) == ["LEFT", "GOTO_CHARGING_STATION"]


@pytest.mark.usefixtures("every_engine")
def test_a_drone_that_begins_too_far_from_all_stations_is_refused():
    world = shielded_strip(2, 0)
    with pytest.raises(SimulationError, match="shielded: a drone cannot reach a charging station"):
        Flight(world).episode(path_of(world))


def test_a_battery_that_holds_one_hover_is_refused():
    with pytest.raises(ScenarioError, match="does not last longer than a hover of 60 s"):
        shielded_strip(1, 4)
    shielded_strip(1.01, 4)


def test_noise_beside_drones_that_give_way_is_refused():
    changes: dict[str, Any] = {
        "position_noise": {"probability": 0.1},
        "separation_m": 20,
        "on_conflict": "hover_higher_index",
    }
    with pytest.raises(ScenarioError, match=r"shielded: true: not beside position_noise and on_co"):
        shielded_strip(10, 4, **changes)
    del changes["position_noise"]
    shielded_strip(10, 4, **changes)


def test_bounds_are_refused():
    world = shielded_strip(10, 4)
    with pytest.raises(ScenarioError, match=r"drones\.shielded: true: the optimum can be computed"):
        refuse_other_models(world.scenario)


# ---- at random


def with_shields(made: Mapping[str, Any], shielded: bool = True) -> dict[str, Any]:
    """A scenario all of whose drones are shielded or not, of longer episodes."""
    drones = made["drones"]
    if isinstance(drones, Mapping):
        drones = {**drones, "shielded": shielded}
    else:
        drones = [{**each, "shielded": shielded} for each in drones]
    return {**made, "drones": drones, "episode": {**made["episode"], "steps": 30}}


MAKERS = {
    "all": random_all.one_of_all,
    "free": random_free.scenario,
    "tasks": random_tasks.scenario,
}


def scenarios(maker: str, first: int, many: int) -> Iterator[tuple[int, dict[str, Any]]]:
    """So many random scenarios with batteries that shields do not refuse, by seed."""
    yield from islice(_fitting(maker, first), many)


def _fitting(maker: str, first: int) -> Iterator[tuple[int, dict[str, Any]]]:
    for seed in count(first):
        made = MAKERS[maker](seed)
        try:
            if not build_world(from_mapping(with_shields(made)), seed).scenario.limited_battery:
                continue
        except ScenarioError:  # some worlds have a station in a building
            continue
        yield seed, made


def crashes_of(scenario: Scenario, seed: int, engine: str = "batch") -> tuple[int, int]:
    """The crashes and charges of two episodes under random commands, half of which have ceilings.

    One of seven commands is any number, allowed or not.
    """
    world, rng = build_world(scenario, seed), np.random.default_rng(seed)
    ceilings = tuple((rng.random(scenario.drone_count) < 0.5).tolist())
    told = RunSettings(ceilings, scenario.episode.carry_over, keep_events=False)
    player, crashes, charges = make_engine(engine, world, told), 0, 0
    for episode in range(2):
        shown = player.reset(draw(world, seed, episode))
        while not (shown.terminated or shown.truncated):
            assert all(map(any, shown.masks)), "something is allowed"
            shown = player.step([some_command(world, mask, rng) for mask in shown.masks])
        crashes, charges = crashes + player.log.crashes, charges + player.log.charges
    return crashes, charges


def fly_random_scenarios(maker: str, first: int, many: int) -> None:
    """Fly random scenarios with shields, and for comparison without."""
    plain = 0
    for seed, made in scenarios(maker, first, many):
        shielded = from_mapping(with_shields(made))
        assert crashes_of(shielded, seed, "des")[0] == 0, seed
        plain += crashes_of(from_mapping(with_shields(made, False)), seed, "des")[0]
    assert plain > many, "without shields they do"


@pytest.mark.thorough
@pytest.mark.parametrize("maker", MAKERS)
def test_shielded_drones_never_crash_in_random_scenarios(maker: str):
    fly_random_scenarios(maker, 0, 7)


@pytest.mark.slow
@pytest.mark.parametrize("maker", MAKERS)
def test_shielded_drones_never_crash_in_many_random_scenarios(maker: str):
    fly_random_scenarios(maker, 14, 53)


@pytest.mark.thorough
def test_engines_agree_on_shielded_drones():
    for seed, made in scenarios("all", 0, 3):
        world, rng = (
            build_world(from_mapping(with_shields(made)), seed),
            np.random.default_rng(seed),
        )
        ceilings = tuple((rng.random(world.scenario.drone_count) < 0.5).tolist())
        one, other = engines(world, ceilings)
        assert [name for k in range(2) for name in differences(one, other, seed, k)] == [], seed


SMALL: dict[str, Any] = {"drones.battery.autonomy_min": 12}
"""A battery with which drones often have to return."""

FREE = {**SMALL, "drones.motion.space": "free"}
CHANGES: dict[str, dict[str, Any]] = {
    "as it is": {},
    "small batteries": SMALL,
    "noise": {**SMALL, "position_noise": {"probability": 0.5, "sigma_cells": 2.0}},
    "wind": {**SMALL, "wind_mps": [3.0, -2.0]},
    "by event": {**SMALL, "decisions": {"kind": "event", "patience_s": 45.5}},
    "free": FREE,
    "free, by event": {**FREE, "decisions": "event"},
    "giving way": {
        **SMALL,
        "separation_m": 60,
        "on_conflict": "hover_higher_index",
        "position_noise": None,
    },
    "rotary wing": {
        "drones.battery": {"kind": "rotary_wing", "capacity_wh": 40, "return_below": 0.1}
    },
}
CASES = ("case4", "case5", "case6", "case7", "case8", "case9", "street_canyon")


def fly_cases(change: str, seeds: range) -> None:
    """Fly the cases with shields on many seeds, and for comparison without on two of them."""
    plain = 0
    for name in CASES:
        for shield in (True, False):
            changes = {**CHANGES[change], "drones.shielded": shield}
            scenario = load(scenario_path(name), changes)
            for seed in seeds if shield else seeds[:2]:
                crashes, _ = crashes_of(scenario, seed)
                assert not (shield and crashes), (name, seed)
                plain += crashes
    assert plain > 0, "without shields they do"


@pytest.mark.thorough
@pytest.mark.parametrize("change", CHANGES)
def test_shielded_drones_never_crash_in_the_cases(change: str):
    fly_cases(change, range(3))


@pytest.mark.slow
@pytest.mark.parametrize("change", CHANGES)
def test_shielded_drones_never_crash_in_the_cases_on_many_seeds(change: str):
    fly_cases(change, range(3, 40))
