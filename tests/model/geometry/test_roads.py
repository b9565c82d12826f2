"""Ways round obstacles, against networkx on a graph of its own, and a planner that samples."""

import itertools

import numpy as np
import pytest

from desim_uav.model.geometry.prisms import deepest_at, obstacles
from desim_uav.model.geometry.roads import corners_at, roads
from desim_uav.model.motion.legs import leg_between
from desim_uav.model.motion.limits import CALM, Limits
from tests.model.geometry.maps import graph_of, pieces, random_town, shortest
from tests.model.geometry.ways import times_along, way_home, way_to, whole_way

LIMITS = Limits(10.0, 4.0, 5.0, 3.0, 2.0)
CELL = (100.0, 100.0)
HOUSE = np.zeros((10, 10))
HOUSE[4:6, 4] = 50.0  # from (400, 400) to (600, 500); with 5 m, from (395, 395) to (605, 505)


class TestByHand:
    HOUSES = obstacles(HOUSE, CELL, [], 5.0)
    STATIONS = np.array([(500.0, 900.0), (50.0, 450.0)])
    WAYS = roads(HOUSES, 40.0, STATIONS, (1000.0, 1000.0))

    def test_round_a_house(self):
        found = whole_way(self.HOUSES, self.WAYS, 0, 500.0, 300.0)
        assert found.tolist() in (
            [[500, 300], [395, 395], [395, 505], [500, 900]],
            [[500, 300], [605, 395], [605, 505], [500, 900]],
        )
        length = np.hypot(105, 95) + 110 + np.hypot(105, 395)
        node, metres = way_to(self.HOUSES, self.WAYS, 0, 500.0, 300.0)
        assert metres == pytest.approx(length) and node >= 2

    def test_straight_where_nothing_stands(self):
        assert way_to(self.HOUSES, self.WAYS, 0, 50.0, 300.0) == (0, pytest.approx(750.0))
        assert whole_way(self.HOUSES, self.WAYS, 1, 300.0, 450.0).tolist() == [
            [300, 450],
            [50, 450],
        ]

    def test_over_the_house(self):
        over = roads(self.HOUSES, 55.0, self.STATIONS, (1000.0, 1000.0))
        assert len(over.nodes_m) == 2
        assert way_to(self.HOUSES, over, 0, 500.0, 300.0) == (0, 600.0)

    def test_the_station_that_is_reached_first(self):
        times = times_along(self.WAYS, LIMITS, CALM, np.inf)
        found = way_home(self.HOUSES, self.WAYS, times, LIMITS, CALM, np.inf, 510.0, 300.0)
        # To (50, 450) there is a straight way: 483.8 m at 10 m/s and a ramp of 2.5 s.
        assert found == (1, 1, round((np.hypot(460, 150) / 10 + 2.5) * 1e6))
        # A wind to the north-east makes it quicker to go round the house.
        wind = (6.0, 6.0)
        times = times_along(self.WAYS, LIMITS, wind, np.inf)
        station, node, _ = way_home(
            self.HOUSES, self.WAYS, times, LIMITS, wind, np.inf, 510.0, 300.0
        )
        assert station == 0 and self.WAYS.nodes_m[node].tolist() == [605, 395]

    def test_no_way_in_a_storm(self):
        times = times_along(self.WAYS, LIMITS, (10.0, 1.0), np.inf)
        assert (times[:, 2:] == -1).all() and times[0, 0] == times[1, 1] == 0
        home = way_home(self.HOUSES, self.WAYS, times, LIMITS, (10.0, 1.0), np.inf, 500.0, 300.0)
        assert home == (-1, -1, -1)

    def test_no_way_out_of_a_yard(self):
        yard = np.zeros((10, 10))
        yard[3:6, 3:6] = 60.0
        yard[4, 4] = 0.0
        houses = obstacles(yard, CELL, [], 5.0)
        ways = roads(houses, 40.0, self.STATIONS, (1000.0, 1000.0))
        assert way_to(houses, ways, 0, 450.0, 450.0) == (-1, np.inf)
        assert whole_way(houses, ways, 0, 450.0, 450.0).shape == (0, 2)
        times = times_along(ways, LIMITS, CALM, np.inf)
        assert way_home(houses, ways, times, LIMITS, CALM, np.inf, 450.0, 450.0) == (-1, -1, -1)

    def test_a_station_in_an_obstacle_is_refused(self):
        with pytest.raises(ValueError, match=r"station 1 at \(396, 450\) is in an obstacle"):
            roads(self.HOUSES, 40.0, np.array([(1.0, 1.0), (396.0, 450.0)]), (1000.0, 1000.0))

    def test_too_many_corners_are_refused(self):
        heights = np.random.default_rng(1).uniform(20.0, 60.0, (60, 60))
        heights[::2], heights[:, ::2] = 0.0, 0.0
        houses = obstacles(heights, CELL, [], 5.0)
        with pytest.raises(
            ValueError, match=r"3481 corners at 10 m, and there are 1 stations: more"
        ):
            roads(houses, 10.0, np.array([(50.0, 50.0)]), (6000.0, 6000.0))

    def test_it_does_not_stop_at_corners_which_it_passes_straight_on(self):
        row = np.zeros((10, 10))
        row[[1, 3, 5, 7], 4] = 50.0  # with gaps between them
        houses = obstacles(row, CELL, [], 5.0)
        stations = np.array([(850.0, 450.0), (850.0, 300.0)])
        ways = roads(houses, 40.0, stations, (1000.0, 1000.0))
        for x in (20.0, 40.0, 150.0, 250.0):
            found = whole_way(houses, ways, 0, x, 395.0)
            assert found.tolist() == [[x, 395], [805, 395], [850, 450]]
        found = whole_way(houses, ways, 1, 20.0, 450.0)
        assert found.tolist() == [[20, 450], [95, 395], [850, 300]]

    def test_corners_at_an_altitude(self):
        heights = np.zeros((3, 3))
        heights[0, 0], heights[2, 2] = 30.0, 50.0
        houses = obstacles(heights, CELL, [], 5.0)
        assert [len(corners_at(houses, z, (300.0, 300.0))) for z in (20.0, 40.0, 60.0)] == [2, 1, 0]


