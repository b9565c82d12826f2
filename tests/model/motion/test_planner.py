"""Returns to the stations: A* against Dijkstra, hop by hop, and ties."""

import itertools

import numpy as np
import pytest

from desim_uav.model.geometry.grid import Grid, altitudes
from desim_uav.model.motion.planner import Planner, shortest_path
from tests.verification.figure import check
from tests.verification.planning import HOPS, figures, surveyed

CROSS = [(0, 2), (4, 2), (2, 0), (2, 4)]


def flat(nx_, ny, height_m=None):
    heights = np.zeros((nx_, ny)) if height_m is None else np.array(height_m, float)
    levels, under = altitudes(20.0, 10.0, heights.max())
    return Grid(240.0 * nx_, 240.0 * ny, heights, levels, 10.0, under)


def of_axes(x_us, y_us, level_us):
    """The times of hops that do not depend on the direction along an axis."""
    return (x_us, x_us, y_us, y_us, level_us, level_us)


def fly(start, hops):
    """The nodes of a path."""
    stops = np.array(start) + np.cumsum(np.array(hops, int).reshape(-1, 3), axis=0)
    return [start, *map(tuple, stops.tolist())]


@pytest.mark.thorough
def test_the_maps_are_worth_a_look():
    cases = surveyed()
    ways = [min((t for t in times if t is not None), default=None) for *_, times in cases]
    assert sum(way is None for way in ways) >= 30
    assert sum(way is not None and way > 0 for way in ways) >= 700
    blocked_starts = [graph.in_degree(start) == 0 for graph, _, start, *_ in cases]
    assert sum(blocked_starts) >= 50
    assert len({len({k for *_, k in graph}) for graph, *_ in cases}) >= 4


def test_the_time_is_dijkstras_and_no_way_is_no_way():
    check(figures())


def test_in_wind_the_time_is_dijkstras_with_an_own_time_of_each_direction():
    cases = surveyed(400, windy=True)
    assert sum(plan is not None and len(plan.hops) > 3 for *_, plan, _ in cases) > 100
    for _, _, _, _, plan, times in cases:
        ways = [(time, station) for station, time in enumerate(times) if time is not None]
        assert (plan and (plan.duration_us, plan.station)) == min(ways, default=None)


@pytest.mark.parametrize("windy", [False, True])
def test_the_path_can_be_flown_hop_by_hop(windy):
    for graph, hop_us, start, stations, plan, _ in surveyed(400, True) if windy else surveyed():
        if plan is None:
            continue
        assert set(plan.hops) <= set(HOPS)
        path = fly(start, plan.hops)
        assert path[-1] == (*stations[plan.station], 0)
        assert len(set(path)) == len(path)
        flown = 0
        for here, there in itertools.pairwise(path):
            assert graph.has_edge(here, there)
            flown += graph.edges[here, there]["weight"]
        assert flown == plan.duration_us
        assert sum(hop_us[HOPS.index(hop)] for hop in plan.hops) == flown


class TestByHand:
    def test_on_a_station(self):
        plan = Planner(flat(3, 3), [(2, 2), (1, 1)], of_axes(5, 7, 9)).plan((1, 1, 0))
        assert (plan.station, plan.duration_us, plan.hops) == (1, 0, ())

    def test_around_a_wall_or_over_it(self):
        # A wall across the middle of 5 x 3 cells with a gap at the far end.
        heights = np.zeros((5, 3))
        heights[0:4, 1] = 25.0
        grid = flat(5, 3, heights)
        assert grid.levels_m == (20.0, 30.0)
        assert grid.levels_under_ceiling == 1
        planner = Planner(grid, [(0, 2)], of_axes(10, 10, 3))
        assert planner.plan((0, 0, 0), ceiling=True).duration_us == 100
        assert planner.plan((0, 0, 0), ceiling=False).duration_us == 26
        over = planner.plan((0, 0, 0), ceiling=False).hops
        assert over[0] == (0, 0, 1)
        assert over[-1] == (0, 0, -1)

    def test_no_way(self):
        heights = np.zeros((3, 3))
        heights[1, :] = 20.0
        planner = Planner(flat(3, 3, heights), [(2, 2)], of_axes(10, 10, 3))
        assert planner.plan((0, 0, 0)) is None
        assert planner.plan((0, 0, 0), ceiling=False).duration_us == 46

    def test_out_of_a_building(self):
        heights = np.zeros((3, 1))
        heights[1, 0] = 100.0
        planner = Planner(flat(3, 1, heights), [(0, 0), (2, 0)], of_axes(10, 10, 3))
        assert planner.plan((1, 0, 0)).hops == ((-1, 0, 0),)
        assert planner.plan((1, 0, 1)).duration_us == 13

    @pytest.mark.parametrize("stations", list(itertools.permutations(CROSS)))
    def test_ties_go_to_the_lowest_index(self, stations):
        planner = Planner(flat(5, 5), list(stations), of_axes(11, 11, 3))
        plan = planner.plan((2, 2, 0))
        assert (plan.station, plan.duration_us) == (0, 22)
        # Nearer by one cell: the index does not matter.
        assert stations[planner.plan((3, 2, 0)).station] == (4, 2)

    def test_nearest_is_in_time_not_in_hops(self):
        planner = Planner(flat(5, 5), [(4, 2), (2, 3)], of_axes(10, 21, 3))
        assert planner.plan((2, 2, 0)).station == 0

    def test_a_plan_does_not_depend_on_those_before(self):
        grid = flat(6, 6)
        stations = [(0, 0), (5, 5)]
        asked = list(itertools.product(range(6), range(6), [0], [True, False]))
        used = Planner(grid, stations, of_axes(7, 7, 3))
        forward = [used.plan((x, y, k), c) for x, y, k, c in asked]
        backward = [used.plan((x, y, k), c) for x, y, k, c in reversed(asked)][::-1]
        anew = [
            Planner(grid, stations, of_axes(7, 7, 3)).plan((x, y, k), c) for x, y, k, c in asked
        ]
        assert forward == backward == anew


def test_shortest_path_holds_both_ends():
    blocked = np.zeros((1, 4, 1), bool)
    path = shortest_path(blocked, [1] * 6, (0, 0, 0), (3, 0, 0))
    assert path == [(0, 0, 0), (1, 0, 0), (2, 0, 0), (3, 0, 0)]
    blocked[0, 2, 0] = True
    assert shortest_path(blocked, [1] * 6, (0, 0, 0), (3, 0, 0)) == []
