"""Simple polygons: checked, cut into convex parts, and grown by a margin.

A polygon is an array of corners (corners, 2) in metres. It may be non-convex, but its edges must
not meet except at the corners between neighbours.
"""

from __future__ import annotations

from itertools import combinations, pairwise
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
    for i, j in combinations(range(len(polygon)), 2):
        if np.hypot(*(polygon[i] - polygon[j])) < NEAREST_M:
            raise ValueError(
                f"corners {i} and {j} are one place, {_words(polygon[i])}; a polygon is closed by "
                f"itself, and its edges must not meet"
            )
    for i, j in combinations(range(len(polygon)), 2):
        if _meet(polygon, i, j):
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
    parts = _triangles(polygon)
    joined = True
    while joined:
        joined = False
        for one, other in combinations(range(len(parts)), 2):
            ring = _joined(polygon, parts[one], parts[other])
            if ring is not None:
                parts[one] = ring
                del parts[other]
                joined = True
                break
    return [polygon[part] for part in parts]


def grown(convex: Polygon, margin_m: float) -> Polygon:
    """Return a convex polygon that contains all places within a margin of another one.

    Edges are moved outwards. Corners of at most 90 degrees of turn are mitred; sharper ones are
    cut at the margin, too, so that no place is farther than sqrt(2) margins from the polygon.
    """
    found = []
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
            found.append(corner + (one + other) * (margin_m / (1.0 + one @ other)))
    return np.array(found)


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


def _meet(polygon: Polygon, i: int, j: int) -> bool:
    """Return whether two edges meet elsewhere than at a corner between neighbours."""
    count = len(polygon)
    a, b, c, d = (polygon[k % count] for k in (i, i + 1, j, j + 1))
    if (i + 1) % count == j or (j + 1) % count == i:
        before, corner, after = (a, b, d) if (i + 1) % count == j else (c, d, b)
        turned = _turn(before, corner, after)
        one, other = corner - before, after - corner
        far = STRAIGHT * float(np.hypot(*one) * np.hypot(*other))
        return bool(abs(turned) <= far and one @ other < 0.0)
    sides = _turn(a, b, c), _turn(a, b, d), _turn(c, d, a), _turn(c, d, b)
    if sides[0] * sides[1] < 0.0 and sides[2] * sides[3] < 0.0:
        return True
    touches = (a, b, c), (a, b, d), (c, d, a), (c, d, b)
    return any(
        side == 0.0 and _is_between(*three) for side, three in zip(sides, touches, strict=True)
    )


def _is_between(a: Polygon, b: Polygon, c: Polygon) -> bool:
    """Return whether a place on the line of an edge is on the edge."""
    return bool((np.minimum(a, b) <= c).all() and (c <= np.maximum(a, b)).all())


def _triangles(polygon: Polygon) -> list[list[int]]:
    """Return the triangles that ears leave, as numbers of corners."""
    left, found = list(range(len(polygon))), []
    while len(left) > 3:
        ears = [k for k in range(len(left)) if _is_ear(polygon, left, k)]
        if not ears:
            raise ValueError("the polygon cannot be cut into parts; its edges nearly meet")
        best = max(ears, key=lambda k: _slimness(polygon, left, k))
        found.append([left[best - 1], left[best], left[(best + 1) % len(left)]])
        del left[best]
    return [*found, left]


def _is_ear(polygon: Polygon, left: list[int], k: int) -> bool:
    """Return whether a corner can be cut off: it is convex, and its triangle holds no other one."""
    three = left[k - 1], left[k], left[(k + 1) % len(left)]
    a, b, c = polygon[list(three)]
    if not _turn(a, b, c) > 0.0:
        return False
    others = polygon[[other for other in left if other not in three]].T
    inside = np.minimum(_turn(a, b, others), _turn(b, c, others))
    return bool((np.minimum(inside, _turn(c, a, others)) < 0.0).all())


def _slimness(polygon: Polygon, left: list[int], k: int) -> float:
    """Return the least height of the triangle of an ear, in metres: the best ear is not slim."""
    a, b, c = polygon[[left[k - 1], left[k], left[(k + 1) % len(left)]]]
    longest = max(np.hypot(*(b - a)), np.hypot(*(c - b)), np.hypot(*(a - c)))
    return float(_turn(a, b, c) / longest)


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
