"""The best cells for hovering drones: by hand, against every placement, and on the engine."""

from itertools import combinations_with_replacement, product

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from desim_uav.engine.base import RunSettings
from desim_uav.engine.des import Simulation
from desim_uav.errors import UsageError
from desim_uav.model.rules import Action
from desim_uav.optimum import footprints
from desim_uav.optimum.cover import GUARANTEE, Spots, cover, fair_cover, instant_bound
from desim_uav.optimum.footprints import flown_to
from desim_uav.optimum.search import best_cover, greedy_cover
from desim_uav.sample_path import draw
from desim_uav.scenario.load import from_mapping, load
from desim_uav.shipped import scenario_path
from desim_uav.world import build_world
from tests.engine.helpers import in_3d, strip


def a_world(drones, users, cells=(4, 4), radius_m=260.0, **changes):
    return strip([(0, 0)] * drones, users, cells, radius_m=radius_m, **changes)


# ---- worked by hand


def test_two_crowds():
    """Three users at each end of a row, one in the middle: the ends; the first of equal cells."""
    users = [(x, 120) for x in (100, 120, 140, 1080, 2020, 2040, 2060)]
    world = a_world(2, users, (9, 1), 100.0)
    best = cover(Spots(world))
    assert (best.cells, best.users, best.exact) == ([(0, 0), (8, 0)], 6, True)


def test_the_disc_is_closed():
    """A user exactly at the radius is covered, as in the engine."""
    assert cover(Spots(a_world(1, [(220, 120)], (9, 1), 100.0))).users == 1
    assert cover(Spots(a_world(1, [(220.001, 120)], (1, 1), 100.0))).users == 0


def test_one_crowd_is_shared():
    """Six users on one cell are two fair shares: both drones there earn all there is."""
    world = a_world(2, [(120, 120)] * 6, (9, 1), 100.0)
    fair = fair_cover(Spots(world))
    assert (fair.cells, fair.score / 6, fair.users, fair.least) == ([(0, 0), (0, 0)], 2.0, 6, 6)


def test_a_fair_share_is_worth_no_more():
    """Five users here, one there, none elsewhere; a share is 2. Six users of three drones.

    Two drones share the five (2 each), one gets the lone one (1/2): 2.5. Three on the crowd hold
    2, 2 and 1: 2.5, too, with one user fewer.
    """
    users = [(120, 120)] * 5 + [(2040, 120)]
    fair = fair_cover(Spots(a_world(3, users, (9, 1), 100.0)))
    assert fair.score / 6 == 2.5
    assert (fair.cells, fair.users, fair.least) == ([(0, 0), (0, 0), (8, 0)], 6, 5)


def test_a_cell_nobody_can_get_to():
    """Walled in by towers up to the ceiling; over a lower house one can fly."""
    tower, house = 60, 30
    buildings = [[0, 1, tower], [1, 1, tower], [2, 0, house]]
    world = in_3d(buildings, [(0, 0)], (3, 2), users=[(120, 360), (600, 120)], radius_m=100.0)
    assert {node[:2] for node in flown_to(world)} == {(0, 0), (1, 0), (2, 0), (2, 1)}
    assert (2, 0, 0) not in flown_to(world)
    best = cover(Spots(world))
    assert (best.cells, best.users) == ([(2, 0)], 1)


def test_more_drones_than_cells():
    best = cover(Spots(a_world(5, [(120, 120), (360, 120)], (2, 1), 100.0)))
    assert (best.users, len(best.cells), best.exact) == (2, 5, True)


def test_on_the_way():
    """Half-way between two cells both users are in reach, over either of them one is."""
    world = a_world(1, [(150, 120), (330, 120)], (2, 1), 100.0)
    places = Spots(world)
    assert (cover(places).users, instant_bound(places)) == (1, 2)


# ---- against every placement


