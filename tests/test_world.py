"""Drawn worlds: users around their clusters, stations on their circle, buildings out of the way."""

import math

import networkx as nx
import numpy as np
import pytest
from scipy import stats

from desim_uav.errors import ScenarioError
from desim_uav.model.rules import Action
from desim_uav.scenario.load import dump, from_mapping, load, loads
from desim_uav.shipped import scenario_path
from desim_uav.world import build_world
from tests.verification.engines import differences, engines
from tests.verification.figure import check
from tests.verification.placement import CUT, SIGMA_M, figures, offsets, scenario, world

FLAT = {"map.dimensions": 2, "users.count": 1}


def within(values, expected, errors=4.0):
    """Is the mean of independent values within so many standard errors of what it should be?"""
    values = np.asarray(values, float)
    return abs(values.mean() - expected) <= errors * values.std(ddof=1) / math.sqrt(len(values))


def built(drawn):
    """The cells with a building."""
    return {tuple(cell) for cell in np.argwhere(drawn.grid.height_m > 0.0).tolist()}


class TestUsers:
    @pytest.mark.parametrize("size", ["[2400, 2400]", "[600, 2400]", "[500, 400]"])
    @pytest.mark.parametrize("seed", range(5))
    def test_inside_their_disc_and_the_map(self, size, seed):
        drawn = world(
            seed,
            map__size_m=size,
            map__cells="[8, 8]",
            map__dimensions=2,
            users__count=400,
            drones__battery="null",
            stations__count=0,
        )
        width, depth = drawn.scenario.map.size_m
        for user, (x, y, z) in enumerate(drawn.homes):
            cx, cy, radius = drawn.clusters[user % 4]
            assert math.hypot(x - cx, y - cy) <= radius
            assert 0 <= x <= width
            assert 0 <= y <= depth
            assert z == 0.0

    def test_the_truncated_normal(self):
        # r² / 2σ² is exponential, cut off at (2σ)² / 2σ² = 2; the bearing is uniform.
        offset = offsets(8000)
        scaled = (offset**2).sum(axis=1) / (2 * SIGMA_M**2)
        assert scaled.max() <= 2.0
        assert stats.kstest(scaled, lambda e: (1 - np.exp(-e)) / CUT).pvalue > 1e-3
        bearing = np.arctan2(offset[:, 1], offset[:, 0])
        assert stats.kstest(bearing, stats.uniform(-math.pi, 2 * math.pi).cdf).pvalue > 1e-3
        assert within(offset[:, 0] * offset[:, 1], 0.0)

    def test_the_moments_cut_by_the_disc_and_by_the_map(self):
        check(figures())

    def test_heights_in_a_built_cell(self):
        # Every cell is built, 5 to 15 m; nobody lives above 9 m.
        drawn = world(
            5,
            users__count=3000,
            users__clusters__count=30,
            users__max_height_m=9,
            map__obstacles="{coverage: [1, 1], height_m: [5, 15]}",
        )
        share = []
        for x, y, z in drawn.homes:
            building = drawn.grid.height_m[int(x // 240), int(y // 240)]
            if building == 0.0:
                assert z == 0.0
                continue
            assert 0.0 <= z <= min(building, 9.0)
            share.append(z / min(building, 9.0))
        assert len(share) > 2500
        assert stats.kstest(share, "uniform").pvalue > 1e-3

    def test_nobody_lives_above_the_ground_without_a_building(self):
        drawn = world(6, users__count=500)
        cells = [(int(x // 240), int(y // 240)) for x, y, _ in drawn.homes]
        in_built = np.array([cell in built(drawn) for cell in cells])
        assert (drawn.homes[~in_built, 2] == 0.0).all()
        assert (drawn.homes[in_built, 2] > 0.0).all()
        assert in_built.any()

    def test_at_given_places(self):
        places = [[100, 300], [0, 0], [2400, 2400]]
        drawn = world(map__dimensions=2, users__positions_m=places)
        assert drawn.homes.tolist() == [[*place, 0] for place in places]


class TestClusters:
    def test_radii_and_centroids(self):
        drawn = world(1, **FLAT, users__clusters__count=5000)
        x, y, radius = drawn.clusters.T
        assert stats.kstest(radius, stats.uniform(240, 240).cdf).pvalue > 1e-3
        for place in (x, y):
            along = (place - radius) / (2400 - 2 * radius)
            assert stats.kstest(along, "uniform").pvalue > 1e-3
        assert within((x - x.mean()) * (y - y.mean()), 0.0)

    def test_where_a_radius_does_not_fit_the_centroid_is_in_the_middle(self):
        drawn = world(
            1,
            **FLAT,
            map__size_m="[400, 2400]",
            users__clusters__count=50,
            drones__battery="null",
            stations__count=0,
        )
        x, _, radius = drawn.clusters.T
        assert (x[radius >= 200] == 200.0).all()

    def test_users_are_dealt_round_robin(self):
        drawn = world(2, map__dimensions=2, users__count=10, users__clusters="{count: 3}")
        found = [
            {c for c, (x, y, r) in enumerate(drawn.clusters) if math.hypot(hx - x, hy - y) <= r}
            for hx, hy, _ in drawn.homes
        ]
        assert all(user % 3 in near for user, near in enumerate(found))


class TestStationsAndStarts:
    def test_case_8(self):
        case = load(scenario_path("case8"))
        for seed in range(3):
            drawn = build_world(case, seed)
            assert drawn.stations == ((5, 9), (8, 3), (1, 3))
            assert drawn.starts == drawn.stations

    @pytest.mark.parametrize(
        ("count", "cells"),
        [
            (1, ((5, 9),)),
            (2, ((5, 9), (5, 1))),
            (3, ((5, 9), (8, 3), (1, 3))),
            (4, ((5, 9), (9, 5), (5, 1), (1, 5))),
        ],
    )
    def test_on_a_circle_clockwise_from_north(self, count, cells):
        assert world(stations__count=count, **FLAT).stations == cells
        alone = world(stations__count=0, drones__battery="null", drones__count=count, **FLAT)
        assert (alone.stations, alone.starts) == ((), cells)

    def test_drones_start_round_robin(self):
        drawn = world(drones__count=5, stations__count=2, **FLAT)
        assert drawn.starts == ((5, 9), (5, 1), (5, 9), (5, 1), (5, 9))
        given = world(drones__count=2, drones__start_cells="[[0, 1], [3, 3]]", **FLAT)
        assert given.starts == ((0, 1), (3, 3))

    def test_clipped_to_the_map(self):
        drawn = world(stations__radius_m=5000, stations__count=4, **FLAT)
        assert drawn.stations == ((5, 9), (9, 5), (5, 0), (0, 5))

    def test_two_on_one_cell(self):
        with pytest.raises(ScenarioError, match="on one cell"):
            scenario(stations__radius_m=100, stations__count=4)


class TestBuildings:
    @pytest.mark.thorough
    @pytest.mark.parametrize("stations", [0, 3])
    def test_coverage_heights_and_free_cells(self, stations):
        options = {"drones.battery": "null"} if stations == 0 else {}
        counts, shares = [], []
        for seed in range(150):
            drawn = world(seed, stations__count=stations, users__count=1, **options)
            height_m = drawn.grid.height_m
            cells = built(drawn)
            kept_free = {*drawn.stations, *drawn.starts}
            assert not cells & kept_free
            assert 5 - len(kept_free) <= len(cells) <= 15
            heights = height_m[height_m > 0]
            assert ((heights >= 20) & (heights <= 60)).all()
            counts.append(len(cells))
            shares += ((heights - 20) / 40).tolist()
            free = nx.grid_2d_graph(10, 10)
            free.remove_nodes_from(cells)
            assert nx.is_connected(free)
        assert min(counts) <= 6
        assert max(counts) >= 14
        # Uniform in 5-15 %; three in a hundred squares fall on a cell that is kept free.
        assert within(counts, 10.0 * 0.97)
        assert stats.kstest(shares, "uniform").pvalue > 1e-3

    def test_every_other_cell_is_built_as_often(self):
        often = np.zeros((10, 10))
        for seed in range(300):
            often += world(seed, users__count=1).grid.height_m > 0
        often = np.delete(often.ravel(), [59, 83, 13])
        assert often.min() > 0
        # Redrawn maps and draws without replacement bend this a little: 97 cells, 300 maps.
        assert stats.chisquare(often).pvalue > 1e-3

    def test_nothing_is_built_in_2d(self):
        drawn = world(**FLAT)
        assert built(drawn) == set()
        assert drawn.grid.levels_m == (20.0,)
        assert Action.UP not in drawn.actions

    @pytest.mark.parametrize("seed", range(10))
    def test_one_large_square_covers_all_cells_it_touches(self, seed):
        # 16 squares of 600 m, two and a half cells: one of them is built.
        drawn = world(
            seed,
            drones__count=1,
            drones__battery="null",
            stations__count=0,
            users__count=1,
            drones__start_cells="[[0, 0]]",
            map__obstacles="{coverage: [0.0625, 0.0625], height_m: [30, 30], square_m: 600}",
        )
        touched = [
            [i for i in range(10) if 240 * i < 600 * (s + 1) and 240 * (i + 1) > 600 * s]
            for s in range(4)
        ]
        possible = [{(i, j) for i in xs for j in ys} - {(0, 0)} for xs in touched for ys in touched]
        assert built(drawn) in possible

    def test_a_cell_is_as_tall_as_its_tallest_square(self):
        # Four squares a cell, all built: the tallest of four uniform heights.
        heights = []
        for seed in range(20):
            drawn = world(
                seed,
                users__count=1,
                map__obstacles="{coverage: [1, 1], height_m: [5, 15], square_m: 120}",
            )
            assert len(built(drawn)) == 97
            heights += drawn.grid.height_m[drawn.grid.height_m > 0].tolist()
        assert stats.kstest(heights, lambda h: ((h - 5) / 10) ** 4).pvalue > 1e-3

    def test_squares_are_drawn_without_replacement(self):
        # All of them; squares of 100 m fit no cell of 240 m.
        everywhere = "{coverage: [1, 1], height_m: [5, 5], square_m: 100}"
        assert len(built(world(2, users__count=1, map__obstacles=everywhere))) == 97

    def test_levels_end_at_the_tallest_building(self):
        for seed in range(20):
            grid = world(seed, users__count=1).grid
            tallest = grid.height_m.max()
            under = grid.levels_m[: grid.levels_under_ceiling]
            assert under == tuple(z for z in (20.0, 40.0, 60.0) if z <= tallest)
            assert len(grid.levels_m) == len(under) + 1
            assert grid.levels_m[-1] > tallest

    def test_a_map_that_falls_apart_is_redrawn(self):
        # Two in five cells: about none of the first draws hangs together on a small map.
        options = {
            "map__size_m": "[1200, 1200]",
            "map__cells": "[5, 5]",
            "users__count": 1,
            "stations__radius_m": 480,
            "users__clusters__radius_m": "[100, 100]",
            "map__obstacles": "{coverage: [0.4, 0.4], height_m: [20, 60]}",
        }
        for seed in range(20):
            drawn = world(seed, **options)
            free = nx.grid_2d_graph(5, 5)
            free.remove_nodes_from(built(drawn))
            assert nx.is_connected(free)

    def test_none_of_a_hundred_redrawn_maps(self):
        with pytest.raises(ScenarioError, match=r"map\.obstacles: none of 101 drawn maps"):
            world(users__count=1, map__obstacles="{coverage: [0.7, 0.7], height_m: [20, 60]}")

    def test_low_buildings_are_not_in_the_way(self):
        # Below the lowest level; a cell as tall as the level is.
        low = world(map__obstacles="{coverage: [0.9, 0.9], height_m: [19.999, 19.999]}")
        assert not low.grid.blocked.any()
        assert low.grid.levels_m == (20.0,)
        listed = world(map__obstacles="{cells: [[2, 2, 20], [4, 4, 19]]}")
        assert listed.grid.levels_m == (20.0, 40.0)
        assert listed.grid.levels_under_ceiling == 1
        assert np.argwhere(listed.grid.blocked).tolist() == [[0, 2, 2]]
        assert not listed.grid.can_enter(2, 2, 0)
        assert not listed.grid.can_enter(2, 2, 1)
        assert listed.grid.can_enter(2, 2, 1, ceiling=False)
        assert listed.grid.can_enter(4, 4, 0)
        assert not listed.grid.can_enter(-1, 4, 0)
        assert not listed.grid.can_enter(10, 4, 0)


class TestSeeds:
    def test_the_same_seed_is_the_same_world(self):
        one, other = world(7), world(7)
        for name in ("clusters", "homes"):
            assert (getattr(one, name) == getattr(other, name)).all()
        assert (one.grid.height_m == other.grid.height_m).all()

    def test_another_seed_is_another_world(self):
        one, other = world(7), world(8)
        assert (one.clusters != other.clusters).all()
        assert (one.homes[:, :2] != other.homes[:, :2]).all()
        assert (one.grid.height_m != other.grid.height_m).any()

    def test_the_world_seed(self):
        assert scenario(seed=5).effective_world_seed == 5
        assert scenario(seed=5, world_seed=9).effective_world_seed == 9
        assert scenario(seed=5, world_seed=0).effective_world_seed == 0


class TestPhysics:
    def test_the_paper(self):
        drawn = world()
        assert drawn.step_us == 60_000_000
        assert drawn.horizon_us == 1_800_000_000
        assert drawn.only_type.capacity == 1_800_000_000
        assert drawn.links[0].bandwidth_hz == 5_000_000
        assert len(drawn.actions) == 9
        assert {t.duration_us for t in drawn.only_type.epoch_transits.values()} == {60_000_000}
        assert {a.name: t.distance_m for a, t in drawn.only_type.epoch_transits.items()} == {
            "FORWARD": 240,
            "BACKWARD": 240,
            "RIGHT": 240,
            "LEFT": 240,
            "UP": 20,
            "DOWN": 20,
        }
        assert drawn.only_type.planner.hop_us == (*[30_990_663] * 4, *[4_484_639] * 2)

    def test_cells_that_are_not_square(self):
        drawn = world(map__size_m="[2400, 1200]", stations__radius_m=500, users__count=1)
        assert drawn.only_type.epoch_transits[Action.FORWARD].distance_m == 120
        assert drawn.only_type.epoch_transits[Action.RIGHT].distance_m == 240
        assert drawn.only_type.planner.hop_us[0] == 30_990_663
        assert drawn.only_type.planner.hop_us[2] == round((120 / 8.3 + 8.3 / 4) * 1e6)

    def test_unlimited(self):
        drawn = world(**FLAT, drones__battery="null", drones__bandwidth_kbps="null")
        assert drawn.only_type.capacity == 0
        assert drawn.links[0].bandwidth_hz == math.inf
        assert len(drawn.actions) == 5


@pytest.mark.parametrize(
    ("map_", "levels_m", "under_ceiling"),
    [
        ("{obstacles: null}", (20,), 1),
        ("{obstacles: null, levels: {max_altitude_m: 79}}", (20, 40, 60), 3),
        ("{obstacles: null, levels: {max_altitude_m: 80}}", (20, 40, 60, 80), 4),
        ("{obstacles: {cells: [[0, 0, 50]]}}", (20, 40, 60), 2),
        ("{obstacles: {cells: [[0, 0, 50]]}, levels: {max_altitude_m: 30}}", (20, 40, 60), 2),
        ("{obstacles: {cells: [[0, 0, 50]]}, levels: {max_altitude_m: 60}}", (20, 40, 60), 3),
    ],
)
def test_levels_up_to_an_altitude(map_, levels_m, under_ceiling):
    """Levels are those up to the tallest building, or up to max_altitude_m if that is higher."""
    levelled = loads(f"map: {map_}")
    grid = build_world(levelled, 0).grid
    assert grid.levels_m == levels_m
    assert grid.levels_under_ceiling == under_ceiling
    assert levelled.map.most_levels == len(levels_m)
    assert loads(dump(levelled)) == levelled


@pytest.mark.parametrize("motion", [{}, {"space": "free"}])
def test_drones_climb_over_open_country(motion):
    """Without buildings there was one level, and nothing led up."""
    country = {"obstacles": None, "levels": {"max_altitude_m": 60}}
    drones = {"count": 2, "motion": motion}
    text = {"map": country, "drones": drones, "users": {"count": 6}, "episode": {"steps": 8}}
    one, other = engines(build_world(from_mapping(text), 0), (True,) * 2)
    assert differences(one, other, 3, 0) == []
    heights_m = {leg.to_m[2] for leg in one.log.legs}
    assert 20.0 < max(heights_m) <= 60.0
