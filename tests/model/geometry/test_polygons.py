"""Polygons: what is refused, convex parts, and growth by a margin."""

import time

import numpy as np
import pytest

from desim_uav.model.geometry.polygons import area, checked, convex_parts, grown
from tests.model.geometry.maps import depths, distances, star

SQUARE = [(0, 0), (10, 0), (10, 10), (0, 10)]
COMB = [(0, 0), (50, 0), (50, 30), (40, 30), (40, 5), (30, 5), (30, 30), (20, 30), (20, 5), (0, 5)]
BOW = [(0, 0), (10, 10), (10, 0), (0, 10)]


def turns(convex):
    ahead = np.roll(convex, -1, axis=0) - convex
    into = np.roll(ahead, 1, axis=0)
    return into[:, 0] * ahead[:, 1] - into[:, 1] * ahead[:, 0]


class TestChecks:
    def test_a_clockwise_polygon_is_turned_and_straight_corners_are_dropped(self):
        found = checked([(0, 0), (0, 10), (5, 10), (10, 10), (10, 0)])
        assert area(found) == 100.0
        assert sorted(map(tuple, found)) == sorted(SQUARE)

    @pytest.mark.parametrize(
        ("corners", "words"),
        [
            ([(0, 0), (1, 1)], "3 to 200 corners, not 2"),
            ([(k, k * k) for k in range(201)], "3 to 200 corners, not 201"),
            ([(0, 0, 0)] * 3, r"a list of corners \[x, y\]"),
            ([(0, 0), (1, 0), (np.nan, 1)], r"a list of corners \[x, y\]"),
            ([*SQUARE, (0, 0)], r"corners 0 and 4 are one place, \(0, 0\)"),
            (BOW, r"edges 0 from \(0, 0\) to \(10, 10\) and 2 from \(10, 0\) to \(0, 10\) meet"),
            ([(0, 0), (10, 0), (10, 10), (5, 0), (0, 10)], "edges 0 .* and 2 .* meet"),
            (
                [(0, 0), (10, 0), (5, 0), (5, 5)],
                r"edges 0 .* and 1 from \(10, 0\) to \(5, 0\) meet",
            ),
            ([(0, 0), (5, 0), (10, 0)], "edges 0 .* and 2 .* meet"),
        ],
    )
    def test_what_is_no_simple_polygon_is_refused(self, corners, words):
        with pytest.raises(ValueError, match=words):
            checked(corners)

    def test_every_simple_star_is_taken(self):
        rng = np.random.default_rng(1)
        for _ in range(200):
            corners = star(rng, rng.uniform(-500, 500, 2), 100.0)
            assert area(checked(corners)) == pytest.approx(abs(area(corners)))

    def test_random_corners_are_refused_where_edges_meet(self):
        rng, refused = np.random.default_rng(2), 0
        for _ in range(300):
            corners = rng.uniform(0.0, 10.0, (5, 2))
            crosses = any(
                turned(*corners[[i, i + 1]], c) * turned(*corners[[i, i + 1]], d) < 0
                and turned(c, d, corners[i]) * turned(c, d, corners[i + 1]) < 0
                for i in range(4)
                for c, d in zip(corners, np.roll(corners, -1, axis=0), strict=True)
            )
            try:
                checked(corners)
            except ValueError:
                refused += 1
                assert crosses
            else:
                assert not crosses
        assert 100 < refused < 290


def turned(a, b, c):
    return (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])


class TestParts:
    def test_a_convex_polygon_is_one_part(self):
        (part,) = convex_parts(checked(SQUARE))
        assert sorted(map(tuple, part)) == sorted(SQUARE)

    def test_a_comb_is_four_parts(self):
        parts = convex_parts(checked(COMB))
        assert len(parts) <= 6
        assert sum(map(area, parts)) == pytest.approx(area(checked(COMB)))

    def test_parts_are_convex_and_make_up_the_polygon(self):
        rng = np.random.default_rng(3)
        for _ in range(100):
            polygon = checked(star(rng, np.zeros(2), 100.0))
            parts = convex_parts(polygon)
            assert all((turns(part) > 0.0).all() for part in parts)
            assert sum(map(area, parts)) == pytest.approx(area(polygon))
            assert len(parts) <= len(polygon) - 2
            places = rng.uniform(-100, 100, (200, 2))
            inside = np.max([depths(places, part) for part in parts], axis=0)
            true = distances(places, polygon) == 0.0
            assert ((inside > 0.0) == true)[np.abs(inside) > 1e-9].all()


class TestGrowth:
    def test_a_square_by_hand(self):
        found = grown(checked(SQUARE), 2.0)
        assert sorted(map(tuple, found)) == [(-2, -2), (-2, 12), (12, -2), (12, 12)]

    def test_a_sharp_corner_is_cut(self):
        found = grown(checked([(0, 0), (100, -5), (100, 5)]), 2.0)
        assert len(found) == 6
        assert found[:, 0].min() == pytest.approx(-2.0)

    def test_it_holds_all_within_the_margin_and_nothing_beyond_its_square_root_of_two(self):
        rng = np.random.default_rng(4)
        for _ in range(200):
            polygon = checked(star(rng, np.zeros(2), 100.0))
            margin = rng.uniform(0.1, 30.0)
            for part in convex_parts(polygon):
                found = grown(part, margin)
                assert (turns(found) > 0.0).all()
                away = distances(found, part)
                assert (away > margin * (1 - 1e-9)).all()
                assert (away < 2**0.5 * margin * (1 + 1e-9)).all()
                places = rng.uniform(-150, 150, (300, 2))
                near = distances(places, part) < margin
                assert (depths(places, found)[near] > -1e-9).all()


def test_parts_of_many_corners_are_found_soon():
    """200 corners took 1.2 s; a comb of 200 corners is cut into its teeth."""
    teeth = [
        (x, y)
        for k in range(49)
        for x, y in ((4 * k, 0), (4 * k, 9), (4 * k + 2, 9), (4 * k + 2, 0))
    ]
    comb = [*teeth, (194, -5), (0, -5)]
    began = time.process_time()
    parts = convex_parts(checked(comb))
    assert time.process_time() - began < 1.0
    assert sum(map(area, parts)) == pytest.approx(49 * 18 + 194 * 5)
    assert all((turns(part) > 0.0).all() for part in parts)
