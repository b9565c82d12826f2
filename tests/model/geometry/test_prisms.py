"""Obstacles as prisms, and where a way enters them, against places all along the way."""

import numpy as np
import pytest

from desim_uav.model.geometry.prisms import Zone, deepest_at, first_entry, obstacles
from tests.model.geometry.maps import Town, depths, random_town

FLAT = np.zeros((10, 10))
CELL = (100.0, 100.0)
HOUSE = FLAT.copy()
HOUSE[4, 4] = 50.0
TRIANGLE = Zone(np.array([(650.0, 100.0), (750.0, 100.0), (700.0, 200.0)]), 30.0, 60.0)


class TestByHand:
    HOUSES = obstacles(HOUSE, CELL, [TRIANGLE], 5.0)

    def enters(self, start, stop):
        start, stop = tuple(map(float, start)), tuple(map(float, stop))
        share = first_entry(self.HOUSES, start, stop)
        return share if share == np.inf else share * float(np.linalg.norm(np.subtract(stop, start)))

    def test_a_way_ends_a_margin_before_a_wall(self):
        assert self.enters((0, 450, 40), (1000, 450, 40)) == pytest.approx(395.0)
        assert self.enters((450, 1000, 40), (450, 0, 40)) == pytest.approx(495.0)

    def test_a_way_down_ends_a_margin_above_a_roof(self):
        assert self.enters((450, 450, 100), (450, 450, 20)) == pytest.approx(45.0)
        # Through the roof at x = 450, and through the wall at x = 395, 52.5 m up.
        found = self.enters((300, 450, 100), (600, 450, 10))
        assert found == pytest.approx(np.hypot(150.0, 45.0))
        assert self.enters((300, 450, 100), (600, 450, -50)) == pytest.approx(95.0 * 5**0.5 / 2)

    def test_a_way_above_and_beside_is_free(self):
        assert self.enters((0, 450, 55), (1000, 450, 55)) == np.inf
        assert self.enters((0, 395, 10), (1000, 395, 10)) == np.inf
        assert self.enters((0, 395.00001, 10), (1000, 395.00001, 10)) == pytest.approx(395.0)

    def test_under_and_over_a_zone(self):
        across = (600, 150), (800, 150)
        assert self.enters((*across[0], 20), (*across[1], 20)) == np.inf
        assert self.enters((*across[0], 70), (*across[1], 70)) == np.inf
        # The left side is x = 650 + (y - 100) / 2; its normal (2, -1) / sqrt(5) is moved by 5 m.
        wall = 675 - 5 * 5**0.5 / 2
        assert self.enters((*across[0], 40), (*across[1], 40)) == pytest.approx(wall - 600)
        assert self.enters((700, 150, 0), (700, 150, 100)) == pytest.approx(25.0)

    def test_a_drone_at_the_edge_flies_on(self):
        assert self.enters((395, 450, 40), (395, 900, 40)) == np.inf
        assert self.enters((395, 450, 40), (300, 440, 40)) == np.inf
        assert self.enters((395, 450, 40), (396, 450, 40)) == 0.0
        assert self.enters((395, 450, 40), (395, 450, 40)) == np.inf
        # However it was rounded.
        for off in (1e-9, -1e-9):
            assert self.enters((395 + off, 450, 40), (395 + off, 900, 40)) == np.inf
            assert self.enters((395 + off, 450, 40), (0, 1000, 90)) == np.inf
            assert self.enters((395 + off, 450, 40), (500, 450, 40)) == pytest.approx(0.0, abs=2e-9)

    def test_a_drone_inside_can_only_get_out(self):
        assert self.enters((400, 450, 40), (300, 450, 40)) == np.inf
        assert self.enters((400, 450, 40), (430, 450, 40)) == 0.0

    def test_depths(self):
        assert deepest_at(self.HOUSES, (450.0, 450.0, 0.0)) == pytest.approx(55.0)
        assert deepest_at(self.HOUSES, (400.0, 450.0, 54.0)) == pytest.approx(1.0)
        assert deepest_at(self.HOUSES, (450.0, 450.0, 60.0)) == pytest.approx(-5.0)
        assert deepest_at(self.HOUSES, (50.0, 50.0, 20.0)) == -np.inf

    def test_nothing_is_in_the_way_without_obstacles(self):
        empty = obstacles(FLAT, CELL, [], 5.0)
        assert first_entry(empty, (0.0, 0.0, 0.0), (999.0, 999.0, 9.0)) == np.inf

    def test_equally_high_houses_side_by_side_are_one(self):
        rows = FLAT.copy()
        rows[2:8, 3:5] = 40.0
        rows[2, 4] = 41.0
        assert len(obstacles(rows, CELL, [], 5.0).heights_m) == 3

    @pytest.mark.parametrize("margin_m", [0.0, -1.0, np.nan, 1001.0])
    def test_margins_are_bounded(self, margin_m):
        with pytest.raises(ValueError, match=r"between 0.01 and 1000 m, not"):
            obstacles(FLAT, CELL, [], margin_m)

    def test_a_zone_has_a_height(self):
        with pytest.raises(ValueError, match="lower at its bottom"):
            obstacles(FLAT, CELL, [TRIANGLE._replace(low_m=60.0)], 5.0)


