"""Clusters and stations fit the map: defaults are scaled with it, and a misfit is warned of."""

import pytest

from desim_uav.scenario.checks import doubts
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
