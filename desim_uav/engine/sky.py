"""The rows of a world that the kernels of the sky need (see ``sky.rows``), for both engines."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import accumulate, chain, count, product
from typing import Any, NamedTuple

import numpy as np

from desim_uav.engine.constants import transit_row, transits_of
from desim_uav.links import Links
from desim_uav.model.geometry.coverage import SEEN_ROWS, bucket_grid
from desim_uav.model.motion.motion import TRAPEZOID, PieceRow
from desim_uav.model.radio.between import Window, window_rows
from desim_uav.model.radio.buildings import Buildings, cells_as_prisms, pieces_as_prisms
from desim_uav.model.radio.curves import MOST_CURVES, Curve, blank_curve, draw
from desim_uav.model.radio.fits import NONE, SLABS, Fits, fits_of
from desim_uav.model.radio.links import LOOKS, Link, Look
from desim_uav.model.radio.marks import KINDS, Mark, memory_for
from desim_uav.model.radio.path_loss import RowPathLoss
from desim_uav.model.radio.slopes import DB
from desim_uav.model.radio.tracks import TrackRow
from desim_uav.rowcode.rows import Table, address, blank, has_tables, held_by, is_row, origin_of
from desim_uav.rowcode.views import in_memory, zeros
from desim_uav.sky.links import MOST_PASSED
from desim_uav.sky.rows import Change, LegRow, Propagation, Scene, Sky, Turn
from desim_uav.sky.separation import most_turns
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


def scene_of(world: World) -> Scene:
    """Return what the kernels of the sky know of a world."""
    scene: Any = blank(Scene)
    scene.separation_m = world.scenario.separation_m or 0.0
    scene.transits = Table(map(transit_row, transits_of(world)))
    thresholds = accumulate((len(links.thresholds_db) for links in world.links), initial=0)
    scene.radios = Table(map(_propagation, world.links, thresholds, [world] * len(world.links)))
    if _interferes(world) and not world.marked:
        for number, radio in enumerate(scene.radios):
            radio.curves = _curves(world, number)
    scene.groups = Table(world.groups.tolist())
    buckets = bucket_grid(*world.area, world.reach_m)
    scene.buckets_x, scene.buckets_y = buckets
    scene.bucket_x_m, scene.bucket_y_m = (
        size / max(count, 1) for size, count in zip(world.area, buckets, strict=True)
    )
    if world.in_air:
        scene.heights_m = Table(world.homes[:, 2].tolist())
    if world.marked:
        buildings = buildings_of(world)
        scene.drawn_as = Table(world.stream_numbers.tolist())
        scene.nx, scene.ny = world.grid.cells
        scene.cell_x_m, scene.cell_y_m = world.grid.cell_m
        scene.built_x, scene.built_y = buildings.shape
        scene.built_x_m, scene.built_y_m = buildings.side_m
        scene.corners, scene.corners_at = buildings.corners, buildings.offsets
        scene.roofs_m, scene.tallest_m = buildings.roofs_m, buildings.tallest_m
        scene.built_at, scene.built = buildings.heads, buildings.members
    typed_scene: Scene = scene
    return typed_scene


def _propagation(links: Links, lowest: int, world: World) -> Propagation:
    """Return how the signals of a radio are received, without the functions of its path loss."""
    row, radio, fits = blank(Propagation), links.radio, _fits_between(world, links)
    row.classes, row.levels, row.lowest = len(links.efficiencies) - 1, len(links.rings_m), lowest
    row.radii_m = Table(links.rings_m.reshape(-1).tolist())
    row.ratios = Table(math.exp(threshold / DB) for threshold in links.thresholds_db)
    row.slabs = fits.terms.shape[3]
    row.terms = Table(fits.terms.reshape(-1).tolist())
    row.ranges = Table(fits.ranges.reshape(-1).tolist())
    row.bounds_m = Table(fits.bounds_m.reshape(-1).tolist())
    if radio.graded:
        row.sight = KINDS[radio.sight]
        row.carrier_ghz, row.power_dbm = radio.carrier_ghz, radio.power_dbm
        row.noise_dbm = radio.budget.noise_dbm
        if radio.shadowing is not None:
            row.los_shadow_db, row.nlos_shadow_db = map(float, radio.shadowing)
    return row


def _fits_between(world: World, links: Links) -> Fits:
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


def _curves(world: World, number: int) -> Table[Curve]:
    """Return the curves of a radio, which are still to be drawn.

    There are none if they were too many, or if its path loss has no ``rates``: with ``slope`` only,
    hardly anything is monotone.
    """
    antennas_m: Sequence[float] = world.grid.levels_m
    if number >= len(world.types):
        antennas_m = (world.scenario.access_points[number - len(world.types)].height_m,)
    pairs = product(antennas_m, np.unique(world.homes[:, 2]).tolist())
    heights_m = {antenna_m - user_m for antenna_m, user_m in pairs}
    has_rates = type(world.links[number].radio.loss).rates is not RowPathLoss.rates
    if not has_rates or len(heights_m) > MOST_CURVES:
        return Table()
    return Table(blank_curve(height_m, math.hypot(*world.area)) for height_m in heights_m)


_numbers = count(1)


def complete(scene: Any) -> None:
    """Number a scene in memory, in which the functions of path losses are known; draw its curves.

    Its number is its own in this process, so a scene that comes from another one has to be given
    one, too.
    """
    scene.number = next(_numbers)
    for radio in scene.radios:
        if len(radio.curves):
            loss = radio.level, radio.rates, radio.loss_values
            draw(address(radio.curves[0]), len(radio.curves), *loss, radio.carrier_ghz)


def buildings_of(world: World) -> Buildings:
    """Return the buildings that block lines of sight: a city, or the built cells of the map."""
    blocks, city = any(links.radio.sight == "buildings" for links in world.links), world.grid.city
    if blocks and len(city):
        return pieces_as_prisms(city.blocking_m, city.roofs_m, world.area)
    height_m = world.grid.height_m
    return cells_as_prisms(height_m if blocks else 0.0 * height_m, world.grid.cell_m)


def sky_of(world: World, room: Room) -> Sky:
    """Return the sky of an environment, whose legs are still to be written."""
    sky: Any = blank(Sky)
    users, senders = len(world.homes), _senders(world)
    sky.legs = Table(_leg(world, sender) for sender in range(senders))
    sky.from_us = sky.to_us = -1
    sky.seen = np.zeros(SEEN_ROWS * users)
    nx, ny = bucket_grid(*world.area, world.reach_m)
    sky.heads = np.zeros(nx * ny, np.int64)
    sky.following = np.zeros(users if nx * ny else 0, np.int64)
    sky.changes = zeros(Change, room.changes * (senders if _interferes(world) else 1))
    if world.graded:
        sky.found = zeros(Change, room.changes)
        sky.order = np.zeros(room.changes, np.int64)
        sky.windows = zeros(Window, window_rows(SLABS[-1], most_pieces(world)))
    if world.scenario.separation_m is not None:
        pieces = most_pieces(world)
        sky.tracks, sky.turns = zeros(TrackRow, 2 * (pieces + 1)), zeros(Turn, most_turns(pieces))
    if world.in_air:
        _set_air(sky, world)
    if world.marked:
        _set_marks(sky, world, room)
    typed_sky: Sky = sky
    return typed_sky


def _senders(world: World) -> int:
    """Return the number of drones and access points."""
    return world.scenario.drone_count + len(world.scenario.access_points)


def _interferes(world: World) -> bool:
    """Return whether senders interfere with each other."""
    return bool(world.links[0].radio.reuse > 0)


def _leg(world: World, sender: int) -> LegRow:
    """Return a leg of a sender, with memory for pieces of its own in free flight."""
    leg = blank(LegRow)
    leg.band = sender % world.links[0].radio.reuse if _interferes(world) else sender
    if sender < world.scenario.drone_count and world.type_of(sender).free:
        leg.pieces = Table(blank(PieceRow) for _ in range(TRAPEZOID))
    return leg


def most_pieces(world: World) -> int:
    """Return the number of pieces of the longest profile of a transit."""
    own = TRAPEZOID if world.free else 0
    return max(own, *(len(transit.profile) for transit in transits_of(world)))


def _set_air(sky: Any, world: World) -> None:
    """Set the memory for links whose changes are not those of rings."""
    air, senders = sky.air, _senders(world)
    air.links = Table(blank(Link) for _ in range(senders))
    for link in air.links:
        link.looks = zeros(Look, LOOKS)
    air.looked_s = np.zeros(LOOKS)
    thresholds = chain.from_iterable(links.thresholds_db for links in world.links)
    air.thresholds_db = Table([*thresholds, 0.0])
    air.tracks = zeros(TrackRow, senders * (most_pieces(world) + 1))
    sky.held = np.zeros(senders * len(world.homes), np.int64)
    sky.passed = zeros(Change, MOST_PASSED)


def _set_marks(sky: Any, world: World, room: Room) -> None:
    """Set the memory for marks, and that in which they are made."""
    air, senders, making = sky.air, _senders(world), sky.making
    sky.mark_rows = room.marks
    air.marks = zeros(Mark, senders * room.marks)
    air.marks_at = np.zeros(senders * (len(world.homes) + 1), np.int64)
    buildings, cells = buildings_of(world), world.grid.cells
    memory = memory_for(most_pieces(world), room.legs, cells, buildings, room.stretches)
    making.tracks, making.borders_s = memory.tracks, memory.borders_s
    making.visits, making.turns = memory.visits, memory.turns
    making.times_s, making.blocked, making.visited = memory.buffers


def enlarged(sky: Sky, world: World, room: Room) -> Sky:
    """Return a sky in memory with more room (see ``sky_of``), and all that the old one knows."""
    larger, had, rows = in_memory(sky_of(world, room)), sky.mark_rows, room.marks
    _copy(sky, larger, Sky)
    if world.marked:
        larger.mark_rows = rows
        old: Any = sky.air.marks
        marks: Any = larger.air.marks
        marks.array[:] = 0
        marks.array.reshape(-1, rows)[:, :had] = old.array.reshape(-1, had)
        begins: Any = larger.air.marks_at
        moved = np.arange(len(sky.legs)) * (rows - had)
        begins[:] += np.repeat(moved, len(begins) // len(moved))
    return larger


def _copy(one: Any, other: Any, kind: Any) -> None:
    """Copy the numbers of a view of a row to another one, whose tables may be longer."""
    for name, of in kind.kinds.items():
        value, its = getattr(one, name), getattr(other, name)
        if is_row(of):
            _copy(value, its, of)
        elif origin_of(of) is None:
            setattr(other, name, value)
        elif isinstance(value, np.ndarray):
            its[: len(value)] = value
        elif has_tables(held_by(of)):
            for row, copied in zip(value, its, strict=False):
                _copy(row, copied, held_by(of))
        else:
            its.array[: len(value)] = value.array
