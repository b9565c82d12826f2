"""Changes of class of users who stand still, which are computed once for all legs of a world."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from desim_uav.model.geometry.coverage import (
    SEEN_ROWS,
    DroneLeg,
    Users,
    look_around,
)
from desim_uav.model.geometry.relative import Change
from desim_uav.model.motion.motion import Transit, cruise_of
from desim_uav.model.radio.nested import changes_on
from desim_uav.model.rules import Action, kind_of, move_of
from desim_uav.rowcode.views import dtype_of, zeros
from desim_uav.rules.standing import COURSES
from desim_uav.world import World

Ints = NDArray[np.int64]

MOST_LOOKS = 2**22
"""The largest number of pairs of a leg and a user for which crossings are computed in advance."""


def tabulate(world: World) -> tuple[Ints, Any]:
    """Return the changes on all legs of a step: the first row of each leg, and the rows.

    Times are those since the leg's start, and a leg's last change is first. There are
    ``legs_in_table`` legs for each type of drones; those from cell (x, y) have the numbers from
    ``(x * ny + y) * 5`` on, in order of ``COURSES``. Both arrays are empty if users walk, if
    classes hold within other distances at other altitudes, or if there are more than MOST_LOOKS
    pairs of a leg and a user.
    """
    pairs = legs_in_table(world) * len(world.types) * len(world.homes)
    walks = world.fixed_walks
    one_level = len(world.grid.levels_m) == 1 or not world.graded
    chooses = bool(cruise_of(world.scenario.fleet[0].motion))  # a course is then several legs
    if (
        world.free
        or chooses
        or walks is None
        or any(walks.legs[axis].any() for axis in ("vx_mps", "vy_mps"))
        or pairs > MOST_LOOKS
        or not one_level
    ):
        return np.empty(0, np.int64), zeros(Change, 0)
    looks = _Looks(world)
    tables = [rows for number in range(len(world.types)) for rows in looks.of_type(number)]
    return np.cumsum([0, *map(len, tables)]), np.concatenate(tables, dtype=dtype_of(Change))


def legs_in_table(world: World) -> int:
    """Return the number of legs of a step that a type of drones can fly on one level."""
    nx, ny = world.grid.cells
    return nx * ny * len(COURSES)


class _Looks:
    """Finds the crossings of users at home on the legs of drones."""

    def __init__(self, world: World) -> None:
        self.world, users = world, len(world.homes)
        self.users = Users(*world.walks(world.seed, 0), np.zeros((SEEN_ROWS, users)))
        look_around(self.users, 0, world.step_us)

    def of_type(self, number: int) -> list[Any]:
        """Return the crossings of all legs of a type of drones."""
        by_course = {
            move_of(action)[:2]: transit
            for action, transit in self.world.types[number].epoch_transits.items()
            if kind_of(action) not in (Action.UP, Action.DOWN)
        }
        rings_m = self.world.links[number].rings_m[0]
        return [
            self._along((x, y), course, by_course.get(course), rings_m)
            for x, y in np.ndindex(self.world.grid.cells)
            for course in COURSES
        ]

    def _along(
        self,
        cell: tuple[int, int],
        course: tuple[int, int],
        transit: Transit | None,
        rings_m: NDArray[np.float64],
    ) -> Any:
        """Return the crossings of one leg, the last one first; a hover has none."""
        if transit is None:
            return zeros(Change, 0)
        cell_x_m, cell_y_m = self.world.grid.cell_m
        route = (
            (cell[0] + 0.5) * cell_x_m,
            (cell[1] + 0.5) * cell_y_m,
            (cell[0] + course[0] + 0.5) * cell_x_m,
            (cell[1] + course[1] + 0.5) * cell_y_m,
        )
        leg = DroneLeg(transit.rows, route, (0, self.world.step_us), 0.0, fresh=False)
        rows = changes_on(leg, self.users, rings_m, self.world.groups)
        return rows[np.lexsort((rows["user"], rows["change"] > 0, rows["t_us"]))[::-1]]