def by_all_placements(places):
    """(Most users, best sum of fair shares, least and most users with it), by brute force."""
    drones, users = places.drones, places.users
    held = places.footprints.by_cell()
    cells = sorted({(ix, iy) for ix, iy, _ in flown_to(places.world)})
    most, best, with_best = 0, -1.0, []
    for placement in combinations_with_replacement(cells, drones):
        covers = [set(np.flatnonzero(held[cell]).tolist()) for cell in placement]
        covered = set().union(*covers)
        most = max(most, len(covered))
        choices = [[d for d in range(drones) if user in covers[d]] for user in covered]
        for attached in product(*choices):
            shares = (min(1.0, attached.count(d) * drones / users) for d in range(drones))
            reward = round(sum(shares), 9)
            if reward > best:
                best, with_best = reward, []
            if reward == best:
                with_best.append(len(covered))
    return most, best, min(with_best), max(with_best)


@settings(max_examples=60, deadline=None)
@given(st.data())
def test_against_every_placement(data):
    cells = data.draw(st.sampled_from([(3, 3), (4, 2), (5, 1)]))
    drones = data.draw(st.integers(1, 3))
    side = st.integers(0, 24).map(lambda tenth: tenth * 10.0 * cells[0])
    users = data.draw(st.lists(st.tuples(side, st.just(120.0)), min_size=1, max_size=6))
    radius_m = data.draw(st.sampled_from([60.0, 150.0, 260.0, 400.0]))
    places = Spots(a_world(drones, users, cells, radius_m))
    best, fair = cover(places), fair_cover(places)
    most, reward, least, greatest = by_all_placements(places)
    assert (best.users, best.exact) == (most, True)
    assert (round(fair.score / len(users), 9), fair.least, fair.users) == (reward, least, greatest)
    assert fair.exact


@pytest.mark.parametrize(("drones", "cells"), [(2, 10), (3, 10), (2, 20), (3, 20), (4, 10)])
@pytest.mark.parametrize("seed", [0, 1])
def test_larger_maps(drones, cells, seed):
    """By numbers: every pair, triple, quadruple of footprints that lie in no other."""
    rng = np.random.default_rng(seed)
    users = (rng.random((70, 2)) * 2400).tolist()
    size = {"size_m": [2400, 2400], "cells": [cells, cells]}
    world = strip([(0, 0)] * drones, users, (10, 10), radius_m=300.0, map=size)
    places = Spots(world)
    held = places.footprints.by_cell().reshape(-1, 70)
    held = np.unique(held, axis=0)
    inside = (held[:, None] <= held[None]).all(axis=2)
    held = held[inside.sum(axis=1) == 1].astype(np.float32)
    missed = 1.0 - held
    least = np.inf
    for one in range(len(held)):
        if drones == 2:
            least = min(least, (missed[one] @ missed.T).min())
        elif drones == 3:
            least = min(least, ((missed[one] * missed) @ missed.T).min())
    best = cover(places)
    assert best.exact
    if drones < 4:
        assert best.users == 70 - least
    fair = fair_cover(places)
    assert fair.exact and fair.score <= drones * best.users
    assert fair.users <= best.users


def test_the_first_of_equally_good_covers():
    """Two drones, four footprints: the greedy cover has five users, others all six."""
    held = np.array(
        [[1, 1, 0, 1, 1, 0], [1, 1, 1, 0, 0, 0], [0, 0, 0, 1, 1, 1], [1, 1, 1, 0, 0, 0]]
    )
    greedy, bound = greedy_cover(held.astype(bool), 2)
    assert greedy.tolist() == [0, 1] and bound == 6
    found, most = best_cover(held.astype(bool), 2, 60.0, in_order=True)
    assert (found.tolist(), most) == ([1, 2], 6)


def test_an_interrupted_search_still_knows_its_bounds():
    rng = np.random.default_rng(5)
    users = (rng.random((300, 2)) * 2400).tolist()
    world = strip([(0, 0)] * 6, users, (10, 10), radius_m=300.0)
    places = Spots(world)
    proven, found = cover(places), cover(places, limit_s=0.0)
    assert proven.exact and not found.exact
    assert found.users <= proven.users <= found.at_most
    assert found.users >= GUARANTEE * proven.users
    most, fair = fair_cover(places), fair_cover(places, budget=0)
    assert most.exact and not fair.exact and fair.least is None
    assert fair.score <= most.score <= fair.at_most
    assert instant_bound(places, limit_s=0.0) >= instant_bound(places) >= proven.users


# ---- on the engine


