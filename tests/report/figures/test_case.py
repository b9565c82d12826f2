"""The picture of a case: drawn from the run folder alone, for every kind of map."""

import runpy
import sys
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from desim_uav.errors import PolicyError
from desim_uav.report.figures import case_picture
from desim_uav.scenario.load import load
from desim_uav.shipped import scenario_path
from tests.run_to_folder import run_to_folder

ROOT = Path(__file__).parents[3]


@pytest.fixture
def run_dir(tmp_path):
    def run(name):
        scenario = load(scenario_path(name))
        done = run_to_folder(
            scenario,
            "baseline",
            episodes=2,
            warmup=0,
            keep_events=False,
            out=tmp_path / name,
            command=[],
        )
        return Path(done.summary["run_dir"])

    return run


def labels(figure):
    return [text.get_text() for text in figure.legends[0].get_texts()]


def test_a_case_among_buildings(run_dir):
    figure = case_picture(run_dir("case8"), episode=1, minute=10)
    drones = [label for label in labels(figure) if label.startswith("drone")]
    assert [label.partition(",")[0] for label in drones] == ["drone 0", "drone 1", "drone 2"]
    assert "charging station" in labels(figure)
    map_axes, colour_bar = figure.axes
    assert colour_bar.get_ylabel() == "building height, m"
    flying = sum(label.endswith("flying") for label in drones)
    footprints = [patch for patch in map_axes.patches if patch.get_alpha()]
    assert len(footprints) == flying


def test_a_map_without_buildings_stations_and_clusters(run_dir):
    figure = case_picture(run_dir("tiny"))
    assert len(figure.axes) == 1
    assert labels(figure) == ["user at the start, and walk", "drone 0, flying"]
    path = figure.axes[0].lines[-2].get_xydata()
    assert tuple(path[0]) == (120.0, 360.0)
    assert len(path) == 6


def test_homes_and_walks_are_those_of_the_users(run_dir):
    folder = run_dir("case8")
    users = pd.read_parquet(folder / "users.parquet")
    users = users[users["episode"] == 1]
    walks, homes = case_picture(folder, episode=1).axes[0].lines[:2]
    assert homes.get_xydata() == pytest.approx(users[users["t_s"] == 0][["x_m", "y_m"]].to_numpy())
    drawn = walks.get_xydata()
    parts = np.split(drawn, np.flatnonzero(np.isnan(drawn[:, 0])))
    for part, (_, walk) in zip(parts, users.groupby("user"), strict=True):
        assert part[~np.isnan(part[:, 0])] == pytest.approx(walk[["x_m", "y_m"]].to_numpy())


def test_the_script_writes_a_picture(run_dir, tmp_path, monkeypatch):
    picture = tmp_path / "case1.png"
    script = ROOT / "analysis" / "case_picture.py"
    monkeypatch.setattr(sys, "argv", [str(script), str(run_dir("case1")), str(picture), "0", "5"])
    runpy.run_path(str(script))
    assert picture.read_bytes().startswith(b"\x89PNG")


def test_a_folder_that_is_no_run(tmp_path):
    with pytest.raises(PolicyError, match="no such table"):
        case_picture(tmp_path)
