"""Reads streets from a network of SUMO."""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path

from desim_uav.model.mobility.street_graph import Point, Way
from desim_uav.model.mobility.sumo_net import read_net
from desim_uav.model.traces import Version, version_of


def ways_of(file: Path, driving: bool, offset_m: Point) -> list[Way]:
    """Return the ways of a file for cars or for pedestrians, in metres on the map.

    Raises ValueError with the file and, if one is at fault, the line.
    """
    dx, dy = offset_m
    ways = _ways(file, driving, version_of(file))
    return [Way(tuple((x + dx, y + dy) for x, y in way.points), way.one_way) for way in ways]


@lru_cache(maxsize=4)
def _ways(file: Path, driving: bool, version: Version) -> list[Way]:
    """Return the ways of a file at this version."""
    return read_net(file, driving)
