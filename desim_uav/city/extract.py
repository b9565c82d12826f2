"""What an extract of a map says of buildings, whatever the format of its file."""

from __future__ import annotations

from collections.abc import Mapping
from functools import lru_cache
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from desim_uav.geodata.projection import Projection
from desim_uav.model.traces import Version, bytes_of, version_of

MOST_BYTES = 96 * 2**20
"""The largest file that is read: about 1.5 million nodes of OpenStreetMap."""

MOST_BUILDINGS = 50_000
"""The most buildings of a file."""

MOST_DEGREES = 1.0
"""No building spans more degrees of longitude or latitude."""

Ring = NDArray[np.float64]
"""Longitudes and latitudes (places, 2) of a closed line, whose first place is not repeated."""

Group = tuple[list[Ring], list[Ring]]
"""Outer rings, and inner ones that are cut out of them."""


class Element(NamedTuple):
    """A building, or a part of one, with its name in the file and its tags."""

    name: str
    groups: list[Group]
    tags: Mapping[str, str]
    is_part: bool


class Extract(NamedTuple):
    """The buildings of a file, and whose data they are."""

    elements: list[Element]
    attribution: str
    notices: tuple[str, ...] = ()

    def projection(
        self, size_m: tuple[float, float], origin: tuple[float, float] | None
    ) -> Projection:
        """Return the projection to a map of this size.

        It is about ``origin`` (longitude, latitude), which is the map's south-western corner, or
        about the middle of all buildings, which is the middle of the map.
        """
        if origin is not None:
            return Projection(*origin)
        rings = [ring for one in self.elements for outer, _ in one.groups for ring in outer]
        places = np.concatenate(rings)
        low, high = places.min(axis=0).tolist(), places.max(axis=0).tolist()
        middle = 0.5 * (low[0] + high[0]), 0.5 * (low[1] + high[1])
        return Projection(*middle, 0.5 * size_m[0], 0.5 * size_m[1])


def read_extract(file: Path) -> Extract:
    """Return the buildings of a GeoJSON file or of OpenStreetMap XML.

    Raises ValueError with the file and the element.
    """
    return _read(file, version_of(file))


@lru_cache(maxsize=4)
def _read(file: Path, version: Version) -> Extract:
    from desim_uav.city import geojson, osm

    content = bytes_of(file)
    if len(content) > MOST_BYTES:
        raise ValueError(
            f"{file}: {len(content) / 2**20:.0f} MiB; at most {MOST_BYTES >> 20} MiB, so cut a "
            "smaller extract"
        )
    text = content.removeprefix(b"\xef\xbb\xbf").lstrip()
    reader = osm if text.startswith(b"<") else geojson
    extract = _above_ground(file, reader.read(file, content))
    if not extract.elements:
        raise ValueError(f"{file}: it has no buildings above the ground")
    if len(extract.elements) > MOST_BUILDINGS:
        raise ValueError(
            f"{file}: {len(extract.elements):,} buildings; at most {MOST_BUILDINGS:,}, so cut a "
            "smaller extract"
        )
    return extract


def _above_ground(file: Path, extract: Extract) -> Extract:
    """Return an extract without buildings that have the tag ``location=underground``."""
    above, under = list[Element](), list[Element]()
    for one in extract.elements:
        (under if one.tags.get("location") == "underground" else above).append(one)
    if not under:
        return extract
    words = f"{file}: {len(under)} buildings with location=underground are left out, first "
    notice = words + under[0].name.removeprefix(f"{file}: ")
    return extract._replace(elements=above, notices=(*extract.notices, notice))


def ring_of(where: str, places: object) -> Ring:
    """Return a ring of longitudes and latitudes, without its last place, which is its first.

    Raises ValueError, which begins with ``where``.
    """
    try:
        ring = np.array(places, np.float64)
    except (TypeError, ValueError, OverflowError):
        ring = np.zeros(0)
    if ring.ndim != 2 or ring.shape[1] < 2 or not np.isfinite(ring).all():
        raise ValueError(f"{where}: a ring is a list of places [longitude, latitude]")
    ring = ring[:, :2]
    if len(ring) < 4 or (ring[0] != ring[-1]).any():
        raise ValueError(
            f"{where}: a ring has at least 4 places, of which the last one is the first"
        )
    if (np.abs(ring) > (180.0, 90.0)).any():
        x, y = ring[(np.abs(ring) > (180.0, 90.0)).any(axis=1)][0].tolist()
        raise ValueError(f"{where}: ({x:g}, {y:g}) is no longitude and latitude in degrees")
    if np.ptp(ring, axis=0).max() > MOST_DEGREES:
        raise ValueError(
            f"{where}: it spans more than {MOST_DEGREES:g} degree; does it cross 180 degrees of "
            "longitude?"
        )
    return ring[:-1]
