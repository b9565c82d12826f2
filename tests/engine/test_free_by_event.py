"""Free flight with decisions by event: worlds by hand, in both engines, and an environment.

Both engines fly random scenarios in ``test_everything.py``.
"""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import numpy as np
import pytest

from desim_uav import UavEnv
from desim_uav.model.rules import Mode
from desim_uav.world import World
from tests.engine.helpers import HOVER_WH, US, Flight, events, path_of, seen, strip
from tests.engine.random_all import scenario
from tests.engine.random_parts import accepted
from tests.engine.random_radio import audited
from tests.engine.replay import check_log
from tests.engine.test_by_event import asked, times
from tests.selection import by_default

FREELY = {"motion": {"space": "free", "max_speed_mps": 10, "max_acceleration_mps2": 5}}
"""In d metres, of at least 20, such drones take d / 10 + 2 s. In 60 s they reach 580 m."""

every_engine = pytest.mark.usefixtures("every_engine")


def by_event(patience_s: float = 20, **changes: Any) -> World:
    decisions = {"kind": "event", "patience_s": patience_s}
    return strip(**{"decisions": decisions, "drones": FREELY, **changes})


def fly(world: World, told: list[Any], path: Any = None) -> Flight:
    """An episode of one drone, which hears these commands and then hovers."""
    flight = Flight(world)
    shown, heard = flight.engine.reset(path or path_of(world)), iter(told)
    flight.shown = [shown]
    while not (shown.terminated or shown.truncated):
        now = next(heard, "hover")
        shown = flight.engine.step([flight.command(now) if isinstance(now, str) else now])
        flight.shown.append(shown)
    check_log(world, flight.engine.log)
    return flight


@every_engine
def test_a_drone_is_asked_when_it_has_arrived_but_not_before_its_patience_is_over():
    # 290 m take 31 s. 58 m take 7.8 s, and then it hovers until 20 s have passed.
    flight = fly(by_event(steps=2), [[0.5, 0.0], "hover", [0.1, 0.0], [0.2, 0.0]])
    assert seen(flight.engine.log, "depart", "arrive") == events("""
               0  10  depart  0
        31000000   3  arrive  0
        51000000  10  depart  0
        58800000   3  arrive  0
        71000000  10  depart  0
        84600000   3  arrive  0
    """)
    assert [t / US for t in asked(flight, 0)] == [0, 31, 51, 71, 91, 111]
    assert [t / US for t in times(flight)] == [0, 31, 51, 71, 91, 111, 120]


@every_engine
def test_others_go_on():
    # Drone 1 is asked after 31 s; drone 0, which flies for 60 s, is not.
    world = by_event(starts=[(0, 0), (4, 0)], steps=1)
    flight = Flight(world)
    shown = flight.engine.reset(path_of(world))
    shown = flight.engine.step([[1.0, 0.0], [0.5, 0.0]])
    assert shown.t_us == 31 * US
    allowed = [[a.name for a, may in zip(world.actions, mask, strict=True) if may]
               for mask in shown.masks]  # fmt: skip
    assert allowed == [["HOVER"], ["FLY", "HOVER"]]
    shown = flight.engine.step([[-1.0, 0.0], [0.0, 0.0]])  # what drone 0 hears counts nothing
    assert shown.t_us == 51 * US
    shown = flight.engine.step([[-1.0, 0.0], [0.0, 0.0]])
    assert (shown.t_us, shown.truncated) == (60 * US, True)
    (leg,) = [leg for leg in flight.engine.log.legs if leg.drone == 0 and leg.duration_us]
    assert leg.to_m == (700, 120, 20)


@every_engine
@pytest.mark.parametrize("in_joules", [False, True])
def test_a_battery_may_end_in_the_hover_after_a_short_leg(in_joules: bool):
    # 58 m take 7.8 s. The battery of time lasts 15 s.
    battery: dict[str, Any] = {"autonomy_min": 0.25}
    if in_joules:
        battery = {"kind": "rotary_wing", "capacity_wh": HOVER_WH * 0.25}
    battery |= {"on_crash": "remove", "return_below": 0.1}
    flight = fly(by_event(steps=1, battery=battery), [[0.1, 0.0, -1.0]])
    ((t_us, *_),) = seen(flight.engine.log, "crash")
    assert t_us == 15 * US if not in_joules else 15 * US < t_us < 17 * US
    assert [event[0] for event in seen(flight.engine.log, "arrive")] == [7_800_000]
    assert asked(flight, 0) == [0]


