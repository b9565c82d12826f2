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
        self.filled: list[str] = []

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
        notices = []
        if self.open:
            notices.append(
                f"{self.file}: {len(self.open)} buildings whose outlines are not closed in the "
                f"extract are left out, first {self.open[0]}"
            )
        if self.filled:
            notices.append(
                f"{self.file}: {len(self.filled)} buildings have courtyards whose outlines are not "
                f"closed in the extract and are built over, first {self.filled[0]}"
            )
        return Extract([one for one in elements if one is not None], LICENCE, tuple(notices))

    def _of_way(self, name: str, way: Way) -> Element | None:
        where = f"{self.file}: way {in_short(name)}"
        if len(way.nodes) < 4 or way.nodes[0] != way.nodes[-1]:
            self.open.append(f"way {in_short(name)}")
            return None
        return self._element(where, ([way.nodes], []), way.tags)

    def _of_relation(self, name: str, relation: Relation) -> Element | None:
        where = f"{self.file}: relation {in_short(name)}"
        outer, all_outer = self._rings_of(relation, ("outer", ""))
        if not outer or not all_outer:
            self.open.append(f"relation {in_short(name)}")
            return None
        inner, all_inner = self._rings_of(relation, ("inner",))
        if not all_inner:
            self.filled.append(f"relation {in_short(name)}")
        return self._element(where, (outer, inner), relation.tags)

    def _rings_of(self, relation: Relation, roles: tuple[str, ...]) -> tuple[list[list[str]], bool]:
        """Return the closed rings of ways with these roles, and whether all ways are in them."""
        refs = [ref for ref, role in relation.members if role in roles]
        rings, closed = rings_of([self.ways[ref].nodes for ref in refs if ref in self.ways])
        return rings, closed and all(ref in self.ways for ref in refs)

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


def rings_of(lines: list[list[str]]) -> tuple[list[list[str]], bool]:
    """Return the closed rings that lines of nodes make up, and whether all lines are in them."""
    left, rings, closed = [line for line in lines if len(line) > 1], [], True
    while left:
        ring = left.pop()
        while ring[0] != ring[-1]:
            k = next((k for k, line in enumerate(left) if ring[-1] in (line[0], line[-1])), None)
            if k is None:
                break
            line = left.pop(k)
            ring = ring + (line[1:] if line[0] == ring[-1] else line[-2::-1])
        if ring[0] == ring[-1] and len(ring) > 3:
            rings.append(ring)
        else:
            closed = False
    return rings, closed
