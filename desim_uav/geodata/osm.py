"""Reads OpenStreetMap XML: nodes, ways and relations with their tags.

Document types and entities are refused, so a file can neither name another one nor grow while it is
read.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import NamedTuple
from xml.parsers import expat

from desim_uav.errors import in_short

LICENCE = "© OpenStreetMap contributors, ODbL 1.0 (https://www.openstreetmap.org/copyright)"
"""The attribution that the licence of OpenStreetMap's data asks for."""

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


class OsmFile(NamedTuple):
    """The longitudes and latitudes of nodes, the ways and the relations of a file, by number."""

    nodes: dict[str, Place]
    ways: dict[str, Way]
    relations: dict[str, Relation]


def read(file: Path, content: bytes) -> OsmFile:
    """Return what a file has. Raises ValueError with the file and the line."""
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
    return OsmFile(reader.nodes, reader.ways, reader.relations)


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
