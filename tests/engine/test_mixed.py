"""Drones that fly freely beside drones that fly from cell to cell, in one fleet."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest

from desim_uav.engine.base import EpisodeLog, RunSettings
from desim_uav.engine.choose import make_engine
from desim_uav.model.rules import Action
from desim_uav.sample_path import SamplePath
from desim_uav.world import World
from tests.engine.helpers import (
    Flight,
    check_that_the_other_engine_goes_on,
    events,
    in_3d,
    path_of,
    seen,
    strip,
)
from tests.engine.random_mixed import world_of
from tests.engine.random_radio import audited
from tests.engine.replay import check_log
from tests.selection import by_default
from tests.verification.engines import differences, engines

BY_CELLS = {"max_speed_mps": 20, "max_acceleration_mps2": 4, "timing": "minimum_time"}
"""A motion in which 240 m take 240 / 20 + 20 / 4 = 17 s, the first 50 m of them 5 s."""
FREE = {"space": "free", "max_speed_mps": 10, "max_acceleration_mps2": 5, "margin_m": 10}
"""In a step of 60 s, 10 * (60 - 2) = 580 m; d metres take d / 10 + 2 s, from 20 m on."""

STEERED = ("depart", "blocked", "arrive", "land", "charge", "charged", "crash", "enter", "exit")
PLAIN = {"count": 1, "footprint_radius_m": 100, "bandwidth_kbps": None}

Told = Sequence[Any]
"""The commands of a drone: names of actions, and numbers of free flight."""


def by_cells(**own: Any) -> dict[str, Any]:
    return {"name": "by_cells", "motion": BY_CELLS, "battery": None, **PLAIN, **own}


def free(**own: Any) -> dict[str, Any]:
    return {"name": "free", "motion": FREE, "battery": None, **PLAIN, **own}


def mixed(*types: dict[str, Any], **changes: Any) -> World:
    """A row of nine cells with a station on cell 4, at x = 1080 m, and drones of both kinds."""
    limited = any(each["battery"] for each in types)
    stations = {"count": int(limited), "radius_m": 0}
    world = strip(**{"stations": stations, **changes, "drones": list(types)})
    assert world.mixed
    return world


def fly(world: World, path: SamplePath, *told: Told, **settings: Any) -> EpisodeLog:
    """An episode in which each drone hears its commands, and then hovers."""
    flight = Flight(world, **settings)
    shown = flight.engine.reset(path)
    while not (shown.terminated or shown.truncated):
        now = [one[shown.step] if shown.step < len(one) else "hover" for one in told]
        commands = [flight.command(one) if isinstance(one, str) else one for one in now]
        shown = flight.engine.step(commands)
    check_log(world, flight.engine.log)
    return flight.engine.log


@pytest.mark.usefixtures("every_engine")
class TestByHand:
    """Small worlds, and the logs that follow from the numbers in their files."""

    def test_each_flies_in_its_own_way_and_both_charge_at_one_station(self):
        # Drone 0 leaves x = 120 m for the next cell: the user at 270 m is 100 m away after 50 m.
        # Drone 1 flies half as far as it can from x = 2040 m, 290 m in 31 s; the user at 1900 m
        # is within 100 m after 40 m, at 4 + 1 s, and no more after 240 m, at 24 + 1 s.
        # Then both return: three hops of 17 s each, and 670 m in 69 s. The pad gives 2 s per s:
        # 111 s take 55.5 s, and then 129 s take 64.5 s.
        battery = {"autonomy_min": 10, "return_below": 1.0}
        world = mixed(
            by_cells(battery=battery, start_cells=[(0, 0)]),
            free(battery=battery, start_cells=[(8, 0)]),
            users=[(270, 120), (1900, 120)],
            steps=4,
        )
        log = fly(world, path_of(world), ["right", "goto"], [[-0.5, 0.0, -1.0], [0.0, 0.0, 1.0]])
        assert seen(log, *STEERED) == events("""
                    0  10  depart   0
                    0  10  depart   1
              5000000   4  enter    0  0
              5000000   4  enter    1  1
             17000000   3  arrive   0
             25000000   2  exit     1  1
             31000000   3  arrive   1
             60000000  10  depart   0
             60000000  10  depart   1
             60000000  11  exit     0  0
             77000000   3  arrive   0
             77000000   3  depart   0
             94000000   3  arrive   0
             94000000   3  depart   0
            111000000   3  arrive   0
            111000000   3  land     0  -  -  0
            111000000   3  charge   0  -  -  0
            129000000   3  arrive   1
            129000000   3  land     1  -  -  0
            166500000   3  charged  0  -  -  0
            166500000   3  charge   1  -  -  0
            231000000   3  charged  1  -  -  0
        """)
        taken = [(step.drone, step.action_taken.name) for step in log.steps[:4]]
        assert taken == [(0, "RIGHT"), (1, "FLY"), *((d, "GOTO_CHARGING_STATION") for d in (0, 1))]
        first, second, *_ = log.steps
        assert (first.aim_x, second.aim_x) == (0.0, -0.5)
        assert (first.return_drain, second.return_drain) == (51_000_000, 69_000_000)

    def test_the_order_of_types_does_not_matter(self):
        # Drone 1 moves in 17 s, and returns over three cells; drone 2 moves in 30.990663 s.
        battery = {"autonomy_min": 10, "return_below": 1.0}
        slow = {"timing": "minimum_time"}
        world = mixed(
            free(start_cells=[(8, 0)]),
            by_cells(battery=battery, start_cells=[(0, 0)]),
            by_cells(name="slow", motion=slow, start_cells=[(6, 0)]),
            steps=2,
        )
        log = fly(world, path_of(world), [[-0.5, 0.0]], ["right", "goto"], ["right", "left"])
        assert seen(log, "arrive", "land") == events("""
             17000000   3  arrive  1
             30990663   3  arrive  2
             31000000   3  arrive  0
             77000000   3  arrive  1
             90990663   3  arrive  2
             94000000   3  arrive  1
            111000000   3  arrive  1
            111000000   3  land    1  -  -  0
        """)

    def test_a_mask_allows_what_the_own_kind_can_do(self):
        battery = {"autonomy_min": 10, "return_below": 1.0}
        world = mixed(free(), by_cells(battery=battery), free(name="far", battery=battery))
        flight = Flight(world)
        (shown, *_) = [flight.engine.reset(path_of(world))]
        moves = ["FORWARD", "BACKWARD", "RIGHT", "LEFT", "HOVER"]
        home = ["GOTO_CHARGING_STATION"]
        assert [action.name for action in world.actions] == [*moves, *home, "CHARGE", "FLY"]
        assert [
            [action.name for action, may in zip(world.actions, mask, strict=True) if may]
            for mask in shown.masks
        ] == [["HOVER", "FLY"], moves + home, ["HOVER", *home, "FLY"]]

    def test_a_command_of_the_other_kind_is_a_hover(self):
        world = mixed(by_cells(start_cells=[(0, 0)]), free(start_cells=[(8, 0)]), steps=1)
        log = fly(world, path_of(world), ["fly"], ["left"])
        assert seen(log, "depart", "blocked") == []
        assert [step.action_taken for step in log.steps] == [Action.HOVER] * 2
        assert [step.action for step in log.steps] == [Action.FLY, Action.LEFT]

    def test_numbers_are_no_command_from_cell_to_cell(self):
        world = mixed(by_cells(start_cells=[(0, 0)]), free(start_cells=[(8, 0)]))
        engine = Flight(world).engine
        engine.reset(path_of(world))
        with pytest.raises(ValueError, match=r"drone 0 is the index .*; not \[1.0, 0.0\]"):
            engine.step([[1.0, 0.0], [1.0, 0.0]])

    def test_one_of_each_kind_come_too_near(self):
        # Drone 1 leaves x = 1560 m for 1038 m and is 100 m from x = 1080 m after 380 m, at 39 s.
        world = mixed(
            by_cells(start_cells=[(4, 0)]), free(start_cells=[(6, 0)]), steps=1, separation_m=100
        )
        log = fly(world, path_of(world), ["hover"], [[-0.9, 0.0]])
        assert [event[:4] for event in seen(log, "conflict", "clear")] == [
            (39_000_000, 13, "conflict", 0)
        ]
        assert log.apart.conflict_us == 21_000_000
        assert log.apart.least_m < 1e-6

    @pytest.mark.parametrize("first", ["by_cells", "free"])
    def test_the_drone_with_the_higher_index_gives_way(self, first):
        # They would meet at x = 1080 m.
        types = [by_cells(start_cells=[(3, 0)]), free(start_cells=[(5, 0)])]
        commands: list[Told] = [["right"], [[-0.4, 0.0]]]
        if first == "free":
            types, commands = types[::-1], commands[::-1]
        world = mixed(*types, steps=1, separation_m=100, on_conflict="hover_higher_index")
        log = fly(world, path_of(world), *commands)
        found = [event[:4] for event in seen(log, "blocked", "depart")]
        assert found == [(0, 10, "depart", 0), (0, 10, "blocked", 1)]

    def test_each_is_asked_when_it_is_free(self):
        # After 17 s, and after 31 s; each then hovers for 25 s until it is asked again.
        world = mixed(
            by_cells(start_cells=[(0, 0)]),
            free(start_cells=[(8, 0)]),
            steps=1,
            decisions={"kind": "event", "patience_s": 25},
        )
        log = fly(world, path_of(world), ["right"], [[-0.5, 0.0]])
        assert seen(log, "decide") == events("""
                   0  10  decide  0
                   0  10  decide  1
            17000000  10  decide  0
            31000000  10  decide  1
            42000000  10  decide  0
            56000000  10  decide  1
        """)


# ---- a drone alone


CLIMBS = {
    "kind": "link_classes",
    "power_dbm": 0,
    "path_loss": {"kind": "al_hourani", "environment": "urban"},
}
WINDY = {"kind": "rotary_wing", "capacity_wh": 16.0, "return_below": 0.9}
KEYS = ("t_us", "x_m", "y_m", "z_m", "mode", "charge", "return_drain", "action", "action_taken")
SERVICE = ("attached_users", "served_requests", "used_hz", "used", "aim_x", "aim_y", "aim_z")


def told_of(seed: int, three_d: bool) -> list[Told]:
    """Random commands of a drone by cells, and of one that flies freely."""
    rng = np.random.default_rng(seed)
    moves = ["right", "left", "right", "left", "hover", "goto", "charge"]
    moves += ["up", "down", "up", "down"] if three_d else []
    cells = [str(rng.choice(moves)) for _ in range(24)]
    numbers = rng.uniform(-1.0, 1.0, (24, 4 if three_d else 3)).round(3)
    return [cells, numbers.tolist()]


def fleet_of(types: Sequence[dict[str, Any]], radio: bool, **changes: Any) -> World:
    """Thirty cells in a row, or in 3D with buildings at both ends, and one station for two."""
    common = {
        "users": [*((x, 120.0) for x in (300, 620, 900)), *((x, 100.0) for x in (6300, 6800))],
        "steps": 24,
        "drones": list(types),
        "stations": {"count": 1, "radius_m": 0, "pads": 2},
        "wind_mps": [1.5, -2.0],
        **changes,
    }
    if not radio:
        return strip(cells=(30, 1), **common)
    return in_3d([[0, 0, 70], [29, 0, 50]], [], cells=(30, 1), **common)


@pytest.mark.thorough
@pytest.mark.usefixtures("every_engine")
@pytest.mark.parametrize("radio", [False, True])
@pytest.mark.parametrize("seed", range(4))
def test_drones_that_never_meet_fly_as_each_would_alone(seed, radio):
    battery: Any = WINDY | {"on_crash": "respawn", "respawn_after_min": 1}
    links: dict[str, Any] = {"footprint_radius_m": 300}
    types = [by_cells(start_cells=[(2, 0)]), free(start_cells=[(27, 0)])]
    for each in types:
        each["battery"] = battery
        if radio:
            del each["footprint_radius_m"], each["bandwidth_kbps"]
            links = {"radio": CLIMBS}
        each.update(links)
    told = told_of(seed, radio)
    asks = {user: [(7.0 * user, 95, 300), (400, 60, 300), (900, 240, 300)] for user in range(5)}
    both = fleet_of(types, radio)
    log = fly(both, path_of(both, asks), *told)
    assert both.mixed
    for drone, own in enumerate(types):
        alone = fleet_of([own], radio)
        assert not alone.mixed
        one = fly(alone, path_of(alone, asks), told[drone])
        assert _of(one, 0) == _of(log, drone)
        assert len(_of(log, drone)[0]) > 30


def _of(log: EpisodeLog, drone: int) -> tuple[list[Any], ...]:
    """The events, legs and steps of a drone, without its number and its rewards."""
    assert log.events is not None
    own = [(*event[:3], *event[4:]) for event in log.events if event[3] == drone]
    legs = [leg._replace(drone=0) for leg in log.legs if leg.drone == drone]
    steps = [
        [getattr(step, key) for key in KEYS + SERVICE] for step in log.steps if step.drone == drone
    ]
    return own, legs, steps


# ---- both engines, and the audit, in random scenarios


def unlike(seed: int) -> list[str]:
    """In what two episodes of both engines differ, some of whose drones have no ceiling."""
    world, rng = world_of(seed), np.random.default_rng(seed)
    ceilings = tuple((rng.random(world.scenario.drone_count) < 0.5).tolist())
    one, other = engines(world, ceilings)
    return [name for episode in range(2) for name in differences(one, other, seed, episode)]


@pytest.mark.parametrize("seed", by_default([], range(120)))
def test_both_engines_are_equal(seed: int):
    assert unlike(seed) == []


@pytest.mark.parametrize("seed", by_default([2, 7], range(40)))
def test_no_event_breaks_a_rule(seed: int):
    assert audited(world_of(seed))


@pytest.mark.thorough
def test_random_scenarios_have_everything():
    found = [world_of(seed).scenario for seed in range(40)]
    assert {scenario.decisions.by_event for scenario in found} == {True, False}
    assert {any(scenario.wind_mps) for scenario in found} == {True, False}
    assert {scenario.three_d for scenario in found} == {True, False}
    assert {scenario.separation_m is None for scenario in found} == {True, False}
    assert {scenario.episode.carry_over for scenario in found} == {True, False}
    first = {scenario.fleet[0].motion.space == "free" for scenario in found if _plain(scenario)}
    assert first == {True, False}


def _plain(scenario: Any) -> bool:
    return hasattr(scenario.fleet[0].motion, "space")


@pytest.mark.thorough
@pytest.mark.parametrize("name", ["des", "batch"])
@pytest.mark.parametrize("seed", range(3))
def test_saved_states_go_on_as_the_original(seed, name):
    check_that_the_other_engine_goes_on(world_of(seed), name, seed)


@pytest.mark.usefixtures("every_engine")
def test_what_drones_carry_over_is_of_their_own_kind(engine_name: str):
    # After 60 s, drone 0 is on the second of its hops and drone 1 on its way in a straight line.
    battery = {"autonomy_min": 10, "return_below": 1.0}
    world = mixed(
        by_cells(battery=battery, start_cells=[(0, 0)]),
        free(battery=battery, start_cells=[(8, 0)]),
        steps=1,
    )
    told = RunSettings((True, True), True, keep_events=True)
    engine = make_engine(engine_name, world, told)
    engine.reset(path_of(world))
    goto = world.actions.index(Action.GOTO_CHARGING_STATION)
    engine.step([goto, [0.0, 0.0, 1.0]])
    first, second = engine.carried() or ()
    assert first.hop == (1, 0, 0) and first.free is None
    assert second.free is not None and second.free[:2] == (2040.0, 120.0)
    engine.reset(path_of(world))
    engine.step([goto, goto])
    # 4 hops of 17 s, and 960 m in 98 s.
    assert seen(engine.log, "land") == events("""
         8000000  3  land  0  -  -  0
        38000000  3  land  1  -  -  0
    """)
