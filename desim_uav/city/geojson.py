"""Reads buildings from GeoJSON (RFC 7946): polygons and multipolygons with properties as tags."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, NoReturn

from desim_uav.city.extract import Element, Extract, Group, ring_of

BUILDING, PART = "building", "building:part"


def read(file: Path, content: bytes) -> Extract:
    """Return the buildings of a GeoJSON file. Raises ValueError with the file and the feature.

    If a feature has a tag ``building`` or ``building:part``, those that have one are the buildings;
    otherwise all polygons are.
    """
    data = _parsed(file, content)
    features = list(_features(file, data))
    polygons = [one for one in features if one[1]["type"] in ("Polygon", "MultiPolygon")]
    tagged = any(_is(tags, BUILDING) or _is(tags, PART) for _, _, tags in polygons)
    elements = [
        Element(name, list(_groups(name, geometry)), tags, _is(tags, PART))
        for name, geometry, tags in polygons
        if not tagged or _is(tags, BUILDING) or _is(tags, PART)
    ]
    attribution = data.get("attribution") or data.get("copyright") or ""
    others = len(features) - len(elements)
    notices = (f"{file}: {others} features are no buildings and left out",) if others else ()
    return Extract(elements, attribution if isinstance(attribution, str) else "", notices)


def _parsed(file: Path, content: bytes) -> dict[str, Any]:
    def refuse(name: str) -> NoReturn:
        raise ValueError(f"{file}: {name} is no number of JSON")

    try:
        data = json.loads(content.decode("utf-8-sig"), parse_constant=refuse)
    except UnicodeDecodeError as error:
        raise ValueError(f"{file}: it is not UTF-8 text") from error
    except json.JSONDecodeError as error:
        where = f"{file}:{error.lineno}:{error.colno}"
        raise ValueError(f"{where}: it is not JSON: {error.msg}") from error
    except RecursionError as error:
        raise ValueError(f"{file}: its lists are nested too deeply") from error
    if not isinstance(data, dict):
        raise ValueError(f"{file}: it is no GeoJSON, which is an object with a type")
    return data


Feature = tuple[str, dict[str, Any], dict[str, str]]
"""The name of a feature in messages, its geometry, and its tags."""


def _features(file: Path, data: dict[str, Any]) -> Iterator[Feature]:
    kind = data.get("type")
    if kind not in ("FeatureCollection", "Feature"):
        raise ValueError(f"{file}: type: {kind!r}: must be FeatureCollection or Feature")
    features = data.get("features") if kind == "FeatureCollection" else [data]
    if not isinstance(features, list):
        raise ValueError(f"{file}: features: must be a list")
    for number, feature in enumerate(features):
        where = f"{file}: feature {number}"
        if not isinstance(feature, dict):
            raise ValueError(f"{where}: must be an object")
        if "id" in feature:
            where += f" ({str(feature['id'])[:60]})"
        geometry, tags = feature.get("geometry"), feature.get("properties") or {}
        if geometry is None:
            continue
        if not isinstance(geometry, dict) or not isinstance(geometry.get("type"), str):
            raise ValueError(f"{where}: geometry: must be an object with a type")
        if not isinstance(tags, dict):
            raise ValueError(f"{where}: properties: must be an object")
        texts = {key: str(value) for key, value in tags.items() if value is not None}
        yield where, geometry, texts


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
