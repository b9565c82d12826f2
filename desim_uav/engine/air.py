"""What ``model.radio.air`` knows of a world, for both engines."""

from __future__ import annotations

from typing import Any

import numpy as np

from desim_uav.engine.constants import transits_of
from desim_uav.model.radio.link import thresholds_db
from desim_uav.model.radio.scene import PLACE_COLUMNS, SENDER_COLUMNS, memory
from desim_uav.model.rows import Table
from desim_uav.rules.rows import Constants
from desim_uav.world import World

MOST_PASSED = 64
"""The most rows of a pair of levels that are kept; only the first of them counts."""


def set_air(made: Constants, world: World) -> None:
    """Set the fields of the constants that ``model.radio.air`` needs, if the world needs it."""
    tables: tuple[Table[Any], ...] = (Table(), Table(), Table(), Table())
    if world.in_air:
        radio: Any = world.scenario.drones.radio
        made.carrier_ghz, made.power_dbm = radio.carrier_ghz, radio.power_dbm
        made.noise_dbm = radio.budget.noise_dbm
        profiles = [transit.profile for transit in transits_of(world)]
        tables = (
            Table(thresholds_db(radio.ladder).tolist()),
            Table(world.homes[:, 2].tolist()),
            Table(np.concatenate(profiles).reshape(-1).tolist()),
            Table(np.cumsum([0, *map(len, profiles)]).tolist()),
        )
    made.thresholds_db, made.heights_m, made.profiles, made.profiles_at = tables


def set_memory(tables: Any, world: World) -> None:
    """Set the tables in which kernels work, if the world needs them."""
    if world.in_air:
        drones, users = world.scenario.drones.count, len(world.homes)
        longest = max(len(transit.profile) for transit in transits_of(world))
        for name, array in memory(drones, longest).items():
            setattr(tables, "link_words" if name == "words" else name, array.reshape(-1))
        tables.ways = np.zeros(drones * PLACE_COLUMNS)
        tables.senders = np.zeros(drones * SENDER_COLUMNS, np.int64)
        tables.thresholds_at = Table([0, len(world.efficiencies) - 1])
        tables.losses, tables.radios = np.zeros(3, np.int64), np.zeros(2)
        tables.held = np.zeros(users, np.int64)
        tables.passed = np.zeros(2 * MOST_PASSED, np.int64)
