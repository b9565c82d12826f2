"""Attachment of users: each covered user is attached to exactly one of the drones that cover it."""

from __future__ import annotations

from desim_uav.model.compiled_rows import call
from desim_uav.model.kernels import rule
from desim_uav.rules.due import due, key, nothing_before, settle_slot
from desim_uav.rules.note import note
from desim_uav.rules.rows import Constants, Drone, Path, State, User
from desim_uav.rules.service import count_attached, scan_later, stop, wait
from desim_uav.rules.words import ATTACHMENT, ON_ATTACH, ON_DETACH


@rule
def attach(state: State, drone: Drone, user: User, phase: int) -> None:
    """Attach a user to a drone; if the user has an open request, it joins the drone's queue."""
    now_us = state.now_us
    user.holder = drone.index
    user.held_since_us = now_us
    state.attached_from_us += now_us
    drone.attached_users += 1
    note(state, phase, ON_ATTACH, drone.index, user.index, -1, -1)
    if user.request.number >= 0:
        wait(state, drone, user)
        scan_later(state, drone)


@rule
def detach(state: State, drone: Drone, user: User, phase: int) -> None:
    """Detach a user from its drone, which stops serving it.

    A user whom other drones still cover becomes loose: ``settle`` attaches it to one of them.
    """
    if user.request.number >= 0:
        count_attached(state, user)
        if user.request.server < 0:
            drone.waiting.remove(user.index)
        else:
            stop(state, user, phase)
            if len(drone.waiting) > 0:
                scan_later(state, drone)
    state.attached_us += state.now_us - user.held_since_us
    state.attached_from_us -= user.held_since_us
    user.holder = -1
    drone.attached_users -= 1
    note(state, phase, ON_DETACH, drone.index, user.index, -1, -1)
    if user.covered > 0:
        state.loose.append(user.index)


@rule
def settle_after(world: Constants, path: Path, state: State, phase: int) -> None:
    """Schedule ``settle`` for the attachment phase of this instant, if there is anything to settle.

    It is called at once if no other event of the instant comes before. After ``phase`` 7, nothing
    is scheduled: commands are followed by a call of their own (see ``rules.episode.command``).
    """
    if phase <= ATTACHMENT and (len(state.loose) > 0 or state.to_scan > 0):
        place = key(ATTACHMENT, -1, -1)
        if nothing_before(state, place):
            settle(world, path, state, ATTACHMENT, ATTACHMENT)
        else:
            due(state, settle_slot(state), state.now_us, place)


@rule
def settle(world: Constants, path: Path, state: State, attachment: int, admission: int) -> None:
    """Attach loose users; then let the affected drones admit requests from their queues.

    A user is attached to the drone whose footprint it entered first. ``attachment`` and
    ``admission`` are the phases under which the two are logged.
    """
    loose = state.loose
    for k in range(len(loose)):
        user = state.users[loose[k]]
        if user.holder < 0:
            first = entered_first(user)
            if first >= 0:
                attach(state, state.drones[first], user, attachment)
    loose.clear()
    d = 0
    while state.to_scan > 0:
        drone = state.drones[d]
        if drone.scan:
            drone.scan = 0
            state.to_scan -= 1
            call(world.scan, (world, path, state, drone, admission))
        d += 1


@rule
def entered_first(user: User) -> int:
    """Return the index of the drone whose footprint a user entered first (ties: lowest), or -1."""
    first, first_us, d, left = -1, -1, 0, user.covered
    while left > 0:
        entered_us = user.covering[d]
        if entered_us >= 0:
            left -= 1
            if first < 0 or entered_us < first_us:
                first, first_us = d, entered_us
        d += 1
    return first
