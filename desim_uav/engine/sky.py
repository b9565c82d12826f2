"""The rows of a world that the kernels of the sky need (see ``sky.rows``), for both engines."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from desim_uav.engine.air import fits_between, windows_for
from desim_uav.engine.constants import transit_row, transits_of
from desim_uav.model.geometry.coverage import SEEN_ROWS, bucket_grid
from desim_uav.model.motion.motion import TRAPEZOID
from desim_uav.model.radio.tracks import TRACK_COLUMNS
from desim_uav.rowcode.rows import Table, array_in, blank, in_memory
from desim_uav.sky.rows import Change, Leg, Piece, Rings, Scene, Sky, Turn
from desim_uav.sky.separation import most_turns
from desim_uav.world import Links, World


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
    return rings


def sky_of(world: World, crossings: int) -> Sky:
    """Return the sky of an environment, whose legs are still to be written.

    It has memory for this many ``crossings``, which are the changes on a leg.
    """
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
    sky.changes = np.zeros((crossings, Change.words), np.int64)
    if world.graded:
        sky.found = np.zeros((crossings, Change.words), np.int64)
        sky.order = np.zeros(crossings, np.int64)
        sky.windows = _windows(world).reshape(-1)
    if world.scenario.separation_m is not None:
        _set_pairs(sky, world)
    made: Sky = sky
    return made


def _windows(world: World) -> NDArray[np.float64]:
    """Return memory for the windows of a leg between levels of any type of drones."""
    fits = [fits_between(world, links) for links in world.links[: len(world.types)]]
    return max((windows_for(world, each) for each in fits), key=len)


def enlarged(sky: Sky, world: World, crossings: int) -> Sky:
    """Return a larger sky in memory with the same legs (see ``sky_of``)."""
    made, old = in_memory(sky_of(world, crossings)), array_in(sky)
    numbers = sum(Leg.words + Piece.words * len(leg.pieces) for leg in sky.legs)
    legs = slice(Sky.words, Sky.words + numbers)  # the first table
    array_in(made)[legs] = old[legs]
    return made


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
