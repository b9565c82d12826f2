"""Simple polygons: checked, cut into convex parts, and grown by a margin.

A polygon is an array of corners (corners, 2) in metres. It may be non-convex, but its edges must
not meet except at the corners between neighbours.
"""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

Polygon = NDArray[np.float64]

MOST_CORNERS = 200
"""The most corners of a polygon."""

NEAREST_M = 1e-3
"""Corners that are nearer to each other than this are refused."""

STRAIGHT = 1e-12
"""The sine of an angle below which three corners are taken to be on one line."""


def checked(corners: object) -> Polygon:
    """Return a simple polygon counterclockwise, without corners on straight lines.

    Raises ValueError that says what is wrong with it.
    """
    polygon = np.array(corners, float)
    if polygon.ndim != 2 or polygon.shape[1] != 2 or not np.isfinite(polygon).all():
        raise ValueError("a polygon is a list of corners [x, y] in metres")
    if not 3 <= len(polygon) <= MOST_CORNERS:
        raise ValueError(f"a polygon has 3 to {MOST_CORNERS} corners, not {len(polygon)}")
    for i, j in _near_corners(polygon):
        raise ValueError(
            f"corners {i} and {j} are one place, {_words(polygon[i])}; a polygon is closed by "
            f"itself, and its edges must not meet"
        )
    for i, j in _meeting_edges(polygon):
        raise ValueError(f"edges {_edge(polygon, i)} and {_edge(polygon, j)} meet")
    if area(polygon) < 0.0:
        polygon = polygon[::-1]
    sines = _sines(polygon)
    return np.ascontiguousarray(polygon[np.abs(sines) > STRAIGHT])


def area(polygon: Polygon) -> float:
    """Return the area in m², which is positive if the corners are counterclockwise."""
    x, y = (polygon - polygon[0]).T
    return float(0.5 * (x * np.roll(y, -1) - y * np.roll(x, -1)).sum())


def convex_parts(polygon: Polygon) -> list[Polygon]:
    """Return convex polygons that make up a polygon as ``checked`` returns it.

    The ears of the polygon are cut off one by one, and neighbouring parts are joined again where
    that makes a convex part (Hertel and Mehlhorn, 1983): there are at most four times as many as
    are needed.
    """
    return joined(polygon, _triangles(polygon))


def joined(corners: Polygon, parts: list[list[int]]) -> list[Polygon]:
    """Return convex parts, given by the numbers of their corners, with neighbours joined.

    Two parts with a common edge are joined where that makes a convex part.
    """
    parts = list(parts)
    apart: set[tuple[tuple[int, ...], tuple[int, ...]]] = set()
    while True:
        for one, other in _neighbours(parts):
            both = tuple(parts[one]), tuple(parts[other])
            ring = None if both in apart else _joined(corners, parts[one], parts[other])
            if ring is not None:
                parts[one] = ring
                del parts[other]
                break
            apart.add(both)
        else:
            return [corners[part] for part in parts]


def _neighbours(parts: list[list[int]]) -> list[tuple[int, int]]:
    """Return the pairs of parts that have an edge in common, in order."""
    owner = {
        edge: number
        for number, part in enumerate(parts)
        for edge in zip(part, [*part[1:], part[0]], strict=True)
    }
    others = ((one, owner.get((stop, start), -1)) for (start, stop), one in owner.items())
    return sorted({(min(pair), max(pair)) for pair in others if pair[1] >= 0})


def grown(convex: Polygon, margin_m: float) -> Polygon:
    """Return a convex polygon that contains all places within a margin of another one.

    Edges are moved outwards. Corners of at most 90 degrees of turn are mitred; sharper ones are
    cut at the margin, too, so that no place is farther than sqrt(2) margins from the polygon.
    """
    corners_m = []
    for before, corner, after in zip(
        np.roll(convex, 1, axis=0), convex, np.roll(convex, -1, axis=0), strict=True
    ):
        into, out = _outwards(before, corner), _outwards(corner, after)
        normals = [into, out]
        if into @ out < 0.0:
            middle = (corner - before) / np.hypot(*(corner - before))
            middle = middle - (after - corner) / np.hypot(*(after - corner))
            normals.insert(1, middle / np.hypot(*middle))
        for one, other in pairwise(normals):
            corners_m.append(corner + (one + other) * (margin_m / (1.0 + one @ other)))
    return np.array(corners_m)


def _words(place: Polygon) -> str:
    return f"({place[0]:g}, {place[1]:g})"


def _edge(polygon: Polygon, k: int) -> str:
    return f"{k} from {_words(polygon[k])} to {_words(polygon[(k + 1) % len(polygon)])}"


def _turn(a: Polygon, b: Polygon, c: Polygon) -> Any:
    """Return twice the area of a triangle: positive if it turns to the left."""
    return (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])


