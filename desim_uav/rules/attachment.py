"""Attachment of users: each covered user is attached to exactly one of the drones that cover it."""

from __future__ import annotations

from desim_uav.model.services import SHARING
from desim_uav.rowcode.kernels import rule
from desim_uav.rules.links import count_handover, unsettle
from desim_uav.rules.migration import follow
from desim_uav.rules.note import note
from desim_uav.rules.rows import Constants, Drone, State, User
from desim_uav.rules.service import count_attached, scan_if_used, stop, wait
from desim_uav.rules.stages import leave
from desim_uav.rules.stores import give_room_back
from desim_uav.rules.tasks import offload_again
from desim_uav.rules.words import ON_ATTACH, ON_DETACH


@rule
def attach(world: Constants, state: State, drone: Drone, user: User, phase: int) -> None:
    """Attach a user to a drone; if the user has an open request, it joins the drone's queue."""
    now_us = state.now_us
    user.holder = drone.index
    user.held_since_us = now_us
    state.attached_from_us += now_us
    drone.attached_users += 1
    if state.keeps_credit:
        drone.credit.held_us -= now_us
    note(state, phase, ON_ATTACH, drone.index, user.index, -1, -1)
    if state.keeps_links:
        count_handover(state, drone, user, phase)
        unsettle(state, user)
    if user.request.number >= 0:
        if state.keeps_tasks:
            offload_again(world, state, user, phase)
            follow(world, state, drone, user, phase)
        wait(world, state, drone, user)


@rule
def detach(state: State, drone: Drone, user: User, phase: int) -> None:
    """Detach a user from its drone, which stops serving it; a task at a processor goes on there.

    A user whom other drones still cover becomes loose: ``settle`` attaches it to one of them.
    """
    if user.request.number >= 0:
        count_attached(state, user)
        if user.request.line <= SHARING:
            served = user.request.server >= 0
            if served:
                stop(state, user, phase)
            leave(state, drone, user)
            if served or user.request.line == SHARING:
                scan_if_used(state, drone)
    state.attached_us += state.now_us - user.held_since_us
    if state.keeps_sensors:
        state.sensors[user.index].attached_us += state.now_us - user.held_since_us
        give_room_back(state, drone, user)
    state.attached_from_us -= user.held_since_us
    user.holder = -1
    if state.keeps_links:
        links = state.links[user.index]
        links.left, links.left_us = drone.index, state.now_us
        unsettle(state, user)
    drone.attached_users -= 1
    if state.keeps_credit:
        drone.credit.held_us += state.now_us
    note(state, phase, ON_DETACH, drone.index, user.index, -1, -1)
    if user.covered > 0:
        state.loose.append(user.index)


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
