"""Reads streets from a network of the traffic simulator SUMO (``.net.xml``).

An edge of it leads in one direction from one junction to another. It has the line ``shape``, or is
straight, and may be used by whom one of its lanes allows. What is within junctions is not read.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from desim_uav.geodata.xml_reader import XmlReader
from desim_uav.model.mobility.street_graph import Point, StreetWay
from desim_uav.model.traces import bytes_of, coordinate, parsed

ROOT = "net"


def read_net(path: Path, driving: bool) -> list[StreetWay]:
    """Return the ways of a network, in metres. Raises ValueError with file and line.

    Pedestrians may go along an edge in both directions.
    """
    reader = _Reader(path, "passenger" if driving else "pedestrian")
    reader.parse(bytes_of(path))
    return reader.ways(driving)


class _Edge:
    """An edge: its ends, its line if it has one, whether it may be used, and its line number."""

    def __init__(self, start: str, stop: str, shape: tuple[Point, ...], line: int) -> None:
        self.start, self.stop, self.shape, self.line = start, stop, shape, line
        self.open = False


class _Reader(XmlReader):
    """Collects junctions and edges while a network is parsed."""

    def __init__(self, path: Path, user: str) -> None:
        super().__init__(path)
        self.user = user
        self.junctions: dict[str, Point] = {}
        self.edges: list[_Edge] = []
        self.in_edge = self.begun = False

    def begin(self, tag: str, attributes: Mapping[str, str]) -> None:
        """Begin an element: a junction, an edge, or a lane of it."""
        if not self.begun and tag != ROOT:
            raise self.error(f"<{tag}>: expected <{ROOT}>, as SUMO's networks begin")
        self.begun = True
        if tag == "junction" and attributes.get("type") != "internal":
            name = self.text(tag, attributes, "id")
            self.junctions[name] = self._point(
                self.text(tag, attributes, "x"), self.text(tag, attributes, "y")
            )
        elif tag == "edge":
            self.in_edge = "function" not in attributes or attributes["function"] == "normal"
            if self.in_edge:
                start, stop = (self.text(tag, attributes, end) for end in ("from", "to"))
                shape = self._shape(attributes.get("shape", ""))
                self.edges.append(_Edge(start, stop, shape, self.line))
        elif tag == "lane" and self.in_edge:
            self.edges[-1].open |= self._allows(attributes)

    def ways(self, driving: bool) -> list[StreetWay]:
        """Return the ways of all edges that may be used."""
        ways = []
        for edge in self.edges:
            for end in (edge.start, edge.stop):
                if end not in self.junctions:
                    raise ValueError(f"{self.file}:{edge.line}: there is no junction {end!r}")
            if edge.open:
                inner = edge.shape[1:-1]
                points = (self.junctions[edge.start], *inner, self.junctions[edge.stop])
                ways.append(StreetWay(points, driving))
        return ways

    def _allows(self, attributes: Mapping[str, str]) -> bool:
        if "allow" in attributes:
            return bool({self.user, "all"} & set(attributes["allow"].split()))
        return not {self.user, "all"} & set(attributes.get("disallow", "").split())

    def _shape(self, text: str) -> tuple[Point, ...]:
        points = []
        for pair in text.split():
            numbers = pair.split(",")
            if len(numbers) not in (2, 3):
                raise self.error(f"shape: {pair!r}: expected x,y")
            points.append(self._point(*numbers[:2]))
        return tuple(points)

    def _point(self, x: str, y: str) -> Point:
        try:
            return parsed("x", x, coordinate), parsed("y", y, coordinate)
        except ValueError as error:
            raise self.error(str(error)) from error
