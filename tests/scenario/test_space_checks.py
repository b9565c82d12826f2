"""Keys of free flight: what is refused, and how it is said."""

from __future__ import annotations

from typing import Any

import pytest

from desim_uav.errors import ScenarioError
from desim_uav.scenario import space_checks
from desim_uav.scenario.load import from_mapping, scenario_hash
from desim_uav.world import build_world

FREE = {"space": "free"}
SQUARE = [[100, 100], [200, 100], [200, 200], [100, 200]]


def made(motion: dict[str, Any] | None = None, **sections: Any) -> Any:
    drones = {"motion": {**FREE, **(motion or {})}, **sections.pop("drones", {})}
    return from_mapping({"map": {"dimensions": 2}, "drones": drones, **sections})


def test_it_is_read():
    scenario = made({"climb_mps": 3}, map={"no_fly": [{"polygon_m": SQUARE}], "dimensions": 2})
    assert scenario.free
    assert scenario.map.no_fly[0].altitude_m == (0.0, 10_000.0)
    assert not from_mapping({}).free


def test_a_scenario_without_it_keeps_its_hash():
    told = {"drones": {"motion": {"kind": "bang_coast_bang", "space": "cells", "margin_m": 5}}}
    assert scenario_hash(from_mapping(told)) == scenario_hash(from_mapping({}))
    assert scenario_hash(made()) != scenario_hash(from_mapping({"map": {"dimensions": 2}}))


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("climb_mps", 0),
        ("descent_mps", -1),
        ("vertical_mps2", 1e9),
        ("margin_m", 0),
        ("space", "air"),
    ],
)
def test_limits_have_bounds(key, value):
    with pytest.raises(ScenarioError, match=key):
        made({key: value})


@pytest.mark.parametrize(
    ("zone", "says"),
    [
        ({"polygon_m": SQUARE[:2]}, "polygon_m"),
        ({"polygon_m": [SQUARE[0], SQUARE[2], SQUARE[1], SQUARE[3]]}, "edges .* meet"),
        ({"polygon_m": [*SQUARE, SQUARE[0]]}, "are one place"),
        ({"polygon_m": [[-5, 0], [1, 0], [1, 1]]}, "polygon_m"),
        ({"polygon_m": SQUARE, "altitude_m": [50, 50]}, "low < high"),
        ({"polygon_m": SQUARE, "altitude_m": [-1, 50]}, "altitude_m"),
        ({"polygn_m": SQUARE}, "polygon_m"),
        ({}, "polygon_m"),
    ],
)
def test_zones_are_simple_polygons(zone, says):
    with pytest.raises(ScenarioError, match=says):
        made(map={"dimensions": 2, "no_fly": [zone]})


def test_zones_need_drones_that_heed_them():
    with pytest.raises(ScenarioError, match=r"map\.no_fly.*cell to cell"):
        from_mapping({"map": {"no_fly": [{"polygon_m": SQUARE}]}})


@pytest.mark.parametrize(
    ("sections", "key"),
    [
        ({"drones": {"battery": {"kind": "per_action"}}}, "battery"),
        ({"drones": {"battery": {"kind": "fixed_wing"}}}, "battery"),
    ],
)
def test_what_it_does_not_go_with_is_named(sections, key):
    with pytest.raises(ScenarioError, match=key):
        made(**sections)


def mixed(
    space_checks: dict[str, Any] | None = None, *more: dict[str, Any], **sections: Any
) -> Any:
    types = [{"name": "a", "motion": {**FREE, **(space_checks or {})}}, {"name": "b"}, *more]
    return from_mapping({"map": {"dimensions": 2}, "drones": types, **sections})


def test_types_fly_freely_or_from_cell_to_cell():
    scenario = mixed()
    assert scenario.free and scenario.mixed
    assert not made().mixed and not from_mapping({}).mixed
    with pytest.raises(ScenarioError, match=r"types a fly freely .* types b .*this needs"):
        scenario.require_one_space("this")
    made().require_one_space("this")
    with pytest.raises(ScenarioError, match="space: free: this needs drones that fly from cell"):
        scenario.require_cells("this")


def test_zones_need_drones_that_all_heed_them():
    zones = {"map": {"dimensions": 2, "no_fly": [{"polygon_m": SQUARE}]}}
    with pytest.raises(ScenarioError, match=r"no_fly.* drones of drones\.1 fly from cell to cell"):
        mixed(**zones)


def test_cruise_speeds_are_compared_among_types_that_fly_alike():
    mixed({"cruise": [5, 8]})
    cells = {"name": "c", "motion": {"cruise": [6, 8.3]}}
    with pytest.raises(ScenarioError, match=r"drones\.2\..* cell to cell .*of drones\.1, null"):
        mixed({"cruise": [5, 8]}, cells)
    others = {"name": "c", "motion": {"space": "free"}}
    with pytest.raises(ScenarioError, match=r"drones\.2\.motion.* that fly freely have the same"):
        mixed({"cruise": [5, 8]}, others)


def test_what_free_flight_refuses_is_asked_of_types_that_fly_freely():
    mixed(None, {"name": "c", "motion": {"return_timing": "fill_epoch"}})
    with pytest.raises(ScenarioError, match=r"drones\.0\.motion\.return_timing"):
        mixed({"return_timing": "fill_epoch"})
    battery = {"kind": "per_action", "action_min": 1}
    by_cells = {"name": "c", "motion": {"timing": "fill_epoch"}, "battery": battery}
    mixed(None, by_cells)


def test_returns_are_quickest():
    with pytest.raises(ScenarioError, match="return_timing"):
        made({"return_timing": "fill_epoch"})


def test_the_margin_leaves_room_in_a_cell():
    with pytest.raises(ScenarioError, match=r"margin_m.*120 m"):
        made({"margin_m": 120}, map={"dimensions": 3})
    made({"margin_m": 120})


@pytest.mark.parametrize("what", ["station 0", "the start of drone 0"])
def test_stations_and_starts_are_no_obstacles(what):
    middle = [[1190, 1190], [1210, 1190], [1210, 1210], [1190, 1210]]
    cells = {"size_m": [2400, 2400], "cells": [5, 5], "dimensions": 2}
    sections: dict[str, Any] = {"map": {**cells, "no_fly": [{"polygon_m": middle}]}}
    if what == "station 0":
        sections["stations"] = {"count": 1, "radius_m": 0}
    else:
        sections["stations"] = {"count": 1}
        sections["drones"] = {"count": 1, "start_cells": [[2, 2]]}
    scenario = made({"margin_m": 3}, **sections)
    with pytest.raises(ScenarioError, match=f"drones.motion: space: free: {what}.*in an obstacle"):
        build_world(scenario, 0)


def test_zones_that_take_minutes_to_be_cut_are_refused(monkeypatch: pytest.MonkeyPatch):
    zones = [{"polygon_m": SQUARE}, {"polygon_m": [[300, 300], [400, 300], [400, 400]]}]
    zoned = {"dimensions": 2, "no_fly": zones}
    monkeypatch.setattr(space_checks, "MOST_WORK", 25)
    made(map=zoned)
    monkeypatch.setattr(space_checks, "MOST_WORK", 24)
    with pytest.raises(ScenarioError, match=r"map\.no_fly.*7 corners of 2 polygons"):
        made(map=zoned)
