"""The tour past the homes of users: its length, its division among drones, and its flights."""

from itertools import pairwise, permutations
from typing import Any

import numpy as np
import pytest

from desim_uav.errors import PolicyError
from desim_uav.experiment.run import play
from desim_uav.model.random.streams import Purpose, Streams
from desim_uav.policies import load_policy
from desim_uav.policies.tour import Tour, rounds_of, tour_of
from desim_uav.scenario.load import from_mapping, load
from desim_uav.shipped import scenario_path
from desim_uav.world import World, build_world
from tests.engine.helpers import in_3d, strip
from tests.selection import by_default

Cell = tuple[int, int]


def length(order: Any, at_m: Any) -> float:
    ends = np.roll(order, -1)
    return float(np.abs(at_m[order] - at_m[ends]).sum())


def flown(world: World, policy: Any, drone: int = 0) -> list[Cell]:
    """The cells of a drone after each step."""
    ((log, _),) = play(world, load_policy(policy), "mine", seed=0)
    return [world.grid.cell_of(s.x_m, s.y_m) for s in log.steps if s.drone == drone]


def homes(*cells: Cell) -> list[tuple[float, float]]:
    return [(240.0 * x + 120.0, 240.0 * y + 120.0) for x, y in cells]


# ---- the tour


@pytest.mark.parametrize("seed", by_default(range(3), range(40)))
def test_a_tour_of_few_places_is_near_the_shortest(seed):
    at_m = np.random.default_rng(seed).integers(0, 20, (7, 2)).astype(float)
    shortest = min(length(np.array((0, *rest)), at_m) for rest in permutations(range(1, 7)))
    found = tour_of(at_m)
    assert sorted(found) == list(range(7))
    assert shortest <= length(found, at_m) <= 1.25 * shortest


def test_no_reversal_makes_it_shorter():
    at_m = np.random.default_rng(5).random((40, 2))
    found = tour_of(at_m)
    for i in range(40):
        for j in range(i + 2, 41):
            other = np.concatenate([found[:i], found[i:j][::-1], found[j:]])
            assert length(other, at_m) >= length(found, at_m) - 1e-5


@pytest.mark.parametrize(("starts", "count"), [(1, 1), (2, 30), (5, 12), (4, 2)])
def test_every_stop_is_on_a_round(starts, count):
    chance = np.random.default_rng(count)
    stops = sorted({(int(x), int(y)) for x, y in chance.integers(0, 12, (count, 2))})
    world = strip([(k, 0) for k in range(starts)], cells=(12, 12))
    rounds = rounds_of(world, stops)
    assert {cell for own in rounds for cell in own} == set(stops)
    assert len(rounds) == starts and all(rounds)
    if len(stops) >= 3 * starts:
        assert sum(map(len, rounds)) == len(stops), "no stop is on two rounds"


def test_parts_are_those_near_the_drones():
    stops = [(0, 0), (1, 0), (1, 1), (9, 8), (9, 9), (10, 9)]
    rounds = rounds_of(strip([(11, 11), (0, 3)], cells=(12, 12)), stops)
    assert [sorted(own) for own in rounds] == [stops[3:], stops[:3]]
    assert [own[0] for own in rounds] == [(10, 9), (1, 1)], "the nearest stop comes first"


# ---- flights


def test_a_drone_flies_round_after_round():
    world = strip([(0, 0)], homes((2, 0), (4, 0)), steps=9)
    path = [x for x, _ in flown(world, Tour())]
    assert path == [1, 2, 3, 4, 3, 2, 3, 4, 3]
    assert [x for x, _ in flown(world, Tour(stay=1))] == [1, 2, 2, 3, 4, 4, 3, 2, 2]


def test_a_drone_climbs_over_a_building():
    world = in_3d([[1, 0, 30.0], [1, 1, 30.0]], [(0, 0)], users=homes((2, 0)), steps=5)
    assert flown(world, Tour()) == [(0, 0), (1, 0), (2, 0), (2, 0), (2, 0)]


@pytest.mark.parametrize("battery", [{"autonomy_min": 10}, {"autonomy_min": 25}])
def test_drones_are_home_in_time_for_a_charge(battery):
    """With three drones at the edge of what a battery lasts, nobody crashes, and all fly on."""
    battery = {**battery, "return_below": 0.9}
    stations = {"count": 1, "full_charge_min": 3}
    users = homes(*((x, y) for x in (0, 4, 8) for y in (0, 4, 8)))
    world = strip([(4, 4)] * 2, users, (9, 9), steps=120, battery=battery, stations=stations)
    ((log, _),) = play(world, Tour(), "mine", seed=0)
    assert log.crashes == 0
    assert log.charges >= 4
    visited = {world.grid.cell_of(s.x_m, s.y_m) for s in log.steps}
    if battery["autonomy_min"] == 25:
        assert {world.grid.cell_of(*at) for at in users} <= visited


def test_only_the_groups_that_are_named_are_visited():
    scenario = from_mapping(
        {
            "map": {"size_m": [2160, 240], "cells": [9, 1], "dimensions": 2},
            "users": [
                {"name": "meters", "positions_m": homes((1, 0), (3, 0))},
                {"name": "people", "positions_m": homes((8, 0))},
            ],
            "drones": {"count": 1, "start_cells": [[0, 0]], "battery": None},
            "stations": {"count": 0},
            "episode": {"steps": 12},
        }
    )
    world = build_world(scenario, 0)
    assert max(x for x, _ in flown(world, "tour:meters")) == 3
    assert max(x for x, _ in flown(world, Tour(groups=["people"]))) == 8
    assert max(x for x, _ in flown(world, "tour:meters+people+stay=0")) == 8
    for name, words in (
        ("tour:meter", r"unknown group of users 'meter' \(did you mean 'meters'\?\); there are me"),
        ("tour:meters+stai=1", r"tour has no option 'stai' \(did you mean 'stay'\?\)"),
        ("tour:stay=x", "must be a whole number from 0 to 1000"),
    ):
        with pytest.raises(PolicyError, match=words):
            load_policy(name).begin(world, Streams(0, Purpose.LEARNER))
    with pytest.raises(PolicyError, match="there are none; users are not a list of groups"):
        load_policy("tour:meters").begin(strip(), Streams(0, Purpose.LEARNER))


@pytest.mark.parametrize("name", by_default(["case8"], ["case8", "case9", "festival", "tiny"]))
def test_a_remembered_tour_goes_on(name):
    """What is remembered is all that decisions depend on."""
    scenario = load(scenario_path(name), ["episode.steps=8"])
    world = build_world(scenario, 0)
    whole = play(world, Tour(), "mine", seed=0)
    assert [log.crashes for log, _ in whole] == [0]
    one, other = Tour(), Tour()
    for each in (one, other):
        each.begin(world, Streams(0, Purpose.LEARNER))
    one._next[0] = len(one._rounds[0]) - 1
    other.remember(one.memory())
    assert other.memory() == one.memory()


def test_consecutive_cells_are_neighbours():
    world = strip([(0, 0)], homes((2, 2), (0, 2), (2, 0)), (3, 3), steps=20)
    for one, other in pairwise(flown(world, Tour())):
        assert abs(one[0] - other[0]) + abs(one[1] - other[1]) == 1