def random_way(rng, town):
    """A way on the map and somewhat beyond; some are level, vertical, or along walls."""
    size = np.array([*town.size_m, 0.0])
    start, stop = rng.uniform(-0.1, 1.1, (2, 3)) * size + rng.uniform(0, 120.0, (2, 1)) * (0, 0, 1)
    kind = rng.random()
    if kind < 0.3:
        stop[2] = start[2]
    elif kind < 0.4:
        stop[:2] = start[:2]
    elif kind < 0.5:
        grid = rng.integers(0, 10) * town.cell_m[0] + rng.choice([-1, 0, 1]) * town.margin_m
        start[0] = stop[0] = grid
    return start, stop


def survey(maps, seed, ways=10):
    """Ways over random maps: (blocked, free)."""
    rng, blocked, free = np.random.default_rng(seed), 0, 0
    for _ in range(maps):
        town = random_town(rng)
        prisms = town.prisms()
        for _ in range(ways):
            start, stop = random_way(rng, town)
            share = first_entry(prisms, tuple(start), tuple(stop))
            begins_inside = deepest(prisms, start[None])[0] > 1e-6
            if begins_inside:
                continue
            length = np.linalg.norm(stop - start)
            until = min(share, 1.0)
            places = start + np.linspace(0.0, until, 300)[:, None] * (stop - start)
            assert (deepest(prisms, places) <= 2e-6).all()
            assert (town.clearance_m(places) >= town.margin_m - 1e-5).all()
            if share == np.inf:
                free += 1
                continue
            blocked += 1
            # A little further the way is inside, and no farther from the obstacle than it may be.
            after = start + (share + np.array([1e-4, 1e-3]) / length)[:, None] * (stop - start)
            assert (deepest(prisms, after) > 0.0).any() or length * (1 - share) < 1e-3
            at = start + share * (stop - start)
            away = town.clearance_m(at[None], slack_m=-1e-5)[0]
            assert away <= 2**0.5 * town.margin_m + 1e-5
    return blocked, free


def deepest(prisms, places):
    """How deep places (n, 3) are, by own formulas."""
    found = np.full(len(places), -np.inf)
    offsets = zip(prisms.offsets[:-1], prisms.offsets[1:], prisms.heights_m, strict=True)
    for first, last, (low, high) in offsets:
        inside = depths(places[:, :2], prisms.corners_m[first:last])
        vertical = np.minimum(places[:, 2] - low, high - places[:, 2])
        found = np.maximum(found, np.minimum(inside, vertical))
    return found


@pytest.mark.thorough
def test_ways_end_where_they_enter():
    blocked, free = survey(20, 5)
    assert blocked > 20 and free > 20


@pytest.mark.slow
def test_ways_end_where_they_enter_on_a_thousand_maps():
    blocked, free = survey(1000, 6)
    assert blocked > 2000 and free > 2000


def test_a_town_is_what_it_says():
    town = Town(HOUSE, CELL, [(TRIANGLE.corners_m, 30.0, 60.0)], 5.0)
    places = np.array([(390.0, 450.0, 40.0), (700.0, 210.0, 40.0), (700.0, 210.0, 66.0)])
    assert town.clearance_m(places).tolist()[:2] == [10.0, 10.0]
    assert town.clearance_m(places)[2] == pytest.approx(np.inf)
