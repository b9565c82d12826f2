"""What is drawn for a world: its buildings, the clusters of users, and the users' homes."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from desim_uav.city.itu import itu_city
from desim_uav.errors import ScenarioError
from desim_uav.model.geometry.city import NO_CITY, City
from desim_uav.model.geometry.grid import Cell, Grid, connected, reachable
from desim_uav.model.random.streams import Purpose, Streams
from desim_uav.scenario.buildings import BuildingsOfItu
from desim_uav.scenario.map import DrawnObstacles
from desim_uav.scenario.schema import Scenario
from desim_uav.scenario.yaml12 import KeyPath
from desim_uav.user_group import UserGroup, groups_of

REDRAWS = 100
"""How often a map is drawn anew whose free cells are not connected."""
PLACEMENTS = 10_000
"""How often the place of a home is drawn anew that is not on the map."""


def draw_buildings(scenario: Scenario, seed: int, kept_free: set[Cell]) -> NDArray[np.float64]:
    """Draw the tallest building of each cell (nx, ny) until the free cells are connected."""
    obstacles = scenario.map.obstacles
    height_m = np.zeros(scenario.map.cells)
    if obstacles is None or not scenario.three_d:
        return height_m
    if not isinstance(obstacles, DrawnObstacles):
        for ix, iy, height in obstacles.cells:
            height_m[ix, iy] = height
        return height_m
    rng = Streams(seed, Purpose.WORLD).generator(0)
    for _ in range(1 + REDRAWS):
        height_m = _draw_squares(scenario, obstacles, rng)
        for cell in kept_free:
            height_m[cell] = 0.0
        if connected((height_m > 0.0) & (height_m >= scenario.map.levels.min_altitude_m)):
            return height_m
    raise ScenarioError(
        f"map.obstacles: none of {1 + REDRAWS} drawn maps (world seed {seed}) leaves the free "
        f"cells connected at the lowest level; lower map.obstacles.coverage"
    )


def draw_city(
    scenario: Scenario, seed: int, kept_free: set[Cell]
) -> tuple[City, NDArray[np.float64]]:
    """Return the city of a map, and up to which height each cell (nx, ny) is blocked for flight.

    Without a city that is the tallest building of the cell (``draw_buildings``). Cells that are
    kept free have no drawn buildings. Raises ScenarioError if buildings of a file
    stand there, or if the free cells are not connected, at the lowest level.
    """
    buildings, the_map = scenario.map.buildings, scenario.map
    if buildings is None or not scenario.three_d:
        return NO_CITY, draw_buildings(scenario, seed, kept_free)
    from desim_uav.city.footprints import cell_heights

    if isinstance(buildings, BuildingsOfItu):
        rng = Streams(seed, Purpose.WORLD).generator(0)
        numbers = buildings.alpha, buildings.beta, buildings.gamma
        city = _without(itu_city(the_map.size_m, *numbers, rng), kept_free, the_map.cell_m)
    else:
        city = the_map.city_of_file
    height_m = cell_heights(city, the_map.cells, the_map.cell_m, buildings.blocked_share)
    lowest_m, cells = the_map.levels.min_altitude_m, sorted(kept_free)
    blocked = (height_m > 0.0) & (height_m >= lowest_m)
    on = [cell for cell in cells if blocked[cell]]
    reached = reachable(blocked, cells[0]) if cells else ~blocked
    off = [cell for cell in cells if not reached[cell]]
    if on or off:
        what = f"buildings block cell {on[0]}" if on else f"buildings cut off cell {off[0]}"
        raise ScenarioError(
            f"map.buildings: {what}, where a station or a drone at its start stands, at the lowest "
            f"level, {lowest_m:g} m; raise map.levels.min_altitude_m, or move it "
            f"(stations.radius_m, drones.start_cells)"
        )
    return city, height_m


def _without(city: City, cells: set[Cell], cell_m: tuple[float, float]) -> City:
    """Return a city without the buildings that reach into some cells."""
    west, south, east, north = city.boxes_m.T
    stays = np.ones(len(city), bool)
    for ix, iy in cells:
        (dx, dy), (x, y) = cell_m, (ix * cell_m[0], iy * cell_m[1])
        stays &= (east <= x) | (west >= x + dx) | (north <= y) | (south >= y + dy)
    pieces = tuple(piece for piece, stay in zip(city.pieces_m, stays, strict=True) if stay)
    return City(pieces, city.roofs_m[stays])


def _draw_squares(
    scenario: Scenario, obstacles: DrawnObstacles, rng: np.random.Generator
) -> NDArray[np.float64]:
    """Draw building squares without replacement on their own grid, and map them to cells."""
    width_m, depth_m = scenario.map.size_m
    nx, ny = scenario.map.cells
    square_x = obstacles.square_m or width_m / nx
    square_y = obstacles.square_m or depth_m / ny
    columns, rows = math.ceil(width_m / square_x - 1e-9), math.ceil(depth_m / square_y - 1e-9)
    fraction = rng.uniform(*obstacles.coverage)
    count = round(fraction * columns * rows)
    squares = rng.choice(columns * rows, size=count, replace=False)
    heights = rng.uniform(*obstacles.height_m, size=count)
    height_m = np.zeros((nx, ny))
    if obstacles.square_m is None:  # a square is a cell
        height_m[np.divmod(squares, rows)] = heights
        return height_m
    for square, height in zip(squares.tolist(), heights.tolist(), strict=True):
        column, row = divmod(square, rows)
        xs = _overlapped(column * square_x, (column + 1) * square_x, width_m / nx, nx)
        ys = _overlapped(row * square_y, (row + 1) * square_y, depth_m / ny, ny)
        height_m[xs, ys] = np.maximum(height_m[xs, ys], height)
    return height_m


def _overlapped(low_m: float, high_m: float, cell_m: float, cells: int) -> slice:
    """Return the cells along one axis that share more than an edge with [low, high]."""
    first = math.floor(low_m / cell_m + 1e-9)
    return slice(first, min(math.ceil(high_m / cell_m - 1e-9), cells))


def draw_clusters(scenario: Scenario, seed: int) -> list[NDArray[np.float64]]:
    """Draw the clusters of each group of users, in rows of x, y and radius.

    Centroids are uniform on the map, and if possible a radius from the edge.
    """
    return [_clusters(scenario, seed, group) for group in groups_of(scenario)]


def _clusters(scenario: Scenario, seed: int, group: UserGroup) -> NDArray[np.float64]:
    """Draw the clusters of a group of users."""
    clusters, circles = group.keys.clusters, []
    streams = Streams(seed, Purpose.WORLD).beginning(group.first_stream)
    if clusters is None:
        return np.empty((0, 3))
    for cluster in range(clusters.count):
        rng = streams.generator(1 + cluster)
        radius = rng.uniform(*clusters.radius_m)
        margins = (min(radius, side / 2) for side in scenario.map.size_m)
        x, y = (
            rng.uniform(margin, side - margin)
            for margin, side in zip(margins, scenario.map.size_m, strict=True)
        )
        circles.append((x, y, radius))
    return np.array(circles)


def draw_homes(
    scenario: Scenario, seed: int, grid: Grid, clusters: Sequence[NDArray[np.float64]]
) -> NDArray[np.float64]:
    """Draw the users' homes: clusters in turn, truncated normal positions, heights in buildings.

    ``clusters`` are those of each group of users.
    """
    streams = Streams(seed, Purpose.PLACEMENT)
    homes = np.zeros((scenario.user_count, 3))
    for group, own in zip(groups_of(scenario), clusters, strict=True):
        users, begun = group.keys, streams.beginning(group.first_stream)
        for user in range(group.count):
            rng, home = begun.generator(user), homes[group.first + user]
            if users.positions_m is not None:
                home[:2] = users.positions_m[user]
            else:
                home[:2] = _truncated_normal(rng, own[user % len(own)], grid, group.path)
            building = grid.roof_at(*home[:2].tolist())
            if building > 0.0:
                home[2] = rng.uniform(0.0, min(building, users.max_height_m))
    return homes


def _truncated_normal(
    rng: np.random.Generator, cluster: NDArray[np.float64], grid: Grid, key: KeyPath
) -> tuple[float, float]:
    """Draw from a normal around a centroid (σ = radius / 2), truncated to its disc and the map."""
    x, y, radius = cluster
    for _ in range(PLACEMENTS):
        dx, dy = rng.normal(0.0, radius / 2.0, size=2)
        on_map = 0.0 <= x + dx <= grid.width_m and 0.0 <= y + dy <= grid.depth_m
        if dx * dx + dy * dy <= radius * radius and on_map:
            return float(x + dx), float(y + dy)
    raise ScenarioError(
        f"{'.'.join(map(str, key))}.clusters.radius_m: none of {PLACEMENTS} places drawn around a "
        f"centroid is on the map; the map is too small for a radius of {radius:g} m"
    )
