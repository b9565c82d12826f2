"""The stores of drones, in which updates that are delivered at the ground are carried there.

A drone takes an update only if there is room for the whole of it, which is promised to its sender
as long as the update stands in the drone's line.
"""

from __future__ import annotations

from desim_uav.rowcode.kernels import apart, rule
from desim_uav.rules.battery import type_of
from desim_uav.rules.rows import Constants, Drone, State, User
from desim_uav.rules.stages import scan_later


@apart
def finds_room(world: Constants, state: State, drone: Drone, user: User) -> bool:
    """Return whether a drone's store has room for a user's update, which is promised to it then.

    What is not delivered at the ground needs no room, nor does what access points receive.
    """
    if len(drone.freight) == 0 or drone.point >= 0 or world.senses[user.index] < 0:
        return True
    if not world.updates[world.senses[user.index]].ground:
        return True
    freight, size = drone.freight[user.index], user.request.required
    if freight.promised == 0:
        if not has_room(world, drone, size):
            drone.crowded, drone.full_ubit = 1, max(drone.full_ubit, drone.stored_ubit)
            return False
        freight.promised = size
        drone.stored_ubit += size
    return True


@rule
def has_room(world: Constants, drone: Drone, size: int) -> bool:
    """Return whether a drone's store has room for so many millionths of a bit more.

    The stores of access points are not limited.
    """
    return drone.point >= 0 or drone.stored_ubit + size <= type_of(world, drone).store_ubit


@rule
def give_room_back(state: State, drone: Drone, user: User) -> None:
    """Give back the room that a drone has promised to a user, so that others may have it."""
    if len(drone.freight) > 0 and drone.freight[user.index].promised > 0:
        drone.stored_ubit -= drone.freight[user.index].promised
        drone.freight[user.index].promised = 0
        if drone.crowded and drone.serving:
            scan_later(state, drone)


@rule
def empty_store(drone: Drone) -> None:
    """Empty a drone's store, and take back all promises."""
    for u in range(len(drone.freight)):
        freight = drone.freight[u]
        freight.count = freight.fresh_us = freight.promised = freight.before_us = 0
    drone.store.clear()
    drone.stored_ubit = drone.full_ubit = drone.crowded = 0