@every_engine
def test_users_enter_in_the_hover_after_a_short_leg():
    # The drone is at 178 m from 7.8 s on. The user is 100 m away at 78 m, after 15 s at 5 m/s.
    world = by_event(steps=1, users=[(3, 120)])
    path = path_of(world, walks={0: [(0.0, 3.0, 120.0, 5.0, 0.0)]})
    flight = fly(world, [[0.1, 0.0]], path)
    assert [event[0] for event in seen(flight.engine.log, "enter")] == [15 * US]


@every_engine
def test_it_returns_and_is_asked_when_it_is_charged():
    # 960 m take 98 s. The pad gives 2 s a second.
    battery = {"autonomy_min": 10, "return_below": 1.0, "respawn_after_min": 1}
    world = by_event(steps=5, battery=battery)
    flight = fly(world, ["hover", "goto", [0.2, 0.0, -1.0]])
    assert seen(flight.engine.log, "land", "charge", "charged", "depart") == events("""
         20000000  10  depart   0
        118000000   3  land     0  -  -  0
        118000000   3  charge   0  -  -  0
        177000000   3  charged  0  -  -  0
        177000000  10  depart   0
    """)
    assert [t / US for t in asked(flight, 0)][:4] == [0, 20, 177, 197]


def test_there_are_no_more_epochs_than_foreseen():
    world = by_event(patience_s=5, steps=2)
    flight = fly(world, [[1e-3, 0.0]] * 100)
    assert len(flight.shown) - 1 == 24 <= world.most_epochs


@pytest.mark.parametrize("seed", by_default(range(2), range(20)))
def test_each_drone_is_asked_when_its_command_is_over(seed: int):
    world = accepted(scenario, 1000 + seed, lambda found: found.free and found.decisions.by_event)
    checked, patience_us = 0, world.patience_us
    for log in audited(world):
        ends = {(leg.drone, leg.t_us): leg.duration_us for leg in log.legs}
        breaks = {"land", "crash", "deplete", "respawn", "charged"}
        for drone in range(world.scenario.drone_count):
            mine = [event for event in log.events or () if event[3] == drone]
            at = [event[0] for event in mine if event[2] == "decide"]
            gone = [event[0] for event in mine if event[2] in breaks]
            gone += [leg.t_us for leg in log.legs if leg.drone == drone and leg.mode != Mode.FLYING]
            for now, following in pairwise(at):
                if not any(now <= t <= following for t in gone):
                    assert following - now == max(ends.get((drone, now), 0), patience_us)
                    checked += 1
    assert checked or world.scenario.episode.carry_over, "crashed drones may stay away"


@pytest.mark.thorough
def test_an_environment_has_it():
    changes = {
        "map": {"size_m": [1200, 1200], "cells": [5, 5], "dimensions": 2},
        "drones": {"count": 2, **FREELY, "battery": {"respawn_after_min": 1}},
        "users": {"count": 10},
        "stations": {"count": 1},
        "decisions": {"kind": "event", "patience_s": 10},
        "episode": {"steps": 4},
    }
    env = UavEnv(changes, world_seed=0)
    env.reset(seed=1)
    rng, passed_s, over = np.random.default_rng(0), [0.0], False
    while not over:
        action = rng.uniform(-1.0, 1.0, env.action_space.shape).astype(np.float32)
        _, reward, terminated, truncated, info = env.step(action)
        over = terminated or truncated
        passed_s.append(info["sim_time_s"])
        assert np.isfinite(reward)
    assert passed_s[-1] == 240.0
    assert min(np.diff(passed_s)) > 0.0
    assert len(passed_s) > 5
