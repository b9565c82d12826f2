"""Commands that choose the share of tasks that is offloaded: worlds by hand, and both engines."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from desim_uav import UavEnv, UavParallelEnv, load_policy
from desim_uav.engine.base import EpisodeLog
from desim_uav.engine.choose import ENGINES
from desim_uav.errors import ScenarioError
from desim_uav.experiment import tables
from desim_uav.experiment.run import play
from desim_uav.learning.training import Training
from desim_uav.model.rules import Action, Mode, Variant, actions, free_actions
from desim_uav.policies.planning.ground import grounds_of
from desim_uav.scenario.load import from_mapping
from desim_uav.world import World, build_world
from tests.engine.helpers import (
    US,
    Ask,
    Flight,
    check_that_the_other_engine_goes_on,
    path_of,
    seen,
)
from tests.engine.random_parts import accepted
from tests.engine.random_tasks import scenario
from tests.engine.test_offloading import AWAY, RADIO, ask
from tests.engine.test_transfers import FAR
from tests.masks import mask
from tests.selection import by_default
from tests.verification.engines import differences, engines

COMMANDED = {"kind": "commanded", "shares": [0, 0.5, 1]}

every_engine = pytest.mark.usefixtures("every_engine")


def choosing(
    users: Sequence[tuple[float, float]] = (FAR,), offloading: Any = None, **more: Any
) -> World:
    """A drone that hovers over one cell; a user at FAR sends 1 Mbit/s, and computes with 1 GHz."""
    motion, cells = more.pop("motion", {}), more.pop("cells", (1, 1))
    described = {
        "map": {"size_m": [600, 700], "cells": cells, "dimensions": 2},
        "drones": {
            "count": 1,
            "radio": RADIO,
            "battery": None,
            "start_cells": [[0, 0]],
            "processor": {"cores": 2, "ghz": 2},
            "motion": motion,
        },
        "stations": {"count": 0},
        "users": {"positions_m": users, "mobility": {"kind": "static"}, "processor": {"ghz": 1}},
        "services": {"task": {"kind": "compute", "input_mbit": [1], "cycles_per_bit": [1000]}},
        "offloading": offloading or COMMANDED,
        "demand": {"kind": "static", "mix": {"task": 1}},
        "reward": {"kind": "coverage_battery"},
        "episode": {"steps": 4, "step_s": 60},
    }
    return build_world(from_mapping({**described, **more}), 0)


def flown(world: World, asks: dict[int, Sequence[Ask]], *told: Any) -> EpisodeLog:
    """An episode whose drone hears these commands, and then hovers."""
    flight = Flight(world)
    shown, heard = flight.engine.reset(path_of(world, asks)), iter(told)
    while not (shown.terminated or shown.truncated):
        now = next(heard, "hover+1")
        shown = flight.engine.step([flight.command(now) if isinstance(now, str) else now])
    return flight.engine.log


def parts(log: EpisodeLog) -> list[float]:
    return [one.part for one in sorted(log.requests, key=lambda one: one.t_request_us)]


# ---- by hand


@every_engine
def test_each_step_has_the_share_that_was_commanded() -> None:
    """6 Mbit take 6 s alone and 6 s + 3 s offloaded; half of it 3 s alone, and 3 s + 1.5 s."""
    world = choosing()
    log = flown(world, {0: [ask(60.0 * k + 1, 6.0) for k in range(3)]}, "hover+0.5", "hover+0")
    assert parts(log) == [0.5, 0.0, 1.0]
    took = [one.t_end_us - one.t_request_us for one in log.requests]
    assert took == [4_500_000, 6 * US, 9 * US]
    steps = tables.steps_table([log], world)
    assert steps["action_taken"].tolist() == ["hover+0.5", "hover+0", "hover+1", "hover+1"]
    assert log.steps[0].action == Variant(Action.HOVER, share=0.5)


@every_engine
def test_a_task_of_nobodys_user_is_decided_when_its_user_is_attached() -> None:
    """Whoever is attached to nobody offloads all, and waits; the drone then flies there."""
    world = choosing([AWAY])
    log = flown(world, {0: [ask(1.0, 6.0)]}, "hover+0")
    assert parts(log) == [1.0]
    assert log.requests[0].outcome == "never_served"
    for name, part in (("forward+0.5", 0.5), ("forward+0", 0.0)):
        log = flown(choosing([AWAY], cells=(1, 2)), {0: [ask(1.0, 6.0)]}, "hover+1", name)
        assert parts(log) == [part]
        attached_us = seen(log, "attach")[0][0]
        assert attached_us > 60 * US
        alone_s = 6.0 * (1.0 - part)
        assert log.requests[0].t_end_us - attached_us >= alone_s * US


@every_engine
def test_free_drones_choose_a_share_between_the_ends() -> None:
    world = choosing(offloading={"kind": "commanded", "shares": [0.2, 1]}, motion={"space": "free"})
    assert world.commands.names == ("aim_x", "aim_y", "aim_share")
    asks = {0: [ask(60.0 * k + 1, 6.0) for k in range(4)]}
    log = flown(world, asks, [0.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 0.0, 7.0], "hover+0.2")
    assert parts(log) == pytest.approx([0.6, 0.2, 1.0, 0.2])
    frame = tables.steps_table([log], world)
    assert frame["aim_share"].tolist() == [0.0, -1.0, 7.0, 0.0]
    assert frame["action_taken"].tolist() == ["fly", "fly", "fly", "hover+0.2"]


@every_engine
def test_a_drone_that_is_asked_by_event_keeps_its_share_until_it_is_asked_again() -> None:
    for motion, told in (({}, ["hover+0"]), ({"space": "free"}, [[0.0, 0.0, -1.0]])):
        world = choosing(motion=motion, decisions={"kind": "event", "patience_s": 45})
        log = flown(world, {0: [ask(44.0, 0.5), ask(46.0, 0.5)]}, *told)
        assert parts(log) == [0.0, 1.0]


@every_engine
@pytest.mark.parametrize("carry_over", [True, False])
@pytest.mark.parametrize("motion", [{}, {"space": "free"}], ids=["cells", "free"])
def test_before_its_first_command_a_drone_has_the_lowest_share(motion: Any, carry_over: bool):
    """A task of the time 0 is made before the first command; that of an earlier episode is over."""
    world = choosing(
        motion=motion,
        offloading={"kind": "commanded", "shares": [0.25, 1]},
        episode={"steps": 1, "step_s": 60, "carry_over": carry_over},
    )
    everything = [0.0, 0.0, 1.0] if motion else "hover+1"
    flight = Flight(world, carry_over=carry_over)
    for _ in range(2):
        shown = flight.engine.reset(path_of(world, {0: [ask(0.0, 0.5), ask(20.0, 0.5)]}))
        while not (shown.terminated or shown.truncated):
            told = everything if motion else flight.command(everything)
            shown = flight.engine.step([told])
        assert parts(flight.engine.log) == [0.25, 1.0]


@every_engine
def test_a_command_that_goes_on_in_the_next_episode_keeps_its_share() -> None:
    for motion, told in (({}, "hover+1"), ({"space": "free"}, [0.0, 0.0, 1.0])):
        world = choosing(
            motion=motion,
            decisions={"kind": "event", "patience_s": 45},
            episode={"steps": 1, "step_s": 60, "carry_over": True},
        )
        flight = Flight(world, carry_over=True)
        for _ in range(2):  # it is asked at 0 and 45 s, and then 30 s later
            shown = flight.engine.reset(path_of(world, {0: [ask(0.0, 0.5), ask(29.0, 0.5)]}))
            while not (shown.terminated or shown.truncated):
                shown = flight.engine.step([told if motion else flight.command(told)])
        assert parts(flight.engine.log) == [1.0, 1.0]


# ---- names, masks


def test_actions_multiply_and_those_of_charging_are_the_last() -> None:
    made = actions(False, True, (5.0, 20.0), (0.0, 0.5))
    names = [action.name.lower() for action in made]
    assert names[:5] == ["forward@5+0", "backward@5+0", "right@5+0", "left@5+0", "hover+0"]
    assert names[5:10] == [*(f"{move}@20+0" for move in ("forward", "backward", "right", "left")),
                           "forward@5+0.5"]  # fmt: skip
    assert names[-2:] == ["goto_charging_station", "charge"]
    assert len(set(names)) == len(names) == 2 * (4 * 2 + 1) + 2
    free = [action.name.lower() for action in free_actions(True, (0.0, 1.0))]
    assert free == ["fly", "hover+0", "hover+1", "goto_charging_station", "charge"]


@pytest.mark.parametrize("mode", Mode)
def test_a_drone_without_a_choice_has_one_action(mode: Mode) -> None:
    made = actions(True, True, (5.0, 20.0), (0.0, 0.5))
    marks = mask(made, mode, False, False)
    allowed = [action.name for action, mark in zip(made, marks, strict=True) if mark]
    only = {Mode.CRASHED: "HOVER+0.5", Mode.RETURNING: "GOTO_CHARGING_STATION"}
    if mode in (Mode.FLYING, Mode.CHARGED):
        assert len(allowed) == 2 * (6 * 2 + 1)
    else:
        assert allowed == [only.get(mode, "CHARGE")]


@every_engine
def test_a_drone_under_way_has_one_action() -> None:
    world = choosing(motion={"space": "free"}, decisions={"kind": "event", "patience_s": 100})
    flight = Flight(world)
    shown = flight.engine.reset(path_of(world))
    assert shown.masks[0] == (True,) * 4
    shown = flight.engine.step([[0.0, 0.0, 1.0]])
    if not (shown.terminated or shown.truncated):
        assert sum(shown.masks[0]) in (1, 4)


# ---- who chooses


def taken(world: World, policy: Any) -> list[str]:
    loaded = load_policy(policy) if isinstance(policy, str) else policy
    ((log, _),) = play(world, loaded, "mine", seed=0)
    return [step.action_taken.name.lower() for step in log.steps]


def test_scripts_and_functions_name_the_share_or_take_the_highest(tmp_path: Path) -> None:
    script = tmp_path / "mine.csv"
    script.write_text("step,drone,action\n0,0,hover+0\n1,0,hover\n2,0,hover+0.5\n")
    assert taken(choosing(), f"script:{script}") == ["hover+0", "hover+1", "hover+0.5", "hover+1"]
    choices = ["hover+0.5", Action.HOVER, Variant(Action.HOVER, share=0.0), 4]

    def mine(observation: Any, mask: Any) -> Any:
        return choices[observation.step]

    assert taken(choosing(), load_policy(mine)) == ["hover+0.5", "hover+1", "hover+0", "hover+0"]


@pytest.mark.parametrize("space", ["cells", "free"])
@pytest.mark.parametrize("policy", ["hover", "baseline", "random"])
def test_policies_fly_with_it(policy: str, space: str) -> None:
    names = set(taken(choosing(motion={"space": space}), policy))
    assert names <= {action.name.lower() for action in choosing(motion={"space": space}).actions}
    if policy == "hover":
        assert names == {"hover+1"}


def test_planners_offload_as_much_as_they_can() -> None:
    moves = grounds_of(choosing())[0].flights.moves
    assert moves[0] == Variant(Action.HOVER, share=1.0)
    assert {action.share for action in moves} == {1.0}  # type: ignore[union-attr]


def test_environments_have_an_action_for_each_move_and_share() -> None:
    changes = {"episode.carry_over": False}
    described = choosing().scenario
    env = UavEnv(described, changes, world_seed=0)
    assert env.action_space.n == 15
    _, info = env.reset(seed=0)
    assert info["action_mask"].sum() == 15
    many = UavParallelEnv(described, changes, world_seed=0)
    shown, _ = many.reset(seed=0)
    assert many.action_space("drone_0").n == 15
    assert shown["drone_0"]["action_mask"].sum() == 15
    env = UavEnv(choosing(motion={"space": "free"}).scenario, changes, world_seed=0)
    assert env.action_space.shape == (3,)


@pytest.mark.thorough
def test_both_engines_learn_the_same() -> None:
    tables_ = []
    for engine in ENGINES:
        training = Training(choosing([FAR, (300.0, 500.0)]), 0, engine)
        while training.episode < 6:
            training.play(6 - training.episode)
        tables_.append(training.q.copy())
    assert (tables_[0] == tables_[1]).all() and np.abs(tables_[0]).sum() > 0


@pytest.mark.parametrize(
    ("shares", "problem"),
    [
        ([0.5, 0.5], "must ascend; 0.5 follows 0.5"),
        ([1, 0], "must ascend; 0 follows 1"),
        ([], "at least 1"),
        ([0, 1.5], "must be at most 1"),
        ([-0.1, 1], "must be at least 0"),
        ([k / 10 for k in range(9)], "at most 8"),
        ("half", "must be a list"),
    ],
)
def test_shares_that_cannot_be_chosen_are_refused(shares: Any, problem: str) -> None:
    with pytest.raises(ScenarioError, match=problem):
        choosing(offloading={"kind": "commanded", "shares": shares})


# ---- random scenarios


def random_world(seed: int) -> World:
    """A random scenario with tasks, whose commands choose a share."""

    def made(number: int) -> dict[str, Any]:
        shares = [[0, 0.5, 1], [0.25, 0.8], [0, 1]][number % 3]
        return {**scenario(number), "offloading": {"kind": "commanded", "shares": shares}}

    return accepted(made, seed)


@pytest.mark.parametrize("seed", by_default([], range(40)))
def test_both_engines_are_equal(seed: int) -> None:
    world = random_world(seed)
    one, other = engines(world, (bool(seed % 2),) * world.scenario.drone_count)
    for episode in range(2):
        assert differences(one, other, seed, episode) == []


@pytest.mark.thorough
@pytest.mark.parametrize("name", ["des", "batch"])
@pytest.mark.parametrize("seed", range(3))
def test_saved_states_go_on_as_the_original(seed: int, name: str) -> None:
    check_that_the_other_engine_goes_on(random_world(seed), name, seed)
