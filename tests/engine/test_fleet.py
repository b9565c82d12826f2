"""Drones of several types in one world: by hand, and both engines against each other."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from desim_uav.engine.base import RunSettings
from desim_uav.engine.choose import make_engine
from desim_uav.engine.des import Simulation
from desim_uav.experiment import tables
from desim_uav.measures.tally import headline
from desim_uav.model.rules import Action, Mode
from desim_uav.model.state import Facts
from desim_uav.sample_path import draw
from desim_uav.scenario.load import from_mapping
from desim_uav.world import World, build_world
from tests.engine.helpers import HOP_US, US, Flight, before_end, events, fly, path_of, seen, strip
from tests.engine.random_fleet import world_of
from tests.engine.random_radio import audited
from tests.engine.replay import check_log
from tests.selection import by_default
from tests.verification.engines import differences, engines

QUICK = {"max_speed_mps": 20, "max_acceleration_mps2": 4, "timing": "minimum_time"}
"""A motion in which 240 m take 240 / 20 + 20 / 4 = 17 s."""
SLOW = {"timing": "minimum_time"}
QUICK_HOP_US = 17 * US


def fleet(*types: dict[str, Any], steps: int = 5, **changes: Any) -> World:
    """A row of nine cells with a station on cell 4, and drones of several types.

    Drones are slow, cover 100 m and have unlimited bandwidth and battery, unless said here.
    """
    plain = {"footprint_radius_m": 100, "bandwidth_kbps": None, "motion": SLOW, "battery": None}
    drones = [{"name": f"type{k}", "count": 1, **plain, **own} for k, own in enumerate(types)]
    stations = {"count": 1, "radius_m": 0}
    return strip(steps=steps, **{"stations": stations, **changes, "drones": drones})


@pytest.mark.usefixtures("every_engine")
class TestByHand:
    """Worlds of two types, and the logs that follow from the numbers in their files."""

    def test_each_type_flies_and_covers_in_its_own_way(self):
        # The wide one covers the user at 400 m from x = 120 on: 280 m are within 300 m. The quick
        # one leaves x = 2040 to the left; the user at 1890 is 100 m away after 50 m, which take
        # 5 s at 4 m/s². The user at 1500 is 300 m from where it ends, and in nobody's footprint.
        world = fleet(
            {"footprint_radius_m": 300, "start_cells": [(0, 0)]},
            {"motion": QUICK, "start_cells": [(8, 0)]},
            users=[(400, 120), (1890, 120), (1500, 120)],
            steps=1,
        )
        log = fly(world, path_of(world), "hover", "left")
        assert before_end(log, "enter", "depart", "arrive") == events(f"""
                   0   4  enter   0  0
                   0  10  depart  1
             5000000   4  enter   1  1
            {QUICK_HOP_US}   3  arrive  1
        """)

    def test_bandwidth_is_that_of_the_type(self):
        # Two requests of 400 kbit/s each: one fits into 500 kbit/s, and both into 900.
        world = fleet(
            {"bandwidth_kbps": 500, "start_cells": [(0, 0)]},
            {"bandwidth_kbps": 900, "start_cells": [(8, 0)]},
            users=[(120, 120), (130, 120), (2040, 120), (2050, 120)],
            steps=1,
        )
        asks = {user: [(0, 90, 400)] for user in range(4)}
        log = fly(world, path_of(world, asks))
        assert seen(log, "serve") == events("""
            0  7  serve  0  0  0
            0  7  serve  1  2  2
            0  7  serve  1  3  3
        """)

    def test_returns_and_charges_take_what_the_type_takes(self):
        # Both return from four cells away at once. The quick one is there after 4 * 17 = 68 s and
        # has lost 68 of 300 s, which the pad gives back at 1 s per s: full at 136 s. The slow one
        # lands after 4 hops, waits for the pad, and gets 2 s per s.
        slow_us, quick_us = 4 * HOP_US, 4 * QUICK_HOP_US
        battery = {"return_below": 1.0}
        world = fleet(
            {"battery": {"autonomy_min": 10, **battery}, "start_cells": [(0, 0)]},
            {"battery": {"autonomy_min": 5, **battery}, "motion": QUICK, "start_cells": [(8, 0)]},
        )
        flight = Flight(world)
        log = flight.episode(path_of(world), "goto", "goto")
        full_us = 2 * quick_us
        assert seen(log, "land", "charge", "charged") == events(f"""
             {quick_us}  3  land     1  -  -  0
             {quick_us}  3  charge   1  -  -  0
             {slow_us}   3  land     0  -  -  0
             {full_us}   3  charge   0  -  -  0
             {full_us}   3  charged  1  -  -  0
             {full_us + slow_us // 2}  3  charged  0  -  -  0
        """)
        first, second = flight.shown[0].observations
        assert (first.capacity_s, second.capacity_s) == (600.0, 300.0)
        assert (first.return_s, second.return_s) == (slow_us / US, quick_us / US)
        assert (first.station, first.flight_s, second.flight_s) == (0, slow_us / US, 68.0)

    def test_crashes_end_as_the_type_says(self):
        # Type 0 is removed, type 1 is replaced at the next decision epoch, type 2 flies on.
        world = fleet(
            {"battery": {"autonomy_min": 0.75, "on_crash": "remove"}, "start_cells": [(0, 0)]},
            {"battery": {"autonomy_min": 1.25, "respawn_after_min": 0}, "start_cells": [(8, 0)]},
            {"start_cells": [(6, 0)]},
        )
        log = fly(world, path_of(world))
        assert seen(log, "crash", "respawn") == events("""
             45000000  6  crash    0
             75000000  6  crash    1
            120000000  9  respawn  1  -  -  0
            195000000  6  crash    1
            240000000  9  respawn  1  -  -  0
        """)
        last = {step.drone: step for step in log.steps[-3:]}
        assert [last[d].mode for d in range(3)] == [Mode.CRASHED, Mode.FLYING, Mode.FLYING]
        assert [last[d].charge for d in range(3)] == [0, 15 * US, None]

    def test_energy_is_that_of_the_types_that_are_measured_in_it(self):
        # Two hover for a minute, charge until they are full, and hover for another minute; one
        # battery holds minutes, and the other 30 Wh.
        world = fleet(
            {"battery": {"autonomy_min": 10}, "start_cells": [(4, 0)]},
            {"battery": {"kind": "rotary_wing", "capacity_wh": 30.0}, "start_cells": [(4, 0)]},
            {"battery": None, "start_cells": [(0, 0)], "bandwidth_kbps": 1000},
            users=[(120, 120)],
            steps=3,
            stations={"count": 1, "radius_m": 0, "pads": 2},
        )
        path = path_of(world, {0: [(0, 60, 500)]})
        log = fly(world, path, "hover charge", "hover charge")
        requests = tables.requests_table([log], world)
        episodes = tables.episodes_table([log], world, requests)
        row, steps = episodes.iloc[0], tables.steps_table([log], world)
        used_wh = 120 * 168.48421774108203 / 3600
        assert steps["energy_wh"].dropna().sum() == pytest.approx(used_wh, abs=1e-8)
        assert row["energy_wh"] == pytest.approx(used_wh, abs=1e-8)
        assert row["charged_wh"] == pytest.approx(used_wh / 2, abs=1e-8)
        assert row["served_mbit"] == 30.0
        assert math.isnan(row["j_per_mbit"]), "the energy of the drone that served is unknown"
        assert headline(requests, episodes)["j_per_mbit"] is None

    def test_only_the_crash_of_its_type_ends_an_episode(self):
        world = fleet(
            {"battery": {"autonomy_min": 0.75, "on_crash": "remove"}, "start_cells": [(0, 0)]},
            {"battery": {"autonomy_min": 1.25, "on_crash": "end_episode"}},
        )
        flight = Flight(world)
        assert flight.episode(path_of(world)).duration_us == 120 * US
        assert flight.shown[-1].terminated

    def test_a_drone_without_a_battery_is_never_told_to_charge(self):
        world = fleet({"battery": {"return_below": 1.0}, "start_cells": [(4, 0)]}, {})
        flight = Flight(world)
        log = flight.episode(path_of(world), "hover charge", "goto charge")
        charging = (Action.GOTO_CHARGING_STATION, Action.CHARGE)
        goto, charge = map(world.actions.index, charging)
        allowed = [[shown.masks[d][goto] for shown in flight.shown[:3]] for d in range(2)]
        assert allowed == [[True, True, True], [False, False, False]]
        allowed = [[shown.masks[d][charge] for shown in flight.shown[:2]] for d in range(2)]
        assert allowed == [[False, True], [False, False]]
        taken = [step.action_taken for step in log.steps if step.drone == 1]
        assert taken == [Action.HOVER] * 5
        assert world.type_of(1).actions == world.actions[:-2]


# ---- what drones observe


def observed(kind: str) -> tuple[World, list[tuple[float, ...]]]:
    """What drones observe after a step: one has 540 of 600 s, one 240 of 300 s, one no battery."""
    world = fleet(
        {"battery": {"autonomy_min": 10}, "bandwidth_kbps": 500, "start_cells": [(0, 0)]},
        {"battery": {"autonomy_min": 5}, "bandwidth_kbps": 900, "start_cells": [(8, 0)]},
        {"start_cells": [(6, 0)]},
        users=[(120, 120), (2040, 120)],
        observation={"kind": kind},
        demand={"kind": "continuous"},
    )
    flight = Flight(world)
    flight.episode(path_of(world, {user: [(0, 120, 300)] for user in range(2)}))
    return world, [seen.features for seen in flight.shown[1].observations]


def named(world: World, drone: int, numbers: tuple[float, ...]) -> dict[str, float]:
    shown = world.scenario.observation.features(world.facts_of(drone))
    return dict(zip((feature.name for feature in shown), numbers, strict=True))


@pytest.mark.usefixtures("every_engine")
class TestObservations:
    """Numbers are shares of what the drone's own type has."""

    def test_charge_and_bandwidth_are_shares_of_the_own_ones(self):
        world, numbers = observed("local")
        first, second, third = (named(world, d, numbers[d]) for d in range(3))
        assert (first["battery"], second["battery"]) == (0.9, 0.8)
        assert "battery" not in third and "n_b" not in third
        assert first["bandwidth_left"] == 1 - 300 / 500
        assert second["bandwidth_left"] == 1 - 300 / 900
        assert third["bandwidth_left"] == 1.0
        assert first["n_b"] == 4 * HOP_US / US / 600
        assert second["n_b"] == 4 * HOP_US / US / 300

    def test_the_state_of_the_paper_has_a_battery_where_there_is_one(self):
        world, numbers = observed("position")
        assert numbers == [(0, 0, 9), (8, 0, 4), (6, 0)]
        sizes = [f.high for f in world.scenario.observation.features(world.facts_of(1))]
        assert sizes == [8, 0, 5]

    def test_others_are_shown_by_their_own_capacity(self):
        world, numbers = observed("team")
        first, third = named(world, 0, numbers[0]), named(world, 2, numbers[2])
        # The nearest other one is the drone without a battery, which counts as full.
        assert (first["other0_battery"], first["other1_battery"]) == (1.0, 0.8)
        assert (third["other0_battery"], third["other1_battery"]) == (0.8, 0.9)

    def test_radar_counts_drones_that_are_away(self):
        world, numbers = observed("radar")
        shown = [named(world, d, numbers[d]) for d in range(3)]
        assert [any(name.startswith("away") for name in each) for each in shown] == [True] * 3
        assert "stations0_+0_+0" in shown[0] and "stations0_+0_+0" not in shown[2]


def test_facts_know_of_a_battery_that_others_have():
    world, _ = observed("position")
    first, *_, third = (world.facts_of(d) for d in range(3))
    assert isinstance(first, Facts)
    assert (first.capacity_s, third.capacity_s) == (600.0, None)
    assert (first.bandwidth_khz, third.bandwidth_khz) == (500.0, math.inf)
    assert first.some_charge and third.some_charge


# ---- one type in two forms


def test_a_list_of_equal_types_is_one_block(engine_name: str):
    block = {"count": 3, "footprint_radius_m": 250, "battery": {"autonomy_min": 4}}
    rest = {"users": {"count": 5}, "episode": {"steps": 6}}
    one = from_mapping({"drones": block, **rest})
    several = [block | {"name": name, "count": count} for name, count in (("a", 1), ("b", 2))]
    found = []
    for scenario in (one, from_mapping({"drones": several, **rest})):
        world = build_world(scenario, 3)
        told = RunSettings((True,) * 3, carry_over=True, keep_events=True)
        engine = make_engine(engine_name, world, told)
        rng = np.random.default_rng(0)
        for episode in range(2):
            shown = engine.reset(draw(world, 3, episode))
            while not (shown.terminated or shown.truncated):
                mask = [np.flatnonzero(allowed) for allowed in shown.masks]
                shown = engine.step([int(rng.choice(allowed)) for allowed in mask])
            found.append((scenario is one, episode, engine.log.events, engine.log.steps))
    assert [each[2:] for each in found if each[0]] == [each[2:] for each in found if not each[0]]


def test_the_audit_notices_energy_of_drones_that_have_none(monkeypatch):
    world = fleet(
        {"battery": {"autonomy_min": 10}, "start_cells": [(0, 0)]},
        {"battery": {"kind": "rotary_wing", "capacity_wh": 30.0}, "start_cells": [(8, 0)]},
    )

    def of_all(engine):
        return tuple(sum(getattr(one, of) for one in engine.drones) for of in ("used", "gained"))

    monkeypatch.setattr(Simulation, "energy_uj", of_all)
    with pytest.raises(AssertionError, match="energy of all drones together"):
        fly(world, path_of(world), "right", "left")


# ---- both engines


def flown(seed: int, graded: bool) -> list[str]:
    """In what two episodes of both engines differ, some of whose drones have no ceiling."""
    world, rng = world_of(seed, graded), np.random.default_rng(seed)
    ceilings = tuple((rng.random(world.scenario.drone_count) < 0.5).tolist())
    one, other = engines(world, ceilings)
    return [name for episode in range(2) for name in differences(one, other, seed, episode)]


@pytest.mark.parametrize("first", by_default((), range(0, 200, 10)))
def test_both_engines_are_equal(first: int):
    unlike = {seed: flown(seed, False) for seed in range(first, first + 10)}
    assert {seed: found for seed, found in unlike.items() if found} == {}


@pytest.mark.thorough
@pytest.mark.parametrize("first", range(0, 60, 20))
def test_both_engines_are_equal_with_classes_of_links(first: int):
    unlike = {seed: flown(seed, True) for seed in range(first, first + 20)}
    assert {seed: found for seed, found in unlike.items() if found} == {}


@pytest.mark.parametrize("graded", by_default([False], [False, True]))
@pytest.mark.parametrize("first", by_default([300], range(300, 340, 8)))
def test_no_event_breaks_a_rule(first: int, graded: bool):
    """The audit after each event, and the log read by rules of its own."""
    for seed in range(first, first + (2 if first == 300 else 8)):
        world = world_of(seed, graded)
        for log in audited(world):
            check_log(world, log)


def test_random_fleets_differ_in_every_key():
    differing = [set(world_of(seed, seed % 2 == 0).scenario.differing) for seed in range(30)]
    assert set.union(*differing) == {
        *("footprint_radius_m", "bandwidth_kbps", "radio", "motion", "battery", "admission")
    }
