"""Pictures of runs in which drones fly freely, in a fleet of two types, round a zone."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from desim_uav.model.motion.motion import BangCoastBang, travelled
from desim_uav.model.rules import US, Mode
from desim_uav.report.figures import battery_figure, case_picture, snapshot_figure, visits_figure
from desim_uav.report.figures.visits import visit_minutes
from desim_uav.report.playback import Playback
from desim_uav.report.run import Run
from desim_uav.report.tracks import after_s
from desim_uav.scenario.load import from_mapping
from tests.run_to_folder import run_to_folder

ZONE = ((500, 210), (700, 210), (700, 590), (500, 590))
FLEET = {
    "name": "fleet",
    "seed": 3,
    "map": {
        "size_m": [1200, 800],
        "cells": [6, 4],
        "no_fly": [{"polygon_m": ZONE}],
    },
    "drones": [
        {
            "name": name,
            "count": 1,
            "start_cells": [[0, 1]],
            "motion": {"space": "free", "max_speed_mps": 15},
            "battery": {"kind": "rotary_wing", "capacity_wh": capacity_wh, "return_below": 1.0},
        }
        for name, capacity_wh in (("scout", 15.0), ("relay", 25.0))
    ],
    "stations": {"count": 1},
    "users": {"count": 4},
    "episode": {"steps": 20},
}


def flown(folder: Path, dimensions: int, keep_events: bool = True) -> Run:
    relief = {"obstacles": {"cells": [[5, 3, 50]]}} if dimensions == 3 else {}
    map_ = {**FLEET["map"], **relief, "dimensions": dimensions}
    scenario = from_mapping({**FLEET, "map": map_})
    settings = {"episodes": 1, "warmup": 0, "keep_events": keep_events, "command": []}
    run_to_folder(scenario, "random", out=folder, **settings)
    return Run(folder)


@pytest.fixture(scope="module", params=[2, 3])
def run(request, tmp_path_factory) -> Run:
    return flown(tmp_path_factory.mktemp("flown") / "run", request.param)


@pytest.fixture(scope="module")
def flat(tmp_path_factory) -> Run:
    return flown(tmp_path_factory.mktemp("flat") / "run", 2)


def test_a_cell_has_the_time_that_a_sampler_finds_there(run):
    minutes, every_s = visit_minutes(run, [0]), 0.5
    sampled, playback = np.zeros_like(minutes), Playback(run, 0)
    for t_s in np.arange(every_s / 2, 1200, every_s):
        moment = playback.at(round(t_s * US))
        for drone, (x, y, _) in enumerate(moment.drones_m):
            if moment.modes[drone] is Mode.FLYING:
                sampled[(drone, *run.world.grid.cell_of(x, y))] += every_s / 60
    assert sampled == pytest.approx(minutes, abs=0.05)
    assert np.count_nonzero(minutes) > 15


def test_the_time_at_which_a_transit_has_flown_so_far():
    for metres in (3.0, 40.0, 800.0):
        flight = BangCoastBang(12.0, 4.0, "minimum_time").fastest_transit(metres)
        for share in np.linspace(0.0, 1.0, 41):
            reached = travelled(flight.rows, after_s(flight, share * metres))
            assert reached == pytest.approx(share * metres, abs=1e-9)


def crosses(places) -> bool:
    """Does a path lead through the middle of the zone?"""
    for (x0, y0), (x1, y1) in pairwise(places):
        for share in np.linspace(0.0, 1.0, 200):
            x, y = x0 + share * (x1 - x0), y0 + share * (y1 - y0)
            if 505 < x < 695 and 215 < y < 585:
                return True
    return False


def test_paths_on_flat_maps_lead_round_zones(flat):
    (axes,) = case_picture(flat).axes
    steps = flat.of("steps", 0)
    through = []
    for drone in range(2):
        drawn = [line for line in axes.lines if line.get_color() == _colour(axes, drone)]
        path = drawn[0].get_xydata()
        assert not crosses(path)
        own = steps[steps["drone"] == drone]
        assert path[-1] == pytest.approx([own["x_m"].iloc[-1], own["y_m"].iloc[-1]])
        through.append(crosses(own[["x_m", "y_m"]].to_numpy()))
    assert any(through), "no return of this run leads round the zone within a step"


def _colour(axes, drone):
    labels = {line.get_label(): line.get_color() for line in axes.lines}
    return next(colour for label, colour in labels.items() if label.startswith(f"drone {drone} "))


def test_without_events_paths_join_the_ends_of_steps(tmp_path):
    run = flown(tmp_path / "run", 2, keep_events=False)
    (axes,) = case_picture(run).axes
    lengths = [len(line.get_xydata()) for line in axes.lines]
    assert lengths.count(21) == 2


def test_drones_are_named_with_their_types(run):
    titles = [axes.get_title("left") for axes in battery_figure(run).axes]
    assert titles == ["drone 0 (scout)", "drone 1 (relay)"]
    titles = [axes.get_title("left") for axes in visits_figure(run).axes[:2]]
    assert [title.partition(":")[0] for title in titles] == ["drone 0 (scout)", "drone 1 (relay)"]
    (legend,) = snapshot_figure(run).legends
    named = [text.get_text().partition(",")[0] for text in legend.get_texts()]
    assert {"drone 0 (scout)", "drone 1 (relay)"} <= {*named}
    assert "no flight" in named


def test_nothing_of_a_map_in_3d_is_clipped(run):
    (axes,) = snapshot_figure(run).axes
    if run.scenario.three_d:
        assert not any(drawn.get_clip_on() for drawn in (*axes.lines, *axes.collections))


def test_zones_are_on_maps_of_visits(run):
    figure = visits_figure(run)
    for axes in figure.axes[:2]:
        (zone,) = [patch for patch in axes.patches if patch.get_hatch() == "//"]
        assert set(map(tuple, zone.get_xy())) == set(ZONE)
