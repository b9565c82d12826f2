"""The cells of the charging stations and of the drones at the start, neither of them random."""

from __future__ import annotations

import math

from desim_uav.model.grid import Cell
from desim_uav.scenario.schema import Scenario


def station_cells(scenario: Scenario) -> list[Cell]:
    """Return the cells of the charging stations, which lie on a circle, clockwise from north."""
    return _on_circle(scenario, scenario.stations.count)


def start_cells(scenario: Scenario) -> list[Cell]:
    """Return the start cell of each drone.

    These are the scenario's ``start_cells`` if given, else the stations' cells in turn, else, if
    there are no stations, cells on the circle.
    """
    count = scenario.drones.count
    if scenario.drones.start_cells is not None:
        return list(scenario.drones.start_cells)
    stations = station_cells(scenario)
    if not stations:
        return _on_circle(scenario, count)
    return [stations[drone % len(stations)] for drone in range(count)]


def _on_circle(scenario: Scenario, count: int) -> list[Cell]:
    """Return the cells at the angles 2πk / count.

    Coordinates are rounded to 1e-6 m, and cells outside the map are moved to its edge.
    """
    radius = scenario.stations.radius_m
    width, depth = scenario.map.size_m
    angles = [2.0 * math.pi * k / count for k in range(count)]
    points = [
        (width / 2.0 + radius * math.sin(angle), depth / 2.0 + radius * math.cos(angle))
        for angle in angles
    ]
    return [_cell_at(scenario, x, y) for x, y in points]


def _cell_at(scenario: Scenario, x_m: float, y_m: float) -> Cell:
    (nx, ny), (dx, dy) = scenario.map.cells, scenario.map.cell_m
    ix, iy = math.floor(round(x_m, 6) / dx), math.floor(round(y_m, 6) / dy)
    return min(max(ix, 0), nx - 1), min(max(iy, 0), ny - 1)
