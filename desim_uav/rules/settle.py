"""The end of an instant: users are attached, and drones divide their bandwidth."""

from __future__ import annotations

from desim_uav.rowcode.compiled_rows import call
from desim_uav.rowcode.kernels import apart, rare_rule, rule
from desim_uav.rules.association import settle_levels
from desim_uav.rules.attachment import attach, entered_first
from desim_uav.rules.backhaul import divide
from desim_uav.rules.bands import (
    BOTH,
    DOWN,
    UP,
    count_sharing,
    is_used,
    lacks_bandwidth,
    show_band,
)
from desim_uav.rules.battery import type_of
from desim_uav.rules.classes import retune
from desim_uav.rules.delivery import send_stored
from desim_uav.rules.due import due, key, nothing_before, settle_slot
from desim_uav.rules.links import unsettle
from desim_uav.rules.migration import move
from desim_uav.rules.power import power
from desim_uav.rules.rows import Constants, Drone, Path, State, User
from desim_uav.rules.service import suspend
from desim_uav.rules.stages import scan_later
from desim_uav.rules.updates import offer_room
from desim_uav.rules.words import ATTACHMENT


@rule
def settle_after(world: Constants, path: Path, state: State, phase: int) -> None:
    """Schedule ``settle`` for the attachment phase of this instant, if there is anything to settle.

    It is the last event of this phase, so that all of an instant is settled together. It is called
    at once if no other event of the instant comes before. After ``phase`` 7, nothing is scheduled:
    commands are followed by a call of their own (see ``rules.episode.command``).
    """
    if phase <= ATTACHMENT and _is_unsettled(state):
        place = key(ATTACHMENT + 1, -1, -1) - 1
        if nothing_before(state, place):
            _settle_all(world, path, state, ATTACHMENT, ATTACHMENT)
        else:
            due(state, settle_slot(state), state.now_us, place)


@rule
def settle(world: Constants, path: Path, state: State, attachment: int, admission: int) -> None:
    """Attach loose users; then let the affected drones divide their bandwidth among requests.

    ``attachment`` and ``admission`` are the phases under which the two are logged. Before
    this, the links of drones whose interference has changed pass to new classes, and unsettled
    users are handed over to drones that they receive better.
    """
    if _is_unsettled(state):
        _settle_all(world, path, state, attachment, admission)


@rule
def _is_unsettled(state: State) -> bool:
    """Return whether there is anything to settle."""
    if len(state.loose) > 0 or state.to_scan > 0:
        return True
    return bool(state.keeps_links and _links_change(state))


@rare_rule
def _links_change(state: State) -> bool:
    """Return whether there are links whose levels or classes have to be looked at."""
    return bool(len(state.unsettled) > 0 or state.retunes)


@rare_rule
def _settle_all(
    world: Constants, path: Path, state: State, attachment: int, admission: int
) -> None:
    """Settle what there is to settle (see ``settle``)."""
    if state.keeps_links:
        _settle_links(world, path, state, attachment)
    loose = state.loose
    for k in range(len(loose)):
        user = state.users[loose[k]]
        if user.holder < 0:
            first = entered_first(user)
            if first >= 0:
                attach(world, state, state.senders[first], user, attachment)
    loose.clear()
    if state.relays and state.to_scan > 0:
        _admit_first(world, path, state, attachment, admission)
    d = 0
    while state.to_scan > 0:
        drone = state.senders[d]
        if drone.scan:
            _make_ready(world, state, drone, attachment)
            drone.scan = 0
            state.to_scan -= 1
            _admit(world, path, state, drone, admission)
            if count_sharing(drone) > 0:
                divide(world, state, drone, admission)
            if state.keeps_tasks:
                _compute(world, state, drone, admission)
            if state.uploads and drone.upload.under_way:
                send_stored(world, state, drone)
        d = d + 1 if d + 1 < len(state.senders) else 0  # whoever is scanned may free a site


@rare_rule
def _compute(world: Constants, state: State, drone: Drone, phase: int) -> None:
    """Let a drone's processor divide its cycles, and tasks on their way to others their rates."""
    if drone.computes and len(drone.computing) > 0:
        call(world.processors[drone.radio].process, (world, state, drone, phase))
    if state.relays and len(drone.moving) > 0:
        move(world, state, drone, phase)
    power(world, state, drone)


@rule
def _admit(world: Constants, path: Path, state: State, drone: Drone, phase: int) -> None:
    """Let a drone admit requests that wait, to each of its bands."""
    show_band(drone, DOWN)
    call(type_of(world, drone).scan, (world, path, state, drone, phase))
    if drone.band != BOTH:
        show_band(drone, UP)
        call(type_of(world, drone).scan, (world, path, state, drone, phase))


@rule
def _make_ready(world: Constants, state: State, drone: Drone, attachment: int) -> None:
    """Suspend what a drone can no longer hold, and let in what its store has room for again."""
    if (state.keeps_links and lacks_bandwidth(drone)) or drone.free_bps < 0:
        suspend(world, state, drone, attachment)
    if state.keeps_sensors and drone.crowded and drone.stored_ubit < drone.full_ubit:
        offer_room(world, state, drone)


@apart
def _admit_first(
    world: Constants, path: Path, state: State, attachment: int, admission: int
) -> None:
    """Admit held rates at all drones before they share what is left, as results are relayed.

    What a drone holds decides on what is left for others, who therefore divide anew, too.
    """
    for d in range(len(state.senders)):
        drone = state.senders[d]
        if len(drone.moving) > 0:
            scan_later(state, drone)
        if not is_used(drone) and not drone.crowded:
            continue
        scan_later(state, drone)
        _make_ready(world, state, drone, attachment)
        _admit(world, path, state, drone, admission)


@apart
def _settle_links(world: Constants, path: Path, state: State, phase: int) -> None:
    """Find the classes of drones anew whose interference has changed, and compare levels."""
    if state.retunes:
        retune(world, path, state, phase)
    if state.by_level:
        settle_levels(world, path, state, phase)


@rare_rule
def on_turn(world: Constants, path: Path, state: State, user: User) -> None:
    """Do what is due for a user's rival, once no other event comes before it in this phase."""
    unsettle(state, user)
    settle_after(world, path, state, ATTACHMENT)
