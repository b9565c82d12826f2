"""Policies for drones that fly freely beside drones that fly from cell to cell."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from typing import Any

import pytest

from desim_uav.engine.base import EpisodeLog
from desim_uav.engine.choose import ENGINES
from desim_uav.errors import DesimError, PolicyError, ScenarioError, SimulationError
from desim_uav.experiment import tables
from desim_uav.experiment.run import play
from desim_uav.learning.training import Training
from desim_uav.model.random.streams import Purpose, Streams
from desim_uav.model.rules import Action
from desim_uav.model.state import Observation
from desim_uav.optimum.paper_model import refuse_other_models
from desim_uav.policies import load_policy
from desim_uav.policies.base import PolicyLike
from desim_uav.shipped import find_table
from desim_uav.world import World
from tests.engine.helpers import strip

EACH = [one if one == "des" else pytest.param(one, marks=pytest.mark.thorough) for one in ENGINES]
SPEEDS = {"max_speed_mps": 8.3, "max_acceleration_mps2": 4.0}
BY_CELLS = {**SPEEDS, "timing": "minimum_time"}
FREE = {**SPEEDS, "space": "free", "margin_m": 10}


def fleet(kinds: Sequence[str], starts: Sequence[Any], **changes: Any) -> World:
    """Drones of kinds (``cells`` or ``free``) over ten times ten cells of 240 m."""
    plain = {"count": 1, "footprint_radius_m": 300, "bandwidth_kbps": None, "battery": None}
    types = [
        {
            "name": f"type{k}",
            **plain,
            **changes.get("own", {}),
            "motion": FREE if kind == "free" else BY_CELLS,
            "start_cells": [start],
        }
        for k, (kind, start) in enumerate(zip(kinds, starts, strict=True))
    ]
    others = {key: value for key, value in changes.items() if key != "own"}
    return strip(**{"cells": (10, 10), "steps": 45, **others, "drones": types})


def flown(world: World, policy: PolicyLike, engine: str = "des", **settings: Any) -> EpisodeLog:
    (log, _), *_ = play(
        world, load_policy(policy), "mine", 0, engine=engine, keep_events=True, **settings
    )
    return log


STARTS = [(5, 9), (8, 3), (1, 3), (0, 0), (9, 9)]
USERS = [(x, y) for x in (300, 1210, 2000) for y in (480, 1300, 1900)]


@pytest.mark.parametrize("engine", EACH)
def test_the_baseline_flies_the_routes_of_a_fleet_by_cells(engine: str):
    """With the same limits and in minimum time: each event at the same time, to a microsecond."""
    cells = flown(fleet(["cells"] * 5, STARTS, users=USERS), "baseline", engine)
    kinds = ["free", "cells", "free", "cells", "free"]
    mixed = flown(fleet(kinds, STARTS, users=USERS), "baseline", engine)
    assert len(cells.events) == len(mixed.events) > 500
    one, other = (sorted((e[2:], e[1], e[0]) for e in log.events) for log in (cells, mixed))
    for before, after in zip(one, other, strict=True):
        assert before[:2] == after[:2] and abs(before[2] - after[2]) <= 1, (before, after)


def limited(**changes: Any) -> World:
    """A drone by cells and a free one with batteries, which return."""
    battery = {"autonomy_min": 12, "return_below": 0.6}
    stations = {"count": 2, "radius_m": 480}
    return fleet(
        ["cells", "free"],
        [(2, 2), (7, 7)],
        **{"stations": stations, "users": USERS, "steps": 30, "own": {"battery": battery}},
        **changes,
    )


@pytest.mark.parametrize("policy", ["baseline", "random", "hover"])
def test_each_drone_takes_actions_of_its_own_kind(policy: str):
    log = flown(limited(), policy)
    actions = [{step.action_taken for step in log.steps if step.drone == d} for d in range(2)]
    moves = {Action.FORWARD, Action.BACKWARD, Action.LEFT, Action.RIGHT}
    assert Action.FLY not in actions[0] and not actions[1] & moves
    if policy != "hover":
        assert Action.GOTO_CHARGING_STATION in actions[0] & actions[1]
        assert Action.FLY in actions[1]


@pytest.mark.thorough
@pytest.mark.parametrize("policy", ["baseline", "random", "hover"])
def test_both_engines_are_equal(policy: str):
    one, other = (flown(limited(), policy, engine) for engine in ENGINES)
    assert (one.events, one.legs, one.steps) == (other.events, other.legs, other.steps)


@pytest.mark.parametrize("policy", ["baseline", "random"])
def test_what_a_policy_remembers_can_be_kept(policy: str):
    world, policies = limited(), [load_policy(policy) for _ in range(2)]
    (log, _), *_ = play(world, policies[0], policy, 0, keep_events=True)
    assert log.steps
    policies[1].begin(world, Streams(0, Purpose.LEARNER), carried=False)
    told: Any = policies[0]
    remembered = json.loads(json.dumps(told.memory()))
    other: Any = policies[1]
    other.remember(remembered)
    assert other.memory() == told.memory()


def test_a_function_answers_each_drone_in_its_own_way():
    def choose(observation: Observation, mask: Sequence[bool]) -> Any:
        return [0.5, 0.0, -1.0] if observation.drone else "right"

    log = flown(limited(), choose)
    assert {step.action_taken for step in log.steps if step.drone == 0} >= {Action.RIGHT}
    assert {step.action_taken for step in log.steps if step.drone == 1} >= {Action.FLY}
    table = tables.steps_table([log], limited())
    assert table["aim_x"][table["drone"] == 0].isna().all()
    assert (table["aim_x"][table["drone"] == 1] == 0.5).any()


@pytest.mark.parametrize(
    ("chosen", "says"),
    [
        (lambda seen, mask: Action.RIGHT, "'right' is not an action of drone 1; allowed: hover, "),
        (lambda seen, mask: "fly", "'fly' is not an action of drone 0; allowed: forward, "),
        (lambda seen, mask: "up", "'up' is not an action of drone 0"),
    ],
)
def test_an_action_of_the_other_kind_is_refused(chosen: Any, says: str):
    with pytest.raises(PolicyError, match=says):
        flown(limited(), chosen)


@pytest.mark.parametrize(
    ("drone", "answer", "allowed"),
    [
        (0, [0.5, 0.0, -1.0], "the index of an action, a whole number: 0 (forward), "),
        (1, [0.5, 0.0], "3 finite numbers, or the index of an action: 4 (hover), "),
        (1, [0.5, 0.0, math.nan], "3 finite numbers, or"),
        (1, [0.5, 0.0, "up"], "3 finite numbers, or"),
        (1, 0.5, "3 finite numbers, or"),
    ],
)
def test_commands_of_the_other_kind_are_refused(drone: int, answer: Any, allowed: str):
    with pytest.raises(SimulationError) as error:
        flown(limited(), lambda seen, mask: answer if seen.drone == drone else 4)
    assert f"it returned {answer!r} for drone {drone}; allowed: {allowed}" in str(error.value)


def test_learners_with_tables_and_bounds_need_drones_by_cells():
    with pytest.raises(ScenarioError, match="a learner with a table needs drones that fly from"):
        Training(limited(), 0)
    with pytest.raises(DesimError, match=r"space: free: .* with cells"):
        refuse_other_models(limited().scenario, several_types=True)


def test_a_network_needs_drones_of_one_kind():
    file = str(find_table("ppo_festival.npz"))
    with pytest.raises(ScenarioError, match="a network needs drones of one of the two kinds"):
        flown(limited(), file)
