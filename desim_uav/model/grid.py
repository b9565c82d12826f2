"""The map as drones know it: cells, levels, and where a drone can be."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from desim_uav.copies import Unchanging
from desim_uav.model.kernels import kernel

Cell = tuple[int, int]


@dataclass(frozen=True, eq=False)
class Grid(Unchanging):
    """Cells of ``width_m`` / nx by ``depth_m`` / ny; ``height_m`` (nx, ny) of the tallest building.

    ``levels_m`` are the altitudes under the ceiling (the tallest building), ascending, and above
    them the one level a drone without a ceiling needs to fly over everything, where it needs one.
    """

    width_m: float
    depth_m: float
    height_m: NDArray[np.float64]
    levels_m: tuple[float, ...]
    level_step_m: float
    levels_under_ceiling: int

    @property
    def cells(self) -> Cell:
        """The number of cells along x and y."""
        nx, ny = self.height_m.shape
        return nx, ny

    @cached_property
    def cell_m(self) -> tuple[float, float]:
        """The size of a cell along x and y."""
        nx, ny = self.cells
        return self.width_m / nx, self.depth_m / ny

    @cached_property
    def blocked(self) -> NDArray[np.bool_]:
        """(level, x, y): a cell can be entered at levels strictly above its height only."""
        levels = np.array(self.levels_m)[:, None, None]
        built = self.height_m[None, :, :] > 0.0
        return built & (levels <= self.height_m[None, :, :])

    @cached_property
    def _free(self) -> list[list[list[bool]]]:
        free: list[list[list[bool]]] = (~self.blocked).tolist()
        return free

    def levels(self, ceiling: bool) -> int:
        """How many levels a drone can use."""
        return self.levels_under_ceiling if ceiling else len(self.levels_m)

    def can_enter(self, ix: int, iy: int, level: int, ceiling: bool = True) -> bool:
        """Is (ix, iy) on the map, and free at ``level``, and ``level`` one of the drone's?"""
        nx, ny = self.cells
        on_map = 0 <= ix < nx and 0 <= iy < ny and 0 <= level < self.levels(ceiling)
        return on_map and self._free[level][ix][iy]

    @cached_property
    def _centres(self) -> list[list[tuple[float, float]]]:
        (nx, ny), (dx, dy) = self.cells, self.cell_m
        return [[((ix + 0.5) * dx, (iy + 0.5) * dy) for iy in range(ny)] for ix in range(nx)]

    def centre(self, ix: int, iy: int) -> tuple[float, float]:
        """The middle of a cell, in metres."""
        return self._centres[ix][iy]

    def cell_of(self, x_m: float, y_m: float) -> Cell:
        """The cell that holds a point, clipped to the map."""
        (nx, ny), (dx, dy) = self.cells, self.cell_m
        return cell_index(x_m, dx, nx), cell_index(y_m, dy, ny)

    def level_of(self, z_m: float) -> int:
        """The level nearest to an altitude."""
        return level_index(z_m, self.levels_m[0], self.level_step_m, len(self.levels_m))


@kernel
def cell_index(at_m: float, cell_m: float, cells: int) -> int:
    """The cell along one axis that holds a coordinate, clipped to the map."""
    return int(min(max(int(at_m // cell_m), 0), cells - 1))


@kernel
def level_index(z_m: float, lowest_m: float, step_m: float, levels: int) -> int:
    """The level nearest to an altitude, half-way to the even one."""
    return int(min(max(int(np.rint((z_m - lowest_m) / step_m)), 0), levels - 1))


def altitudes(
    min_altitude_m: float, step_m: float, tallest_m: float
) -> tuple[tuple[float, ...], int]:
    """(levels, how many of them are under the ceiling) for the tallest building of a 3D map.

    The levels are ``min_altitude_m + k step_m``, none above the tallest building; the lowest
    always exists. One more, the first above the tallest building, is for drones without a ceiling.
    """
    levels = [min_altitude_m]
    while min_altitude_m + len(levels) * step_m <= tallest_m:
        levels.append(min_altitude_m + len(levels) * step_m)
    under_ceiling = len(levels)
    if levels[-1] <= tallest_m:
        levels.append(min_altitude_m + len(levels) * step_m)
    return tuple(levels), under_ceiling


def reachable(blocked: NDArray[np.bool_], start: Cell) -> NDArray[np.bool_]:
    """The cells of one level (nx, ny) that moves along x and y lead to from ``start``."""
    reached = np.zeros_like(blocked)
    reached[start] = True
    frontier = [start]
    nx, ny = blocked.shape
    while frontier:
        ix, iy = frontier.pop()
        for jx, jy in ((ix + 1, iy), (ix - 1, iy), (ix, iy + 1), (ix, iy - 1)):
            if 0 <= jx < nx and 0 <= jy < ny and not blocked[jx, jy] and not reached[jx, jy]:
                reached[jx, jy] = True
                frontier.append((jx, jy))
    return reached


def connected(blocked: NDArray[np.bool_]) -> bool:
    """Do the free cells of one level (nx, ny) hang together?"""
    free = np.argwhere(~blocked)
    return len(free) > 0 and bool(reachable(blocked, (free[0][0], free[0][1]))[~blocked].all())
