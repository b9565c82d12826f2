"""The stores of drones, in which updates wait that are delivered at the ground.

A drone takes an update only if there is room for the whole of it, which is promised to its sender
as long as the update stands in the drone's line.
"""

from __future__ import annotations

from desim_uav.rowcode.kernels import apart, rule
from desim_uav.rules import words
from desim_uav.rules.backhaul import has_one
from desim_uav.rules.battery import type_of
from desim_uav.rules.due import undo, upload_slot
from desim_uav.rules.rows import Constants, Drone, State, Update, User
from desim_uav.rules.stages import scan_later


@rule
def is_stored(world: Constants, drone: Drone, user: User) -> bool:
    """Return whether a sender puts a user's updates into its store, to bring them to the ground.

    Access points are there already, unless what they receive has to pass over a backhaul.
    """
    if len(drone.freight) == 0 or world.senses[user.index] < 0:
        return False
    ground = world.updates[world.senses[user.index]].ground
    return bool(ground and (drone.point < 0 or has_one(world, drone)))


@apart
def finds_room(world: Constants, state: State, drone: Drone, user: User) -> bool:
    """Return whether a drone's store has room for a user's update, which is promised to it then.

    What does not go into the store needs no room.
    """
    if not is_stored(world, drone, user):
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

    The stores of access points hold as much as those of drones that have no limit.
    """
    most = words.NEVER if drone.point >= 0 else type_of(world, drone).store_ubit
    return drone.stored_ubit + size <= most


@rule
def give_room_back(state: State, drone: Drone, user: User) -> None:
    """Give back the room that a drone has promised to a user, so that others may have it."""
    if len(drone.freight) > 0 and drone.freight[user.index].promised > 0:
        drone.stored_ubit -= drone.freight[user.index].promised
        drone.freight[user.index].promised = 0
        if drone.crowded and drone.serving:
            scan_later(state, drone)


@rule
def empty_store(state: State, drone: Drone) -> None:
    """Empty a drone's store, and take back all promises."""
    upload = drone.upload
    if upload.under_way:
        undo(state, upload_slot(state, drone.index))
    upload.under_way = upload.first = upload.done = upload.rate = upload.counted_us = 0
    for u in range(len(drone.freight)):
        freight = drone.freight[u]
        freight.count = freight.fresh_us = freight.promised = freight.before_us = 0
    drone.store.clear()
    drone.stored_ubit = drone.full_ubit = drone.crowded = 0


@rule
def copy_update(to: Update, update: Update) -> None:
    """Copy an update."""
    to.number, to.user, to.generated_us = update.number, update.user, update.generated_us
    to.attached_us, to.size, to.bps = update.attached_us, update.size, update.bps
    to.request, to.sent_us, to.received_us = update.request, update.sent_us, update.received_us
    to.drone = update.drone
