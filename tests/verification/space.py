"""What a scenario's mapping says of free flight, in the terms of the fixed-step simulator."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from desim_uav.world import World
from tests.reference import free


def space_of(mapping: dict[str, Any], world: World, ceilings: Sequence[bool]) -> free.Space:
    """The limits and the obstacles of a scenario in plain numbers."""
    motion, grid = mapping["drones"]["motion"], world.grid
    dx, dy = grid.cell_m
    boxes = [
        ((x * dx, y * dy, 0.0), ((x + 1) * dx, (y + 1) * dy, float(grid.height_m[x, y])))
        for x, y in np.argwhere(grid.height_m > 0.0).tolist()
    ]
    for zone in mapping["map"]["no_fly"]:
        (left, low), _, (right, up), _ = zone["polygon_m"]
        bottom_m, top_m = zone["altitude_m"]
        boxes.append(((left, low, bottom_m), (right, up, top_m)))
    under = grid.levels_m[grid.levels_under_ceiling - 1]
    return free.Space(
        motion["max_speed_mps"],
        motion["max_acceleration_mps2"],
        motion["climb_mps"],
        motion["descent_mps"],
        motion["vertical_mps2"],
        tuple(mapping["map"]["size_m"]),
        grid.levels_m,
        [under if low else grid.levels_m[-1] for low in ceilings],
        boxes,
        motion["margin_m"],
        tuple(mapping.get("wind_mps", (0.0, 0.0))),
        tuple(motion["cruise"]) if "cruise" in motion else None,
    )
