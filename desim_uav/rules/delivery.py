"""How what is in the store of a sender comes to the ground: over its backhaul, or by landing.

A backhaul delivers the updates one after the other, in the order in which they were received, at
the rate that the links leave of it. A drone that lands on a station delivers all that it still has,
and one that crashes loses it.
"""

from __future__ import annotations

from desim_uav.rowcode.kernels import apart, rule
from desim_uav.rules import words
from desim_uav.rules.ages import deliver, let_fall, log_update
from desim_uav.rules.backhaul import for_store_bps, has_one
from desim_uav.rules.due import due, key, undo, upload_slot
from desim_uav.rules.note import note
from desim_uav.rules.rows import Constants, Drone, State, Update, User
from desim_uav.rules.stages import scan_later
from desim_uav.rules.stores import copy_update, empty_store


@rule
def store(world: Constants, state: State, drone: Drone, user: User, update: Update) -> None:
    """Put an update into the store of the sender that has received it; its place was promised."""
    freight = drone.freight[user.index]
    freight.count += 1
    freight.fresh_us = max(freight.fresh_us, update.generated_us)
    freight.promised = 0
    if state.keeps_requests or state.keeps_events or has_one(world, drone):
        copy_update(drone.store.added(), update)
    drone.upload.under_way = int(has_one(world, drone))


# ---- over the backhaul


@apart
def send_stored(world: Constants, state: State, drone: Drone) -> None:
    """Send the first update in a sender's store at the rate that its links leave now."""
    upload, rate = drone.upload, for_store_bps(state, drone)
    if rate != upload.rate:
        upload.done += (state.now_us - upload.counted_us) * upload.rate
        upload.rate, upload.counted_us = rate, state.now_us
        _await_delivery(world, state, drone)


@rule
def _await_delivery(world: Constants, state: State, drone: Drone) -> None:
    """Schedule the delivery of the first update in a sender's store, if it is sent now."""
    upload, slot, rate = drone.upload, upload_slot(state, drone.index), drone.upload.rate
    undo(state, slot)
    if rate > 0:
        lasts_us = (drone.store[upload.first].size - upload.done + rate - 1) // rate
        if state.now_us + lasts_us <= world.horizon_us:
            due(state, slot, state.now_us + lasts_us, key(words.COMPLETION, drone.index, -1))


@apart
def deliver_first(world: Constants, state: State, drone: Drone) -> None:
    """Deliver the first update in a sender's store, whose last bit has come to the ground.

    Its room is given back, and the next one is sent.
    """
    upload = drone.upload
    update = drone.store[upload.first]
    deliver(world, state, drone, update, words.COMPLETION)
    drone.freight[update.user].count -= 1
    drone.stored_ubit -= update.size
    _remove_first(drone)
    upload.done, upload.counted_us = 0, state.now_us
    if len(drone.store) > 0:
        _await_delivery(world, state, drone)
    else:
        upload.under_way = upload.rate = 0
    if drone.crowded and drone.serving:
        scan_later(state, drone)


@rule
def _remove_first(drone: Drone) -> None:
    """Remove the first update in a store.

    The rest moves to the front when it is not more than what has been removed, so that each update
    moves once at most, on average.
    """
    store, upload = drone.store, drone.upload
    upload.first += 1
    left = len(store) - upload.first
    if left <= upload.first:
        for k in range(left):
            copy_update(store[k], store[upload.first + k])
        for _ in range(upload.first):
            store.pop()
        upload.first = 0


# ---- by landing, or not at all


@apart
def unload(world: Constants, state: State, drone: Drone, phase: int) -> None:
    """Deliver all updates in a drone's store, as it has landed on a station.

    The age of a sensor falls once, to that of the freshest one.
    """
    for u in range(len(drone.freight)):
        freight, sensor = drone.freight[u], state.sensors[u]
        if freight.count > 0:
            freight.before_us = let_fall(world, state, drone, state.users[u], freight.fresh_us)
            sensor.delivered += freight.count
    for k in range(drone.upload.first, len(drone.store)):
        update = drone.store[k]
        note(state, phase, words.ON_DELIVER, drone.index, update.user, -1, update.number)
        after_us = state.now_us - state.sensors[update.user].fresh_us
        before_us = drone.freight[update.user].before_us
        log_update(state, update, words.DELIVERED, before_us, after_us)
    empty_store(state, drone)


@apart
def lose_updates(world: Constants, state: State, drone: Drone) -> None:
    """Lose all updates in the store of a drone that has crashed."""
    for u in range(len(drone.freight)):
        state.sensors[u].lost += drone.freight[u].count
    for k in range(drone.upload.first, len(drone.store)):
        update = drone.store[k]
        note(state, words.DEPLETION, words.ON_LOSE, drone.index, update.user, -1, update.number)
        log_update(state, update, words.LOST_IN_CRASH, -1, -1)
    empty_store(state, drone)
