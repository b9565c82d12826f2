"""Zones without flights in the pictures of runs."""

from pathlib import Path

import numpy as np
import pytest

from desim_uav.report.figures import case_picture, snapshot_figure
from desim_uav.report.figures.map import NO_FLIGHT
from desim_uav.scenario.load import load
from tests.run_to_folder import run_to_folder

FREELY = Path(__file__).parents[1] / "freely.yaml"
ALPHA = 0.14  # of zones only
LONE = "map.no_fly=[{polygon_m: [[500, 0], [620, 0], [620, 1380], [500, 1380]]}]"


def flown(folder, *overrides):
    """A short run over zones."""
    scenario = load(FREELY, ["episode.steps=2", "users.count=3", *overrides])
    run_to_folder(scenario, "hover", episodes=1, warmup=0, keep_events=True, out=folder, command=[])
    return folder


def named(figure):
    """The texts of a figure's legend."""
    return [text.get_text() for legend in figure.legends for text in legend.get_texts()]


def test_walls_of_zones_stand_from_one_altitude_to_the_other(tmp_path):
    figure = snapshot_figure(flown(tmp_path / "run"))
    (axes,) = figure.axes
    below, high = (corners(zone) for zone in axes.collections if zone.get_alpha() == ALPHA)
    assert named(figure).count("no flight") == 1
    assert set(map(tuple, below[:, :2])) == {(500, 0), (620, 0), (620, 1380), (500, 1380)}
    assert {*below[:, 2]} == {0.0, min(120.0, axes.get_zlim()[1])}
    assert {*high[:, 2]} == {0.0, axes.get_zlim()[1]}, "no higher than the picture"


@pytest.mark.parametrize(
    ("altitude", "words"), [("", "no flight"), (", altitude_m: [0, 120]", "no flight, 0 to 120 m")]
)
def test_zones_of_flat_maps_are_hatched(tmp_path, altitude, words):
    zone = LONE.replace("]]}", f"]]{altitude}}}")
    run = flown(tmp_path / "run", "map.dimensions=2", zone)
    for figure in (snapshot_figure(run), case_picture(run)):
        (patch,) = [p for p in figure.axes[0].patches if p.get_hatch()]
        assert patch.get_edgecolor()[:3] == pytest.approx((0xC0 / 255, 0, 0))
        assert set(map(tuple, patch.get_xy())) == {(500, 0), (620, 0), (620, 1380), (500, 1380)}
        assert words in named(figure)
    assert NO_FLIGHT["facecolor"] == "none"


def corners(collection):
    """The corners of all faces of a collection in 3D: an array (corners, 3)."""
    if hasattr(collection, "_segslices"):  # Matplotlib below 3.10
        return np.concatenate([collection._vec[:3, face].T for face in collection._segslices])
    padded = collection._invalid_vertices
    return collection._faces[~padded if np.ndim(padded) else ...].reshape(-1, 3)
