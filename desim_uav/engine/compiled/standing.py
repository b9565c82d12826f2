"""Changes of class of users who stand still, which are computed once for all legs of a world."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from desim_uav.model.geometry.coverage import (
    SEEN_ROWS,
    VX,
    VY,
    X0,
    Y0,
    DroneLeg,
    Users,
    look_around,
)
from desim_uav.model.geometry.relative import TIME_US, USER
from desim_uav.model.motion.motion import Transit, cruise_of
from desim_uav.model.radio.nested import CHANGE, changes_on
from desim_uav.model.rules import Action, kind_of, move_of
from desim_uav.rowcode.compiled_rows import set_word
from desim_uav.rowcode.kernels import rule
from desim_uav.rules.rows import Constants, Drone, Path, State
from desim_uav.world import World

Ints = NDArray[np.int64]
CHANGE_COLUMNS = 3

COURSES = ((0, 0), (0, 1), (0, -1), (1, 0), (-1, 0))
"""The directions of legs in the plane, in cells; ``_course`` returns the index of a direction."""

MOST_LOOKS = 2**22
"""The largest number of pairs of a leg and a user for which crossings are computed in advance."""


def tabulate(world: World) -> tuple[Ints, Ints]:
    """Return the changes on all legs of a step: the first row of each leg, and the rows.

    Rows are (time since the leg's start in µs, user, change), a leg's last one first. There are
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
        or walks.legs[:, VX:].any()
        or pairs > MOST_LOOKS
        or not one_level
    ):
        return np.empty(0, np.int64), np.empty((0, CHANGE_COLUMNS), np.int64)
    looks = _Looks(world)
    found = [rows for number in range(len(world.types)) for rows in looks.of_type(number)]
    return np.cumsum([0, *map(len, found)]), np.concatenate(found)


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

    def of_type(self, number: int) -> list[NDArray[np.int64]]:
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
    ) -> NDArray[np.int64]:
        """Return the crossings of one leg, the last one first; a hover has none."""
        if transit is None:
            return np.empty((0, CHANGE_COLUMNS), np.int64)
        cell_x_m, cell_y_m = self.world.grid.cell_m
        route = (
            (cell[0] + 0.5) * cell_x_m,
            (cell[1] + 0.5) * cell_y_m,
            (cell[0] + course[0] + 0.5) * cell_x_m,
            (cell[1] + course[1] + 0.5) * cell_y_m,
        )
        leg = DroneLeg(transit.profile, route, (0, self.world.step_us), 0.0, fresh=False)
        rows = changes_on(leg, self.users, rings_m, self.world.groups)
        return rows[np.lexsort((rows[:, USER], rows[:, CHANGE] > 0, rows[:, TIME_US]))[::-1]]


@rule
def stand(world: Constants, path: Path) -> int:
    """Return whether all users stand still at the homes for which the table was computed."""
    if len(world.known_at) == 0 or path.stepwise or len(path.legs) != 5 * len(world.homes):
        return 0
    for user in range(len(world.homes)):
        home, leg = world.homes[user], 5 * user
        if path.legs[leg + X0] != home.x_m or path.legs[leg + Y0] != home.y_m:
            return 0
        if path.legs[leg + VX] != 0.0 or path.legs[leg + VY] != 0.0:
            return 0
    return 1


@rule
def recall(world: Constants, state: State, drone: Drone) -> None:
    """Write the crossings of a leg that begins now, from the table, into ``drone.ahead``.

    At access points, which stand still as all users do, there are none.
    """
    if drone.point >= 0:
        drone.ahead.clear()
        return
    course = _course(drone.to_x - drone.x, drone.to_y - drone.y)
    leg = world.types[drone.type].first_known + (drone.x * world.ny + drone.y) * 5 + course
    first, ahead = world.known_at[leg], drone.ahead
    count = world.known_at[leg + 1] - first
    if count > ahead.buffer:
        set_word(ahead, 3, 1)
        count = 0
    set_word(ahead, 1, count)
    for k in range(count):
        known, change = world.known[first + k], ahead[k]
        change.t_us = state.now_us + known.t_us
        change.user, change.change = known.user, known.change


@rule
def _course(dx: int, dy: int) -> int:
    if dx != 0:
        return 3 if dx > 0 else 4
    if dy != 0:
        return 1 if dy > 0 else 2
    return 0
