"""Clusters and stations fit the map: defaults are scaled with it, and a misfit is warned of."""

import math

import pytest

from desim_uav.errors import ScenarioError
from desim_uav.scenario.doubts import doubts
from desim_uav.scenario.layout import station_cells
from desim_uav.scenario.load import dump, load, loads
from desim_uav.shipped import scenario_path
from desim_uav.world import build_world

ALONE = "drones: {battery: null, count: 1, start_cells: [[0, 0]]}"
SMALL = "map: {size_m: [500, 500]}\n"


def test_defaults_are_scaled_with_the_shorter_side():
    scenario = loads("map: {size_m: [3000, 500]}\nname: narrow\n")
    assert scenario.stations.radius_m == 200.0
    assert scenario.users.clusters.radius_m == (50.0, 100.0)
    assert loads(dump(scenario)) == scenario


def test_on_the_paper_s_map_they_are_the_paper_s():
    for number in range(1, 10):
        scenario = load(scenario_path(f"case{number}"))
        assert scenario.stations.radius_m == 960.0
        assert scenario.users.clusters.radius_m == (240.0, 480.0)
        assert list(doubts(scenario)) == []


def test_clusters_of_a_small_map_lie_apart():
    """They all fell on its middle."""
    world = build_world(loads(SMALL), 0)
    centres = {(x, y) for x, y, _ in world.clusters.tolist()}
    assert len(centres) == 4
    assert len(set(world.stations)) == 3


def test_radii_that_were_given_stay():
    scenario = loads(
        SMALL + "users: {clusters: {radius_m: [240, 480]}}\nstations: {radius_m: 240}\n"
    )
    assert scenario.users.clusters.radius_m == (240.0, 480.0)
    assert scenario.stations.radius_m == 240.0


@pytest.mark.parametrize(
    ("count", "nearest", "equidistant"),
    [
        (2, [(5, 9), (5, 1)], [(5, 8), (5, 1)]),
        (3, [(5, 9), (8, 3), (1, 3)], [(5, 8), (7, 2), (2, 2)]),
    ],
)
def test_stations_can_be_exactly_as_far_from_the_middle(count, nearest, equidistant):
    # In half cells from the middle, (5, 8) is (1, 7), (5, 1) is (1, -7), (7, 2) is (5, -5) and
    # (2, 2) is (-5, -5): all of them have a square of 50.
    drones = "drones: {count: 2}"
    stations = f"stations: {{count: {count}, placement: %s}}"
    assert station_cells(loads(f"{{{drones}, {stations % 'nearest'}}}")) == nearest
    assert station_cells(loads(f"{{{drones}, {stations % 'equidistant'}}}")) == equidistant


@pytest.mark.parametrize("cells", ["[10, 10]", "[9, 9]", "[12, 7]", "[3, 3]"])
@pytest.mark.parametrize("radius_m", [10, 700, 960, 1500])
def test_equidistant_stations_are_so_on_any_map(cells, radius_m):
    scenario = loads(
        f"{{map: {{size_m: [2400, 2100], cells: {cells}, dimensions: 2}}, drones: {{count: 1}}, "
        f"episode: {{step_s: 300}}, stations: {{count: 1, radius_m: {radius_m}}}}}"
    )
    (dx, dy), stations = scenario.map.cell_m, scenario.stations
    several = stations.model_copy(update={"count": 4, "placement": "equidistant"})
    found = station_cells(scenario.model_copy(update={"stations": several}))
    from_middle = [((x + 0.5) * dx - 1200, (y + 0.5) * dy - 1050) for x, y in found]
    assert len({round(math.hypot(*place), 6) for place in from_middle}) == 1


def test_equidistant_stations_on_one_cell_are_refused():
    with pytest.raises(ScenarioError, match=r"stations 0 and 1 stand on one cell .*fewer stations"):
        loads("stations: {count: 40, placement: equidistant}")


@pytest.mark.parametrize(
    ("text", "keys"),
    [
        ("users: {clusters: {radius_m: [240, 480]}}", ["users.clusters.radius_m: [240, 480]"]),
        ("stations: {radius_m: 260}", ["stations.radius_m: 260"]),
        ("stations: {radius_m: 250}\nusers: {clusters: {radius_m: [20, 249]}}", []),
        (f"stations: {{radius_m: 900, count: 0}}\n{ALONE}", []),
    ],
)
def test_a_misfit_is_warned_of(text, keys):
    found = list(doubts(loads(SMALL + text)))
    assert [doubt.partition(": ")[0] for doubt in found] == [key.partition(": ")[0] for key in keys]
    for doubt, key in zip(found, keys, strict=True):
        assert doubt.startswith(key)
        assert "500 x 500 m (map.size_m)" in doubt
