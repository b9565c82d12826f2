"""Reads GeoJSON (RFC 7946): features with their geometries, and their properties as tags."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple, NoReturn

from desim_uav.errors import in_short

MOST_DIGITS = 300
"""A whole number with more of them may be beyond the largest floating-point number."""

SIMPLE = "Point", "MultiPoint", "LineString", "MultiLineString", "Polygon", "MultiPolygon"
"""The types of geometries that have coordinates."""

COLLECTION = "GeometryCollection"
"""The type of a geometry that has others."""

WGS84 = re.compile(r"(?:.*[:/#])?(?:CRS84|4326)", re.IGNORECASE)
"""The names of the coordinate reference system of GeoJSON, in any authority's form."""


class Feature(NamedTuple):
    """The name of a feature in messages, its simple geometries, and its properties as texts."""

    name: str
    geometries: list[dict[str, Any]]
    tags: dict[str, str]


class GeoJson(NamedTuple):
    """The features of a file, and whose data they are."""

    features: list[Feature]
    attribution: str


def read(file: Path, content: bytes) -> GeoJson:
    """Return what a file has. Raises ValueError with the file and the feature."""
    data = _parsed(file, content)
    _require_wgs84(str(file), data)
    attribution = data.get("attribution") or data.get("copyright") or ""
    return GeoJson(list(_features(file, data)), attribution if isinstance(attribution, str) else "")


def _parsed(file: Path, content: bytes) -> dict[str, Any]:
    def refuse(name: str) -> NoReturn:
        raise ValueError(f"{file}: {name} is no number of JSON")

    def whole(text: str) -> int:
        if len(text) > MOST_DIGITS:
            raise ValueError(f"{file}: {in_short(text, 20)} is too large a number")
        return int(text)

    try:
        text = content.decode("utf-8-sig")
        data = json.loads(text, parse_constant=refuse, parse_int=whole)
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
        _require_wgs84(where, feature)
        geometry, tags = feature.get("geometry"), feature.get("properties") or {}
        if geometry is None:
            continue
        if not isinstance(tags, dict):
            raise ValueError(f"{where}: properties: must be an object")
        texts = {key: str(value) for key, value in tags.items() if value is not None}
        yield Feature(where, _simple(where, geometry), texts)


def _simple(where: str, geometry: Any) -> list[dict[str, Any]]:
    """Return a geometry, or those of a collection, which may hold collections."""
    left, simple = [geometry], []
    while left:
        one = left.pop()
        kind = one.get("type") if isinstance(one, dict) else None
        if kind != COLLECTION and kind not in SIMPLE:
            raise ValueError(
                f"{where}: geometry: type: {in_short(repr(kind))}: must be one of "
                f"{', '.join(SIMPLE)} and {COLLECTION}"
            )
        _require_wgs84(where, one)
        if kind != COLLECTION:
            simple.append(one)
            continue
        members = one.get("geometries")
        if not isinstance(members, list):
            raise ValueError(f"{where}: geometries: must be a list")
        left += reversed(members)
    return simple


def _require_wgs84(where: str, of: dict[str, Any]) -> None:
    """Raise ValueError if an object has a ``crs``, as GeoJSON once could, other than WGS 84."""
    crs = of.get("crs")
    if crs is None:
        return
    properties = crs.get("properties") if isinstance(crs, dict) else None
    name = properties.get("name") if isinstance(properties, dict) else None
    if not isinstance(name, str) or not WGS84.fullmatch(name):
        raise ValueError(
            f"{where}: crs: {in_short(crs if name is None else name)}: places must be longitudes "
            "and latitudes of WGS 84 (CRS84 or EPSG:4326); convert the file to it"
        )
