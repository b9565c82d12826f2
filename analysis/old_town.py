"""Write ``scenarios/old_town.geojson``: an invented town, whose data are of our own making.

``python analysis/old_town.py`` writes the file anew, byte for byte: row houses along ring streets
around a market place, blocks with courtyards, towers as parts of churches, and a wall.
"""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import numpy as np

from desim_uav.geodata.projection import Projection

FILE = Path(__file__).resolve().parents[1] / "scenarios" / "old_town.geojson"
SIDE_M = 600.0
ORIGIN = (-30.0, 40.0)
"""The south-western corner of the map, in the Atlantic Ocean, where no town is."""

RINGS_M = ((50, 82), (94, 126), (138, 172), (184, 220), (232, 270))
"""From where to where the houses of each ring stand, seen from the market place."""
STREETS = (4, 6, 8, 10, 12)
"""The number of streets that cross each ring."""
STREET_M, YARD_M = 8.0, 9.0
COURTS = ((1, 1), (1, 4), (2, 2), (2, 6), (3, 3), (3, 8))
"""The blocks, by ring and number, that are one house around a courtyard."""
CHURCHES = ((0, 2), (2, 4), (4, 7))
"""The blocks that are a church with a tower."""


def degrees(places: np.ndarray) -> list[list[float]]:
    """Return places in metres as longitudes and latitudes, by fixed-point iteration."""
    projection = Projection(*ORIGIN)
    per_degree = projection.places_m(np.array(ORIGIN)[None] + 1e-3)[0] / 1e-3
    found = np.tile(ORIGIN, (len(places), 1))
    for _ in range(20):
        found = found + (places - projection.places_m(found)) / per_degree
    return [[round(x, 7), round(y, 7)] for x, y in found.tolist()]


def arc(radius_m: float, begin: float, end: float, count: int) -> list[tuple[float, float]]:
    """Return places on an arc around the market place."""
    middle = SIDE_M / 2
    angles = np.linspace(begin, end, count + 1)
    return [(middle + radius_m * math.cos(a), middle + radius_m * math.sin(a)) for a in angles]


def ring(places: list[tuple[float, float]]) -> list[list[float]]:
    """Return the closed ring of a polygon."""
    closed = degrees(np.array(places))
    return [*closed, closed[0]]


def feature(rings: list[list[list[float]]], **tags: Any) -> dict[str, Any]:
    """Return a building."""
    geometry = {"type": "Polygon", "coordinates": rings}
    properties = {key.replace("_", ":"): value for key, value in tags.items()}
    return {"type": "Feature", "properties": properties, "geometry": geometry}


def sector(inner: float, outer: float, begin: float, end: float) -> list[tuple[float, float]]:
    """Return a part of a ring, counterclockwise."""
    return [*arc(outer, begin, end, 3), *reversed(arc(inner, begin, end, 3))]


def church(inner: float, outer: float, begin: float, end: float, tall: int) -> list[dict[str, Any]]:
    """Return a church whose parts, a nave and a tower, take the place of its outline."""
    cut = begin + 0.3 * (end - begin)
    return [
        feature([ring(sector(inner, outer, begin, end))], building="church", height=f"{tall} m"),
        feature([ring(sector(inner, outer, begin, cut))], building_part="yes", height=f"{tall} m"),
        feature([ring(sector(inner, outer, cut, end))], building_part="yes", height="17"),
    ]


def houses(
    inner: float, outer: float, begin: float, end: float, rng: np.random.Generator
) -> list[dict[str, Any]]:
    """Return houses side by side, some of them with an empty lot or a yard behind."""
    count = max(2, round((end - begin) * 0.5 * (inner + outer) / 17.0))
    edges = np.linspace(begin, end, count + 1)
    built = []
    for one, other in zip(edges[:-1].tolist(), edges[1:].tolist(), strict=True):
        if rng.random() < 0.06:
            continue
        yard = rng.random() < 0.4
        places = [*arc(outer, one, other, 1), *reversed(arc(inner, one, other, 1))]
        if yard:  # an L: the half towards the market place is missing on one side
            half = 0.5 * (one + other)
            deep = inner + YARD_M
            places = [*arc(outer, one, other, 1), *reversed(arc(deep, half, other, 1))]
            places += reversed(arc(inner, one, half, 1))
        levels = int(rng.integers(2, 6))
        built.append(feature([ring(places)], building="house", building_levels=levels))
    return built


def town() -> dict[str, Any]:
    """Return the town."""
    rng = np.random.default_rng(1410)
    features: list[dict[str, Any]] = []
    for number, ((inner, outer), streets) in enumerate(zip(RINGS_M, STREETS, strict=True)):
        gap = STREET_M / (0.5 * (inner + outer))
        turn = 0.35 * number
        for block in range(streets):
            begin = turn + 2 * math.pi * block / streets + 0.5 * gap
            end = turn + 2 * math.pi * (block + 1) / streets - 0.5 * gap
            if (number, block) in CHURCHES:
                tall = int(rng.integers(38, 56))
                features += church(inner, outer, begin, end, tall)
            elif (number, block) in COURTS:
                hole = YARD_M / (0.5 * (inner + outer))
                court = ring(sector(inner + YARD_M, outer - YARD_M, begin + hole, end - hole))
                outline = ring(sector(inner, outer, begin, end))
                height = round(float(rng.uniform(16, 26)), 1)
                features.append(feature([outline, court], building="apartments", height=height))
            else:
                features += houses(inner, outer, begin, end, rng)
    for number, one in enumerate(features):
        one["id"] = number
    return {
        "type": "FeatureCollection",
        "attribution": "an invented town, made by analysis/old_town.py of desim-uav",
        "features": features,
    }


def main() -> None:
    """Write the file."""
    content = town()
    lines = ",\n".join(json.dumps(one, separators=(",", ":")) for one in content.pop("features"))
    head = json.dumps(content)[:-1]
    FILE.write_text(f'{head}, "features": [\n{lines}\n]}}\n', encoding="utf-8")
    print(f"{FILE.name}: {lines.count(chr(10)) + 1} features")


if __name__ == "__main__":
    main()