def free_place(rng, town, prisms, z):
    """A place on the map that is in no obstacle, or None."""
    for _ in range(50):
        x, y = rng.uniform(0.0, 1.0, 2) * town.size_m
        if deepest_at(prisms, (x, y, z)) <= 0.0:
            return x, y
    return None


def survey(maps, seed):
    """(ways compared, of these round a corner, without a way)."""
    rng, found, bent, without = np.random.default_rng(seed), 0, 0, 0
    while found < maps:
        town, z = random_town(rng), rng.uniform(10.0, 90.0)
        prisms = town.prisms()
        places = [free_place(rng, town, prisms, z) for _ in range(4)]
        if None in places:
            continue
        stations, (x, y) = np.array(places[:2]), places[2]
        ways = roads(prisms, z, stations, town.size_m)
        polygons = pieces(prisms, z)
        corners = np.concatenate([np.zeros((0, 2)), *polygons])
        on_map = ((corners >= 0.0) & (corners <= np.array(town.size_m))).all(axis=1)
        nodes = np.concatenate([stations, [(x, y)], corners[on_map]])
        graph = graph_of(nodes, polygons)
        more = rng.uniform(0.0, 1.0, (60, 2)) * town.size_m
        sampled = graph_of(np.concatenate([nodes[:3], more]), polygons)
        for station in range(2):
            node, length = way_to(prisms, ways, station, x, y)
            assert length == pytest.approx(shortest(graph, 2, station), rel=1e-9)
            assert length <= shortest(sampled, 2, station) + 1e-6
            found += 1
            way = whole_way(prisms, ways, station, x, y)
            if node < 0:
                assert len(way) == 0
                without += 1
                continue
            bent += len(way) > 2
            assert np.hypot(*np.diff(way, axis=0).T).sum() == pytest.approx(length, rel=1e-12)
            assert way[0].tolist() == [x, y] and (way[-1] == stations[station]).all()
            assert ((way >= 0.0) & (way <= np.array(town.size_m))).all()
            hold(town, way, z)
    return found, bent, without


def hold(town, way, z):
    """No place on a way is within a margin of an obstacle."""
    share = np.linspace(0.0, 1.0, 400)[:, None]
    for one, other in itertools.pairwise(way):
        clear = town.clearance_m(one + share * (other - one), z)
        assert (clear >= town.margin_m - 1e-5).all()


@pytest.mark.thorough
def test_ways_are_the_shortest_and_free():
    _found, bent, _without = survey(40, 2)
    assert bent > 5


@pytest.mark.slow
def test_ways_are_the_shortest_and_free_on_a_thousand_maps():
    _found, bent, without = survey(2000, 3)
    assert bent > 500 and without > 5


def test_times_are_those_of_the_legs():
    rng = np.random.default_rng(4)
    for _ in range(5):
        town, z = random_town(rng), 40.0
        prisms = town.prisms()
        places = [free_place(rng, town, prisms, z) for _ in range(3)]
        ways = roads(prisms, z, np.array(places[:2]), town.size_m)
        wind = tuple(rng.uniform(-4.0, 4.0, 2))
        times = times_along(ways, LIMITS, wind, 6.0)
        totals = []
        for station in range(2):
            way = whole_way(prisms, ways, station, *places[2])
            legs = [
                leg_between(LIMITS, wind, 6.0, (*one, z), (*other, z)).duration_us
                for one, other in itertools.pairwise(way)
            ]
            totals.append(sum(legs) if len(way) else np.inf)
        station, _, total = way_home(prisms, ways, times, LIMITS, wind, 6.0, *places[2])
        assert total == min(totals) and totals[station] == total
