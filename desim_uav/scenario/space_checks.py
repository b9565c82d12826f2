"""Checks of cities and of free flight: what they cannot be combined with, refused by name."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from desim_uav.scenario.buildings import BuildingsOfItu
from desim_uav.scenario.drones import Drones, flies_freely
from desim_uav.scenario.finding import Finding
from desim_uav.scenario.schema import Scenario
from desim_uav.scenario.yaml12 import KeyPath

MOST_WORK = 12_000_000
"""The largest sum of the squared numbers of corners of all zones: it takes about a minute."""

MOST_BUILDINGS = 50_000
"""The most buildings of a drawn city."""

FREE = "drones.motion: space: free"


def buildings_fit_the_map(scenario: Scenario) -> Iterator[Finding]:
    """No city in 2D, and a drawn one in reasonable number that has a building."""
    buildings, path = scenario.map.buildings, ("map", "buildings")
    if buildings is not None and not scenario.three_d:
        yield Finding(
            path,
            "not in 2D, where drones fly above everything; leave it out, or map.dimensions: 3",
            (("map", "dimensions"),),
        )
    if isinstance(buildings, BuildingsOfItu):
        width, depth = scenario.map.size_m
        count = buildings.beta * width * depth / 1e6
        if not 1 <= count <= MOST_BUILDINGS:
            yield Finding(
                (*path, "beta"),
                f"makes {count:,.0f} buildings of the map; from 1 to {MOST_BUILDINGS:,}",
                (("map", "size_m"),),
            )


def free_flight_fits_the_scenario(scenario: Scenario) -> Iterator[Finding]:
    """What drones that fly freely cannot do, and what only they can."""
    for key, drones in zip(scenario.fleet_keys, scenario.fleet, strict=True):
        if getattr(drones.motion, "reach", "step") == "map" and not flies_freely(drones):
            yield Finding((*key, "motion", "reach"), f"map needs {FREE}", ((*key, "motion"),))
    if not scenario.free:
        if scenario.map.no_fly:
            yield Finding(
                ("map", "no_fly"),
                f"drones that fly from cell to cell do not heed it; it needs {FREE}",
                tuple((*key, "motion") for key in scenario.fleet_keys),
            )
        return
    yield from _zones_are_cut_soon(scenario)
    if scenario.mixed and scenario.map.no_fly:
        cells = [
            key
            for key, drones in zip(scenario.fleet_keys, scenario.fleet, strict=True)
            if not flies_freely(drones)
        ]
        names = ", ".join(".".join(map(str, key)) for key in cells)
        yield Finding(
            ("map", "no_fly"),
            f"the drones of {names} fly from cell to cell and do not heed it; all types need "
            "motion: space: free",
            tuple((*key, "motion") for key in cells),
        )
    for key, drones in zip(scenario.fleet_keys, scenario.fleet, strict=True):
        if flies_freely(drones):
            yield from _of_type(scenario, key, drones)


def _zones_are_cut_soon(scenario: Scenario) -> Iterator[Finding]:
    """Zones with so many corners that it would take minutes to cut them into convex parts."""
    corners = [len(zone.polygon_m) for zone in scenario.map.no_fly]
    work = sum(count * count for count in corners)
    if work > MOST_WORK:
        yield Finding(
            ("map", "no_fly"),
            f"{sum(corners)} corners of {len(corners)} polygons, with a sum of squares of {work:,} "
            f"by polygon, take about {work / MOST_WORK:.1f} min to be cut into convex parts; the "
            f"sum of squares may be {MOST_WORK:,}",
        )


def _of_type(scenario: Scenario, key: KeyPath, drones: Drones) -> Iterator[Finding]:
    motion: Any = drones.motion
    if motion.reach == "map" and not scenario.decisions.by_event:
        yield Finding(
            (*key, "motion", "reach"),
            "map needs decisions: event, because a leg to any place may take longer than a step",
            (("decisions",),),
        )
    also: tuple[KeyPath, ...] = ((*key, "motion", "space"),)
    if motion.return_timing != "minimum_time":
        yield Finding(
            (*key, "motion", "return_timing"),
            f"not beside {FREE}, in which drones always return in minimum time",
            also,
        )
    if motion.cruise is not None and len(motion.cruise) != 2:
        yield Finding(
            (*key, "motion", "cruise"),
            f"must be two speeds beside {FREE}: the lowest and the highest that a command can "
            "choose",
            also,
        )
    side_m = min(scenario.map.cell_m)
    if scenario.map.obstacles is not None and motion.margin_m >= side_m / 2.0:
        yield Finding(
            (*key, "motion", "margin_m"),
            f"must be less than half of the side of a cell, {side_m / 2.0:g} m, beside buildings",
            (*also, ("map", "cells"), ("map", "size_m")),
        )
