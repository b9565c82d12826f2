"""The users whom a drone covers in a step, for every leg that it can fly and every step of a run.

A leg begins over the middle of a cell and ends there or over a neighbouring cell. Levels and
buildings are left out: whatever a drone flies, its flight over the map is one of these legs. A
share is the part of a step for which a user is in the footprint of a drone on a leg, whose times of
entry and exit are those that the engines compute.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from desim_uav.drone_type import DroneType
from desim_uav.errors import UsageError
from desim_uav.model.geometry.coverage import SEEN_ROWS, DroneLeg, Users, look_around
from desim_uav.model.geometry.crossings import crossings
from desim_uav.model.geometry.grid import Grid
from desim_uav.model.geometry.relative import Change
from desim_uav.model.mobility.walks import Walks
from desim_uav.model.motion.motion import REST, PieceRow
from desim_uav.model.rules import MOVES, Action
from desim_uav.rowcode.kernels import maker
from desim_uav.rowcode.rows import Table
from desim_uav.rowcode.views import zeros
from desim_uav.world import World

HEADINGS = (Action.HOVER, Action.FORWARD, Action.BACKWARD, Action.RIGHT, Action.LEFT)
"""The legs from a cell, in the order of the last dimension of tables of legs."""

LEGS = len(HEADINGS)

LARGEST = 2 * 10**7
"""The largest number of pairs of a leg and a user that are examined for a step."""

MOST_SHARES = 3 * 10**7
"""The largest number of shares that are kept for a run."""


class Shares(NamedTuple):
    """The users whom legs cover, and the share of the step for which each is covered.

    Those of leg i are ``users[j]`` and ``shares[j]`` for j in ``first[i]:first[i + 1]``. The legs
    are those of step 0 from cell 0, then from cell 1, and so on. There are ``steps`` steps, which
    recur: if users stand still, one step is kept for all.
    """

    first: NDArray[np.int64]
    users: NDArray[np.int32]
    shares: NDArray[np.float64]
    steps: int


@maker
def leg_of(shares: Shares, t: int, cell: int) -> int:
    """Return the number of the first leg from a cell in a step."""
    legs = (len(shares.first) - 1) // shares.steps
    return (t % shares.steps) * legs + cell * LEGS


def cells_ahead(grid: Grid) -> NDArray[np.int64]:
    """Return the cell to which each leg leads, (cells, 5), or -1 if that is off the map."""
    nx, ny = grid.cells
    ahead = np.full((nx * ny, len(HEADINGS)), -1)
    for ix in range(nx):
        for iy in range(ny):
            for k, heading in enumerate(HEADINGS):
                dx, dy, _ = MOVES.get(heading, (0, 0, 0))
                if 0 <= ix + dx < nx and 0 <= iy + dy < ny:
                    ahead[ix * ny + iy, k] = (ix + dx) * ny + iy + dy
    return ahead


def shares_of(
    world: World,
    kind: DroneType,
    episodes: Sequence[Walks],
    steps: int,
    on_episode: Callable[[], None],
) -> Shares:
    """Return the shares of ``steps`` steps of each episode for drones of a type.

    The users of the episodes walk as given.

    Raises UsageError if there are too many.
    """
    nx, ny = world.grid.cells
    ahead, users = cells_ahead(world.grid), len(world.homes)
    if ahead.size * users > LARGEST:
        raise UsageError(
            f"map.cells: {nx * ny} cells, 5 legs from each, times {users} users are too many pairs "
            f"(more than {LARGEST})"
        )
    centres = np.array([world.grid.centre(ix, iy) for ix in range(nx) for iy in range(ny)])
    profiles = tuple(
        kind.epoch_transits[heading].rows if heading in kind.epoch_transits else REST.rows
        for heading in HEADINGS
    )
    radius_m, dense = kind.drones.footprint_radius_m, np.zeros((*ahead.shape, users))
    buffer, sizes, total = zeros(Change, 8 * users + 8), [np.zeros(1, np.int64)], 0
    numbers: list[NDArray[np.int32]] = []
    shares: list[NDArray[np.float64]] = []
    for walks in episodes:
        walkers = Users(*walks, np.zeros((SEEN_ROWS, users)))
        for step in range(steps):
            span = (step * world.step_us, (step + 1) * world.step_us)
            while (
                most := _cover(walkers, profiles, centres, ahead, span, radius_m, buffer, dense)
            ) > len(buffer):
                buffer = zeros(Change, most)
            _, _, covered = np.nonzero(dense)
            total += len(covered)
            if total > MOST_SHARES:
                raise UsageError(
                    f"users.count: {users} users over {nx * ny} cells have more than {MOST_SHARES} "
                    "shares of steps in this run; bound fewer episodes"
                )
            sizes.append(np.count_nonzero(dense, axis=2).reshape(-1))
            numbers.append(covered.astype(np.int32))
            shares.append(dense[dense > 0.0])
        on_episode()
    first = np.cumsum(np.concatenate(sizes))
    return Shares(first, np.concatenate(numbers), np.concatenate(shares), steps * len(episodes))


@maker
def _cover(
    walkers: Users,
    profiles: tuple[Table[PieceRow], ...],
    centres: NDArray[np.float64],
    ahead: NDArray[np.int64],
    span: tuple[int, int],
    radius_m: float,
    buffer: Table[Change],
    shares: NDArray[np.float64],
) -> int:
    """Write the share (cells, 5, users) for which each leg covers each user in a span.

    Returns the largest number of crossings of a leg; if ``buffer`` has fewer rows, it is too small.
    """
    shares[:] = 0.0
    begin_us, end_us = span
    look_around(walkers, begin_us, end_us)
    most = 0
    for cell in range(len(ahead)):
        for k in range(ahead.shape[1]):
            to = ahead[cell, k]
            if to < 0:
                continue
            route = (centres[cell, 0], centres[cell, 1], centres[to, 0], centres[to, 1])
            leg = DroneLeg(profiles[k], route, span, radius_m, True, 0.0)
            count = crossings(leg, walkers, buffer)
            most = max(most, count)
            if count > len(buffer):
                continue
            for row in range(count):
                one = buffer[row]
                left = (end_us - one.t_us) / (end_us - begin_us)
                shares[cell, k, one.user] += left if one.change else -left
            for user in range(shares.shape[2]):
                shares[cell, k, user] = max(0.0, shares[cell, k, user])
    return most
