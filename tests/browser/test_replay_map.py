"""What the replay's map shows beside the drones: streets, wind, heat maps, links lost, pictures."""

import json
import re

import numpy as np
import pandas as pd
import pytest

from desim_uav.experiment.replay.page import write_replay
from desim_uav.scenario.load import from_mapping, load
from desim_uav.shipped import find_scenario
from tests.engine.random_all import STREETS
from tests.run_to_folder import run_to_folder

pytestmark = pytest.mark.thorough

CITY = {
    "name": "city",
    "map": {"size_m": [960, 720], "cells": [8, 6], "dimensions": 2},
    "drones": [
        {"name": "large", "count": 2, "footprint_radius_m": 200},
        {"name": "small", "count": 1, "footprint_radius_m": 90},
    ],
    "stations": {"count": 1},
    "users": {
        "count": 30,
        "mobility": {"kind": "streets", "file": str(STREETS), "cut_at_m": [960, 720]},
    },
    "wind_mps": [3.0, 4.0],
    "episode": {"steps": 30},
}
SAMPLES = 240


def run_of(scenario, folder):
    run_to_folder(
        scenario, "random", episodes=1, warmup=0, keep_events=True, out=folder, command=[]
    )
    write_replay(folder)
    return folder


@pytest.fixture(scope="module")
def city(tmp_path_factory):
    """A run of users on streets."""
    return run_of(from_mapping(CITY), tmp_path_factory.mktemp("city") / "run")


def common_of(folder):
    """The data that all episodes of a page have in common."""
    text = (folder / "replay.html").read_text(encoding="utf-8")
    found = re.search(r'<script type="application/json" id="runs">(.*?)</script>', text, re.DOTALL)
    return json.loads(found[1])["runs"][0]


def test_streets_wind_and_types(page, city):
    common = common_of(city)
    streets = load(city / "scenario.yaml").users.mobility.lines()
    assert len(common["map"]["streets"]) == len(streets) > 20
    assert common["map"]["streets"] == [
        [[round(x, 1), round(y, 1)] for x, y in line] for line in sorted(streets)
    ]
    page.open(city / "replay.html", size=(1440, 1100))
    legend = page.text("legend-parts")
    assert "wind, 5 m/s" in legend and "large, serving" in legend and "small, serving" in legend
    page.picture("city")
    page.key("v")
    page.picture("city-3d")


EDGES = """
const box = (id) => { const e = document.getElementById(id);
    return e && !e.hidden ? e.getBoundingClientRect() : null; };
const at = (k) => replay.where({what: "user", index: k}, arguments[0]);
const { users } = replay.state(arguments[0]);
const { metres, pixels } = replay.scale(arguments[0]);
const [x, y] = [at(0).x - users[0].x_m * pixels / metres, at(0).y + users[0].y_m * pixels / metres];
const canvas = box(arguments[0] ? "map-1" : "map");
return { west: x, south: y, east: x + arguments[1] * pixels / metres,
         north: y - arguments[2] * pixels / metres, canvas, legend: box("legend"),
         toggle: box("legend-toggle"), zoom: box("zoom"), foot: replay.foot(arguments[0]) };
"""


def apart(box, other):
    return (
        box["right"] <= other["left"]
        or other["right"] <= box["left"]
        or box["bottom"] <= other["top"]
        or other["bottom"] <= box["top"]
    )


def check_nothing_hides_the_map(page, run=0):
    """No box covers the map or a part of its foot, and the parts lie beside each other."""
    page.frames(2)
    at = page.run(EDGES, run, *CITY["map"]["size_m"])
    canvas, foot = at["canvas"], at["foot"]
    assert canvas["left"] < at["west"] < at["east"] < canvas["right"]
    assert canvas["top"] < at["north"] < at["south"] < foot["top"] < canvas["bottom"]
    ground = {"left": at["west"], "right": at["east"], "top": at["north"], "bottom": at["south"]}
    rows = 1 + max(part["row"] for part in foot["parts"])
    high = (canvas["bottom"] - foot["top"]) / rows
    tops = [foot["top"] + part["row"] * high for part in foot["parts"]]
    places = [
        {**part, "top": top, "bottom": top + high}
        for part, top in zip(foot["parts"], tops, strict=True)
    ]
    boxes = [at[name] for name in ("legend", "toggle", "zoom") if at[name]]
    assert all(apart(ground, box) for box in boxes)
    for k, part in enumerate(places):
        assert canvas["left"] < part["left"] < part["right"] < canvas["right"]
        assert all(apart(part, other) for other in (*boxes, *places[:k]))
    return len(places)


