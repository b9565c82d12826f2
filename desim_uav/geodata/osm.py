"""Reads OpenStreetMap XML: nodes, ways and relations with their tags."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import NamedTuple

from desim_uav.errors import in_short
from desim_uav.geodata.xml_reader import XmlReader

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
    reader.parse(content)
    return OsmFile(reader.nodes, reader.ways, reader.relations)


class _Reader(XmlReader):
    """Collects nodes, ways and relations while a file is parsed."""

    def __init__(self, file: Path) -> None:
        super().__init__(file)
        self.nodes: dict[str, Place] = {}
        self.ways: dict[str, Way] = {}
        self.relations: dict[str, Relation] = {}
        self.way: Way | None = None
        self.relation: Relation | None = None
        self.depth = 0

    def begin(self, tag: str, attributes: Mapping[str, str]) -> None:
        """Begin an element."""
        if self.depth == 0 and tag != "osm":
            raise self.error(f"<{tag}>: expected <osm>, as OpenStreetMap writes")
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
        name = self.text("node", attributes, "id")
        texts = attributes.get("lon", ""), attributes.get("lat", "")
        gone = attributes.get("action") == "delete" or attributes.get("visible") == "false"
        if gone and "" in texts:
            return
        try:
            lon, lat = map(float, texts)
        except ValueError as error:
            raise self.error(f"node {in_short(name)}: lon and lat must be numbers") from error
        if not (abs(lon) <= 180.0 and abs(lat) <= 90.0):
            place = ", ".join(map(in_short, texts))
            raise self.error(f"node {in_short(name)}: ({place}) is no longitude and latitude")
        self.nodes[name] = lon, lat

    def _way(self, attributes: Mapping[str, str]) -> None:
        self.way = self.ways[self.text("way", attributes, "id")] = Way([], {})

    def _relation(self, attributes: Mapping[str, str]) -> None:
        name = self.text("relation", attributes, "id")
        self.relation = self.relations[name] = Relation([], {})

    def _nd(self, attributes: Mapping[str, str]) -> None:
        if self.way is not None:
            self.way.nodes.append(self.text("nd", attributes, "ref"))

    def _member(self, attributes: Mapping[str, str]) -> None:
        if self.relation is not None and attributes.get("type") == "way":
            ref = self.text("member", attributes, "ref")
            self.relation.members.append((ref, attributes.get("role", "")))

    def _tag(self, attributes: Mapping[str, str]) -> None:
        of = self.way or self.relation
        if of is not None:
            of.tags[self.text("tag", attributes, "k")] = self.text("tag", attributes, "v")

    _handlers: Mapping[str, Callable[[_Reader, Mapping[str, str]], None]] = {
        "node": _node,
        "way": _way,
        "relation": _relation,
        "nd": _nd,
        "member": _member,
        "tag": _tag,
    }
