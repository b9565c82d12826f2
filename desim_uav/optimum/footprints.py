"""The users in the footprint over each cell, if users stand still, and the drones' places."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from desim_uav.errors import UsageError
from desim_uav.model.geometry.coverage import SEEN_ROWS, DroneLeg, Users, look_around
from desim_uav.model.geometry.crossings import crossings
from desim_uav.model.geometry.relative import Change
from desim_uav.model.mobility.mobility import Static
from desim_uav.model.motion.motion import REST, TransitLeg
from desim_uav.model.motion.planner import Node
from desim_uav.model.rules import MOVES, Action
from desim_uav.optimum.paper_model import refuse_other_models
from desim_uav.registry import kind_name
from desim_uav.rowcode.views import zeros
from desim_uav.world import World

LARGEST = 2 * 10**8
"""The largest number of pairs of a cell and a user that are examined."""


class Footprints:
    """The footprint of a drone over users who never move, by the engine's own test.

    Raises ScenarioError if the model is not the paper's, and UsageError if users move.
    """

    def __init__(self, world: World) -> None:
        refuse_other_models(world.scenario)
        refuse_walks(world)
        self.world = world
        users = len(world.homes)
        self.users = Users(*world.walks(world.seed, 0), np.zeros((SEEN_ROWS, users)))
        self._buffer = zeros(Change, 4 * len(world.homes) + 4)

    def held(self, centre_m: tuple[float, float]) -> NDArray[np.int64]:
        """Return the users in the footprint of a drone that hovers over a point."""
        over = TransitLeg(REST, centre_m, centre_m, 0.0, 0.0)
        users: NDArray[np.int64] = self._crossings(over, 0)["user"].astype(np.int64)
        return users

    def sets_along(self, leg: TransitLeg, span_us: int) -> set[int]:
        """Return the largest sets of users in the footprint during a leg, user u as bit u.

        Users who enter and leave in the same microsecond all count as covered at once.
        """
        crossings = self._crossings(leg, span_us)
        order = np.lexsort((-crossings["change"], crossings["t_us"]))
        users, grown, largest = 0, False, set()
        for _, user, enters in crossings[order].tolist():
            if grown and not enters:
                largest.add(users)
            users ^= 1 << user
            grown = bool(enters)
        largest.add(users)
        return largest

    def _crossings(self, leg: TransitLeg, span_us: int) -> Any:
        """Return the entries and exits of a leg; users inside at its start enter then."""
        look_around(self.users, 0, span_us)
        route = (*leg.from_m, *leg.to_m)
        radius_m = self.world.only_type.drones.footprint_radius_m
        flown = DroneLeg(leg.transit.rows, route, (0, span_us), radius_m, fresh=True)
        count = crossings(flown, self.users, self._buffer)
        if count > len(self._buffer):
            self._buffer = zeros(Change, 2 * count)
            return self._crossings(leg, span_us)
        return self._buffer[:count].copy()

    def by_cell(self) -> NDArray[np.bool_]:
        """Return (nx, ny, users): whether a drone over the middle of a cell covers a user."""
        nx, ny = self.world.grid.cells
        users = len(self.world.homes)
        if nx * ny * users > LARGEST:
            raise UsageError(
                f"map.cells: {nx * ny} cells times {users} users are too many pairs (more than "
                f"{LARGEST})"
            )
        covered = np.zeros((nx, ny, users), np.bool_)
        for ix in range(nx):
            for iy in range(ny):
                covered[ix, iy, self.held(self.world.grid.centre(ix, iy))] = True
        return covered


def refuse_walks(world: World) -> None:
    """Raise UsageError if users move."""
    for group in world.user_groups:
        if type(group.mobility) is not Static:
            raise UsageError(
                f"{'.'.join(map(str, group.path))}.mobility: the best cells can be computed for "
                f"static users only, not for {kind_name(group.mobility)!r}"
            )


def moves(world: World) -> list[TransitLeg]:
    """Return the moves of serving drones between neighbouring cells, in one direction each."""
    grid, legs = world.grid, {}
    for ix, iy, level in flown_to(world):
        for action in (Action.FORWARD, Action.RIGHT):
            dx, dy, _ = MOVES[action]
            if grid.can_enter(ix + dx, iy + dy, level):
                ends = grid.centre(ix, iy), grid.centre(ix + dx, iy + dy)
                legs[ends] = TransitLeg(world.only_type.epoch_transits[action], *ends, 0.0, 0.0)
    return list(legs.values())


def flown_to(world: World) -> list[Node]:
    """Return the places under the ceiling that drones can reach from their starts, in order."""
    grid = world.grid
    reached = {(*cell, 0) for cell in world.starts}
    frontier = list(reached)
    while frontier:
        ix, iy, level = frontier.pop()
        for dx, dy, dz in MOVES.values():
            there = (ix + dx, iy + dy, level + dz)
            if there not in reached and grid.can_enter(*there):
                reached.add(there)
                frontier.append(there)
    return sorted(reached)
