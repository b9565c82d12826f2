"""Buildings of GeoJSON: polygons and multipolygons with properties as tags."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from desim_uav.city.extract import Element, Extract, Group, ring_of
from desim_uav.geodata import geojson

BUILDING, PART = "building", "building:part"


def read(file: Path, content: bytes) -> Extract:
    """Return the buildings of a GeoJSON file. Raises ValueError with the file and the feature.

    If a feature has a tag ``building`` or ``building:part``, those that have one are the buildings;
    otherwise all polygons are.
    """
    features, attribution = geojson.read(file, content)
    polygons = [
        (name, own, tags)
        for name, geometries, tags in features
        if (own := [one for one in geometries if one["type"] in ("Polygon", "MultiPolygon")])
    ]
    tagged = any(_is(tags, BUILDING) or _is(tags, PART) for _, _, tags in polygons)
    elements = [
        Element(name, [group for one in own for group in _groups(name, one)], tags, _is(tags, PART))
        for name, own, tags in polygons
        if not tagged or _is(tags, BUILDING) or _is(tags, PART)
    ]
    others = len(features) - len(elements)
    notices = (f"{file}: {others} features are no buildings and left out",) if others else ()
    return Extract(elements, attribution, notices)


def _is(tags: Mapping[str, str], name: str) -> bool:
    return tags.get(name, "no") != "no"


def _groups(where: str, geometry: dict[str, Any]) -> Iterator[Group]:
    coordinates = geometry.get("coordinates")
    polygons = [coordinates] if geometry["type"] == "Polygon" else coordinates
    if not isinstance(polygons, list) or not polygons:
        raise ValueError(f"{where}: coordinates: must be a list of rings")
    for polygon in polygons:
        if not isinstance(polygon, list) or not polygon:
            raise ValueError(f"{where}: coordinates: must be a list of rings")
        outer, *inner = (ring_of(where, ring) for ring in polygon)
        yield [outer], inner
