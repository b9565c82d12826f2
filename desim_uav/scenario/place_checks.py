"""Checks of where stations, drones and users are: on the map, each station on a cell of its own."""

from __future__ import annotations

from collections.abc import Iterator

from desim_uav.model.geometry.grid import Cell
from desim_uav.scenario.finding import Finding
from desim_uav.scenario.layout import station_cells
from desim_uav.scenario.schema import Scenario
from desim_uav.scenario.yaml12 import KeyPath

GRID: tuple[KeyPath, ...] = (("map", "size_m"), ("map", "cells"))
"""The keys that say how large the map and its cells are."""


def stations_have_their_own_cells(scenario: Scenario) -> Iterator[Finding]:
    """Two stations on one cell, or given cells off the map."""
    if scenario.stations.cells is not None:
        yield from _given_stations(scenario, scenario.stations.cells)
        return
    station_on: dict[Cell, int] = {}
    for station, cell in enumerate(station_cells(scenario)):
        if cell in station_on:
            yield Finding(
                ("stations", "radius_m"),
                f"stations {station_on[cell]} and {station} stand on one cell {text_of(cell)}; "
                f"take fewer stations, a larger circle or smaller cells",
                (("stations", "count"), *GRID),
            )
            return
        station_on[cell] = station


def _given_stations(scenario: Scenario, cells: tuple[Cell, ...]) -> Iterator[Finding]:
    path = ("stations", "cells")
    for index, cell in enumerate(cells):
        if not on_map(scenario, cell):
            yield Finding((*path, index), off_map(scenario), (("map", "cells"),))
        elif cell in cells[:index]:
            first = cells.index(cell)
            yield Finding((*path, index), f"this cell is given twice, first as {path[-1]}.{first}")


def drones_start_on_the_map(scenario: Scenario) -> Iterator[Finding]:
    """Start cells: one a drone, each on the map."""
    for key, drones in zip(scenario.fleet_keys, scenario.fleet, strict=True):
        cells, path = drones.start_cells, (*key, "start_cells")
        if cells is None:
            continue
        if len(cells) != drones.count:
            yield Finding(
                path,
                f"must be one cell a drone: {drones.count}, not {len(cells)}",
                ((*key, "count"),),
            )
        for index, cell in enumerate(cells):
            if not on_map(scenario, cell):
                yield Finding((*path, index), off_map(scenario), (("map", "cells"),))


def users_are_on_the_map(scenario: Scenario) -> Iterator[Finding]:
    """Given positions off the map."""
    width, depth = scenario.map.size_m
    for key, users in zip(scenario.user_keys, scenario.user_groups, strict=True):
        for index, (x, y) in enumerate(users.positions_m or ()):
            if x > width or y > depth:
                yield Finding(
                    (*key, "positions_m", index),
                    f"off the map, which is {width:g} x {depth:g} m",
                    (("map", "size_m"),),
                )


def on_map(scenario: Scenario, cell: Cell) -> bool:
    """Return whether a map has a cell."""
    return cell[0] < scenario.map.cells[0] and cell[1] < scenario.map.cells[1]


def off_map(scenario: Scenario) -> str:
    """Return what is wrong with a cell that the map does not have."""
    nx, ny = scenario.map.cells
    return f"off the map, which is {nx} x {ny} cells, counted from 0"


def text_of(cell: Cell) -> str:
    """Return a cell as a file has it."""
    return f"[{cell[0]}, {cell[1]}]"
