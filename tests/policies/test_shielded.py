"""Shielded policies: no crash, and what the key of a scenario does with the same base."""

from __future__ import annotations

import pickle
from collections.abc import Sequence
from typing import Any

import pandas as pd
import pytest

import desim_uav as du
from desim_uav.commands.given import Command
from desim_uav.engine.base import RunSettings
from desim_uav.engine.des import Simulation
from desim_uav.engine.masks import Shield
from desim_uav.errors import DesimError, PolicyError, ScenarioError, SimulationError
from desim_uav.experiment.bench.measure import Recorder
from desim_uav.experiment.bench.run import information
from desim_uav.experiment.run import run
from desim_uav.model.random.streams import Purpose, Streams
from desim_uav.model.state import Observation
from desim_uav.policies.base import file_of
from desim_uav.policies.random import Random
from desim_uav.policies.shielded import Shielded
from desim_uav.scenario.load import load
from desim_uav.shipped import bench_folder, find_table, scenario_path
from desim_uav.world import World, build_world
from tests.engine.helpers import path_of, strip

SMALL: dict[str, Any] = {"drones.battery.autonomy_min": 12}
"""A battery with which drones often have to return, some of them above ``return_below``."""

NOISE = {"position_noise": {"probability": 0.5, "sigma_cells": 2.0}}
BY_EVENT = {"decisions": {"kind": "event", "patience_s": 45.5}}
CHANGES: dict[str, dict[str, Any]] = {
    "small batteries": SMALL,
    "noise": SMALL | NOISE,
    "by event": SMALL | BY_EVENT,
    "wind": {**SMALL, "wind_mps": [3.0, -2.0]},
    "giving way": {**SMALL, "separation_m": 60, "on_conflict": "hover_higher_index"},
}
SAME: dict[str, Any] = {"seeds": range(3), "episodes": 3, "engine": "des", "progress": False}


