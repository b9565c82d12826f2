"""Buildings of OpenStreetMap XML: closed ways, and multipolygon relations."""

from __future__ import annotations

from pathlib import Path

from desim_uav.city.extract import Element, Extract, Group, ring_of
from desim_uav.errors import in_short
from desim_uav.geodata import osm
from desim_uav.geodata.osm import LICENCE, OsmFile, Relation, Tags, Way

BUILDING, PART = "building", "building:part"


def read(file: Path, content: bytes) -> Extract:
    """Return the buildings of an extract. Raises ValueError with the file and the element."""
    return _Gatherer(file, osm.read(file, content)).extract()


class _Gatherer:
    """Makes buildings of what a file has."""

    def __init__(self, file: Path, read: OsmFile) -> None:
        self.file, self.nodes = file, read.nodes
        self.ways, self.relations = read.ways, read.relations
        self.open: list[str] = []

    def extract(self) -> Extract:
        """Return the buildings: those of relations, and ways that are not outlines of these."""
        areas = {
            name: one
            for name, one in self.relations.items()
            if one.tags.get("type") == "multipolygon" and _built(one.tags)
        }
        outlines = {
            ref for one in areas.values() for ref, role in one.members if role in ("outer", "")
        }
        elements = [self._of_relation(name, one) for name, one in areas.items()]
        elements += [
            self._of_way(name, way)
            for name, way in self.ways.items()
            if _built(way.tags) and name not in outlines
        ]
        notices: tuple[str, ...] = ()
        if self.open:
            notices = (
                f"{self.file}: {len(self.open)} buildings whose outlines are not closed in the "
                f"extract are left out, first {self.open[0]}",
            )
        return Extract([one for one in elements if one is not None], LICENCE, notices)

    def _of_way(self, name: str, way: Way) -> Element | None:
        where = f"{self.file}: way {in_short(name)}"
        if len(way.nodes) < 4 or way.nodes[0] != way.nodes[-1]:
            self.open.append(f"way {in_short(name)}")
            return None
        return self._element(where, ([way.nodes], []), way.tags)

    def _of_relation(self, name: str, relation: Relation) -> Element | None:
        where = f"{self.file}: relation {in_short(name)}"
        lines: tuple[list[list[str]], list[list[str]]] = ([], [])
        for ref, role in relation.members:
            if role in ("outer", "inner", "") and ref in self.ways:
                lines[role == "inner"].append(self.ways[ref].nodes)
            elif role in ("outer", "inner", ""):
                self.open.append(f"relation {in_short(name)}")
                return None
        rings = [rings_of(one) for one in lines]
        if rings[0] is None or rings[1] is None or not rings[0]:
            self.open.append(f"relation {in_short(name)}")
            return None
        return self._element(where, (rings[0], rings[1]), relation.tags)

    def _element(
        self, where: str, rings: tuple[list[list[str]], list[list[str]]], tags: Tags
    ) -> Element:
        group: Group = ([], [])
        for of, own in zip(group, rings, strict=True):
            for nodes in own:
                missing = next((node for node in nodes if node not in self.nodes), None)
                if missing is not None:
                    raise ValueError(f"{where}: node {in_short(missing)} is not in the file")
                of.append(ring_of(where, [self.nodes[node] for node in nodes]))
        return Element(where, [group], tags, tags.get(BUILDING, "no") == "no")


def _built(tags: Tags) -> bool:
    return tags.get(BUILDING, "no") != "no" or tags.get(PART, "no") != "no"


def rings_of(lines: list[list[str]]) -> list[list[str]] | None:
    """Return the closed rings that lines of nodes make up, or None if some do not close."""
    left, rings = [line for line in lines if len(line) > 1], []
    while left:
        ring = left.pop()
        while ring[0] != ring[-1]:
            k = next((k for k, line in enumerate(left) if ring[-1] in (line[0], line[-1])), None)
            if k is None:
                return None
            line = left.pop(k)
            ring = ring + (line[1:] if line[0] == ring[-1] else line[-2::-1])
        rings.append(ring)
    return rings if all(len(ring) > 3 for ring in rings) else None
