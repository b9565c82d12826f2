"""Commands that choose a cruise speed: worlds by hand, the reference, and both engines."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from desim_uav import UavEnv, load_policy
from desim_uav.engine.base import RunSettings
from desim_uav.engine.choose import ENGINES, make_engine
from desim_uav.experiment import tables
from desim_uav.experiment.run import play
from desim_uav.learning.training import Training
from desim_uav.model.energy.battery import Endurance
from desim_uav.model.rules import Action, Mode, Variant, fastest_of, kind_of, move_of
from desim_uav.policies.planning.ground import grounds_of
from desim_uav.report.tracks import Track
from desim_uav.sample_path import draw
from desim_uav.scenario.load import from_mapping
from desim_uav.world import World, build_world
from tests.engine.helpers import US, Flight, before_end, events, fly, path_of, seen, strip
from tests.engine.random_fleet import world_of
from tests.engine.test_energy import rotary
from tests.selection import by_default
from tests.verification.convergence import FINEST_S, SEEDS, case_of, cruising, sampled, slopes
from tests.verification.engines import differences, engines
from tests.verification.figure import check

CRUISE = {"cruise": [5, 20], "max_speed_mps": 20, "max_acceleration_mps2": 4}
"""240 m take 240 / 5 + 5 / 4 = 49.25 s, or 240 / 20 + 20 / 4 = 17 s."""
SLOW_US, QUICK_US = 49_250_000, 17_000_000

every_engine = pytest.mark.usefixtures("every_engine")


def choosing(starts: Any = ((0, 0),), battery: dict[str, Any] | None = None, **more: Any) -> World:
    """A row of nine cells whose drones choose between 5 and 20 m/s, with a station on cell 4."""
    drones = {"motion": CRUISE, "count": len(starts), "start_cells": starts, "battery": battery}
    drones |= {"footprint_radius_m": 100, "bandwidth_kbps": None}
    return strip(**{"stations": {"count": 1, "radius_m": 0}, **more, "drones": drones})


# ---- by hand


@every_engine
def test_a_move_is_flown_at_the_speed_that_was_chosen():
    # The user at 300 m is 100 m away when the drone has flown 80 m: slow after 1.25 s for the
    # first 3.125 m and 76.875 / 5 = 15.375 s; quick after 5 s for 50 m and 30 / 20 = 1.5 s. On the
    # next cell, a quick drone is 100 m beyond the user after 40 m, which take sqrt(2 * 40 / 4) s.
    world = choosing(users=[(300, 120)], steps=4)
    log = fly(world, path_of(world, {0: [(0, 240, 0)]}), "right@5 left@20 right@20 right@20")
    assert before_end(log, "enter", "exit", "depart", "arrive") == events("""
                0  10  depart  0
         16625000   4  enter   0  0
         49250000   3  arrive  0
         60000000  10  depart  0
         70500000   2  exit    0  0
         77000000   3  arrive  0
        120000000  10  depart  0
        126500000   4  enter   0  0
        137000000   3  arrive  0
        180000000  10  depart  0
        184472136   2  exit    0  0
        197000000   3  arrive  0
    """)
    assert log.distance_m == 4 * 240
    assert [leg.duration_us for leg in log.legs[1:]] == [SLOW_US, *3 * [QUICK_US]]


@every_engine
def test_tables_name_the_action_with_its_speed_and_masks_allow_all_of_them():
    world = choosing(steps=3)
    flight = Flight(world)
    log = flight.episode(path_of(world), "right@5 hover left@20")
    names = tables.steps_table([log], world)["action_taken"].tolist()
    assert names == ["right@5", "hover", "left@20"]
    first = log.steps[0]
    assert first.action == Variant(Action.RIGHT, 5.0)
    assert kind_of(first.action) is Action.RIGHT
    assert flight.shown[0].masks[0] == (True,) * 9


@every_engine
def test_each_speed_takes_the_energy_of_its_leg_and_of_the_hover_after_it():
    world = choosing(battery=rotary(30.0), steps=3)
    log = fly(world, path_of(world), "right@5 right@20 hover")
    energy: Any = world.only_type.drones.battery
    charges = [30 * 3_600_000_000, *(step.charge for step in log.steps)]
    used = [before - after for before, after in pairwise(charges)]
    rest_s, hover_w = (60 - 49.25, 60 - 17, 60), 168.48421774108203
    legs = [world.only_type.epoch_transits[Variant(Action.RIGHT, v)] for v in (5.0, 20.0)]
    flown_j = [energy.drains(leg, leg.duration_us) / 1e6 for leg in legs]
    assert flown_j == pytest.approx([7111.3, 2691.0], abs=0.05)
    expected = [flown + hover_w * s for flown, s in zip((*flown_j, 0.0), rest_s, strict=True)]
    assert [joules / 1e6 for joules in used] == pytest.approx(expected, abs=1e-4)


@every_engine
def test_a_drone_that_is_asked_by_event_is_asked_sooner_after_a_quick_move():
    world = choosing(decisions={"kind": "event", "patience_s": 45}, steps=2)
    flight = Flight(world)
    flight.episode(path_of(world), "right@5 right@20 hover left@20")
    decided = [event[0] for event in seen(flight.engine.log, "decide")]
    arrived = SLOW_US + QUICK_US
    assert decided == [0, SLOW_US, arrived, arrived + 45 * US]


@every_engine
def test_returns_are_flown_at_the_highest_speed_of_the_drone():
    battery = {"kind": "endurance", "autonomy_min": 10, "return_below": 1.0}
    drones = {"motion": {**CRUISE, "cruise": [5]}, "count": 1, "start_cells": [(0, 0)]}
    world = strip(stations={"count": 1, "radius_m": 0}, drones={**drones, "battery": battery})
    log = fly(world, path_of(world), "right@5 goto")
    assert [event[0] for event in seen(log, "land")] == [60 * US + 3 * QUICK_US]


def test_actions_are_in_the_order_of_speeds_and_those_of_charging_are_the_last():
    world = choosing(battery=rotary(30.0))
    assert [action.name.lower() for action in world.actions] == [
        *("forward@5", "backward@5", "right@5", "left@5", "hover"),
        *("forward@20", "backward@20", "right@20", "left@20"),
        *("goto_charging_station", "charge"),
    ]
    assert [int(action) for action in world.actions] == [0, 1, 2, 3, 4, 0, 1, 2, 3, 7, 8]
    assert fastest_of(world.actions)[Action.RIGHT] == 7
    assert move_of(world.actions[7]) == (1, 0, 0)
    names = [Variant(Action.UP, speed).name for speed in (8.3, 12.0, 0.001, 1e3)]
    assert names == ["UP@8.3", "UP@12", "UP@0.001", "UP@1000"]


def test_one_speed_is_minimum_time_at_this_speed():
    quick = {"timing": "minimum_time", "max_speed_mps": 20}
    told = "right left right right"
    made = [strip(steps=4, users=[(300, 120)], drones={"motion": motion}) for motion in (
        quick, {"cruise": [20], "max_speed_mps": 20}
    )]  # fmt: skip
    words = told, " ".join(f"{word}@20" for word in told.split())
    one, other = (fly(world, path_of(world), text) for world, text in zip(made, words, strict=True))
    assert one.events == other.events
    assert one.legs == other.legs


# ---- who chooses


def flown(world: World, policy: Any) -> list[str]:
    loaded = load_policy(policy) if isinstance(policy, str) else policy
    ((log, _),) = play(world, loaded, "mine", seed=0)
    return [step.action_taken.name.lower() for step in log.steps]


def test_the_baseline_flies_at_the_highest_speed():
    assert set(flown(choosing(steps=4), "baseline")) == {"right@20"}


def test_scripts_name_the_speed_or_take_the_highest(tmp_path: Path):
    script = tmp_path / "mine.csv"
    script.write_text("step,drone,action\n0,0,right@5\n1,0,right\n2,0,left@20\n")
    assert flown(choosing(steps=4), f"script:{script}") == [
        *("right@5", "right@20", "left@20", "hover")
    ]


def test_functions_name_the_speed_or_take_the_highest():
    choices = ["right@5", Action.RIGHT, Variant(Action.LEFT, 5.0), 8]

    def mine(observation: Any, mask: Any) -> Any:
        return choices[observation.step]

    assert flown(choosing(steps=4), load_policy(mine)) == [
        *("right@5", "right@20", "left@5", "left@20")
    ]


def test_planners_plan_with_the_speed_that_takes_least_of_a_battery():
    thrifty = grounds_of(choosing(battery=rotary(30.0)))[0].flights.moves
    assert Variant(Action.RIGHT, 5.0) in thrifty  # 8,922 J in a step, not 9,936 J
    by_time = grounds_of(choosing(battery={"kind": "endurance"}))[0].flights.moves
    assert Variant(Action.RIGHT, 20.0) in by_time  # the highest of equally thrifty speeds
    assert len(thrifty) == len(by_time) == 5


@pytest.mark.thorough
def test_greedy_and_rollouts_choose_actions_that_there_are():
    battery = {"kind": "endurance", "autonomy_min": 10}
    world = choosing(battery=battery, users=[(900, 120), (1000, 120)], steps=4)
    taken = flown(world, "greedy")
    assert taken[:3] == ["right@20"] * 3
    named = {action.name.lower() for action in world.actions}
    assert set(flown(world, "rollout:greedy+samples=1+horizon=2")) <= named


def test_environments_have_an_action_for_each_move_and_speed():
    changes = {"drones.motion.cruise": [5, 8.3], "episode.carry_over": False}
    env = UavEnv("case8", {**changes, "drones.count": 1}, world_seed=0)
    assert env.action_space.n == 2 * 6 + 1 + 2
    _, info = env.reset(seed=0)
    assert info["action_mask"].sum() == 13


# ---- what stands beside the engines


def test_tracks_follow_the_speed_that_was_chosen():
    world = choosing(steps=2)
    log = fly(world, path_of(world), "right@5 right@20")
    legs = tables.legs_table([log])

    class Run:
        """A run that has only what a track reads."""

        scenario = world.scenario

    Run.world = world  # type: ignore[attr-defined]
    track = Track(legs, Run, 0)  # type: ignore[arg-type]
    assert track.position_m(20 * US)[0] == pytest.approx(120 + 3.125 + 18.75 * 5)
    assert track.position_m(67 * US)[0] == pytest.approx(360 + 50 + 2 * 20)


def learned(engine: str) -> np.ndarray[Any, Any]:
    world = build_world(
        from_mapping(
            {
                "map": {"size_m": [720, 720], "cells": [3, 3], "dimensions": 2},
                "drones": {"count": 2, "motion": CRUISE, "battery": rotary(8.0)},
                "stations": {"count": 1, "radius_m": 0},
                "users": {"count": 6, "clusters": {"count": 1, "radius_m": [60, 100]}},
                "decisions": {"kind": "event", "patience_s": 60},
                "reward": {"kind": "qoe", "crash": 2.0, "energy": 0.5},
                "episode": {"steps": 12},
            }
        ),
        0,
    )
    training = Training(world, 0, engine)
    while training.episode < 6:
        training.play(6 - training.episode)
    return training.q.copy()


# ---- random scenarios


@pytest.mark.parametrize("seed", by_default([], SEEDS))
def test_agrees_with_the_reference_at_the_finest_dt(seed: int) -> None:
    case, result = case_of(seed, cruising), sampled(seed, FINEST_S, cruising)
    speeds = set()
    for step in case.log.steps:
        record = result.records[step.step][step.drone]
        at = f"step {step.step}, drone {step.drone}"
        assert record.mode == step.mode.name.lower(), at
        assert record.action_taken == step.action_taken.name.lower(), at
        if step.mode is Mode.FLYING:
            here = (step.x_m, step.y_m, step.z_m)
            assert record.position_m == pytest.approx(here, abs=1e-6), at
        speeds.add(getattr(step.action_taken, "cruise_mps", None))
    assert speeds - {None} == set(case.inputs.cruise)


@pytest.mark.slow
def test_converges_to_the_reference_with_slope_one() -> None:
    check(slopes(range(24), 0.35, scenarios=cruising))


@pytest.mark.thorough
def test_engines_agree_in_random_fleets_that_choose():
    chosen = 0
    for seed in range(60):
        world = world_of(seed, graded=False)
        if not isinstance(world.actions[0], Variant):
            continue
        chosen += 1
        one, other = engines(world, (True,) * world.scenario.drone_count)
        assert not differences(one, other, seed, 0), seed
    assert chosen >= 10


@pytest.mark.thorough
def test_engines_agree_in_the_cases_with_a_choice_of_speeds():
    changes = {"battery": rotary(40.0), "motion": {"cruise": [6, 8.3, 18], "max_speed_mps": 20}}
    for seed in range(4):
        scenario = from_mapping({"name": "c", "drones": changes, "episode": {"carry_over": True}})
        world = build_world(scenario, seed)
        one, other = engines(world, (True,) * 3)
        for episode in range(2):
            assert not differences(one, other, seed, episode)


@pytest.mark.thorough
def test_both_engines_learn_the_same():
    one, other = map(learned, ENGINES)
    assert np.abs(one).sum() > 0
    assert (one == other).all()


def test_a_battery_by_time_is_used_alike_at_all_speeds():
    world = choosing(battery={"kind": "endurance", "autonomy_min": 10}, steps=2)
    assert isinstance(world.only_type.drones.battery, Endurance)
    engine = make_engine("des", world, RunSettings((True,), carry_over=False))
    engine.reset(draw(world, 0, 0))
    numbers = [[action.name for action in world.actions].index(f"RIGHT@{v}") for v in (5, 20)]
    left = [engine.step([number]).observations[0].battery_s for number in numbers]
    assert left == [540.0, 480.0]
