"""Makes convex prisms of the buildings of an extract: projected, mended, cut off, cut up."""

from __future__ import annotations

from collections.abc import Iterator
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray

from desim_uav.city.extract import Element, Extract, Group, read_extract
from desim_uav.city.heights import Heights
from desim_uav.geodata.projection import Projection
from desim_uav.model.geometry.city import City
from desim_uav.model.geometry.polygons import Polygon, area, joined
from desim_uav.model.traces import Version, version_of

GRID_M = 0.001
"""Corners are rounded to multiples of this, so that neighbours that share a wall share corners."""

LEAST_M2 = 0.01
"""A polygon with less area, as what the edge of the map leaves of a building, is left out."""

MOST_PIECES = 50_000
"""The most convex pieces on a map."""

PARTS_COVER = 0.9
"""The share of an outline below which its parts are said not to cover it."""


def read_city(
    file: Path,
    size_m: tuple[float, float],
    origin: tuple[float, float] | None,
    height_m: float,
) -> City:
    """Return the city of a file on a map of this size (see ``Extract.projection``).

    ``height_m`` is the height of buildings of which the file says nothing. Raises ValueError with
    the file and the element.
    """
    return _city(file, size_m, origin, height_m, version_of(file))


@lru_cache(maxsize=8)
def _city(
    file: Path,
    size_m: tuple[float, float],
    origin: tuple[float, float] | None,
    height_m: float,
    version: Version,
) -> City:
    extract = read_extract(file)
    try:
        return city_of(extract, size_m, extract.projection(size_m, origin), height_m)
    except MapError as error:
        raise ValueError(f"{file}: {error}") from error


class MapError(ValueError):
    """A problem of all buildings, and not of one of them."""


def city_of(
    extract: Extract, size_m: tuple[float, float], projection: Projection, height_m: float
) -> City:
    """Return the buildings of an extract on a map. Raises ValueError with the element."""
    shapes, mended = _shapes(extract.elements, projection)
    kept, uncovered = _without_outlines(extract.elements, shapes)
    flat = int((shapely.area(shapes[kept]) < LEAST_M2).sum())
    heights, pieces, roofs = Heights(height_m), list[Polygon](), list[float]()
    the_map = shapely.box(0.0, 0.0, *size_m)
    on_map = shapely.intersection(shapes[kept], the_map)
    count = 0
    for number, shape in zip(kept.tolist(), on_map, strict=True):
        element, own = extract.elements[number], []
        for polygon in _polygons(shape):
            own += convex_pieces(polygon, element.name)
        if own:
            count += 1
            pieces += own
            roofs += [heights.of(element.name, element.tags)] * len(own)
        if len(pieces) > MOST_PIECES:
            raise MapError(
                f"the buildings on the map have more than {MOST_PIECES:,} convex pieces; take a "
                "smaller map"
            )
    if not count:
        raise MapError(
            f"none of {len(shapes)} buildings is on the map of {size_m[0]:g} x "
            f"{size_m[1]:g} m (map.size_m, map.buildings.origin)"
        )
    notices = [*extract.notices, *uncovered, *heights.notices()]
    if mended:
        notices.append(f"{mended} outlines that meet themselves are mended")
    if flat:
        notices.append(f"{flat} of {len(kept)} outlines enclose no area and are left out")
    if count + flat < len(kept):
        notices.append(f"{len(kept) - count - flat} of {len(kept)} buildings are off the map")
    return City(tuple(pieces), np.array(roofs), extract.attribution, tuple(notices))


def _shapes(elements: list[Element], projection: Projection) -> tuple[NDArray[Any], int]:
    """Return the shape of each element in metres, and how many outlines were mended."""
    mended = 0
    shapes = np.empty(len(elements), object)
    for number, element in enumerate(elements):
        parts = []
        for group in element.groups:
            shape, invalid = _shape(group, projection)
            mended += invalid
            parts.append(shape)
        shape = parts[0] if len(parts) == 1 else shapely.union_all(parts)
        shapes[number] = shapely.set_precision(shape, GRID_M)
    return shapes, mended


def _shape(group: Group, projection: Projection) -> tuple[Any, int]:
    """Return outer rings without what is in inner ones, and how many met themselves."""
    outer, inner = (
        [shapely.Polygon(projection.places_m(ring)) for ring in rings] for rings in group
    )
    invalid = sum(not polygon.is_valid for polygon in (*outer, *inner))
    if invalid:
        outer, inner = ([shapely.make_valid(one) for one in of] for of in (outer, inner))
    shape = outer[0] if len(outer) == 1 else shapely.union_all(outer)
    return (shapely.difference(shape, shapely.union_all(inner)) if inner else shape), invalid