@pytest.mark.parametrize("width", [360, 768, 1366, 1920])
def test_nothing_hides_the_map(page, city, width):
    """Also without the legend, and with a heat map, whose key phones have in a second row."""
    page.open(city / "replay.html", size=(width, 768))
    assert check_nothing_hides_the_map(page) == 2
    if width >= 960:
        page.key("l")
        check_nothing_hides_the_map(page)
    page.key("h")
    assert check_nothing_hides_the_map(page) == 3
    page.picture(f"wind-{width}")


@pytest.mark.parametrize("width", [360, 1366])
def test_nothing_hides_one_of_two_maps(page, city, tmp_path, width):
    other = run_of(from_mapping(CITY), tmp_path / "other")
    write_replay(city, tmp_path / "pair.html", beside=other)
    page.open(tmp_path / "pair.html", size=(width, 768))
    for run in (0, 1):
        check_nothing_hides_the_map(page, run)


def heat_of(page):
    heat = page.run("const h = replay.heat(); return h && { ...h, values: [...h.values] }")
    heat["values"] = np.array(heat["values"]).reshape(heat["ny"], heat["nx"])
    return heat


def states_of(page, duration_s):
    """The states of the page at the instants of a heat map."""
    return [page.seek(0, (k + 0.5) * duration_s / SAMPLES) for k in range(SAMPLES)]


def test_heat_maps(page, city):
    """They are the means over what the page shows at their instants; the moment does not change."""
    page.open(city / "replay.html", "#episode=0&t=754.25")
    before = page.state()
    states = states_of(page, 1800.0)
    page.seek(0, 754.25)
    page.key("h")
    covered = heat_of(page)
    page.key("h")
    waiting = heat_of(page)
    page.picture("heat")
    assert page.state() == before
    assert (covered["name"], waiting["name"]) == ("covered", "waiting")
    side = covered["side"]
    x, y = ((np.arange(covered[n]) + 0.5) * side for n in ("nx", "ny"))
    radii = [200.0, 200.0, 90.0]
    expected, users = np.zeros((len(y), len(x))), np.zeros((len(y), len(x)))
    for state in states:
        inside = np.zeros(expected.shape, bool)
        for drone, radius in zip(state["drones"], radii, strict=True):
            if drone["mode"] == "flying":
                away2 = (x - drone["x_m"]) ** 2 + ((y - drone["y_m"]) ** 2)[:, None]
                inside |= away2 <= radius**2
        expected += inside / SAMPLES
        for user in state["users"]:
            if user["state"] == "waiting":
                at = (
                    min(int(user["y_m"] / side), len(y) - 1),
                    min(int(user["x_m"] / side), len(x) - 1),
                )
                users[at] += 1.0 / SAMPLES
    assert covered["values"] == pytest.approx(expected, abs=1e-9)
    assert waiting["values"] == pytest.approx(users, abs=1e-9)
    assert waiting["most"] == pytest.approx(users.max()) and covered["values"].max() > 0.5
    page.key("h")
    assert page.run("return replay.heat()") is None


def test_handovers_and_outages_are_counted(page, tmp_path):
    folder = run_of(load(find_scenario("interference"), ["episode.steps=15"]), tmp_path / "run")
    events = pd.read_parquet(folder / "events.parquet")["kind"].value_counts()
    page.open(folder / "replay.html")
    seen = page.seek(0, 900.0, 99)["measures"]
    assert seen["handovers"] == events["handover"] > 0
    assert seen["outages"] == events["outage"] > 0
    assert "handovers" in page.text("measures")
