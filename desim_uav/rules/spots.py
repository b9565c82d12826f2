"""Where users are at a decision epoch, for observations that show users beyond the footprint."""

from __future__ import annotations

from typing import Any

from desim_uav.model.geometry.grid import cell_index
from desim_uav.rowcode.kernels import apart, rule
from desim_uav.rules.requests import doing, done_share
from desim_uav.rules.rows import Constants, Path, Spot, State, User
from desim_uav.rules.words import OPEN


def find_users(world: Any, path: Any, state: Any) -> None:
    """Write the places at which the users are now into ``state.spots``.

    The compiled engine has a function of its own in the place of this one.
    """
    state.find_users()


@rule
def locate(world: Constants, path: Path, state: State) -> None:
    """Write where all users are now and what they do, if the observation maps users.

    The users of a cell are listed in the order of their indices.
    """
    if len(state.spots) > 0:
        _locate(world, path, state)


@apart
def _locate(world: Constants, path: Path, state: State) -> None:
    """Write where all users are now and what they do (see ``locate``)."""
    spots, firsts = state.spots, state.firsts
    find_users(world, path, state)
    for cell in range(len(firsts)):
        firsts[cell] = -1
    for user in range(len(spots) - 1, -1, -1):
        spot = spots[user]
        x = cell_index(spot.x_m, world.cell_x_m, world.nx)
        y = cell_index(spot.y_m, world.cell_y_m, world.ny)
        spot.cell = x * world.ny + y
        spot.following = firsts[spot.cell]
        firsts[spot.cell] = user
        _note_state(state, spot, state.users[user])


@rule
def _note_state(state: State, spot: Spot, user: User) -> None:
    """Write to which sender a user is attached, what it does, and what its request still needs."""
    spot.holder, spot.doing, spot.left = user.holder, doing(user), 0.0
    if spot.doing >= OPEN:
        spot.left = 1.0 - done_share(state, user)
