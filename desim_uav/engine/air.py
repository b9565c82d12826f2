"""What ``model.radio.air`` and ``model.radio.marks`` know of a world, for both engines."""

from __future__ import annotations

from itertools import accumulate, chain
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from desim_uav.engine.constants import transits_of
from desim_uav.links import Links
from desim_uav.model.radio.air import FOUND_COLUMNS
from desim_uav.model.radio.between import WINDOW_COLUMNS, window_rows
from desim_uav.model.radio.fits import NONE, Fits, fits_of
from desim_uav.model.radio.marks import MARK_COLUMNS, memory_for
from desim_uav.model.radio.scene import (
    LOSS_COLUMNS,
    PLACE_COLUMNS,
    RADIO_COLUMNS,
    SENDER_COLUMNS,
    memory,
)
from desim_uav.model.radio.sight import Buildings, cells_as_prisms
from desim_uav.rowcode.rows import Table
from desim_uav.rules.air import PROFILE
from desim_uav.sky.links import MOST_PASSED
from desim_uav.sky.rows import Scene
from desim_uav.world import World


class Room(NamedTuple):
    """How much there is memory for: changes, marks of a sender, legs of a walk, and stretches.

    The changes are those on a leg. The stretches are those of time in which buildings block
    one line of sight.
    """

    changes: int
    marks: int
    legs: int
    stretches: int


def set_air(scene: Scene, world: World) -> None:
    """Set the fields of a scene that ``model.radio.air`` needs, if the world needs it."""
    thresholds = [links.thresholds_db for links in world.links]
    scene.thresholds_db = Table(chain.from_iterable(thresholds))
    scene.thresholds_at = Table(accumulate(map(len, thresholds), initial=0))
    if world.in_air:
        profiles = [transit.profile for transit in transits_of(world)]
        scene.heights_m = Table(world.homes[:, 2].tolist())
        scene.profiles = Table(np.concatenate(profiles).reshape(-1).tolist())
        scene.profiles_at = Table(np.cumsum([0, *map(len, profiles)]).tolist())
    if world.marked:
        buildings = buildings_of(world)
        scene.nx, scene.ny = world.grid.cells
        scene.cell_x_m, scene.cell_y_m = world.grid.cell_m
        scene.corners_m = Table(buildings.corners_m.reshape(-1).tolist())
        scene.corners_at = Table(buildings.offsets.tolist())
        scene.roofs_m = Table(buildings.roofs_m.tolist())
        scene.built_at = Table(buildings.heads.tolist())
        scene.built = Table(buildings.members.tolist())
        scene.tallest_m = buildings.tallest_m


def fits_between(world: World, links: Links) -> Fits:
    """Return the radii of classes between the levels of a radio's links, if it needs them."""
    radio, levels = links.radio, world.grid.levels_m
    if (
        links.free
        or not links.in_air
        or len(links.rings_m) != len(levels)
        or radio.marked
        or radio.reuse > 0
    ):
        return NONE
    return fits_of(radio, levels, world.heights_m)


def windows_for(world: World, fits: Fits) -> NDArray[np.float64]:
    """Return memory for the windows of a leg between levels (``model.radio.between``)."""
    longest = max(len(transit.profile) for transit in transits_of(world))
    return np.zeros((window_rows(fits.terms.shape[3], longest), WINDOW_COLUMNS))


def buildings_of(world: World) -> Buildings:
    """Return the buildings that block lines of sight, which are the built cells of the map."""
    blocks = any(links.radio.sight == "buildings" for links in world.links)
    height_m = world.grid.height_m
    return cells_as_prisms(height_m if blocks else 0.0 * height_m, world.grid.cell_m)


def set_memory(tables: Any, world: World) -> None:
    """Set the tables in which kernels work, if the world needs them."""
    if world.in_air:
        profiles = [transit.profile for transit in transits_of(world)]
        senders = world.scenario.drone_count + len(world.scenario.access_points)
        longest = max(map(len, profiles))
        for name, array in memory(senders, longest).items():
            setattr(tables, "link_words" if name == "words" else name, array.reshape(-1))
        tables.ways = np.zeros(senders * PLACE_COLUMNS)
        tables.senders = np.zeros(senders * SENDER_COLUMNS, np.int64)
        tables.losses = np.zeros(len(world.links) * LOSS_COLUMNS, np.int64)
        tables.radios = np.zeros(len(world.links) * RADIO_COLUMNS)
        tables.held = np.zeros(senders * len(world.homes), np.int64)
        tables.chances = np.zeros(len(world.links), np.int64)
        tables.sought = np.zeros(senders, np.int64)
        tables.found = np.zeros(senders * FOUND_COLUMNS, np.int64)
        tables.passed = np.zeros(2 * MOST_PASSED, np.int64)
        if world.free:
            own = [np.zeros((PROFILE, 4))] * senders
            tables.pieces = np.concatenate([*profiles, *own]).reshape(-1)
            tables.pieces_at = np.cumsum([0, *map(len, profiles), *map(len, own)])


def set_room(tables: Any, world: World, room: Room) -> None:
    """Set the tables of marks, and those in which they are made, if the world needs them."""
    if not world.marked:
        return
    senders = world.scenario.drone_count + len(world.scenario.access_points)
    longest = max(len(transit.profile) for transit in transits_of(world))
    made = memory_for(longest, room.legs, world.grid.cells, buildings_of(world), room.stretches)
    tables.mark_rows = room.marks
    tables.marks = np.zeros(senders * room.marks * MARK_COLUMNS)
    tables.marks_at = np.zeros(senders * (len(world.homes) + 1), np.int64)
    tables.flown, tables.borders_s = made.tracks.reshape(-1), made.borders_s
    tables.visits, tables.seen = made.visits.reshape(-1), made.changes.reshape(-1)
    tables.times, tables.visited = made.buffers.times, made.buffers.visited
    tables.stretches = made.buffers.blocked.reshape(-1)
