"""Where charging stations and drones stand at the start: cells, worked out, not drawn."""

from __future__ import annotations

import math

from desim_uav.model.grid import Cell
from desim_uav.scenario.schema import Scenario


def station_cells(scenario: Scenario) -> list[Cell]:
    """The cells of the charging stations: on a circle, clockwise from north."""
    return _on_circle(scenario, scenario.stations.count)


def start_cells(scenario: Scenario) -> list[Cell]:
    """The cell of each drone: as given, else on the stations round robin, else on the circle."""
    count = scenario.drones.count
    if scenario.drones.start_cells is not None:
        return list(scenario.drones.start_cells)
    stations = station_cells(scenario)
    if not stations:
        return _on_circle(scenario, count)
    return [stations[drone % len(stations)] for drone in range(count)]


def _on_circle(scenario: Scenario, count: int) -> list[Cell]:
    """The cells at angles 2πk / count, coordinates rounded to 1e-6 m and clipped to the map."""
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
