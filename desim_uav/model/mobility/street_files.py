"""Reads streets from a network of SUMO, from OpenStreetMap XML, or from GeoJSON."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from desim_uav.geodata import geojson, osm
from desim_uav.geodata.projection import Projection
from desim_uav.model.mobility.street_graph import Point, StreetWay
from desim_uav.model.mobility.sumo_net import read_net
from desim_uav.model.traces import Version, bytes_of, version_of

NOT_ON_FOOT = {
    *("motorway", "motorway_link", "trunk", "trunk_link", "raceway", "bus_guideway", "busway"),
    *("construction", "proposed", "abandoned", "razed", "escape", "no"),
}
"""Values of OpenStreetMap's tag highway along which nobody walks."""

FOR_CARS = {
    *("motorway", "motorway_link", "trunk", "trunk_link", "primary", "primary_link", "secondary"),
    *("secondary_link", "tertiary", "tertiary_link", "unclassified", "residential", "service"),
    *("living_street", "road"),
}
"""Values of OpenStreetMap's tag highway along which cars drive."""

CLOSED = {"no", "private", "customers", "permit"}
"""Values of tags of access with which a street is left out."""


def ways_of(
    file: Path, driving: bool, offset_m: Point, origin: Point | None
) -> tuple[list[StreetWay], str]:
    """Return the ways of a file for cars or for pedestrians, in metres on the map, and whose data.

    ``origin`` is the longitude and latitude of the map's south-western corner, in degrees.
    Raises ValueError with the file and, if one is at fault, the line or feature.
    """
    dx, dy = offset_m
    ways, attribution = _ways(file, driving, origin, version_of(file))
    return [
        StreetWay(tuple((x + dx, y + dy) for x, y in way.points), way.one_way) for way in ways
    ], attribution


@lru_cache(maxsize=4)
def _ways(
    file: Path, driving: bool, origin: Point | None, version: Version
) -> tuple[list[StreetWay], str]:
    """Return the ways of a file at this version, and whose data they are."""
    content = bytes_of(file)
    start = content.removeprefix(b"\xef\xbb\xbf").lstrip()
    if start.startswith(b"<") and b"<osm" not in start[:2000]:
        net = read_net(file, driving)
        if origin is not None:
            raise ValueError(f"{file}: origin: a network of SUMO is in metres; it has no origin")
        return net, ""
    if start.startswith(b"<"):
        lines, attribution = list(_of_osm(file, content)), osm.LICENCE
    else:
        features, attribution = geojson.read(file, content)
        lines = list(_of_geojson(features))
    if origin is None:
        raise ValueError(
            f"{file}: its places are longitudes and latitudes; write origin: [longitude, "
            "latitude], the south-western corner of the map"
        )
    return list(_open_to(lines, driving, Projection(*origin))), attribution


Line = tuple[list[Point], Mapping[str, str]]
"""Longitudes and latitudes of a line, and its tags."""


def _of_osm(file: Path, content: bytes) -> Iterator[Line]:
    """Yield the ways of OpenStreetMap that are streets, as far as the file has their nodes."""
    read = osm.read(file, content)
    for way in read.ways.values():
        if "highway" not in way.tags or way.tags.get("area") == "yes":
            continue
        part: list[Point] = []
        for node in way.nodes:
            if node in read.nodes:
                part.append(read.nodes[node])
                continue
            yield part, way.tags
            part = []
        yield part, way.tags


def _of_geojson(features: Iterable[geojson.Feature]) -> Iterator[Line]:
    """Yield the lines of GeoJSON; one without a tag ``highway`` is open to all."""
    for name, geometry, tags in ((f.name, one, f.tags) for f in features for one in f.geometries):
        places = geometry.get("coordinates")
        if geometry["type"] == "LineString":
            yield _line(name, places), tags
        elif geometry["type"] == "MultiLineString":
            if not isinstance(places, list):
                raise ValueError(f"{name}: coordinates: must be a list of lines")
            for line in places:
                yield _line(name, line), tags


def _line(name: str, places: Any) -> list[Point]:
    try:
        line = np.array([place[:2] for place in places], np.float64)
    except (TypeError, ValueError, OverflowError):
        line = np.zeros(0)
    if line.ndim != 2 or line.shape[1] != 2 or not np.isfinite(line).all():
        raise ValueError(f"{name}: a line is a list of places [longitude, latitude]")
    if (np.abs(line) > (180.0, 90.0)).any():
        raise ValueError(f"{name}: its places are no longitudes and latitudes in degrees")
    return [(x, y) for x, y in line.tolist()]


def _open_to(lines: Iterable[Line], driving: bool, projection: Projection) -> Iterator[StreetWay]:
    """Yield the lines that cars or pedestrians may use, in metres."""
    for degrees, tags in lines:
        if len(degrees) < 2 or not (_for_cars(tags) if driving else _on_foot(tags)):
            continue
        places = projection.places_m(np.array(degrees))
        points = tuple((x, y) for x, y in places.tolist())
        direction = _direction(tags) if driving else 0
        yield StreetWay(points[::-1] if direction < 0 else points, direction != 0)


def _on_foot(tags: Mapping[str, str]) -> bool:
    foot = tags.get("foot")
    if foot is not None:
        return foot not in CLOSED
    return tags.get("highway") not in NOT_ON_FOOT and tags.get("access") not in CLOSED


def _for_cars(tags: Mapping[str, str]) -> bool:
    if "highway" in tags and tags["highway"] not in FOR_CARS:
        return False
    allowed = [tags[name] for name in ("motor_vehicle", "vehicle", "access") if name in tags]
    return not allowed or allowed[0] not in CLOSED


def _direction(tags: Mapping[str, str]) -> int:
    """Return whether cars may drive forwards only (1), backwards only (-1), or both (0)."""
    one_way = tags.get("oneway", "")
    if one_way.lower() in ("yes", "true", "1"):
        return 1
    if one_way in ("-1", "reverse"):
        return -1
    implied = tags.get("highway") == "motorway" or tags.get("junction") == "roundabout"
    return int(implied and one_way.lower() not in ("no", "false", "0"))