def _sines(polygon: Polygon) -> NDArray[np.float64]:
    """Return the sine of the turn at each corner."""
    into = polygon - np.roll(polygon, 1, axis=0)
    out = np.roll(into, -1, axis=0)
    lengths = np.hypot(*into.T) * np.hypot(*out.T)
    sines: NDArray[np.float64] = (into[:, 0] * out[:, 1] - into[:, 1] * out[:, 0]) / lengths
    return sines


def _near_corners(polygon: Polygon) -> list[tuple[int, int]]:
    """Return the pairs of corners that are nearer to each other than ``NEAREST_M``, in order."""
    dx, dy = np.moveaxis(polygon[:, None] - polygon[None], 2, 0)
    return _pairs(np.hypot(dx, dy) < NEAREST_M)


def _meeting_edges(polygon: Polygon) -> list[tuple[int, int]]:
    """Return the pairs of edges that meet elsewhere than at a corner between neighbours."""
    count = len(polygon)
    a, b = polygon.T[:, :, None], np.roll(polygon, -1, axis=0).T[:, :, None]
    c, d = polygon.T[:, None, :], np.roll(polygon, -1, axis=0).T[:, None, :]
    sides = _turn(a, b, c), _turn(a, b, d), _turn(c, d, a), _turn(c, d, b)
    meet = (sides[0] * sides[1] < 0.0) & (sides[2] * sides[3] < 0.0)
    touches = (a, b, c), (a, b, d), (c, d, a), (c, d, b)
    for side, (start, stop, place) in zip(sides, touches, strict=True):
        between = (np.minimum(start, stop) <= place) & (place <= np.maximum(start, stop))
        meet |= (side == 0.0) & between.all(axis=0)
    for k in range(count):
        after = (k + 1) % count
        meet[k, after] = meet[after, k] = _folds(polygon, k)
    return _pairs(meet)


def _pairs(matrix: NDArray[np.bool_]) -> list[tuple[int, int]]:
    """Return the pairs of different numbers that are found, in order, the lower one first."""
    return [(int(i), int(j)) for i, j in zip(*np.nonzero(np.triu(matrix, 1)), strict=True)]


def _folds(polygon: Polygon, k: int) -> bool:
    """Return whether an edge turns back into itself at its end, a corner between neighbours."""
    count = len(polygon)
    before, corner, after = (polygon[(k + i) % count] for i in range(3))
    turned = _turn(before, corner, after)
    one, other = corner - before, after - corner
    far = STRAIGHT * float(np.hypot(*one) * np.hypot(*other))
    return bool(abs(turned) <= far and one @ other < 0.0)


def _triangles(polygon: Polygon) -> list[list[int]]:
    """Return the triangles that ears leave, as numbers of corners."""
    left, triangles = list(range(len(polygon))), []
    while len(left) > 3:
        heights_m = _ears(polygon[left])
        best = int(np.argmax(heights_m))
        if heights_m[best] < 0.0:
            raise ValueError("the polygon cannot be cut into parts; its edges nearly meet")
        triangles.append([left[best - 1], left[best], left[(best + 1) % len(left)]])
        del left[best]
    return [*triangles, left]


def _ears(ring: Polygon) -> NDArray[np.float64]:
    """Return the least height of the triangle of each corner that can be cut off, else -1.

    Such a corner is convex, and its triangle holds no other one. The best ear is not slim.
    """
    count = len(ring)
    a, b, c = np.roll(ring, 1, axis=0).T, ring.T, np.roll(ring, -1, axis=0).T
    turned = _turn(a, b, c)
    corners, others = (one[:, :, None] for one in (a, b, c)), ring.T[:, None, :]
    one, two, three = corners
    inside = np.minimum(_turn(one, two, others), _turn(two, three, others))
    apart = np.minimum(inside, _turn(three, one, others)) < 0.0
    numbers = np.arange(count)
    for shift in (-1, 0, 1):
        apart[numbers, (numbers + shift) % count] = True
    longest = np.maximum(np.hypot(*(b - a)), np.maximum(np.hypot(*(c - b)), np.hypot(*(a - c))))
    heights_m: NDArray[np.float64] = np.where((turned > 0.0) & apart.all(axis=1), turned, -1.0)
    return np.where(heights_m < 0.0, -1.0, heights_m / longest)


def _joined(polygon: Polygon, one: list[int], other: list[int]) -> list[int] | None:
    """Return two parts with a common edge as one, or None if that is not convex."""
    for i, corner in enumerate(one):
        following = one[(i + 1) % len(one)]
        if corner in other and following in other:
            j = other.index(following)
            if other[(j + 1) % len(other)] != corner:
                continue
            ahead = one[i + 1 :] + one[: i + 1]
            around = other[j + 1 :] + other[: j + 1]
            ring = [*ahead, *around[1:-1]]
            return ring if (_sines(polygon[ring]) > STRAIGHT).all() else None
    return None


def _outwards(start: Polygon, stop: Polygon) -> Polygon:
    """Return the outward normal of an edge of a counterclockwise polygon."""
    dx, dy = stop - start
    normal: Polygon = np.array([dy, -dx]) / np.hypot(dx, dy)
    return normal
