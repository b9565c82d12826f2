"""Changes of class of users who stand still, which are known beforehand for all legs of a step."""

from __future__ import annotations

from desim_uav.rowcode.kernels import apart, rule
from desim_uav.rules.rows import Constants, Drone, Path, State

COURSES = ((0, 0), (0, 1), (0, -1), (1, 0), (-1, 0))
"""The directions of legs in the plane, in cells; ``_course`` returns the index of a direction."""


@rule
def at_home(world: Constants, path: Path) -> bool:
    """Return whether all users, who do not walk, are at their homes."""
    for user in range(len(world.homes)):
        home, leg = world.homes[user], path.legs[user]
        if leg.x_m != home.x_m or leg.y_m != home.y_m:
            return False
    return True


@apart
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
    ahead.take(world.known, first, count)
    for k in range(len(ahead)):
        ahead[k].t_us += state.now_us


@rule
def _course(dx: int, dy: int) -> int:
    if dx != 0:
        return 3 if dx > 0 else 4
    if dy != 0:
        return 1 if dy > 0 else 2
    return 0
