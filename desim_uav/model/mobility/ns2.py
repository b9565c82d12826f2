"""Reads walks from a movement file of the network simulator ns-2 (``setdest``, BonnMotion).

Lines such as ``$node_(0) set X_ 12.5`` say where a node is at first, and lines such as
``$ns_ at 3.0 "$node_(0) setdest 40.0 50.0 1.4"`` that from 3 s on it goes straight to (40, 50) at
1.4 m/s. Other lines of Tcl that a file may have say something of the radio, and are left out.
"""

from __future__ import annotations

import math
import re
from functools import lru_cache
from pathlib import Path
from typing import NamedTuple

from desim_uav.model.traces import (
    LARGEST,
    Version,
    bytes_of,
    coordinate,
    index,
    parsed,
    quantity,
    version_of,
)

_NODE = r"\$node_\((\S+?)\)"
_PLACE = re.compile(rf"{_NODE}\s+set\s+([XYZ])_\s+(\S+)$")
_MOVE = re.compile(rf'\$ns_?\s+at\s+(\S+)\s+"{_NODE}\s+setdest\s+(\S+)\s+(\S+)\s+(\S+)"$')
_ANY_MOVE = re.compile(rf"\$ns_?\s+at\s.*{_NODE}")
_LINE = re.compile(
    rb"^\s*(\$node_\(\S+\)\s+set\s+[XYZ]_\s|\$ns_?\s+at\s.*\ssetdest\s)", re.MULTILINE
)


class Node(NamedTuple):
    """Where a node is at a time, and the line of the file that says so."""

    number: int
    t_s: float
    x_m: float
    y_m: float
    line: int


class _Course:
    """The way points of a node, the last one of which it may not have reached yet."""

    def __init__(self) -> None:
        self.start: dict[str, tuple[float, int]] = {}
        self.points: list[Node] = []


def looks_like_ns2(path: Path) -> bool:
    """Return whether a file has a node's first place or a move. Raises ValueError if unreadable."""
    return _looks_like_ns2(path, version_of(path))


@lru_cache(maxsize=16)
def _looks_like_ns2(path: Path, version: Version) -> bool:
    return _LINE.search(bytes_of(path)) is not None


def read_ns2(path: Path) -> list[Node]:
    """Return the way points of all nodes, node after node. Raises ValueError with file and line."""
    try:
        lines = bytes_of(path).decode("utf-8-sig").splitlines()
    except UnicodeDecodeError as error:
        raise ValueError(f"{path}: it is not UTF-8 text") from error
    courses: dict[int, _Course] = {}
    for number, text in enumerate(lines, start=1):
        try:
            _read_line(text.strip(), number, courses)
        except ValueError as error:
            raise ValueError(f"{path}:{number}: {error}") from error
    nodes = []
    for own in sorted(courses):
        if not {"X", "Y"} <= set(courses[own].start):
            line = courses[own].points[-1].line if courses[own].points else 1
            raise ValueError(f"{path}:{line}: node {own} has no first place (set X_, set Y_)")
        nodes += _begun(own, courses[own])
    return nodes


def _read_line(text: str, number: int, courses: dict[int, _Course]) -> None:
    place, move = _PLACE.match(text), _MOVE.match(text)
    if place:
        course = courses.setdefault(parsed("$node_", place[1], index), _Course())
        if course.points:
            raise ValueError("a node's first place must be given before it moves")
        course.start[place[2]] = parsed(f"{place[2]}_", place[3], coordinate), number
    elif move:
        node, t_s = parsed("$node_", move[2], index), parsed("at", move[1], quantity)
        course = courses.setdefault(node, _Course())
        target = parsed("X", move[3], coordinate), parsed("Y", move[4], coordinate)
        speed_mps = parsed("SPEED", move[5], quantity)
        _set_out(node, course, t_s, target, speed_mps, number)
    elif _ANY_MOVE.match(text):
        raise ValueError(f'{text!r}: expected $ns_ at T "$node_(N) setdest X Y SPEED"')


def _begun(node: int, course: _Course) -> list[Node]:
    """Return the way points of a node with its first place before them."""
    (x_m, line), (y_m, _) = course.start["X"], course.start["Y"]
    return [Node(node, 0.0, x_m, y_m, line), *course.points]


def _set_out(
    node: int,
    course: _Course,
    t_s: float,
    target: tuple[float, float],
    speed_mps: float,
    line: int,
) -> None:
    """Let a node go to a place from where it is at a time, which may be on its way."""
    if not {"X", "Y"} <= set(course.start):
        raise ValueError(f"node {node} has no first place (set X_, set Y_)")
    points = _begun(node, course)
    last = points[-1]
    if len(points) > 1 and t_s < last.t_s:
        before = points[-2]
        if t_s < before.t_s:
            raise ValueError(f"node {node}: times must increase")
        share = (t_s - before.t_s) / (last.t_s - before.t_s)
        x_m = before.x_m + share * (last.x_m - before.x_m)
        y_m = before.y_m + share * (last.y_m - before.y_m)
        course.points.pop()
        last = before
    else:
        x_m, y_m = last.x_m, last.y_m
    if t_s > last.t_s:
        course.points.append(Node(node, t_s, x_m, y_m, line))
    far_m = math.hypot(target[0] - x_m, target[1] - y_m)
    if speed_mps > 0.0 and far_m > 0.0:
        if far_m > speed_mps * (LARGEST - t_s):
            raise ValueError(
                f"SPEED: {speed_mps:g}: too slow, node {node} would arrive after {LARGEST:,} s"
            )
        course.points.append(Node(node, t_s + far_m / speed_mps, *target, line))
