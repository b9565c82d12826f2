"""Levels of links with draws or buildings, by other formulas than the engines'.

The draws are NumPy's (``numpy.random.Philox``, the normal quantile of the standard library), and a
line of sight is cut by the slabs between the walls of each cell.
"""

from __future__ import annotations

import math
from statistics import NormalDist
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from desim_uav.model.radio.radio import LinkClasses
from desim_uav.scenario.schema import Scenario
from desim_uav.world import World

Position = tuple[float, float, float]

TOUCH_M = 1e-4
"""How far from a wall, a roof or the border of a cell nothing is known for certain. A link whose
line of sight is drawn may change when its user or its transmitter has moved by so much."""


class Draws(NamedTuple):
    """What is drawn for a link while the transmitter is in a cell."""

    uniform: float
    los_db: float
    nlos_db: float


def draws_of(
    key: NDArray[np.uint64],
    radio: LinkClasses,
    transmitter: int,
    user: int,
    cell: int,
    users: int = 0,
    number: int | None = None,
) -> Draws:
    """Return the draws of a link; access point k is transmitter -1 - k.

    Only if the episode is imagined, its key is longer and the number of ``users`` matters. The user
    has a ``number`` in the draws, which is ``user`` if there are no groups of users.
    """
    own = user if number is None else number
    draws = _draws_of(key[:2], radio, transmitter, own, cell)
    if len(key) == 2:
        return draws
    new = _draws_of(key[2:4], radio, transmitter, own, cell)
    transmitters = (len(key) - 4) // (1 + users)
    cells = np.array(key[4 : 4 + transmitters]).view(np.int64)
    if cells[transmitter] != cell:
        return new
    chances = np.array(key[4 + transmitters :]).view(np.float64).reshape(transmitters, users)
    chance = float(chances[transmitter, user])
    if draws.uniform < chance:
        return Draws(chance * new.uniform, draws.los_db, new.nlos_db)
    return Draws(1.0 - (1.0 - chance) * (1.0 - new.uniform), new.los_db, draws.nlos_db)


def number_in_draws(scenario: Scenario, user: int) -> int:
    """Return the number of a user in draws: 2^24 for each group before its own, and its place."""
    group = scenario.group_numbers[user]
    return 2**24 * group + user - scenario.group_numbers.index(group)


def _draws_of(
    key: NDArray[np.uint64], radio: LinkClasses, transmitter: int, user: int, cell: int
) -> Draws:
    """Return the draws of a link under a key of two words."""
    counter = sum(word % 2**64 << 64 * k for k, word in enumerate((cell, user, transmitter, 0)))
    words = np.random.Philox(
        key=sum(int(word) << 64 * k for k, word in enumerate(key)), counter=(counter - 1) % 2**256
    ).random_raw(3)
    normals = [NormalDist().inv_cdf(((int(word) >> 12) + 0.5) / 2**52) for word in words[1:]]
    shadows = (0.0, 0.0) if radio.shadowing is None else tuple(map(float, radio.shadowing))
    return Draws((int(words[0]) >> 11) / 2**53, shadows[0] * normals[0], shadows[1] * normals[1])


def possible_levels_dbm(
    world: World,
    key: NDArray[np.uint64],
    radio: LinkClasses,
    transmitter: int,
    user: int,
    ends: tuple[Position, Position],
) -> list[float]:
    """Return the levels that a link may have: one, or several where that is not certain.

    ``ends`` are the places of user and transmitter.
    """
    (ux, uy, uz), (x, y, z) = ends
    apart = math.hypot(x - ux, y - uy), z - uz
    levels_dbm, number = [], number_in_draws(world.scenario, user)
    for cell in _cells(world, x, y):
        draws = draws_of(key, radio, transmitter, user, cell, len(world.homes), number)
        for clear in _clear(world, radio, draws.uniform, ends):
            loss = radio.path_loss.los_db if clear else radio.path_loss.nlos_db
            extra_db = draws.los_db if clear else draws.nlos_db
            levels_dbm.append(radio.power_dbm - loss(*apart, radio.carrier_ghz) - extra_db)
    return levels_dbm


