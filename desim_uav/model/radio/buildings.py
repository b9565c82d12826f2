"""Buildings that block lines of sight: vertical prisms, and a grid of buckets to find them.

A building has a convex footprint on the ground, and a flat roof.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from desim_uav.rowcode.rows import Floats, Ints, Row, Table, row
from desim_uav.rowcode.views import records, zeros


@row
class Corner(Row):
    """A corner of a footprint."""

    x_m: float
    y_m: float


@row
class Stretch(Row):
    """A stretch of time in which a building blocks a line, in seconds since the span's start."""

    since_s: float
    until_s: float


class Buildings(NamedTuple):
    """Buildings, and a grid of buckets by which they are found.

    ``corners`` has those of all footprints, counterclockwise; those of building b are
    ``offsets[b]:offsets[b + 1]``. ``roofs_m`` are the heights. ``shape``: the buckets along x and
    y, and ``side_m`` how long they are. ``members[heads[k]:heads[k + 1]]`` are the buildings that
    reach into bucket k, by rows of x.
    """

    corners: Table[Corner]
    offsets: Ints
    roofs_m: Floats
    shape: tuple[int, int]
    side_m: tuple[float, float]
    heads: Ints
    members: Ints
    tallest_m: float


class Buffers(NamedTuple):
    """The buffers of the kernels, which allocate no memory.

    ``times`` holds the times at which one building may change the state in one piece, at least 9
    for each of its corners and 4 more, and then as many numbers that say what they are. ``blocked``
    holds the stretches of time in which a building blocks the line. ``visited`` (buildings + 1,)
    begins as zeros.
    """

    times: Floats
    blocked: Table[Stretch]
    visited: Ints


def bucketed(
    footprints_m: Sequence[NDArray[np.float64]],
    shape: tuple[int, int],
    side_m: tuple[float, float],
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return the ``heads`` and the ``members`` of buckets that footprints reach into.

    What is off the map belongs to the nearest buckets.
    """
    buckets: list[list[int]] = [[] for _ in range(shape[0] * shape[1])]
    for number, corners in enumerate(footprints_m):
        (west, south), (east, north) = corners.min(axis=0) / side_m, corners.max(axis=0) / side_m
        for ix in _reached(west, east, shape[0]):
            for iy in _reached(south, north, shape[1]):
                buckets[ix * shape[1] + iy].append(number)
    members = [number for bucket in buckets for number in bucket]
    return np.cumsum([0, *map(len, buckets)]), np.array(members, np.int64)


def _reached(low: float, high: float, count: int) -> range:
    """Return the buckets, of ``count`` along an axis, in which a range of them has its places."""
    return range(min(max(int(low), 0), count - 1), max(min(int(np.ceil(high)), count), 1))


MOST_BUCKETS = 512
"""The most buckets of buildings along an axis."""


def pieces_as_prisms(
    pieces_m: Sequence[NDArray[np.float64]],
    roofs_m: NDArray[np.float64],
    size_m: tuple[float, float],
) -> Buildings:
    """Return convex buildings with these footprints, counterclockwise, on a map of this size.

    There is about one bucket for each building.
    """
    per_m = math.sqrt(len(pieces_m) / (size_m[0] * size_m[1]))
    nx, ny = (min(max(round(size * per_m), 1), MOST_BUCKETS) for size in size_m)
    side_m = size_m[0] / nx, size_m[1] / ny
    heads, members = bucketed(pieces_m, (nx, ny), side_m)
    return Buildings(
        records(Corner, np.concatenate(pieces_m)),
        np.cumsum([0, *map(len, pieces_m)]),
        np.array(roofs_m, np.float64),
        (nx, ny),
        side_m,
        heads,
        members,
        float(roofs_m.max()),
    )


def cells_as_prisms(height_m: NDArray[np.float64], side_m: tuple[float, float]) -> Buildings:
    """Return the buildings of a grid of cells (nx, ny), each with the height of what stands on it.

    Each cell that is higher than 0 is a building, and a bucket of its own.
    """
    nx, ny = height_m.shape
    built = np.argwhere(height_m > 0.0)
    corner = np.array([(0, 0), (1, 0), (1, 1), (0, 1)])
    corners = (built[:, None, :] + corner[None, :, :]) * np.array(side_m)
    heads = np.concatenate([[0], np.cumsum(height_m.ravel() > 0.0)])
    return Buildings(
        records(Corner, corners.reshape(-1, 2)),
        np.arange(0, 4 * len(built) + 1, 4),
        np.ascontiguousarray(height_m[height_m > 0.0]),
        (nx, ny),
        side_m,
        heads,
        np.arange(len(built)),
        float(height_m.max(initial=0.0)),
    )


def buffers_for(offsets: Ints, stretches: int) -> Buffers:
    """Return buffers for buildings with these offsets and this number of blocked stretches."""
    most, count = int(np.diff(offsets).max(initial=0)), len(offsets)
    return Buffers(
        np.empty(2 * (9 * most + 4)), zeros(Stretch, stretches), np.zeros(count, np.int64)
    )