def _without_outlines(
    elements: list[Element], shapes: NDArray[Any]
) -> tuple[NDArray[np.int64], list[str]]:
    """Return the numbers of the elements without outlines in which there are parts, and notices."""
    is_part = np.array([one.is_part for one in elements], bool)
    parts, outlines = np.flatnonzero(is_part), np.flatnonzero(~is_part)
    if not len(parts):
        return outlines, []
    tree = shapely.STRtree(shapes[outlines])
    of, within = tree.query(shapely.point_on_surface(shapes[parts]), predicate="within")
    covered: dict[int, list[int]] = {}
    for part, outline in zip(parts[of].tolist(), outlines[within].tolist(), strict=True):
        covered.setdefault(outline, []).append(part)
    short = [
        outline
        for outline, own in covered.items()
        if shapely.union_all(shapes[own]).area < PARTS_COVER * shapes[outline].area
    ]
    notices = []
    if short:
        notices.append(
            f"the parts of {len(short)} buildings cover less than {PARTS_COVER:.0%} of the outline "
            f"that they replace, first {elements[short[0]].name}"
        )
    kept = np.array(sorted({*parts.tolist(), *outlines.tolist()} - set(covered)), np.int64)
    return kept, notices


def _polygons(shape: Any) -> Iterator[Any]:
    """Yield the polygons of a shape that have an area, without corners on straight walls."""
    for part in shapely.get_parts(shapely.simplify(shape, 0.0)):
        if part.geom_type == "Polygon" and part.area >= LEAST_M2:
            yield shapely.orient_polygons(part)


def convex_pieces(polygon: Any, name: str) -> list[Polygon]:
    """Return convex pieces of a polygon, which may have holes; they share no area and cover it.

    The polygon is cut into triangles between its corners (a constrained Delaunay triangulation), of
    which neighbours are joined where that is convex. Raises ValueError, which begins with ``name``,
    if the pieces do not have the polygon's area.
    """
    triangles = [
        np.array(triangle.exterior.coords)[:3]
        for triangle in shapely.constrained_delaunay_triangles(polygon).geoms
    ]
    numbers: dict[tuple[float, ...], int] = {}
    parts = []
    for triangle in triangles:
        corners = triangle if area(triangle) > 0.0 else triangle[::-1]
        parts.append([numbers.setdefault(tuple(one), len(numbers)) for one in corners.tolist()])
    pieces = joined(np.array(list(numbers)), parts)
    if abs(sum(map(area, pieces)) - polygon.area) > 1e-6 * polygon.area:
        raise ValueError(f"{name}: its outline cannot be cut into convex pieces")
    return pieces


def cell_heights(
    city: City, cells: tuple[int, int], cell_m: tuple[float, float], blocked_share: float
) -> NDArray[np.float64]:
    """Return up to which height each cell (nx, ny) is blocked for flight.

    That is the roof of the tallest building on the lines between the middles of opposite sides, on
    which drones fly, or, if that is more, the greatest height at which more than ``blocked_share``
    of the cell is built.
    """
    height_m = np.zeros(cells)
    pieces = np.array([shapely.Polygon(one) for one in city.pieces_m], object)
    tree, (dx, dy) = shapely.STRtree(pieces), cell_m
    south = np.arange(cells[1]) * dy
    for ix in range(cells[0] if len(city) else 0):
        west, east = ix * dx, (ix + 1) * dx
        level = shapely.linestrings([[(west, y + 0.5 * dy), (east, y + 0.5 * dy)] for y in south])
        middle = 0.5 * (west + east)
        upright = shapely.linestrings([[(middle, y), (middle, y + dy)] for y in south])
        for ways in (level, upright):
            cell, piece = tree.query(ways, predicate="intersects")
            np.maximum.at(height_m[ix], cell, city.roofs_m[piece])
        boxes = shapely.box(west, south, east, south + dy)
        cell, piece = tree.query(boxes, predicate="intersects")
        shares = shapely.area(shapely.intersection(boxes[cell], pieces[piece])) / (dx * dy)
        by_area = _by_area(cells[1], cell, city.roofs_m[piece], shares, blocked_share)
        height_m[ix] = np.maximum(height_m[ix], by_area)
    return height_m


def _by_area(
    count: int,
    cell: NDArray[np.int64],
    roofs_m: NDArray[np.float64],
    shares: NDArray[np.float64],
    blocked_share: float,
) -> NDArray[np.float64]:
    """Return the greatest height at which more than a share of each cell is built."""
    height_m, built = np.zeros(count), np.zeros(count)
    for k in np.argsort(-roofs_m, kind="stable").tolist():
        built[cell[k]] += shares[k]
        if built[cell[k]] > blocked_share and height_m[cell[k]] == 0.0:
            height_m[cell[k]] = roofs_m[k]
    return height_m
