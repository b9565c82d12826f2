"""Scripts that give commands of free flight, alone and beside actions of drones by cells."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

import desim_uav as du
from desim_uav.errors import PolicyError
from desim_uav.experiment import tables
from desim_uav.model.rules import Action
from desim_uav.policies import load_policy
from desim_uav.scenario.load import from_mapping
from desim_uav.world import World, build_world
from tests.policies.test_mixed_policies import EACH, USERS, fleet, flown, limited

Write = Callable[..., str]


@pytest.fixture
def script(tmp_path: Path) -> Write:
    numbers = iter(range(100))

    def write(columns: str, *rows: str) -> str:
        file = tmp_path / f"script{next(numbers)}.csv"
        file.write_text("\n".join([columns, *rows]) + "\n")
        return f"script:{file}"

    return write


def alone(**own: Any) -> World:
    """One free drone at (1320, 1320) m with 8.3 m/s and 4 m/s², in steps of 60 s."""
    return fleet(["free"], [(5, 5)], own=own, steps=4)


def choosing() -> dict[str, Any]:
    """Two drones over a map of three dimensions, which choose speeds and charge."""
    return {
        "seed": 0,
        "map": {"size_m": [1000, 1000], "cells": [5, 5], "dimensions": 3},
        "drones": {
            "count": 2,
            "motion": {"space": "free", "max_speed_mps": 12, "cruise": [3, 12]},
            "battery": {"autonomy_min": 6, "return_below": 0.9},
        },
        "stations": {"count": 1, "radius_m": 200},
        "users": {"count": 12},
        "episode": {"steps": 12},
    }


@pytest.mark.parametrize("engine", EACH)
def test_a_drone_flies_by_the_numbers_and_else_hovers(engine: str, script: Write):
    # Within a step of 60 s: 8.3 * (60 - 8.3 / 4) = 480.7775 m, and half of it.
    name = script("step,drone,action,aim_x,aim_y", "0,0,fly,0.5,0", "2,0,Fly,0,-1", "3,0,hover,1,")
    log = flown(alone(), name, engine)
    half, whole = 240.38875, 480.7775
    places = [(step.x_m, step.y_m) for step in log.steps]
    x = 1320.0 + half
    expected = [(x, 1320.0), (x, 1320.0), (x, 1320.0 - whole), (x, 1320.0 - whole)]
    assert [pytest.approx(place, abs=1e-9) for place in expected] == places
    assert [step.action_taken for step in log.steps] == [
        *(Action.FLY, Action.HOVER, Action.FLY, Action.HOVER)
    ]


def test_the_wish_to_charge_is_a_number_and_the_return_an_action(script: Write):
    battery = {"autonomy_min": 12, "return_below": 1.0}
    world = fleet(
        *(["free", "free"], [(5, 5), (7, 7)]),
        own={"battery": battery},
        stations={"count": 1, "radius_m": 0},
        steps=4,
    )
    columns = "drone,aim_charge,step,aim_x,aim_y,action"
    rows = ["0,,0,0.9,0,fly", "1,-1,0,0.9,0,fly", "0,1,1,0.1,0,fly", "1,,1,,,goto_charging_station"]
    log = flown(world, script(columns, *rows))
    taken = [[step.action_taken.name for step in log.steps[:4] if step.drone == d] for d in (0, 1)]
    assert taken == [["FLY", "GOTO_CHARGING_STATION"]] * 2


def test_each_drone_of_a_mixed_fleet_has_its_own_commands(script: Write):
    name = script(
        *("step,drone,action,aim_x,aim_y,aim_charge", "0,0,right,,,", "0,1,fly,0.25,-0.5,"),
        *("1,1,hover,,,", "1,0,left,0,0,0"),
    )
    log = flown(limited(), name)
    taken = [[step.action_taken.name for step in log.steps[:4] if step.drone == d] for d in (0, 1)]
    assert taken == [["RIGHT", "LEFT"], ["FLY", "HOVER"]]
    first = next(step for step in log.steps if step.drone == 1)
    assert (first.aim_x, first.aim_y) == (0.25, -0.5)


@pytest.mark.parametrize("kind", ["mixed", pytest.param("choosing", marks=pytest.mark.thorough)])
@pytest.mark.parametrize("policy", ["random", pytest.param("baseline", marks=pytest.mark.thorough)])
@pytest.mark.parametrize("engine", EACH)
def test_the_table_of_steps_is_a_script(policy: str, kind: str, engine: str, tmp_path: Path):
    """A run by the script of its steps has the same events, whatever policy it was."""
    world = limited() if kind == "mixed" else build_world(from_mapping(choosing()), 0)
    log = flown(world, policy, engine)
    file = tmp_path / "steps.csv"
    tables.steps_table([log], world).to_csv(file)
    again = flown(world, f"script:{file}", engine)
    assert len(log.events) > 100
    assert (again.events, again.legs) == (log.events, log.legs)
    actions = [(step.action_taken, step.charge) for step in log.steps]
    assert [(step.action_taken, step.charge) for step in again.steps] == actions


@pytest.mark.thorough
def test_it_goes_on_after_a_fork(script: Write):
    made = choosing()
    name = script("step,drone,action,aim_x,aim_y,aim_z,aim_cruise", "4,1,fly,-0.5,0.5,0,-1")
    found = du.counterfactual(made, policy="hover", to=name, fork=(0, 3))
    steps = found.other.steps.query("drone == 1")
    assert steps["action"].tolist() == ["hover"] * 4 + ["fly"] + ["hover"] * 7


XY = "step,drone,action,aim_x,aim_y"


@pytest.mark.parametrize(
    ("columns", "row", "told"),
    [
        (XY, "0,0,fly,1.5,0", "aim_x: '1.5': must be from -1 to 1"),
        (XY, "0,0,fly,0,-1.001", "aim_y: '-1.001': must be from -1 to 1"),
        (XY, "0,0,fly,nan,0", "aim_x: 'nan': must be from -1 to 1"),
        (XY, "0,0,fly,0,-inf", "aim_y: '-inf': must be from -1 to 1"),
        (XY, "0,0,fly,1e999,0", "aim_x: '1e999': must be from -1 to 1"),
        (XY, "0,0,hover,east,0", "aim_x: 'east': must be a number"),
        (XY, "0,0,fli,0,0", "action: 'fli': not an action (did you mean 'fly'?)"),
        (f"{XY},aim_charge", "0,0,fly,0,0,yes", "aim_charge: 'yes': must be a number"),
        (f"{XY},aim_cruise", "0,0,fly,0,0,8.3", "aim_cruise: '8.3': must be from -1 to 1"),
    ],
)
def test_numbers_that_cannot_be_read(columns: str, row: str, told: str, script: Write):
    name = script(columns, "9,0,hover,,", row)
    with pytest.raises(PolicyError) as error:
        load_policy(name)
    assert f"{name.removeprefix('script:')}:3: {told}" in str(error.value)


TWO, THREE = "to fly takes aim_x, aim_y", "to fly takes aim_x, aim_y, aim_charge only"


@pytest.mark.parametrize(
    ("columns", "row", "told"),
    [
        (XY, "0,1,fly,0.5,", f"aim_y: missing; {TWO}"),
        ("step,drone,action", "0,1,fly", f"aim_x: missing; {TWO}"),
        ("step,drone,action,aim_X,aim_y", "0,1,fly,1,1", f"aim_x: missing; {TWO}"),
        (f"{XY},aim_z", "0,1,fly,0,0,0.5", f"aim_z: 0.5: {THREE}"),
        (f"{XY},aim_cruise", "0,1,fly,0,0,-1", f"aim_cruise: -1: {THREE}"),
        (XY, "0,0,fly,0.5,0", "action: 'fly' is not an action of drone 0; allowed: forward, back"),
        (XY, "0,1,right,,", "action: 'right' is not an action of drone 1; allowed: hover, "),
        (XY, "0,2,fly,0,0", "drone: 2: must be from 0 to 1"),
    ],
)
def test_a_command_that_does_not_fit_its_drone(columns: str, row: str, told: str, script: Write):
    name = script(columns, "9,0,hover,,", row)
    with pytest.raises(PolicyError) as error:
        flown(limited(), name)
    assert f"{name.removeprefix('script:')}:3: {told}" in str(error.value)


def test_a_command_that_does_not_fit_the_scenario(script: Write):
    for world, row, told in (
        (
            alone(),
            "0,0,right,,",
            "action: 'right' is not an action of this scenario; allowed: fly, ",
        ),
        (alone(), "0,0,charge,,", "'charge' is not an action of this scenario"),
        (fleet(["cells"], [(5, 5)]), "0,0,fly,0,0", "action: 'fly' is not an action"),
    ):
        with pytest.raises(PolicyError) as error:
            flown(world, script(XY, row))
        assert f".csv:2: {told}" in str(error.value) or told in str(error.value)


def test_an_unlimited_drone_has_no_wish_to_charge(script: Write):
    world = fleet(["free"], [(5, 5)], users=USERS)
    with pytest.raises(PolicyError, match=r"aim_charge: 1: to fly takes aim_x, aim_y only"):
        flown(world, script(f"{XY},aim_charge", "0,0,fly,0,0,1"))
