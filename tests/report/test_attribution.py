"""Whose data a map has is said wherever the city or its streets are shown, and once."""

import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from desim_uav.drawing.frame import HEIGHT, PANEL, WIDTH
from desim_uav.env.single import UavEnv
from desim_uav.experiment.replay.page import write_replay
from desim_uav.geodata.attribution import together
from desim_uav.geodata.osm import LICENCE
from desim_uav.report.figures import case_picture, map_figure, snapshot_figure, visits_figure
from desim_uav.scenario.load import from_mapping
from desim_uav.world import World, build_world
from tests.city.test_extracts import box, geojson, osm
from tests.model.mobility.test_streets import net_of
from tests.run_to_folder import run_to_folder

ROUND = "".join(f'<nd ref="{k}"/>' for k in (8, 9, 10, 11, 8))
STREET = f'<way id="9">{ROUND}<tag k="highway" v="residential"/></way>'


def keys_of(file: Path, *, streets: bool, **buildings: Any) -> dict[str, Any]:
    """Few users on the streets of a file, among its buildings, or both."""
    from_it = {"file": str(file), "origin": [0, 0]}
    walk = {"kind": "streets", **from_it, "cut_at_m": [100, 100]}
    return {
        "map": {
            "size_m": [100, 100],
            "cells": [2, 2],
            "levels": {"min_altitude_m": 40},
            "obstacles": None,
            "buildings": {**from_it, **buildings} if buildings else None,
        },
        "drones": {"count": 1, "battery": None},
        "stations": {"count": 0},
        "users": {"count": 2, "mobility": walk if streets else {"kind": "static"}},
        "episode": {"steps": 2},
    }


def world_of(keys: dict[str, Any]) -> World:
    return build_world(from_mapping(keys), 0)


def test_several_attributions_are_named_once():
    assert together(["a; b", "", "b", "c"]) == "a; b; c"
    assert together(["", ""]) == ""


def test_a_world_says_whose_data_its_buildings_and_streets_are(tmp_path):
    file = osm(tmp_path / "a.osm", STREET)
    alone = world_of(keys_of(file, streets=True))
    assert not len(alone.grid.city)
    assert alone.attribution == LICENCE
    assert world_of(keys_of(file, streets=True, height_m=8)).attribution == LICENCE
    both = world_of(keys_of(file, streets=True, attribution="the town hall"))
    assert both.attribution == f"the town hall; {LICENCE}"
    own = net_of(tmp_path, [(0, 0), (50, 50)], [(0, 1), (1, 0)])
    of_sumo = keys_of(own, streets=True)
    del of_sumo["users"]["mobility"]["origin"]
    assert world_of(of_sumo).attribution == ""


def words_in(figure: Any) -> list[str]:
    """The words of the texts in a figure that are neither titles nor labels."""
    texts = [text for axes in figure.axes for text in axes.texts] + figure.texts[1:]
    return [word for text in texts for word in text.get_text().split()]


@pytest.mark.thorough
@pytest.mark.parametrize("buildings", [{}, {"height_m": 8}], ids=["streets", "city"])
def test_manifest_page_and_figures_of_a_run_say_whose_data_the_map_has(tmp_path, buildings):
    file = osm(tmp_path / "a.osm", STREET)
    scenario = from_mapping(keys_of(file, streets=True, **buildings))
    run = tmp_path / "run"
    run_to_folder(scenario, "hover", episodes=1, warmup=0, keep_events=True, out=run, command=[])
    assert json.loads((run / "manifest.json").read_text())["attribution"] == LICENCE
    write_replay(run)
    page = (run / "replay.html").read_text(encoding="utf-8")
    found = re.search(r'<script type="application/json" id="runs">(.*?)</script>', page, re.DOTALL)
    assert json.loads(found[1])["runs"][0]["map"]["attribution"] == LICENCE
    for draw in (case_picture, snapshot_figure, map_figure, visits_figure):
        assert words_in(draw(run)) == LICENCE.split(), draw.__name__


def test_frames_say_whose_data_the_map_has(tmp_path):
    """A frame is that of the same map without an attribution, but for the corner of the map."""
    house = ([box(60, 60, 20, 20)], {"height": 9})
    frames = []
    for whose in ("", "of our own making"):
        file = geojson(tmp_path / f"{len(frames)}.geojson", house, attribution=whose)
        env = UavEnv(keys_of(file, streets=False, height_m=8), render_mode="rgb_array")
        env.reset(seed=0)
        frames.append(env.render())
    y, x = np.nonzero((frames[0] != frames[1]).any(axis=2))
    assert len(x) > 100
    assert y.min() > HEIGHT - 20
    assert WIDTH - PANEL - 110 < x.min() < x.max() < WIDTH - PANEL
