"""Reads buildings from OpenStreetMap XML: closed ways, and multipolygon relations.

Document types and entities are refused, so a file can neither name another one nor grow while it is
read.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import NamedTuple
from xml.parsers import expat

from desim_uav.city.extract import Element, Extract, Group, ring_of
from desim_uav.errors import in_short

LICENCE = "© OpenStreetMap contributors, ODbL 1.0 (https://www.openstreetmap.org/copyright)"
"""The attribution that the licence of OpenStreetMap's data asks for."""

BUILDING, PART = "building", "building:part"

Tags = dict[str, str]
Place = tuple[float, float]


class Way(NamedTuple):
    """The numbers of the nodes of a way, and its tags."""

    nodes: list[str]
    tags: Tags


class Relation(NamedTuple):
    """The ways of a relation, each with its role, and its tags."""

    members: list[tuple[str, str]]
    tags: Tags


def read(file: Path, content: bytes) -> Extract:
    """Return the buildings of an extract. Raises ValueError with the file and the element."""
    reader = _Reader(file)
    parser = reader.parser = expat.ParserCreate()
    parser.StartDoctypeDeclHandler = reader.refuse
    parser.EntityDeclHandler = reader.refuse
    parser.StartElementHandler = reader.begin
    parser.EndElementHandler = reader.end
    try:
        parser.Parse(content, True)
    except expat.ExpatError as error:
        why = expat.ErrorString(error.code)
        raise ValueError(f"{file}:{error.lineno}: it is not well-formed XML: {why}") from error
    return _Gatherer(file, reader).extract()


class _Reader:
    """Collects nodes, ways and relations while a file is parsed."""

    parser: expat.XMLParserType

    def __init__(self, file: Path) -> None:
        self.file = file
        self.nodes: dict[str, Place] = {}
        self.ways: dict[str, Way] = {}
        self.relations: dict[str, Relation] = {}
        self.way: Way | None = None
        self.relation: Relation | None = None
        self.depth = 0

    def refuse(self, *_: object) -> None:
        """Raise ValueError for a document type or an entity."""
        raise self._error("a document type or entity is not allowed")

    def begin(self, tag: str, attributes: Mapping[str, str]) -> None:
        """Begin an element."""
        if self.depth == 0 and tag != "osm":
            raise self._error(f"<{tag}>: expected <osm>, as OpenStreetMap writes")
        self.depth += 1
        handler = self._handlers.get(tag)
        if handler is not None:
            handler(self, attributes)

    def end(self, tag: str) -> None:
        """End an element."""
        self.depth -= 1
        if tag == "way":
            self.way = None
        elif tag == "relation":
            self.relation = None

    def _node(self, attributes: Mapping[str, str]) -> None:
        name = self._text(attributes, "id", "node")
        try:
            self.nodes[name] = float(attributes["lon"]), float(attributes["lat"])
        except (KeyError, ValueError) as error:
            if attributes.get("action") == "delete" or attributes.get("visible") == "false":
                return
            raise self._error(f"node {in_short(name)}: lon and lat must be numbers") from error

    def _way(self, attributes: Mapping[str, str]) -> None:
        self.way = self.ways[self._text(attributes, "id", "way")] = Way([], {})

    def _relation(self, attributes: Mapping[str, str]) -> None:
        name = self._text(attributes, "id", "relation")
        self.relation = self.relations[name] = Relation([], {})

    def _nd(self, attributes: Mapping[str, str]) -> None:
        if self.way is not None:
            self.way.nodes.append(self._text(attributes, "ref", "nd"))

    def _member(self, attributes: Mapping[str, str]) -> None:
        if self.relation is not None and attributes.get("type") == "way":
            ref = self._text(attributes, "ref", "member")
            self.relation.members.append((ref, attributes.get("role", "")))

    def _tag(self, attributes: Mapping[str, str]) -> None:
        of = self.way or self.relation
        if of is not None:
            of.tags[self._text(attributes, "k", "tag")] = self._text(attributes, "v", "tag")

    _handlers: Mapping[str, Callable[[_Reader, Mapping[str, str]], None]] = {
        "node": _node,
        "way": _way,
        "relation": _relation,
        "nd": _nd,
        "member": _member,
        "tag": _tag,
    }

    def _text(self, attributes: Mapping[str, str], name: str, tag: str) -> str:
        if name not in attributes:
            raise self._error(f"<{tag}> has no attribute {name!r}")
        return attributes[name]

    def _error(self, problem: str) -> ValueError:
        return ValueError(f"{self.file}:{self.parser.CurrentLineNumber}: {problem}")


class _Gatherer:
    """Makes buildings of what a file has."""

    def __init__(self, file: Path, reader: _Reader) -> None:
        self.file, self.nodes = file, reader.nodes
        self.ways, self.relations = reader.ways, reader.relations
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
