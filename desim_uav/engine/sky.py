"""The rows of a world that the kernels of the sky need (see ``sky.rows``), for both engines."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from desim_uav.engine.air import Room, fits_between, set_air, set_memory, set_room, windows_for
from desim_uav.engine.constants import transit_row, transits_of
from desim_uav.links import Links
from desim_uav.model.geometry.coverage import SEEN_ROWS, bucket_grid
from desim_uav.model.motion.motion import TRAPEZOID
from desim_uav.model.radio.marks import KINDS, MARK_COLUMNS
from desim_uav.model.radio.tracks import TRACK_COLUMNS
from desim_uav.rowcode.rows import Table, blank, held_by, is_row, origin_of
from desim_uav.rowcode.views import in_memory
from desim_uav.sky.rows import Change, Leg, Piece, Rings, Scene, Sky, Turn
from desim_uav.sky.separation import most_turns
from desim_uav.world import World


def scene_of(world: World) -> Scene:
    """Return what the kernels of the sky know of a world."""
    scene = blank(Scene)
    scene.separation_m = world.scenario.separation_m or 0.0
    scene.transits = Table(map(transit_row, transits_of(world)))
    scene.rings = Table(_rings(world, links) for links in world.links)
    scene.groups = Table(world.groups.tolist())
    buckets = bucket_grid(*world.area, world.reach_m)
    scene.buckets_x, scene.buckets_y = buckets
    scene.bucket_x_m, scene.bucket_y_m = (
        size / max(count, 1) for size, count in zip(world.area, buckets, strict=True)
    )
    set_air(scene, world)
    return scene


def _rings(world: World, links: Links) -> Rings:
    """Return the rings of a radio's links."""
    rings, fits = blank(Rings), fits_between(world, links)
    rings.classes, rings.levels = len(links.efficiencies) - 1, len(links.rings_m)
    rings.radii_m = Table(links.rings_m.reshape(-1).tolist())
    rings.slabs = fits.terms.shape[3]
    rings.terms = Table(fits.terms.reshape(-1).tolist())
    rings.ranges = Table(fits.ranges.reshape(-1).tolist())
    rings.bounds_m = Table(fits.bounds_m.reshape(-1).tolist())
    if links.radio.graded:
        rings.sight = KINDS[links.radio.sight]
        if links.radio.shadowing is not None:
            rings.los_shadow_db, rings.nlos_shadow_db = map(float, links.radio.shadowing)
    return rings


def sky_of(world: World, room: Room) -> Sky:
    """Return the sky of an environment, whose legs are still to be written."""
    sky: Any = blank(Sky)
    users, senders = (
        len(world.homes),
        world.scenario.drone_count + len(world.scenario.access_points),
    )
    sky.legs = Table(_leg(world, sender) for sender in range(senders))
    sky.from_us = sky.to_us = -1
    sky.seen = np.zeros(SEEN_ROWS * users)
    nx, ny = bucket_grid(*world.area, world.reach_m)
    sky.heads = np.zeros(nx * ny, np.int64)
    sky.following = np.zeros(users if nx * ny else 0, np.int64)
    crossings = room.changes
    tables = senders if world.links[0].radio.reuse > 0 else 1
    sky.changes = np.zeros((crossings * tables, Change.words), np.int64)
    if world.graded:
        sky.found = np.zeros((crossings, Change.words), np.int64)
        sky.order = np.zeros(crossings, np.int64)
        sky.windows = _windows(world).reshape(-1)
    if world.scenario.separation_m is not None:
        _set_pairs(sky, world)
    set_memory(sky.air, world)
    set_room(sky.air, world, room)
    made: Sky = sky
    return made


def _windows(world: World) -> NDArray[np.float64]:
    """Return memory for the windows of a leg between levels of any type of drones."""
    fits = [fits_between(world, links) for links in world.links[: len(world.types)]]
    return max((windows_for(world, each) for each in fits), key=len)


def enlarged(sky: Sky, world: World, room: Room) -> Sky:
    """Return a sky in memory with more room (see ``sky_of``), and all that the old one knows."""
    made, had, rows = in_memory(sky_of(world, room)), sky.air.mark_rows, room.marks
    _copy(sky, made, Sky)
    if world.marked:
        made.air.mark_rows = rows
        marks: Any = made.air.marks
        marks[:] = 0.0
        old: Any = sky.air.marks
        marks.reshape(-1, rows, MARK_COLUMNS)[:, :had] = old.reshape(-1, had, MARK_COLUMNS)
        begins: Any = made.air.marks_at
        moved = np.arange(len(sky.legs)) * (rows - had)
        begins[:] += np.repeat(moved, len(begins) // len(moved))
    return made


def _copy(one: Any, other: Any, kind: Any) -> None:
    """Copy the numbers of a view of a row to another one, whose tables may be longer."""
    for name, of in kind.kinds.items():
        value = getattr(one, name)
        if is_row(of):
            _copy(value, getattr(other, name), of)
        elif origin_of(of) is None:
            setattr(other, name, value)
        elif not isinstance(value, np.ndarray):  # rows
            for own, its in zip(value, getattr(other, name), strict=False):
                _copy(own, its, held_by(of))
        else:
            getattr(other, name)[: len(value)] = value


def _set_pairs(sky: Sky, world: World) -> None:
    """Set the memory for the distances of drones."""
    pieces = most_pieces(world)
    sky.tracks = Table([0.0] * (2 * (pieces + 1) * TRACK_COLUMNS))
    sky.turns = Table(blank(Turn) for _ in range(most_turns(pieces)))


def most_pieces(world: World) -> int:
    """Return the number of pieces of the longest profile of a transit."""
    own = TRAPEZOID if world.free else 0
    return max(own, *(len(transit.profile) for transit in transits_of(world)))


def _leg(world: World, sender: int) -> Leg:
    """Return a leg of a sender, with memory for pieces of its own in free flight."""
    leg = blank(Leg)
    if sender < world.scenario.drone_count and world.type_of(sender).free:
        leg.pieces = Table(blank(Piece) for _ in range(TRAPEZOID))
    return leg
