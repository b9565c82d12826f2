"""Cities in the engines: both agree, the audit sees the same, drones fly round houses."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import desim_uav as du
from desim_uav.city.footprints import cell_heights
from desim_uav.engine.choose import make_engine
from desim_uav.engine.des import Simulation
from desim_uav.errors import ScenarioError
from desim_uav.model.geometry.city import City
from desim_uav.model.geometry.prisms import first_entry, obstacles
from desim_uav.model.geometry.roads import roads
from desim_uav.run_folder import read_scenario
from desim_uav.sample_path import draw
from desim_uav.scenario.doubts import doubts
from desim_uav.scenario.load import dump, from_mapping, loads, scenario_hash
from desim_uav.world import World, build_world
from tests.audit.invariants import audit
from tests.city.test_extracts import box, geojson
from tests.engine.test_line_of_sight import flown
from tests.engine.towns import RADIO, told

ITU = {"kind": "itu", "alpha": 0.3, "beta": 300, "gamma": 12}


def mapping(**buildings: Any) -> dict[str, Any]:
    return {
        "map": {
            "size_m": [500, 400],
            "cells": [5, 4],
            "levels": {"min_altitude_m": 30},
            "buildings": buildings,
        },
        "drones": {
            "count": 2,
            "radio": {**RADIO, "line_of_sight": "buildings"},
            "battery": None,
            "start_cells": [[0, 0], [4, 3]],
        },
        "stations": {"count": 0},
        "users": {"count": 12},
        "services": {"upload": {"kind": "transfer", "volume_mbit": [4, 20]}},
        "demand": {"kind": "poisson", "rate_per_hour": 60, "mix": {"upload": 1}},
        "episode": {"steps": 5, "step_s": 60},
    }


def town(tmp_path: Path) -> Path:
    """Houses with courts on half of the map, which are no cells."""
    rng, features = np.random.default_rng(1), []
    for x in range(20, 460, 55):
        for y in range(20, 360, 55):
            if (x < 100 and y < 100) or (x > 350 and y > 250):
                continue
            ring, court = box(x, y, 40, 40), box(x + 12, y + 12, 16, 16)
            features.append(([ring, court], {"height": int(rng.integers(8, 34))}))
    return geojson(tmp_path / "town.geojson", *features, attribution="of our own making")


def of_file(tmp_path: Path, **more: Any) -> World:
    keys = mapping(file=str(town(tmp_path)), origin=[0, 0], **more)
    return build_world(from_mapping(keys), 3)


def built(share: float, roof_m: float) -> City:
    """A house in the corner of a cell of 100 x 100 m, off the lines on which drones fly."""
    side = 100.0 * share**0.5
    return City((np.array([(0, 0), (side, 0), (side, side), (0, side)]),), np.array([roof_m]))


def test_cells_are_blocked_by_area_and_height_and_on_the_lines_of_flight() -> None:
    def height_m(city: City, share: float) -> float:
        return float(cell_heights(city, (1, 1), (100.0, 100.0), share)[0, 0])

    assert height_m(built(0.2, 30.0), 0.19) == 30.0
    assert height_m(built(0.2, 30.0), 0.21) == 0.0
    assert height_m(built(0.26, 30.0), 0.9) == 30.0  # it reaches the line
    low = np.array([(55, 0), (100, 0), (100, 45), (55, 45)], float)
    two = City((*built(0.2, 30.0).pieces_m, low), np.array([30.0, 12.0]))
    assert height_m(two, 0.39) == 12.0
    assert height_m(two, 0.1) == 30.0
    assert height_m(two, 0.5) == 0.0


def test_the_world_has_free_cells_blocked_ones_and_users_in_houses(tmp_path: Path) -> None:
    world = of_file(tmp_path)
    blocked = world.grid.blocked
    assert 0 < blocked[0].sum() < blocked[0].size
    assert not blocked[-1].any()
    roofs = [world.grid.city.roof_at(*home[:2]) for home in world.homes]
    assert all(home[2] <= roof for home, roof in zip(world.homes, roofs, strict=True))
    assert any(home[2] > 0.0 for home in world.homes)
    assert max(world.grid.levels_m) > world.grid.city.tallest_m


def test_a_start_in_a_house_is_refused(tmp_path: Path) -> None:
    geojson(tmp_path / "a.geojson", ([box(0, 0, 99, 99)], {"height": 40}))
    keys = mapping(file="a.geojson", origin=[0, 0])
    with pytest.raises(ScenarioError, match=r"map.buildings: buildings block cell \(0, 0\)"):
        build_world(from_mapping(keys, base=tmp_path), 0)


def test_synthetic_cities_have_the_three_numbers_and_depend_on_the_seed_of_the_world() -> None:
    keys = mapping(kind="itu", alpha=0.3, beta=300, gamma=20)
    keys["map"] |= {"size_m": [4000, 3000], "cells": [20, 15], "levels": {"min_altitude_m": 100}}
    cities = [build_world(from_mapping(keys), seed).grid.city for seed in (0, 0, 1)]
    one, again, other = cities
    assert (one.roofs_m == again.roofs_m).all()
    assert not np.array_equal(one.roofs_m, other.roofs_m)
    side_m = np.ptp(one.pieces_m[0][:, 0])
    assert side_m == pytest.approx((0.3 / 300e-6) ** 0.5)
    assert len(one) == pytest.approx(300 * 12, rel=0.06)  # those of start cells are left out
    assert one.roofs_m.mean() == pytest.approx(20 * (np.pi / 2) ** 0.5, rel=0.03)
    assert one.tallest_m <= 80.0


def test_what_is_assumed_of_buildings_is_said(tmp_path: Path) -> None:
    geojson(tmp_path / "a.geojson", ([box(200, 200, 20, 20)], {"building": "yes"}))
    scenario = from_mapping(mapping(file="a.geojson", origin=[0, 0]), base=tmp_path)
    assert [one for one in doubts(scenario) if "neither a height nor levels" in one]


def test_obstacles_and_buildings_are_not_both_given() -> None:
    keys = mapping(**ITU)
    keys["map"]["obstacles"] = {"cells": [[1, 1, 30]]}
    with pytest.raises(ScenarioError, match=r"map\.buildings.*not beside map\.obstacles"):
        from_mapping(keys)
    keys["map"] |= {"obstacles": None, "dimensions": 2}
    with pytest.raises(ScenarioError, match=r"map\.buildings.*not in 2D"):
        from_mapping(keys)


def test_a_file_is_a_part_of_the_hash_and_of_the_text(tmp_path: Path) -> None:
    scenario = of_file(tmp_path).scenario
    again = loads(dump(scenario))
    before = scenario_hash(scenario)
    assert scenario_hash(again) == before
    file = tmp_path / "town.geojson"
    file.write_text(file.read_text().replace("of our own", "of her own"))
    assert scenario_hash(loads(dump(scenario))) != before


@pytest.mark.thorough
@pytest.mark.parametrize("of", ["file", "itu"])
def test_both_engines_and_the_audit_agree(tmp_path: Path, of: str) -> None:
    world = of_file(tmp_path) if of == "file" else build_world(from_mapping(mapping(**ITU)), 3)
    path = draw(world, 1, 0)
    one = flown(Simulation(world, told(world), audit=audit), path)
    assert len(one) > 60
    assert flown(make_engine("batch", world, told(world)), path) == one


@pytest.mark.thorough
def test_a_run_is_read_and_played_again_when_its_file_is_gone(tmp_path: Path) -> None:
    keys = mapping(file=str(town(tmp_path)), origin=[0, 0])
    run = du.run(keys, policy="random", episodes=1, progress=False, out=tmp_path / "run")
    (tmp_path / "town.geojson").unlink()
    manifest = json.loads((tmp_path / "run" / "manifest.json").read_text())
    assert manifest["attribution"] == "of our own making"
    again = read_scenario(tmp_path / "run")
    assert scenario_hash(again) == manifest["scenario_hash"]
    kept = du.read_run(tmp_path / "run")
    kept.replay(tmp_path / "page.html")
    assert "of our own making" in (tmp_path / "page.html").read_text()
    kept.report(tmp_path / "report.html")
    assert "of our own making" in (tmp_path / "report.html").read_text()
    assert len(run) == len(kept)


@pytest.mark.thorough
def test_free_flight_stops_before_houses_and_returns_round_them(tmp_path: Path) -> None:
    city = of_file(tmp_path).grid.city
    prisms = obstacles(np.zeros((5, 4)), (100.0, 100.0), (), 1.0, city)
    start, stop = (10.0, 40.0, 5.0), (490.0, 40.0, 5.0)
    assert first_entry(prisms, start, stop) == pytest.approx((129.0 - 10.0) / 480.0, abs=1e-4)
    assert first_entry(prisms, (30.0, 40.0, 50.0), (490.0, 40.0, 50.0)) == np.inf
    network = roads(prisms, 5.0, np.array([[490.0, 12.0]]), (500.0, 400.0))
    corner = int(np.argmin(np.hypot(*(network.nodes_m - (129.0, 61.0)).T)))
    assert 365.0 < network.lengths_m[0, corner] < 430.0


@pytest.mark.thorough
def test_a_world_without_a_city_does_not_import_shapely() -> None:
    code = (
        "import sys\n"
        "from desim_uav.scenario.load import load\n"
        "from desim_uav.world import build_world\n"
        "build_world(load('case8'), 0)\n"
        "assert 'shapely' not in sys.modules\n"
        "build_world(load('old_town'), 0)\n"
        "assert 'shapely' in sys.modules\n"
    )
    subprocess.run([sys.executable, "-c", code], check=True)
