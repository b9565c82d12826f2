"""The whole state at a decision epoch as numbers, for learners that train centrally.

Every number is a share from 0 to 1, and their count does not depend on the world. They are, in this
order: the time left; the users in each ``UserState``; the open requests of each service; for each
drone its exact place (x, y, z), its mode (a 1 at the mode's place), its battery, its attached users
and, by service, the requests that it serves and those in its footprint; and for each region of the
map the users there, and then those of them whose requests wait. Users and requests are divided by
the number of users. The regions are those of a grid of at most REGIONS by REGIONS, by x, then y.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from desim_uav.model.geometry.grid import cell_index
from desim_uav.model.rules import Mode
from desim_uav.rowcode.kernels import rule
from desim_uav.rules import words
from desim_uav.rules.battery import capacity_of, is_limited
from desim_uav.rules.flight import position
from desim_uav.rules.requests import doing
from desim_uav.rules.rows import Constants, State

REGIONS = 10
"""The largest number of regions along x and along y."""

MODES, USER_STATES = len(Mode), 4


def names_of(drones: int, services: tuple[str, ...], cells: tuple[int, int]) -> list[str]:
    """Return the names of the numbers of a state, in their order."""
    states = ("idle", "attached", "waiting", "served")
    names = ["time_left", *(f"users_{name}" for name in states)]
    names += [f"open_{name}" for name in services]
    of_drone = ["x", "y", "z", *(f"mode_{mode.name.lower()}" for mode in Mode)]
    of_drone += ["battery", "attached", *(f"served_{name}" for name in services)]
    of_drone += [f"asking_{name}" for name in services]
    names += [f"drone_{d}_{name}" for d in range(drones) for name in of_drone]
    nx, ny = (min(count, REGIONS) for count in cells)
    for what in ("users", "waiting"):
        names += [f"{what}_{x}_{y}" for x in range(nx) for y in range(ny)]
    return names


@rule
def write_state(
    world: Constants, state: State, places: NDArray[np.float64], out: NDArray[np.float64]
) -> None:
    """Write the whole state into ``out``; ``places`` (users, 2) are the users' places in metres."""
    users, services = len(state.users), world.services
    out[0] = 1.0 - state.now_us / world.horizon_us
    at = 1 + USER_STATES
    for k in range(services):
        out[at + k] = state.asked[k] / users
    at += services
    for d in range(len(state.drones)):
        at = _write_drone(world, state, d, out, at)
    _write_users(world, state, places, out, at)


@rule
def _write_drone(world: Constants, state: State, d: int, out: NDArray[np.float64], at: int) -> int:
    """Write what concerns a drone from index ``at`` on; return the index after it."""
    observation, users = state.observations[d], len(state.users)
    drone = state.drones[d]
    x_m, y_m, z_m = position(world, state, drone)
    out[at], out[at + 1] = x_m / world.width_m, y_m / world.depth_m
    out[at + 2] = z_m / world.levels_m[world.levels - 1]
    at += 3
    for mode in range(MODES):
        out[at + mode] = 1.0 if observation.mode == mode else 0.0
    at += MODES
    out[at] = 1.0
    if is_limited(world, drone):
        out[at] = observation.charge / capacity_of(world, drone)
    out[at + 1] = observation.attached_users / users
    at += 2
    for count in range(2 * world.services):
        out[at + count] = state.counts[2 * world.services * d + count] / users
    return at + 2 * world.services


@rule
def _write_users(
    world: Constants, state: State, places: NDArray[np.float64], out: NDArray[np.float64], at: int
) -> None:
    """Count the users in each state, and those in each region, whose numbers begin at ``at``."""
    nx, ny, users = min(world.nx, REGIONS), min(world.ny, REGIONS), len(state.users)
    for k in range(USER_STATES):
        out[1 + k] = 0.0
    for k in range(2 * nx * ny):
        out[at + k] = 0.0
    ended = state.terminated or state.truncated
    for u in range(users):
        user = state.users[u]
        what = user.doing if ended else doing(user)
        out[1 + what] += 1.0
        x = cell_index(places[u, 0], world.width_m / nx, nx)
        y = cell_index(places[u, 1], world.depth_m / ny, ny)
        out[at + x * ny + y] += 1.0
        if what == words.OPEN:
            out[at + (nx + x) * ny + y] += 1.0
    for k in range(USER_STATES):
        out[1 + k] /= users
    for k in range(2 * nx * ny):
        out[at + k] /= users
