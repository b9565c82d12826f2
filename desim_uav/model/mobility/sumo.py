"""Reads measured walks from the floating car data (FCD) that the traffic simulator SUMO writes.

The file is XML: ``<timestep time="0.00"><vehicle id="a" x="1.0" y="2.0" …/></timestep>``, with
``<person …/>`` for pedestrians. Document types and entities are refused, so a file can neither name
another one nor grow while it is read. SUMO writes its settings into a comment; a file that was
written with ``fcd-output.geo``, whose positions are degrees, is refused by it.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from functools import lru_cache
from pathlib import Path
from typing import NamedTuple

from desim_uav.geodata.xml_reader import XmlReader
from desim_uav.model.traces import Version, bytes_of, coordinate, parsed, quantity, version_of

ROOT, STEP, MOVERS, FREIGHT = "fcd-export", "timestep", ("vehicle", "person"), "container"

_TAG = re.compile(rb"\s*<")
_IN_DEGREES = re.compile(r'<fcd-output\.geo\s+value="(true|1)"')


class WayPoint(NamedTuple):
    """Where somebody is at a time, and the line of the file that says so."""

    mover: str
    t_s: float
    x_m: float
    y_m: float
    line: int


def looks_like_xml(path: Path) -> bool:
    """Return whether a file begins as XML does. Raises ValueError if it cannot be read."""
    return _looks_like_xml(path, version_of(path))


@lru_cache(maxsize=16)
def _looks_like_xml(path: Path, version: Version) -> bool:
    return _TAG.match(bytes_of(path).removeprefix(b"\xef\xbb\xbf")) is not None


class Fcd(NamedTuple):
    """The way points of an FCD file, in its order, and the number of its containers."""

    way_points: list[WayPoint]
    containers: int


def read_fcd(path: Path) -> Fcd:
    """Return what an FCD file records. Raises ValueError with file and line."""
    return _read_fcd(path, version_of(path))


@lru_cache(maxsize=16)
def _read_fcd(path: Path, version: Version) -> Fcd:
    reader = _Reader(path)
    reader.parse(bytes_of(path))
    return Fcd(reader.way_points, len(reader.containers))


class _Reader(XmlReader):
    """Collects way points while an FCD file is parsed."""

    def __init__(self, path: Path) -> None:
        super().__init__(path)
        self.way_points: list[WayPoint] = []
        self.containers: set[str | None] = set()
        self.open: list[str] = []
        self.t_s = 0.0

    def comment(self, text: str) -> None:
        """Raise ValueError if SUMO's settings, in a comment, say that positions are degrees."""
        if _IN_DEGREES.search(text):
            raise self.error(
                "its positions are longitudes and latitudes in degrees (SUMO's option "
                "--fcd-output.geo); write it without this option, so that they are in metres"
            )

    def begin(self, tag: str, attributes: Mapping[str, str]) -> None:
        """Begin an element: a time step, or somebody in one."""
        if not self.open and tag != ROOT:
            raise self.error(f"<{tag}>: expected <{ROOT}>, as SUMO's option --fcd-output writes")
        if tag == STEP:
            self.t_s = self._number(tag, attributes, "time")
        elif tag == FREIGHT:
            self.containers.add(attributes.get("id"))
        elif tag in MOVERS:
            if self.open[-1:] != [STEP]:
                raise self.error(f"<{tag}>: expected within <{STEP}>")
            x_m, y_m = (self._number(tag, attributes, name, coordinate) for name in ("x", "y"))
            mover = f"{tag} {self.text(tag, attributes, 'id')!r}"
            self.way_points.append(WayPoint(mover, self.t_s, x_m, y_m, self.line))
        self.open.append(tag)

    def end(self, tag: str) -> None:
        """End an element."""
        self.open.pop()

    def _number(
        self,
        tag: str,
        attributes: Mapping[str, str],
        name: str,
        parse: Callable[[str], float] = quantity,
    ) -> float:
        text = self.text(tag, attributes, name)
        try:
            return parsed(name, text, parse)
        except ValueError as error:
            raise self.error(str(error)) from error
