"""Many sensors at once, in both engines."""

from __future__ import annotations

import pytest

import desim_uav as du
from desim_uav.scenario.load import from_mapping
from desim_uav.scenario.schema import Scenario


def meters(count: int, size_m: float) -> Scenario:
    """Sensors in clusters, whose updates four drones carry to the ground in stores of 10 Mbit."""
    updates = {"kind": "poisson", "mean_s": 600}
    reading = {"kind": "collect", "updates": updates, "size_mbit": [0.2, 0.5, 1.1], "buffer": 10}
    group = {"count": count, "clusters": {"count": count // 25, "radius_m": [200, 400]}}
    fleet = {"count": 4, "battery": {"kind": "rotary_wing"}, "store_mbit": 10}
    data = {
        "name": "meters",
        "map": {"dimensions": 2, "size_m": [size_m, size_m], "cells": [round(size_m / 300)] * 2},
        "drones": {**fleet, "radio": {"kind": "link_classes", "power_dbm": 10, "sharing": "equal"}},
        "stations": {"count": 4},
        "users": {**group, "mobility": {"kind": "static"}},
        "services": {"reading": {**reading, "keeps": "newest", "delivered": "ground"}},
        "demand": {"kind": "sensing", "service": "reading"},
        "reward": {"kind": "age", "scale_s": 60},
        "episode": {"steps": 6},
    }
    return from_mapping(data)


@pytest.mark.thorough
def test_a_thousand_sensors_in_both_engines() -> None:
    scenario = meters(1000, 3000.0)
    one, other = (
        du.run(scenario, policy="random", episodes=1, engine=engine) for engine in ("des", "batch")
    )
    assert one.updates.equals(other.updates) and one.sensors.equals(other.sensors)
    assert len(one.sensors) == 1000 and len(one.updates) > 500
    assert {"stored", "buffered"} <= set(one.updates["fate"])