def _cells(world: World, x: float, y: float) -> list[int]:
    """Return the numbers of the cells that are at most TOUCH_M away from a place."""
    nx, ny = world.grid.cells
    dx, dy = world.grid.cell_m
    return [
        ix * ny + iy
        for ix in range(nx)
        for iy in range(ny)
        if _inside(x, ix, dx, nx) and _inside(y, iy, dy, ny)
    ]


def _inside(at: float, index: int, side_m: float, count: int) -> bool:
    low = index * side_m - TOUCH_M if index else -math.inf
    high = (index + 1) * side_m + TOUCH_M if index + 1 < count else math.inf
    return low <= at <= high


def _clear(
    world: World, radio: LinkClasses, uniform: float, ends: tuple[Position, Position]
) -> list[bool]:
    """Return whether a user sees a transmitter: one answer, or both where it is not certain."""
    if radio.line_of_sight == "buildings":
        city = world.grid.city
        if len(city):
            own = zip(city.pieces_m, city.roofs_m.tolist(), strict=True)
            return _answers(max(_cut_piece_m(piece, roof, ends) for piece, roof in own))
        height_m = world.grid.height_m
        built = [(cell, float(height_m[cell])) for cell in np.ndindex(height_m.shape)]
        cuts = [_cut_m(world, cell, roof, ends) for cell, roof in built if roof > 0.0]
        return _answers(max(cuts, default=-math.inf))
    (ux, uy, uz), (x, y, z) = ends
    elevation = math.degrees(math.atan2(z - uz, math.hypot(x - ux, y - uy)))
    turn = max(1e-5, math.degrees(TOUCH_M / max(math.dist(*ends), TOUCH_M)))
    answers = [uniform < radio.path_loss.p_los(elevation + by) for by in (-turn, turn)]
    return list(dict.fromkeys(answers))


def _answers(deepest_m: float) -> list[bool]:
    """Return whether a line is clear that could be moved by so much until it is: one answer or two.

    Below 0 it is clear.
    """
    return [deepest_m <= 0.0] if abs(deepest_m) > TOUCH_M else [False, True]


def _cut_piece_m(
    piece: NDArray[np.float64], roof_m: float, ends: tuple[Position, Position]
) -> float:
    """Return the same as ``_cut_m`` of a convex piece of a building, by its walls."""
    walls = np.roll(piece, -1, axis=0) - piece
    inwards = np.column_stack([-walls[:, 1], walls[:, 0]]) / np.hypot(*walls.T)[:, None]
    depths = [[*((np.array(end[:2]) - piece) * inwards).sum(axis=1), roof_m - end[2]]
              for end in ends]  # fmt: skip

    def cuts(by_m: float) -> bool:
        since, until = 0.0, 1.0
        for near, far in zip(*depths, strict=True):
            one, other = near - by_m, far - by_m
            if one <= 0.0 and other <= 0.0:
                return False
            if one < 0.0:
                since = max(since, one / (one - other))
            elif other < 0.0:
                until = min(until, one / (one - other))
        return since < until

    if not cuts(-TOUCH_M):
        return -math.inf
    return math.inf if cuts(TOUCH_M) else 0.0


def _cut_m(
    world: World, cell: tuple[int, ...], roof_m: float, ends: tuple[Position, Position]
) -> float:
    """Return by how much a line could be moved until a building no longer cuts it, about, in m.

    It is below 0 if the line passes the building, and then it is minus the distance.
    """
    first, last = np.array(ends[0]), np.array(ends[1])
    side = np.array(world.grid.cell_m)
    low = np.array([*(np.array(cell) * side), -math.inf])
    high = np.array([*((np.array(cell) + 1) * side), roof_m])

    def cuts(by_m: float) -> bool:
        """Whether the line cuts the building, each side of which is moved inwards by so much."""
        since, until = 0.0, 1.0
        for k in range(3):
            a, b = first[k], last[k] - first[k]
            near, far = low[k] + by_m, high[k] - by_m
            if b == 0.0:
                if not near < a < far:
                    return False
                continue
            one, other = sorted(((near - a) / b, (far - a) / b))
            since, until = max(since, one), min(until, other)
        return bool(since < until)

    if not cuts(-TOUCH_M):
        return -math.inf
    return math.inf if cuts(TOUCH_M) else 0.0
