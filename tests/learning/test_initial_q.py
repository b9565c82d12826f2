"""What a drone believes before it has tried anything."""

import numpy as np
import pytest

from desim_uav.errors import UsageError
from desim_uav.learning.initial_q import initial_q
from desim_uav.model.rules import Action
from desim_uav.scenario.load import from_mapping
from desim_uav.world import World, build_world


def made(kind: str | float, world: World, seed: int = 0) -> np.ndarray:
    features = world.scenario.observation.features(world.facts)
    return initial_q(kind, features, world.actions, world.facts, np.random.default_rng(seed))


@pytest.fixture(scope="module")
def world() -> World:
    return build_world(
        from_mapping({"users": {"clusters": {"count": 2}}, "drones": {"count": 1}}), 3
    )


def test_zero_the_maximum_reward_and_a_number(world: World):
    states = 10 * 10 * world.grid.levels_under_ceiling * 31
    for kind, value in (("zero", 0.0), ("max_reward", 1.0), (2.5, 2.5)):
        table = made(kind, world)
        assert table.shape == (states, 9) and table.dtype == np.float32
        assert (table == value).all()


def test_random_is_uniform_and_its_own(world: World):
    table = made("random", world)
    assert table.min() >= 0 and table.max() <= 1
    assert abs(table.mean() - 0.5) < 4 * np.sqrt(1 / 12 / table.size)
    assert (table == made("random", world)).all()
    assert (table != made("random", world, seed=1)).mean() > 0.99


def test_prior_knowledge_is_how_near_the_next_cell_is_to_a_cluster():
    """1 - distance / diagonal, in metres, from the centre of a cell to that of a centroid's."""
    scenario = from_mapping(
        {
            "map": {"size_m": [960, 480], "cells": [4, 2], "dimensions": 2},
            "drones": {"count": 1, "battery": None},
            "stations": {"count": 0},
            "users": {"count": 3, "clusters": {"count": 1, "radius_m": [100, 100]}},
        }
    )
    world = build_world(scenario, 1)
    cx, cy = world.grid.cell_of(*world.clusters[0, :2])
    table = made("prior", world).reshape(4, 2, 5)
    diagonal = np.hypot(960, 480)
    moves = {0: (0, 1), 1: (0, -1), 2: (1, 0), 3: (-1, 0), 4: (0, 0)}
    for x in range(4):
        for y in range(2):
            for action, (dx, dy) in moves.items():
                there = min(max(x + dx, 0), 3), min(max(y + dy, 0), 1)
                away = 240 * np.hypot(there[0] - cx, there[1] - cy)
                assert table[x, y, action] == pytest.approx(1 - away / diagonal, abs=1e-6)
    assert table.max() == 1.0


def test_prior_knowledge_of_the_nearest_cluster_at_every_battery_and_level(world: World):
    levels = world.grid.levels_under_ceiling
    table = made("prior", world).reshape(10, 10, levels, 31, 9)
    assert (table == table[:, :, :1, :1]).all(), "level and battery do not matter"
    hover = world.actions.index(Action.HOVER)
    for action in (Action.UP, Action.DOWN, Action.GOTO_CHARGING_STATION, Action.CHARGE):
        assert (table[..., world.actions.index(action)] == table[..., hover]).all()
    homes = [world.grid.cell_of(x, y) for x, y, _ in world.clusters]
    best = {tuple(place) for place in np.argwhere(table[:, :, 0, 0, hover] == 1.0).tolist()}
    assert best == set(homes)


def test_prior_knowledge_of_nothing():
    scenario = from_mapping({"users": {"positions_m": [[100, 100]]}})
    with pytest.raises(UsageError, match=r"learning\.initial_q: prior knowledge needs clusters"):
        made("prior", build_world(scenario, 0))
