"""The map as a grid of cells and altitude levels, and where a drone can be."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from desim_uav.copies import Unchanging
from desim_uav.model.geometry.city import NO_CITY, City
from desim_uav.rowcode.kernels import rule

Cell = tuple[int, int]


@dataclass(frozen=True, eq=False)
class Grid(Unchanging):
    """The map as a grid of nx by ny cells, each with the height of its tallest building.

    ``height_m``: (nx, ny). ``levels_m``: the altitudes, ascending, of which the first
    ``levels_under_ceiling`` are not above the tallest building. A drone without a ceiling may also
    need one level above all buildings; if so, it is the last. In a ``city``, buildings are not
    cells, and ``height_m`` is up to where each cell is blocked for drones that fly from cell to
    cell.
    """

    width_m: float
    depth_m: float
    height_m: NDArray[np.float64]
    levels_m: tuple[float, ...]
    level_step_m: float
    levels_under_ceiling: int
    city: City = NO_CITY

    @property
    def cells(self) -> Cell:
        """The number of cells along x and y."""
        nx, ny = self.height_m.shape
        return nx, ny

    @property
    def buildings(self) -> str:
        """How many buildings there are, and how tall they are, in words."""
        built = self.height_m[self.height_m > 0.0]
        cells = f"in {len(built)} of {self.height_m.size} cells"
        if len(self.city):
            tallest = f"up to {self.city.tallest_m:.1f} m tall"
            return f"{len(self.city)} convex pieces, {tallest}; {cells} blocked"
        return f"{cells}, {built.min():.1f} to {built.max():.1f} m tall" if len(built) else "none"

    @property
    def tallest_m(self) -> float:
        """The height of the tallest building in metres; 0 without any."""
        return max(float(self.height_m.max(initial=0.0)), self.city.tallest_m)

    @cached_property
    def cell_m(self) -> tuple[float, float]:
        """The size of a cell along x and y."""
        nx, ny = self.cells
        return self.width_m / nx, self.depth_m / ny

    @cached_property
    def blocked(self) -> NDArray[np.bool_]:
        """Whether a building blocks each (level, x, y), which must be strictly above it."""
        levels = np.array(self.levels_m)[:, None, None]
        built = self.height_m[None, :, :] > 0.0
        return built & (levels <= self.height_m[None, :, :])

    @cached_property
    def _free(self) -> list[list[list[bool]]]:
        free: list[list[list[bool]]] = (~self.blocked).tolist()
        return free

    def levels(self, ceiling: bool) -> int:
        """Return the number of levels that a drone can use."""
        return self.levels_under_ceiling if ceiling else len(self.levels_m)

    def can_enter(self, ix: int, iy: int, level: int, ceiling: bool = True) -> bool:
        """Return whether a cell is on the map and free at ``level``, which the drone can use."""
        nx, ny = self.cells
        on_map = 0 <= ix < nx and 0 <= iy < ny and 0 <= level < self.levels(ceiling)
        return on_map and self._free[level][ix][iy]

    @cached_property
    def _centres(self) -> tuple[list[float], list[float]]:
        (nx, ny), (dx, dy) = self.cells, self.cell_m
        return [(ix + 0.5) * dx for ix in range(nx)], [(iy + 0.5) * dy for iy in range(ny)]

    def centre(self, ix: int, iy: int) -> tuple[float, float]:
        """Return the centre of a cell, x and y in metres."""
        xs, ys = self._centres
        return xs[ix], ys[iy]

    def cell_of(self, x_m: float, y_m: float) -> Cell:
        """Return the cell that holds a point; a point off the map belongs to the nearest cell."""
        (nx, ny), (dx, dy) = self.cells, self.cell_m
        return cell_index(x_m, dx, nx), cell_index(y_m, dy, ny)

    def roof_at(self, x_m: float, y_m: float) -> float:
        """Return the height of the building at a place, in metres; 0 without any."""
        if len(self.city):
            return self.city.roof_at(x_m, y_m)
        return float(self.height_m[self.cell_of(x_m, y_m)])

    def level_of(self, z_m: float) -> int:
        """Return the level nearest to an altitude."""
        return level_index(z_m, self.levels_m[0], self.level_step_m, len(self.levels_m))


@rule
def cell_index(at_m: float, cell_m: float, cells: int) -> int:
    """Return the index of the cell along one axis that holds a coordinate, clipped to the map."""
    return int(min(max(int(at_m // cell_m), 0), cells - 1))


@rule
def level_index(z_m: float, lowest_m: float, step_m: float, levels: int) -> int:
    """Return the level nearest to an altitude; of two equally near ones, the even one."""
    return int(min(max(int(np.rint((z_m - lowest_m) / step_m)), 0), levels - 1))


def altitudes(
    min_altitude_m: float, step_m: float, tallest_m: float, max_altitude_m: float | None = None
) -> tuple[tuple[float, ...], int]:
    """Return the levels of a 3D map in metres, and how many of them are under the ceiling.

    The levels are ``min_altitude_m + k step_m``, none above the tallest building, or above
    ``max_altitude_m`` if that is higher; the lowest always exists. If none is above the tallest
    building, one more, the first above it, is for drones without a ceiling.
    """
    levels = [min_altitude_m]
    highest_m = max(tallest_m, max_altitude_m or 0.0)
    while min_altitude_m + len(levels) * step_m <= highest_m:
        levels.append(min_altitude_m + len(levels) * step_m)
    under_ceiling = len(levels)
    if levels[-1] <= tallest_m:
        levels.append(min_altitude_m + len(levels) * step_m)
    return tuple(levels), under_ceiling


def reachable(blocked: NDArray[np.bool_], start: Cell) -> NDArray[np.bool_]:
    """Return which cells of one level (nx, ny) can be reached from ``start`` along x and y."""
    reached = np.zeros(blocked.shape, np.bool_)
    reached[start] = True
    while True:
        wider = reached.copy()
        wider[1:] |= reached[:-1]
        wider[:-1] |= reached[1:]
        wider[:, 1:] |= reached[:, :-1]
        wider[:, :-1] |= reached[:, 1:]
        wider &= reached | ~blocked
        if (wider == reached).all():
            return reached
        reached = wider


def connected(blocked: NDArray[np.bool_]) -> bool:
    """Return whether all free cells of one level (nx, ny) are connected."""
    free = np.argwhere(~blocked)
    return len(free) > 0 and bool(reachable(blocked, (free[0][0], free[0][1]))[~blocked].all())
