"""The cells of the charging stations and of the drones at the start, neither of them random."""

from __future__ import annotations

import math

import numpy as np

from desim_uav.model.geometry.grid import Cell
from desim_uav.scenario.schema import Scenario


def station_cells(scenario: Scenario) -> list[Cell]:
    """Return the cells of the charging stations: as given, or on a circle clockwise from north."""
    stations = scenario.stations
    if stations.cells is not None:
        return list(stations.cells)
    if stations.placement == "equidistant" and stations.count > 0:
        return _equidistant(scenario)
    return _on_circle(scenario, stations.count)


def start_cells(scenario: Scenario) -> list[Cell]:
    """Return the start cell of each drone.

    These are the ``start_cells`` of its type if given, else the stations' cells in turn, else, if
    there are no stations, cells on the circle.
    """
    count = scenario.drone_count
    stations = station_cells(scenario)
    if not stations:
        cells = _on_circle(scenario, count)
    else:
        cells = [stations[drone % len(stations)] for drone in range(count)]
    first = 0
    for drones in scenario.fleet:
        if drones.start_cells is not None:
            cells[first : first + drones.count] = drones.start_cells
        first += drones.count
    return cells


def _on_circle(scenario: Scenario, count: int) -> list[Cell]:
    """Return the cells that contain the circle's points; outside the map, those at its edge.

    Coordinates are rounded to 1e-6 m.
    """
    width, depth = scenario.map.size_m
    return [
        _cell_at(scenario, width / 2.0 + x, depth / 2.0 + y)
        for x, y in _points(scenario.stations.radius_m, count)
    ]


def _points(radius_m: float, count: int) -> list[tuple[float, float]]:
    """Return the points of a circle at the angles 2πk / count, clockwise from north."""
    angles = (2.0 * math.pi * k / count for k in range(count))
    return [(radius_m * math.sin(angle), radius_m * math.cos(angle)) for angle in angles]


def _equidistant(scenario: Scenario) -> list[Cell]:
    """Return the cells of stations that are exactly equally far from the middle of the map.

    Of the distances that centres of cells have and that differ from the radius by at most the
    diagonal of a cell, take the one at which the stations are nearest to the points of the circle
    (the least sum of squares), then the one nearest to the radius. Each station stands on the cell
    at that distance which is nearest to its point, then furthest to the east, then to the north.
    Lengths are rounded to 1e-6 m.
    """
    radius, count = scenario.stations.radius_m, scenario.stations.count
    (nx, ny), (dx, dy) = scenario.map.cells, scenario.map.cell_m
    ix, iy = np.indices((nx, ny)).reshape(2, -1)
    x, y = (2 * ix + 1 - nx) * dx / 2, (2 * iy + 1 - ny) * dy / 2
    off_m = np.abs(np.hypot(x, y) - radius)
    near = off_m <= max(math.hypot(dx, dy), off_m.min())
    ix, iy, x, y = ix[near], iy[near], x[near], y[near]
    distances, ring = np.unique(np.hypot(x, y).round(6), return_inverse=True)
    squares, choices = np.zeros(len(distances)), []
    for east, north in _points(radius, count):
        apart = np.hypot(x - east, y - north).round(6)
        order = np.lexsort((-iy, -ix, apart, ring))
        first = order[np.searchsorted(ring[order], np.arange(len(distances)))]
        squares += apart[first] ** 2
        choices.append(first)
    best = np.lexsort((np.abs(distances - radius), squares.round(3)))[0]
    return [(int(ix[first[best]]), int(iy[first[best]])) for first in choices]


def _cell_at(scenario: Scenario, x_m: float, y_m: float) -> Cell:
    (nx, ny), (dx, dy) = scenario.map.cells, scenario.map.cell_m
    ix, iy = math.floor(round(x_m, 6) / dx), math.floor(round(y_m, 6) / dy)
    return min(max(ix, 0), nx - 1), min(max(iy, 0), ny - 1)
