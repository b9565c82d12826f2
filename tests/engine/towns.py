"""Towns in which lines of sight, or the shadowing of links, change."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from desim_uav.engine.base import RunSettings
from desim_uav.scenario.load import from_mapping
from desim_uav.world import World, build_world

HOUSE = {"cells": [[1, 1, 60], [3, 2, 150], [1, 3, 90]]}
RADIO = {
    "kind": "link_classes",
    "power_dbm": 20,
    "bandwidth_mhz": 1,
    "path_loss": {"kind": "al_hourani", "environment": "dense_urban"},
    "line_of_sight": "drawn",
    "shadowing": {"los_db": 2, "nlos_db": 6},
    "sharing": "equal",
}


def town(count: int = 3, **changes: Any) -> World:
    """Three drones over a dense town of 5 by 5 cells, in which twelve users walk."""
    radio = {**RADIO, **changes.pop("radio", {})}
    built = radio["line_of_sight"] == "buildings"
    scenario = {
        "map": {
            "size_m": [1200, 1200],
            "cells": [5, 5],
            "dimensions": 3 if built else 2,
            **({"obstacles": HOUSE} if built else {}),
        },
        "drones": {
            "count": count,
            "radio": radio,
            "battery": changes.pop("battery", None),
            "start_cells": [[0, 0], [2, 2], [4, 3], [0, 4]][:count],
        },
        "stations": {"count": 0},
        "users": {"count": 12},
        "services": {"upload": {"kind": "transfer", "volume_mbit": [4, 20]}},
        "demand": {"kind": "poisson", "rate_per_hour": 60, "mix": {"upload": 1}},
        "episode": {"steps": 6, "step_s": 60},
        **changes,
    }
    return build_world(from_mapping(scenario), 3)


def told(world: World) -> RunSettings:
    """Settings with events."""
    return RunSettings((True,) * world.scenario.drones.count, carry_over=False, keep_events=True)


WORLDS: Mapping[str, Mapping[str, Any]] = {
    "drawn": {"radio": {"shadowing": None}},
    "with shadowing": {},
    "shadowing alone": {
        "radio": {
            "path_loss": {"kind": "log_distance", "exponent": 3.2, "at_1m_db": 40},
            "line_of_sight": "mean",
        }
    },
    "interference": {"radio": {"interference": "co_channel"}},
    "strongest": {"association": "strongest"},
    "past buildings": {"radio": {"line_of_sight": "buildings"}, "association": {"kind": "a3"}},
}
