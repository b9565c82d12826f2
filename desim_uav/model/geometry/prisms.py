"""Obstacles as convex prisms, and where a straight way in 3-D first enters one of them.

Obstacles are the buildings of the map and zones in which nobody may fly: polygons with a range of
altitudes. All of them are grown by a margin, and drones are places; so a drone that stops where it
would enter a grown obstacle is a margin away from the obstacle itself. A polygon that is not convex
is made up of convex parts, which overlap once they are grown.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from desim_uav.model.geometry.city import NO_CITY, City
from desim_uav.model.geometry.coverage import bucket_of
from desim_uav.model.geometry.polygons import Polygon, checked, convex_parts, grown
from desim_uav.model.radio.buildings import bucketed
from desim_uav.model.radio.tracks import Point
from desim_uav.rowcode.kernels import kernel, part

TOUCH_M = 1e-6
"""A way that gets no deeper into a prism than this only touches it, so that drones can fly along
obstacles, and away from them, whatever the rounding."""

LEAST_MARGIN_M, MOST_MARGIN_M = 0.01, 1000.0
"""The bounds of the margin by which obstacles are grown. There must be one: without it, a way could
pass between two obstacles that touch each other."""


class Zone(NamedTuple):
    """A polygon over which no drone may fly between two altitudes in metres (inf: at any altitude).

    It is a no-fly zone of a scenario.
    """

    corners_m: Polygon
    low_m: float
    high_m: float


class Prisms(NamedTuple):
    """Convex prisms, and a grid of buckets by which they are found.

    Those of prism b are the rows ``offsets[b]:offsets[b + 1]`` of ``corners_m``, counterclockwise,
    and of ``walls``: the inward normal (x, y) of the wall that begins at this corner, and its
    product with the places on the wall. ``heights_m`` (prisms, 2) are the altitudes between which
    it stands. ``boxes_m`` (prisms, 4) are the least x, the largest x, the least y, the largest y.
    ``shape`` and ``side_m`` are the buckets along x and y and their sides, and
    ``members[heads[k]:heads[k + 1]]`` the prisms that reach into bucket k, by rows of x. What is
    off the map belongs to the nearest bucket.
    """

    corners_m: NDArray[np.float64]
    walls: NDArray[np.float64]
    offsets: NDArray[np.int64]
    heights_m: NDArray[np.float64]
    boxes_m: NDArray[np.float64]
    shape: tuple[int, int]
    side_m: tuple[float, float]
    heads: NDArray[np.int64]
    members: NDArray[np.int64]


def obstacles(
    height_m: NDArray[np.float64],
    cell_m: tuple[float, float],
    zones: Sequence[Zone],
    margin_m: float,
    city: City = NO_CITY,
) -> Prisms:
    """Return the grown obstacles of a map: its built cells (nx, ny) or its city, and zones.

    Raises ValueError for a margin or a zone that is not allowed (``polygons.checked``).
    """
    if not LEAST_MARGIN_M <= margin_m <= MOST_MARGIN_M:
        raise ValueError(
            f"the margin must be between {LEAST_MARGIN_M:g} and {MOST_MARGIN_M:g} m, "
            f"not {margin_m:g}"
        )
    footprints: list[Polygon] = []
    heights: list[tuple[float, float]] = []
    for piece, roof in zip(city.pieces_m, city.roofs_m.tolist(), strict=True):
        footprints.append(grown(piece, margin_m))
        heights.append((-np.inf, roof + margin_m))
    for x0, y0, x1, y1, roof in () if len(city) else _rectangles(height_m):
        corners = np.array([(x0, y0), (x1, y0), (x1, y1), (x0, y1)]) * np.array(cell_m)
        footprints.append(grown(corners, margin_m))
        heights.append((-np.inf, roof + margin_m))
    for zone in zones:
        if not zone.low_m < zone.high_m:
            raise ValueError(
                f"a zone must be lower at its bottom ({zone.low_m:g} m) than at its top "
                f"({zone.high_m:g} m)"
            )
        for convex in _parts(tuple(map(tuple, np.asarray(zone.corners_m).tolist()))):
            footprints.append(grown(convex, margin_m))
            heights.append((zone.low_m - margin_m, zone.high_m + margin_m))
    return prisms(footprints, heights, height_m.shape, cell_m)


@lru_cache(maxsize=1000)
def _parts(corners_m: tuple[tuple[float, ...], ...]) -> tuple[Polygon, ...]:
    """Return the convex parts of a polygon, which are the same in each world of a scenario."""
    return tuple(convex_parts(checked(corners_m)))


def prisms(
    footprints_m: Sequence[Polygon],
    heights_m: Sequence[tuple[float, float]],
    shape: tuple[int, ...],
    side_m: tuple[float, float],
) -> Prisms:
    """Return prisms with these convex, counterclockwise footprints and these altitudes."""
    heads, members = bucketed(footprints_m, (shape[0], shape[1]), side_m)
    walls = [_walls(corners) for corners in footprints_m]
    boxes = [np.column_stack([one.min(axis=0), one.max(axis=0)]).ravel() for one in footprints_m]
    return Prisms(
        np.concatenate([np.zeros((0, 2)), *footprints_m]),
        np.concatenate([np.zeros((0, 3)), *walls]),
        np.cumsum([0, *map(len, footprints_m)]),
        np.array(heights_m, float).reshape(-1, 2),
        np.array(boxes, float).reshape(-1, 4),
        (shape[0], shape[1]),
        side_m,
        heads,
        members,
    )


def _walls(corners: Polygon) -> NDArray[np.float64]:
    ahead = np.roll(corners, -1, axis=0) - corners
    inward = np.column_stack([-ahead[:, 1], ahead[:, 0]]) / np.hypot(*ahead.T)[:, None]
    return np.column_stack([inward, (inward * corners).sum(axis=1)])


def _rectangles(height_m: NDArray[np.float64]) -> list[tuple[int, int, int, int, float]]:
    """Return rectangles of equally high built cells: x0, y0, x1, y1 (in cells) and the height."""
    nx, ny = height_m.shape
    left = height_m > 0.0
    rectangles = []
    for ix in range(nx):
        for iy in range(ny):
            if not left[ix, iy]:
                continue
            roof, x1, y1 = height_m[ix, iy], ix + 1, iy + 1
            while y1 < ny and left[ix, y1] and height_m[ix, y1] == roof:
                y1 += 1
            while x1 < nx and left[x1, iy:y1].all() and (height_m[x1, iy:y1] == roof).all():
                x1 += 1
            left[ix:x1, iy:y1] = False
            rectangles.append((ix, iy, x1, y1, float(roof)))
    return rectangles


@kernel
def first_entry(prisms: Prisms, start: Point, stop: Point) -> float:
    """Return the share of a straight way at which it first enters a prism, inf if it does not.

    A way that begins in a prism, however deep, enters it only if it gets deeper.
    """
    (x0, y0, _), (x1, y1, _) = start, stop
    (nx, ny), (dx, dy) = prisms.shape, prisms.side_m
    soonest = np.inf
    first, last = bucket_of(min(x0, x1), dx, nx), bucket_of(max(x0, x1), dx, nx)
    for ix in range(first, last + 1):
        south, north = min(y0, y1), max(y0, y1)
        if first < last:
            south, north = _slab(start, stop, ix * dx, (ix + 1) * dx, ix == 0, ix == nx - 1)
        for iy in range(bucket_of(south, dy, ny), bucket_of(north, dy, ny) + 1):
            bucket = ix * ny + iy
            for k in range(prisms.heads[bucket], prisms.heads[bucket + 1]):
                soonest = min(soonest, entry_into(prisms, prisms.members[k], start, stop))
    return float(soonest)


@part
def _slab(
    start: Point, stop: Point, west: float, east: float, is_first: bool, is_last: bool
) -> tuple[float, float]:
    """Return the range of y of a way within a slab of x, and a bit more."""
    (x0, y0, _), (x1, y1, _) = start, stop
    if x0 > x1:
        x0, y0, x1, y1 = x1, y1, x0, y0
    west = -np.inf if is_first else west - TOUCH_M
    east = np.inf if is_last else east + TOUCH_M
    one = y0 if x0 >= west else y0 + (y1 - y0) * ((west - x0) / (x1 - x0))
    other = y1 if x1 <= east else y0 + (y1 - y0) * ((east - x0) / (x1 - x0))
    return min(one, other) - TOUCH_M, max(one, other) + TOUCH_M


@kernel
def entry_into(prisms: Prisms, b: int, start: Point, stop: Point) -> float:
    """Return the share of a straight way at which it enters one prism, inf if it does not."""
    (x0, y0, z0), (x1, y1, z1) = start, stop
    box, bottom, top = prisms.boxes_m[b], prisms.heights_m[b, 0], prisms.heights_m[b, 1]
    if max(x0, x1) < box[0] or min(x0, x1) > box[1]:
        return np.inf
    if max(y0, y1) < box[2] or min(y0, y1) > box[3]:
        return np.inf
    begin, end = _cut(z0 - bottom, z1 - bottom, 0.0, 1.0)
    begin, end = _cut(top - z0, top - z1, begin, end)
    for k in range(prisms.offsets[b], prisms.offsets[b + 1]):
        if not begin < end:
            return np.inf
        nx, ny, at = prisms.walls[k, 0], prisms.walls[k, 1], prisms.walls[k, 2]
        begin, end = _cut(nx * x0 + ny * y0 - at, nx * x1 + ny * y1 - at, begin, end)
    if not begin < end:
        return np.inf
    depth_m = depth(prisms, b, start) if begin == 0.0 else 0.0
    deepest = depth(prisms, b, _between(start, stop, 0.5 * (begin + end)))
    if end == 1.0:
        deepest = max(deepest, depth(prisms, b, stop))
    return begin if deepest > max(depth_m, TOUCH_M) else np.inf


@part
def _cut(near: float, far: float, begin: float, end: float) -> tuple[float, float]:
    """Return the part of a stretch in which a number is above 0 that goes from one to another."""
    if near <= 0.0 and far <= 0.0:
        return 1.0, 0.0
    if near < 0.0:
        begin = max(begin, near / (near - far))
    elif far < 0.0:
        end = min(end, near / (near - far))
    return begin, end


@part
def _between(start: Point, stop: Point, share: float) -> Point:
    rest = 1.0 - share
    return (
        rest * start[0] + share * stop[0],
        rest * start[1] + share * stop[1],
        rest * start[2] + share * stop[2],
    )


@kernel
def depth(prisms: Prisms, b: int, at: Point) -> float:
    """Return how deep a place is in a prism, in metres: below 0 if it is outside."""
    x, y, z = at
    least = min(z - prisms.heights_m[b, 0], prisms.heights_m[b, 1] - z)
    for k in range(prisms.offsets[b], prisms.offsets[b + 1]):
        inward = prisms.walls[k, 0] * x + prisms.walls[k, 1] * y - prisms.walls[k, 2]
        least = min(least, inward)
    return float(least)


@kernel
def deepest_at(prisms: Prisms, at: Point) -> float:
    """Return how deep a place is in the prism in which it is deepest; 0 or less: in none."""
    x, y, _ = at
    (nx, ny), (dx, dy) = prisms.shape, prisms.side_m
    bucket = bucket_of(x, dx, nx) * ny + bucket_of(y, dy, ny)
    deepest = -np.inf
    for k in range(prisms.heads[bucket], prisms.heads[bucket + 1]):
        deepest = max(deepest, depth(prisms, prisms.members[k], at))
    return float(deepest)
