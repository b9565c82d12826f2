"""What pictures show of links: rings at an altitude, access points, and requests for a volume."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from desim_uav.drawing.frame import FARTHEST, Painter
from desim_uav.drawing.sprites import mast
from desim_uav.report.links import full_service_s, links_content, mean_rate_bps, rings_m
from desim_uav.report.playback import Playback
from desim_uav.report.run import Run
from desim_uav.scenario.load import load, loads
from desim_uav.shipped import scenario_path
from desim_uav.world import World, build_world
from tests.run_to_folder import run_to_folder

RADIO = Path(__file__).with_name("radio.yaml")


@pytest.fixture(scope="module")
def world() -> World:
    """Two access points, and levels of 25 m, 50 m and 75 m."""
    return build_world(load(RADIO), 0)


def test_rings_at_a_level_and_between_two(world: World) -> None:
    low, high = (np.maximum(world.links[0].rings_m[k, 0], 0.0) for k in (0, 1))
    assert rings_m(world, 25.0, 0).tolist() == low.tolist()
    assert rings_m(world, 31.25, 0) == pytest.approx(0.75 * low + 0.25 * high)
    assert rings_m(world, 10.0, 0).tolist() == low.tolist()


def test_a_disc_is_one_ring() -> None:
    world = build_world(load(scenario_path("case8")), 0)
    assert rings_m(world, 27.0, 0).tolist() == [600.0]
    content = links_content(world)
    assert (content["points"], content["graded"], content["type_of"]) == ([], False, [0, 0, 0])
    assert content["types"] == [
        {
            "name": "drones",
            "capacity_us": 1_800_000_000,
            "capacity_wh": None,
            "hover_w": None,
            "bandwidth_hz": 5_000_000,
            "footprint_m": 600.0,
            "processor": None,
            "rings": None,
        }
    ]


FLEET = """
drones:
- {name: low, count: 1, footprint_radius_m: 300, bandwidth_kbps: null, battery: null}
- {name: radio, count: 2, radio: {kind: link_classes}}
"""


def test_each_type_has_its_own_rings() -> None:
    world = build_world(loads(FLEET), 0)
    assert rings_m(world, 27.0, 0).tolist() == [300.0]
    assert len(rings_m(world, 27.0, 1)) == len(world.links[1].thresholds_db) > 1
    content = links_content(world)
    low, radio = content["types"]
    assert content["type_of"] == [0, 1, 1]
    assert (low["name"], low["footprint_m"], low["rings"]) == ("low", 300.0, None)
    assert (low["capacity_us"], low["bandwidth_hz"]) == (None, None)
    assert (radio["name"], radio["capacity_us"]) == ("radio", 1_800_000_000)
    lowest_m = world.grid.levels_m[0]
    assert radio["rings"]["radii_m"][0] == pytest.approx(rings_m(world, lowest_m, 1), abs=0.06)
    assert radio["footprint_m"] >= radio["rings"]["radii_m"][0][0]


def test_what_a_page_knows(world: World) -> None:
    content = links_content(world)
    assert [point["at"] for point in content["points"]] == [[300, 900, 25], [1000, 200, 30]]
    (own,) = content["types"]
    assert len(own["rings"]["radii_m"]) == len(world.grid.levels_m)
    assert all(len(radii) == 15 for radii in own["rings"]["radii_m"])
    assert own["rings"]["snr_db"][0] == -6.94
    assert content["interference"] and content["graded"]


def test_requests_for_a_volume_take_the_time_of_their_mean_rate() -> None:
    """10 s for a quarter: 40 s for all. Nothing delivered: for ever. A time is what it is."""
    requests = pd.DataFrame(
        {
            "requested_s": [np.nan, np.nan, 30.0],
            "served_s": [10.0, 0.0, 12.0],
            "qoe1": [0.25, 0.0, 0.4],
            "bandwidth_kbps": [0.0, 0.0, 64.0],
            "delivered_mbit": [5.0, 0.0, np.nan],
            "throughput_kbps": [100.0, 0.0, np.nan],
        }
    )
    assert full_service_s(requests).tolist() == [40.0, math.inf, 30.0]
    assert mean_rate_bps(requests).tolist() == [500_000.0, 0.0, 64_000.0]


SPLIT = (
    "services.file={kind: compute, input_mbit: [1, 9], cycles_per_bit: [800], deadline_s: 30}",
    *("drones.processor={ghz: 1}", "users.processor={ghz: 0.3}", "offloading=split"),
    "access_points=[]",
)

SENSORS = (
    "services={reading: {kind: collect, updates: {kind: poisson, mean_s: 20}, size_mbit: [3]}}",
    "demand={kind: sensing, service: reading}",
)


@pytest.mark.thorough
@pytest.mark.parametrize("overrides", [(), SPLIT, SENSORS], ids=["links", "tasks", "sensors"])
def test_measures_at_the_end_are_those_of_the_run(
    tmp_path: Path, overrides: tuple[str, ...]
) -> None:
    run_to_folder(
        load(RADIO, overrides),
        "random",
        episodes=2,
        warmup=0,
        keep_events=True,
        out=tmp_path / "run",
        command=[],
    )
    run = Run(tmp_path / "run")
    for row in run.table("episodes").to_dict("records"):
        playback = Playback(run, int(row["episode"]))
        measured = playback.at(playback.duration_us).measures
        expected = [row[f"qoe{k}"] for k in ("1_percent", "2_iterations", "3_percent")]
        assert list(measured) == pytest.approx(expected, rel=1e-9)


def test_a_frame_shows_access_points(world: World) -> None:
    painter = Painter(world)
    x, y = (round(at) for at in painter._pixel(300, 900))
    assert painter.map.getpixel((x, y)) == (0x1E, 0x1E, 0x1E)
    assert mast().size == (20, 20)


def test_a_huge_footprint_takes_little_memory() -> None:
    loud = load(RADIO, ["drones.radio.power_dbm=45", "access_points=[]"])
    painter = Painter(build_world(loud, 0))
    assert painter.radii_px[0] == pytest.approx(FARTHEST * math.hypot(600, 600))
