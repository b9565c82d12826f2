"""A small scenario in which a learner has to fly to users who are far away."""

from __future__ import annotations

from typing import Any

FAR: dict[str, Any] = {
    "name": "far",
    "world_seed": 0,
    "map": {"size_m": [1200, 240], "cells": [5, 1], "dimensions": 2},
    "drones": {
        "count": 1,
        "start_cells": [[0, 0]],
        "footprint_radius_m": 120,
        "bandwidth_kbps": None,
        "battery": None,
    },
    "stations": {"count": 0},
    "users": {"positions_m": [[1080, 120], [1080, 100]], "mobility": {"kind": "static"}},
    "demand": {"kind": "continuous"},
    "episode": {"steps": 12, "carry_over": False},
    "observation": {"kind": "local"},
    "reward": {"kind": "qoe"},
}
"""Two users four cells to the east of the only drone: nothing is gained on the way."""