class Stubborn:
    """Chooses one action after the other, whatever the mask says."""

    ceiling = True

    def begin(self, world: World, streams: Streams, carried: bool = False) -> None:
        """Take the number of actions."""
        self._actions = len(world.actions)

    def act(self, observation: Observation, mask: Sequence[bool]) -> Command:
        """Return an action that depends on the step and the drone."""
        return (observation.step // 4 + observation.drone) % self._actions


def crashes(result: Any) -> int:
    return int(result.episodes["crashes"].sum())


def obeys_its_scenario(result: Any) -> bool:
    """Whether every drone did what the policy commanded, which the engine does if it is allowed."""
    told = result.steps[result.steps["action"].notna()]
    return bool((told["action"] == told["action_taken"]).all())


# ---- by hand


def shown(world: World, epochs: int) -> list[list[str]]:
    """What a shield leaves to drone 0 at each epoch while it hovers, by name."""
    settings = RunSettings((True,), carry_over=False)
    engine, shield = Simulation(world, settings), Shield(world, settings.ceilings)
    hover = [action.name for action in world.actions].index("HOVER")
    snapshot, found = engine.reset(path_of(world)), []
    for _ in range(epochs):
        (mask,) = shield.narrowed(engine, snapshot.masks)
        assert pickle.loads(pickle.dumps(shield)).narrowed(engine, snapshot.masks) == [mask]
        found.append([a.name for a, may in zip(world.actions, mask, strict=True) if may])
        snapshot = engine.step([hover])
    return found


EVERYTHING = ["FORWARD", "BACKWARD", "RIGHT", "LEFT", "HOVER"]


def test_a_return_counts_where_it_is_allowed_to_a_drone_that_cannot_hover_any_more():
    # From cell 0 a return takes 123.96 s, a hover 60 s, and four moves 240 s. At 300 s of 600 s the
    # return is allowed, so that the drone may hover until it has less than 183.96 s.
    world = strip([(0, 0)], battery={"autonomy_min": 10, "return_below": 0.5}, steps=9)
    *before, last = shown(world, 8)
    assert before == [EVERYTHING] * 5 + [[*EVERYTHING, "GOTO_CHARGING_STATION"]] * 2
    assert last == ["RIGHT", "GOTO_CHARGING_STATION"]


def test_a_return_that_would_be_allowed_too_late_does_not_count():
    # A return is allowed at 60 s of 600 s, so that only the moves count: 240 s. At 300 s a hover
    # would leave just as much, which is too little. A shield of the scenario allows it.
    world = strip([(0, 0)], battery={"autonomy_min": 10, "return_below": 0.1}, steps=9)
    *before, last = shown(world, 6)
    assert before == [EVERYTHING] * 5
    assert last == ["RIGHT"]


def test_a_drone_that_begins_too_far_from_all_stations_is_refused():
    world = strip([(0, 0)], battery={"autonomy_min": 2, "return_below": 0.1})
    with pytest.raises(SimulationError, match="a drone cannot reach a charging station any more"):
        run(world, Shielded(base=Random()), "random", 0)


# ---- as the key of a scenario


@pytest.mark.parametrize("more", [{}, NOISE, BY_EVENT], ids=["plain", "noise", "by event"])
@pytest.mark.parametrize("case", [f"case{number}" for number in range(4, 9)])
def test_a_random_policy_does_what_it_does_with_the_key_of_the_scenario(
    case: str, more: dict[str, Any]
):
    changes = {**SMALL, "drones.battery.return_below": 0.5, **more}
    key = du.run(case, {**changes, "drones.shielded": True}, policy="random", **SAME)
    own = du.run(case, changes, policy="shielded:random", **SAME)
    for name in ("steps", "requests", "episodes"):
        pd.testing.assert_frame_equal(getattr(own, name), getattr(key, name))
    assert crashes(own) == 0 < crashes(du.run(case, changes, policy="random", **SAME))
    assert obeys_its_scenario(own)


@pytest.mark.parametrize("base", [Random, Stubborn])
@pytest.mark.parametrize("change", CHANGES)
def test_no_drone_crashes_or_returns_earlier_than_it_may(change: str, base: Any):
    plain = 0
    for case in ("case4", "case8"):
        own = du.run(case, CHANGES[change], policy=Shielded(base=base()), **SAME)
        assert (crashes(own), obeys_its_scenario(own)) == (0, True)
        plain += crashes(du.run(case, CHANGES[change], policy=base(), **SAME))
    assert plain > 0


@pytest.mark.parametrize("base", ["random", "greedy:horizon=5"])
def test_no_drone_crashes_in_a_frozen_scenario(base: str):
    task = bench_folder() / "endurance-small.yaml"
    own = du.run(task, policy=f"shielded:{base}", episodes=2, progress=False)
    assert (crashes(own), obeys_its_scenario(own)) == (0, True)


def test_returns_of_frozen_scenarios_count_everywhere():
    """They are allowed early enough, so that a shielded policy may do what the key allows."""
    for size in ("small", "medium", "large"):
        task = bench_folder() / f"endurance-{size}.yaml"
        for own in build_world(load(task), 0).types:
            assert (own.needs(True) == own.needs(True, early=False)).all()


# ---- in planners and in the benchmark


@pytest.mark.parametrize("policy", ["shielded:rollout:random+{}", "rollout:shielded:random+{}"])
def test_rollouts_under_a_shield_and_of_a_shielded_base(policy: str):
    told = policy.format("samples=1+horizon=2")
    own = du.run("case4", SMALL, policy=told, seed=1, episodes=2, progress=False)
    assert (crashes(own), obeys_its_scenario(own)) == (0, True)


@pytest.mark.parametrize("more", [{}, NOISE], ids=["plain", "noise"])
def test_a_policy_that_is_shown_no_future_is_shielded_in_the_same_way(more: dict[str, Any]):
    world = build_world(load(scenario_path("case4"), {**SMALL, **more}), 0)
    seen = run(world, Recorder(Shielded(base=Stubborn()), 0), "seen", 0, 2)
    plain = run(world, Shielded(base=Stubborn()), "plain", 0, 2)
    pd.testing.assert_frame_equal(seen.steps, plain.steps)


def test_what_a_shielded_policy_is_and_knows():
    scenario = load(scenario_path("case8"))
    besides = "for its shield the map, and the places and batteries of the drones now"
    assert information("shielded:random", scenario) == f"nothing; {besides}"
    assert information("shielded:case8.npz", scenario) == (
        f"{information('case8.npz', scenario)}; {besides}"
    )
    assert file_of("shielded:case8.npz") == find_table("case8.npz")
    assert (Shielded("clairvoyant").clairvoyant, Shielded("greedy").clairvoyant) == (True, False)
    assert Shielded("ppo_case8.npz").observation == du.load_policy("ppo_case8.npz").observation


def test_a_shielded_policy_remembers_what_its_base_does():
    world = build_world(load(scenario_path("case4")), 0)
    settings = RunSettings((True,) * 2, carry_over=False)
    engine, one, other = Simulation(world, settings), Shielded("random"), Shielded("random")
    snapshot = engine.reset(du.draw(world, 0, 0))
    for policy, seed in ((one, 1), (other, 2)):
        policy.begin(world, Streams(seed, Purpose.LEARNER))
        policy.watch(engine)
    other.remember(one.memory())
    for _ in range(5):
        asked = snapshot.observations, snapshot.masks
        assert one.act_jointly(*asked) == other.act_jointly(*asked)


# ---- refused


REFUSED: dict[str, tuple[str, dict[str, Any], str]] = {
    "no battery": ("case1", {}, "no drone has a battery that could be empty"),
    "free flight": ("case4", {"drones.motion.space": "free"}, "drones that fly freely"),
}
OF_KEY: dict[str, dict[str, Any]] = {
    "a short battery": {"drones.battery.autonomy_min": 1},
    "noise and giving way": {
        **NOISE,
        "separation_m": 20,
        "on_conflict": "hover_higher_index",
    },
}


@pytest.mark.parametrize("what", REFUSED)
def test_where_no_shield_can_hold(what: str):
    case, changes, words = REFUSED[what]
    with pytest.raises(PolicyError, match=f"policy 'shielded:hover': .*{words}"):
        du.run(case, changes, policy="shielded:hover", progress=False)


@pytest.mark.parametrize("what", OF_KEY)
def test_the_words_are_those_of_the_key(what: str):
    with pytest.raises(ScenarioError) as of_key:
        load(scenario_path("case4"), {**OF_KEY[what], "drones.shielded": True})
    with pytest.raises(DesimError) as own:
        du.run("case4", OF_KEY[what], policy="shielded:hover", progress=False)
    words = str(own.value).removeprefix("policy 'shielded:hover': ")
    assert words != str(own.value)
    assert words in str(of_key.value)


def test_a_shield_needs_its_base():
    with pytest.raises(PolicyError, match="a shield needs its base: shielded:BASE"):
        du.load_policy("shielded")
    with pytest.raises(PolicyError, match="unknown policy 'greddy'"):
        du.load_policy("shielded:greddy")
