"""The planner with learned numbers, and what its options mean."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from desim_uav.engine.base import RunSettings
from desim_uav.engine.choose import make_engine
from desim_uav.errors import PolicyError
from desim_uav.experiment.run import play
from desim_uav.policies import load_policy
from desim_uav.policies.base import file_of, parts
from desim_uav.policies.greedy import OPTIONS, Greedy
from desim_uav.policies.planner import ARRAY, SETTINGS, WEIGHTS, Planner
from desim_uav.policies.planning.best_plan import LOST
from desim_uav.policies.planning.ground import grounds_of
from desim_uav.policies.planning.sight import look
from desim_uav.policies.planning.team import Habits, TeamPlanner
from desim_uav.policies.weights_file import to_bytes
from desim_uav.sample_path import draw
from desim_uav.scenario.load import from_mapping
from desim_uav.world import World, build_world


def city(drones: int = 3) -> World:
    scenario = {
        "map": {"size_m": [1200, 1200], "cells": [5, 5], "dimensions": 2},
        "drones": {"count": drones, "footprint_radius_m": 300, "battery": {"autonomy_min": 12}},
        "stations": {"count": 2},
        "users": {"count": 20, "clusters": {"count": 3}},
        "demand": {"kind": "dynamic", "think_time_s": 60},
        "episode": {"steps": 12, "carry_over": True},
    }
    return build_world(from_mapping(scenario), 1)


def team_of(world: World, **habits: Any) -> TeamPlanner:
    simulation = make_engine("batch", world, RunSettings((True,) * len(world.starts), True))
    shown, grounds = simulation.reset(draw(world, 3, 0)), grounds_of(world)
    sight = look(simulation, grounds, shown.observations)
    return TeamPlanner(grounds, sight, Habits(12, 1.0, 5.0, 2, **habits))


def test_the_total_of_one_drone_is_the_value_of_its_best_plan() -> None:
    team = team_of(city(1), starts=2)
    assert team.total() <= LOST, "without a plan it crashes"
    team.improve(1)
    _, _, value = team._values(0)
    standing = team.sight.drones[0]
    best = value[standing.ready, standing.place, standing.units]
    assert team.total() == pytest.approx(best, rel=1e-9)


@pytest.mark.parametrize("share", [1.0, 0.6, 1.4])
def test_what_a_plan_gains_is_what_it_adds_to_the_total(share: float) -> None:
    """Whatever the others cover; what comes after the plan is in ``ends``."""
    team = team_of(city(), share=share, starts=2)
    team.improve(2)
    gained, _, _ = team._values(1)
    ground, plan, total = team.grounds[1], team.plans[1], team.total()
    gain = 0.0
    for tick, (action, place, _) in enumerate(plan.tolist()):
        if action < len(ground.after):
            to = ground.after[action, place]
            gain += gained[0, tick, 0, ground.cells[place]] + gained[1, tick, 0, ground.cells[to]]
    team.covers[1] = 0.0
    assert total - team.total() == pytest.approx(gain, rel=1e-9)


def test_more_starts_are_never_worse_and_sometimes_better() -> None:
    gains = []
    for seed in range(6):
        totals = []
        for starts in (2, 5):  # the first ones are the same
            team = team_of(city(), starts=starts)
            team.sight = team.sight._replace(left=12 + seed)  # by which orders are drawn
            team.improve(1)
            totals.append(team.total())
        gains.append(totals[1] - totals[0])
    assert min(gains) >= 0.0
    assert max(gains) > 0.01


def test_what_comes_later_counts_less_by_the_discount() -> None:
    plain, less = team_of(city()), team_of(city(), discount=0.1)
    for part in ("worth", "called"):
        expected = getattr(plain, part) * np.exp(-0.1 * np.arange(12))[:, None]
        assert getattr(less, part) == pytest.approx(expected)


def test_shares_follow_the_margin_and_the_spread() -> None:
    plain, wider = team_of(city()).shares[0], team_of(city(), margin=0.2).shares[0]
    assert (wider >= plain).all() and wider.sum() > plain.sum()
    sure = team_of(city(), spread=0.0).shares[0]
    assert set(np.unique(sure)) == {0.0, 1.0}


def actions(world: World, policy: Any) -> list[Any]:
    ((log, _),) = play(world, policy, "mine", seed=3, engine="batch")
    return [step.action for step in log.steps]


def test_it_begins_as_greedy_and_flies_by_its_weights() -> None:
    world = city()
    plans = actions(world, Greedy(**SETTINGS))
    assert actions(world, Planner(weights=WEIGHTS)) == plans
    other = Planner(weights=WEIGHTS)
    other.use(WEIGHTS | {"share": 0.0, "waiting": -3.0})
    assert other.options["waiting"] == OPTIONS["waiting"].least, "it is cut to what is allowed"
    assert actions(world, other) != plans, "all drones cover the same users"


def test_files_are_known_by_their_array_and_checked(tmp_path: Path) -> None:
    file = tmp_path / "own.npz"
    file.write_bytes(to_bytes(ARRAY, WEIGHTS, np.array([*WEIGHTS.values()]), {}))
    assert parts(str(file)) == ("planner", str(file))
    assert file_of(str(file)) == file
    assert load_policy(str(file)).weights == WEIGHTS  # type: ignore[attr-defined]
    file.write_bytes(to_bytes(ARRAY, {"else": 1.0}, np.ones(1), {}))
    with pytest.raises(PolicyError, match="its weights must be waiting, fade"):
        load_policy(str(file))
    with pytest.raises(PolicyError, match="a planner needs its file"):
        load_policy("planner")