def hovered(scenario, cells):
    """The QoE3 of drones that begin over these cells and stay there, and their mean rewards."""
    keys = {"drones": scenario.drones.model_copy(update={"start_cells": tuple(cells)})}
    world = build_world(scenario.model_copy(update=keys), 0)
    engine = Simulation(world, RunSettings((True,) * len(cells), carry_over=False))
    shown = engine.reset(draw(world, 0, 0))
    while not shown.truncated:
        shown = engine.step([world.actions.index(Action.HOVER)] * len(cells))
    users = len(world.homes)
    return 100 * engine.log.attached_us / (engine.log.duration_us * users), shown.rewards


@pytest.mark.parametrize("case", ["case1", "case2", "case3", "tiny"])
@pytest.mark.parametrize("radius_m", [200.0, 600.0])
def test_as_the_engine_says(case, radius_m):
    scenario = load(scenario_path(case), [f"drones.footprint_radius_m={radius_m}", "world_seed=0"])
    places = Spots(build_world(scenario, 0))
    best, fair = cover(places), fair_cover(places)
    qoe3, _ = hovered(scenario, best.cells)
    assert qoe3 == 100 * best.users / places.users
    qoe3, rewards = hovered(scenario, fair.cells)
    assert fair.least <= fair.users
    assert qoe3 == 100 * fair.users / places.users
    assert sum(rewards) <= fair.score / places.users + 1e-12
    if len(fair.cells) == 1:
        assert sum(rewards) == fair.score / places.users


def test_as_the_engine_says_in_3d():
    """Flown to the best cell, which is built up: above the house the footprint is the same."""
    changes = {"users": [(600, 120), (600, 100)], "radius_m": 100.0, "steps": 5}
    world = in_3d([[2, 0, 30], [0, 1, 60]], [(0, 0)], (3, 2), timing="fill_epoch", **changes)
    best = cover(Spots(world))
    assert (best.cells, best.users) == ([(2, 0)], 2)
    engine = Simulation(world, RunSettings((True,), carry_over=False))
    shown = engine.reset(draw(world, 0, 0))
    for action in (Action.UP, Action.RIGHT, Action.RIGHT, Action.HOVER, Action.HOVER):
        shown = engine.step([world.actions.index(action)])
    assert shown.observations[0][3:5] == ((2, 0), 1)
    assert shown.observations[0].attached_users == best.users


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 2**20), st.integers(1, 3), st.sampled_from([100.0, 200.0, 400.0]))
def test_nobody_holds_more_at_any_instant(seed, drones, radius_m):
    """Drones at random: never more users attached than the bound, nor a step paid better."""
    rng = np.random.default_rng(seed)
    users = (rng.random((20, 2)) * 960).tolist()
    timing = ("fill_epoch", "minimum_time")[seed % 2]
    reward = {"kind": "coverage"}
    world = a_world(drones, users, radius_m=radius_m, timing=timing, steps=20, reward=reward)
    places = Spots(world)
    bound, fair = instant_bound(places), fair_cover(places)
    engine = Simulation(world, RunSettings((True,) * drones, False, keep_events=True))
    shown = engine.reset(draw(world, 0, 0))
    while not shown.truncated:
        shown = engine.step(rng.integers(len(world.actions), size=drones).tolist())
        assert sum(shown.rewards) <= fair.score / places.users + 1e-12
    attached = 0
    for _, _, kind, *_ in engine.log.events:
        attached += (kind == "attach") - (kind == "detach")
        assert attached <= bound


# ---- what is refused


def test_users_that_walk():
    world = build_world(load(scenario_path("case8"), ["world_seed=0"]), 0)
    with pytest.raises(UsageError, match=r"^users\.mobility: .* not for 'random_walk'"):
        Spots(world)


def test_too_large_a_map(monkeypatch):
    monkeypatch.setattr(footprints, "LARGEST", 10)
    with pytest.raises(UsageError, match=r"^map\.cells: 9 cells times 2 users"):
        Spots(a_world(1, [(0, 0), (1, 1)], (9, 1)))


def test_too_many_drones_to_share():
    world = build_world(
        from_mapping(
            {
                "drones": {"count": 9, "battery": None},
                "stations": {"count": 0},
                "users": {"count": 4, "mobility": {"kind": "static"}},
            }
        ),
        0,
    )
    assert fair_cover(Spots(world)) is None
