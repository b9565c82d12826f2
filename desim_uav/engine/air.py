"""What ``model.radio.air`` knows of a world, for both engines."""

from __future__ import annotations

from typing import Any

import numpy as np

from desim_uav.engine.constants import transits_of
from desim_uav.model.radio.scene import (
    LOSS_COLUMNS,
    PLACE_COLUMNS,
    RADIO_COLUMNS,
    SENDER_COLUMNS,
    memory,
)
from desim_uav.model.rows import Table
from desim_uav.rules.rows import Constants
from desim_uav.world import World

MOST_PASSED = 64
"""The most rows of a pair of levels that are kept; only the first of them counts."""


def set_air(made: Constants, world: World) -> None:
    """Set the fields of the constants that ``model.radio.air`` needs, if the world needs it."""
    tables: tuple[Table[Any], ...] = (Table(), Table(), Table())
    if world.in_air:
        profiles = [transit.profile for transit in transits_of(world)]
        tables = (
            Table(world.homes[:, 2].tolist()),
            Table(np.concatenate(profiles).reshape(-1).tolist()),
            Table(np.cumsum([0, *map(len, profiles)]).tolist()),
        )
    made.heights_m, made.profiles, made.profiles_at = tables


def set_memory(tables: Any, world: World) -> None:
    """Set the tables in which kernels work, if the world needs them."""
    if world.in_air:
        senders = world.scenario.drones.count + len(world.scenario.access_points)
        longest = max(len(transit.profile) for transit in transits_of(world))
        for name, array in memory(senders, longest).items():
            setattr(tables, "link_words" if name == "words" else name, array.reshape(-1))
        tables.ways = np.zeros(senders * PLACE_COLUMNS)
        tables.senders = np.zeros(senders * SENDER_COLUMNS, np.int64)
        tables.losses = np.zeros(len(world.links) * LOSS_COLUMNS, np.int64)
        tables.radios = np.zeros(len(world.links) * RADIO_COLUMNS)
        tables.held = np.zeros(len(world.homes), np.int64)
        tables.passed = np.zeros(2 * MOST_PASSED, np.int64)
