"""Requests: how they are opened, wait in a drone's queue, are served, and are closed."""

from __future__ import annotations

from desim_uav.model.services import SHARING
from desim_uav.rowcode.kernels import apart, rare_rule, rule
from desim_uav.rules import words
from desim_uav.rules.backhaul import ASKING, is_too_much, part_bps, reduced, relay_of
from desim_uav.rules.bands import BOTH, count_bands, is_used, show_band
from desim_uav.rules.credit import credit_service
from desim_uav.rules.due import ask_slot, completion_slot, due, key, undo
from desim_uav.rules.links import begin_outage, count_outage, end_outage
from desim_uav.rules.note import note
from desim_uav.rules.rows import Constants, Drone, Path, Request, State, User
from desim_uav.rules.stages import count_amounts, draw_values, hold_at_site, join, scan_later
from desim_uav.rules.stores import finds_room
from desim_uav.rules.tasks import (
    close_task,
    computes_alone,
    count_task,
    log_task,
    open_task,
    progress_of,
    stands_elsewhere,
)
from desim_uav.rules.wide import add_product

MILLION = 1_000_000


@rule
def wait(world: Constants, state: State, drone: Drone, user: User) -> None:
    """Let a user's request stand in a drone's line: by the time it was made, then by user.

    A task may stand at a processor instead, or wait for the link to another drone, and an update
    waits until there is room for it in the drone's store.
    """
    if state.keeps_tasks and stands_elsewhere(world, state, drone, user):
        return
    if state.keeps_sensors and not finds_room(world, state, drone, user):
        return
    user.request.needs_hz = needed_hz(world, drone, user, user.request.bandwidth_bps)
    join(state, drone, user)
    scan_later(state, drone)


@rule
def scan_if_used(state: State, drone: Drone) -> None:
    """Let a drone divide its bandwidth anew if there are requests that might get more of it.

    The updates in its store might get more of its backhaul.
    """
    if is_used(drone) or state.relays or drone.upload.under_way:
        scan_later(state, drone)


# ---- bandwidth and rates


@rule
def needed_hz(world: Constants, drone: Drone, user: User, bps: int) -> int:
    """Return the bandwidth in Hz that a rate needs in the class of a user's link, rounded up."""
    efficiency = efficiency_of(world, drone, user)
    if efficiency == MILLION:
        return bps
    return (bps * MILLION + efficiency - 1) // efficiency


@rule
def rate_bps(world: Constants, drone: Drone, user: User, bandwidth_hz: int) -> int:
    """Return the rate of a user's link over a bandwidth, in whole bit/s, rounded down."""
    return bandwidth_hz * efficiency_of(world, drone, user) // MILLION


@rule
def efficiency_of(world: Constants, drone: Drone, user: User) -> int:
    """Return how many millionths of a bit/s a user's link to a drone carries per hertz."""
    return world.radios[drone.radio].efficiencies[user.classes[drone.index]]


@rule
def fits(world: Constants, state: State, drone: Drone, user: User) -> bool:
    """Return whether a drone has what a user's waiting request needs: bandwidth, and backhaul."""
    request = user.request
    in_band = request.needs_hz <= drone.free_hz or world.radios[drone.radio].bandwidth_hz < 0
    site = relay_of(state, drone, user)
    if site >= 0 and request.bandwidth_bps > state.senders[site].free_bps:
        return False
    return in_band and request.bandwidth_bps <= drone.free_bps


@rule
def serve(world: Constants, state: State, drone: Drone, user: User, phase: int) -> None:
    """Begin to serve a user's request that holds the bandwidth it needs, and waits no longer."""
    request = user.request
    request.queued = 0
    drone.free_hz -= request.needs_hz
    _hold_bps(state, drone, user, request.bandwidth_bps)
    request.used_hz = request.needs_hz
    _begin(world, state, drone, user, phase)


@rule
def _hold_bps(state: State, drone: Drone, user: User, bps: int) -> None:
    """Let a user's request hold so much more of the backhaul of its drone, and of its site."""
    drone.free_bps -= bps
    if state.relays:
        hold_at_site(state, drone, user, bps)


@rule
def give_share(
    world: Constants, state: State, user: User, bandwidth_hz: int, bps: int, phase: int
) -> None:
    """Serve a user's request that shares bandwidth with a rate, or not at all if the rate is 0.

    ``bandwidth_hz`` is the part of the drone's bandwidth that it occupies. Both are less if the
    drone's backhaul cannot carry the sum of what is given (see ``rules.backhaul``).
    """
    drone = state.senders[user.holder]
    site = relay_of(state, drone, user)
    if site >= 0:
        bps = min(bps, part_bps(state.senders[site]))
    if drone.left_bps == ASKING:
        drone.proposed_bps += bps
        return
    if is_too_much(drone):
        bandwidth_hz = reduced(drone, bandwidth_hz)
        bps = min(reduced(drone, bps), drone.left_bps)  # a division may round up
        drone.left_bps -= bps
    give_rate(world, state, drone, user, bandwidth_hz, bps, phase)


@rule
def give_rate(
    world: Constants,
    state: State,
    drone: Drone,
    user: User,
    bandwidth_hz: int,
    rate: int,
    phase: int,
) -> None:
    """Let a drone serve a user's request at a rate, or not at all if the rate is 0.

    The rate is in units of the request's stage per microsecond, and ``bandwidth_hz`` is the part of
    the drone's bandwidth that it occupies.
    """
    request = user.request
    if request.server < 0:
        if rate > 0:
            request.used_hz, request.rate = bandwidth_hz, rate
            _begin(world, state, drone, user, phase)
    elif rate == 0:
        stop(state, user, phase)
    elif rate != request.rate or bandwidth_hz != request.used_hz:
        count_service(state, user)
        drone.used_hz += bandwidth_hz - request.used_hz
        request.used_hz, request.rate = bandwidth_hz, rate
        _await_completion(world, state, user)


@rule
def _begin(world: Constants, state: State, drone: Drone, user: User, phase: int) -> None:
    """Begin to serve a request with the rate and the bandwidth that it has been given."""
    request, now_us = user.request, state.now_us
    drone.used_hz += request.used_hz
    drone.served[request.service] += 1
    request.server = drone.index
    request.started_us = request.counted_us = now_us
    if not (state.keeps_tasks and computes_alone(state, user)):
        state.in_service += 1
        state.served_us -= now_us
    note(state, phase, words.ON_SERVE, drone.index, user.index, request.number, -1)
    _await_completion(world, state, user)


@rule
def _await_completion(world: Constants, state: State, user: User) -> None:
    """Schedule the completion of a request at its rate, if that is before the episode's end."""
    request, slot = user.request, completion_slot(state, user.index)
    left = request.required - request.done
    if request.rate != 1:
        left = (left + request.rate - 1) // request.rate
    if state.now_us + left <= world.horizon_us:
        place = key(words.COMPLETION, request.server, user.index)
        due(state, slot, state.now_us + left, place)
    else:
        undo(state, slot)


@rule
def count_service(state: State, user: User) -> None:
    """Count what has been done for a user's request since this was counted last."""
    request = user.request
    elapsed_us = state.now_us - request.counted_us
    request.counted_us = state.now_us
    request.served_us += elapsed_us
    request.done = min(request.done + elapsed_us * request.rate, request.required)
    add_product(state.bandwidth_us_hz, elapsed_us, request.used_hz)
    if state.keeps_tasks:
        count_task(state, user, elapsed_us)


@rule
def stop(state: State, user: User, phase: int) -> None:
    """Stop serving a user's request. A service of 0 µs is no interruption and no handover."""
    request, now_us = user.request, state.now_us
    drone = state.senders[request.server]
    if state.keeps_credit:
        credit_service(state, user)
    count_service(state, user)
    request.server = -1
    undo(state, completion_slot(state, user.index))
    if now_us > request.started_us:
        if request.t_first_us < 0:
            request.t_first_us = request.started_us
        elif request.started_us > request.stopped_us:
            request.interruptions += 1
        if request.last_server != drone.index:
            request.last_server = drone.index
            _log_handover(state, request)
        request.stopped_us = now_us
    if not (state.keeps_tasks and computes_alone(state, user)):
        state.in_service -= 1
        state.served_us += now_us
    user.share = progress_of(state, user, request.done)
    drone.used_hz -= request.used_hz
    if not request.queued:
        show_band(drone, request.up)
        drone.free_hz += request.used_hz
        _hold_bps(state, drone, user, -request.bandwidth_bps)
    drone.served[request.service] -= 1
    note(state, phase, words.ON_STOP, drone.index, user.index, request.number, -1)


@rare_rule
def regrade(world: Constants, state: State, drone: Drone, user: User) -> None:
    """Adapt the open request of a user to the class that the link to its drone has now.

    A rate that is held needs more bandwidth in a lower class. The sum may exceed the drone's until
    all changes of the instant have happened (see ``suspend``).
    """
    request = user.request
    show_band(drone, request.up)
    request.needs_hz = needed_hz(world, drone, user, request.bandwidth_bps)
    if request.server >= 0 and not request.queued:
        count_service(state, user)
        more_hz = request.needs_hz - request.used_hz
        drone.free_hz -= more_hz
        drone.used_hz += more_hz
        request.used_hz = request.needs_hz
        if drone.free_hz < 0:
            scan_later(state, drone)
    elif request.queued and request.line == SHARING:
        if drone.regraded > 0 and drone.regraded != user.index + 1:
            drone.shared_hz = 0
        drone.regraded = user.index + 1
    scan_if_used(state, drone)


@apart
def suspend(world: Constants, state: State, drone: Drone, phase: int) -> None:
    """Let the requests that a drone admitted last wait until the others fit.

    They have to fit into its bandwidth, each into that of its band, and into its backhaul.
    """
    for band in range(count_bands(drone)):
        show_band(drone, band)
        while drone.free_hz < 0 <= world.radios[drone.radio].bandwidth_hz:
            _suspend_last(world, state, drone, drone.band, phase)
    while drone.free_bps < 0:
        _suspend_last(world, state, drone, BOTH, phase)


@rule
def _suspend_last(world: Constants, state: State, drone: Drone, band: int, phase: int) -> None:
    """Let the request that a drone admitted last wait, of those in a band or in BOTH."""
    last = _admitted_last(state, drone, band)
    stop(state, last, phase)
    wait(world, state, drone, last)


@rule
def _admitted_last(state: State, drone: Drone, band: int) -> User:
    """Return the user whose held request a drone has begun to serve last, in a band or in BOTH.

    Of several, it is the one that was made last (ties: the highest user's), because a drone admits
    the requests of an instant in the order in which they were made.
    """
    last = -1
    for u in range(len(state.users)):
        request = state.users[u].request
        if request.server != drone.index or request.queued:
            continue
        if band in (BOTH, request.up):
            before = state.users[max(last, 0)].request
            later = request.started_us > before.started_us or (
                request.started_us == before.started_us
                and request.t_request_us >= before.t_request_us
            )
            if last < 0 or later:
                last = u
    return state.users[last]


# ---- requests


@rule
def forget_request(request: Request) -> None:
    """Reset a user's request to that of a user who has not asked for anything yet."""
    request.number = request.server = -1
    request.service = request.t_request_us = request.required = request.done = request.rate = 0
    request.stage = request.stages = request.line = request.queued = request.bandwidth_bps = 0
    request.up = request.needs_hz = request.used_hz = request.served_us = request.attached_us = 0
    request.interruptions = request.t_first_us = request.started_us = request.counted_us = 0
    request.stopped_us = request.last_server = 0


@rule
def open_request(world: Constants, path: Path, state: State, user: User, number: int) -> None:
    """Open a user's request as row ``number`` of the sample path's requests describes it."""
    user.request.service = path.services[number]
    draw_values(world, path, state, user, number)
    begin_request(world, state, user, state.now_us)


@rule
def begin_request(world: Constants, state: State, user: User, t_request_us: int) -> None:
    """Begin to keep a user's request, of which service and values are known already."""
    request = user.request
    request.number = state.opened
    request.t_request_us = t_request_us
    request.queued = request.served_us = request.attached_us = request.interruptions = 0
    request.t_first_us = request.started_us = request.stopped_us = -1
    request.server = request.last_server = -1
    state.opened += 1
    state.open_us -= t_request_us
    state.open_requests[request.service] += 1
    count_asking(state, user, 1)
    if state.keeps_links:
        begin_outage(state, user, words.REQUEST)
    if state.keeps_tasks:
        open_task(world, state, user)


@rule
def close(
    world: Constants,
    path: Path,
    state: State,
    user: User,
    phase: int,
    kind: int,
    update: int = -1,
) -> None:
    """Close a user's request, completed or not, and log it under a kind of event.

    ``update`` is the number of the update of a sensor that is dropped with it, if there is one. If
    the demand says so (``Path.follows``), the user's next request is scheduled from now on.
    """
    request, now_us = user.request, state.now_us
    if user.holder >= 0:
        count_attached(state, user)
    if request.served_us > 0 and request.done < request.required:
        request.interruptions += int(now_us > request.stopped_us)
    state.closed_qoe1 += progress_of(state, user, request.done)
    user.share = 0.0
    state.open_us += now_us
    state.open_requests[request.service] -= 1
    count_asking(state, user, -1)
    if state.keeps_tasks:
        close_task(state, user, phase, kind)
    if state.keeps_requests:
        _log_request(world, state, user, kind)
    note(state, phase, kind, user.holder, user.index, request.number, update)
    if state.keeps_links:
        end_outage(state, user, phase)
        count_outage(state, user)
    request.number = -1
    if path.follows[user.index]:
        from_us = now_us
        if state.keeps_sensors:
            from_us += max(0, world.updates[request.service].wait_us - request.served_us)
        foresee_request(world, path, state, user, from_us)


@rule
def foresee_request(world: Constants, path: Path, state: State, user: User, from_us: int) -> None:
    """Schedule a user's next request if there is one before the episode's end.

    Its time in the sample path counts from ``from_us``.
    """
    if user.next_ask < path.asks_at[user.index + 1]:
        due_us = from_us + path.due_us[user.next_ask]
        if due_us < world.horizon_us:
            due(state, ask_slot(state, user.index), due_us, key(words.REQUEST, -1, user.index))


@rule
def count_asking(state: State, user: User, by: int) -> None:
    """Count an open request for all drones that cover its user (``by`` 1), or no longer (-1)."""
    service, left, d = user.request.service, user.covered, 0
    while left > 0:
        if user.covering[d] >= 0:
            state.senders[d].asking[service] += by
            left -= 1
        d += 1


@rule
def count_attached(state: State, user: User) -> None:
    """Add the part of a user's present attachment that is during its request to ``attached_us``."""
    request = user.request
    request.attached_us += state.now_us - max(user.held_since_us, request.t_request_us)


@apart
def _log_request(world: Constants, state: State, user: User, kind: int) -> None:
    """Log a user's request, which is closed now by a kind of event."""
    closed, request = state.closed.added(), user.request
    closed.request_id = request.number
    closed.user = user.index
    closed.service = request.service
    closed.stage = request.stage
    closed.bandwidth_bps = request.bandwidth_bps
    closed.required = request.required
    closed.done = request.done
    closed.served_us = request.served_us
    closed.attached_us = request.attached_us
    closed.t_request_us = request.t_request_us
    closed.t_first_us = request.t_first_us
    closed.t_end_us = state.now_us
    closed.interruptions = request.interruptions
    log_task(world, state, user, closed)
    count_amounts(world, state, user, closed)
    closed.kind = kind


@rule
def _log_handover(state: State, request: Request) -> None:
    """Log a drone that has served a request, if requests are logged."""
    if state.keeps_requests:
        handover = state.handovers.added()
        handover.number = request.number
        handover.drone = request.last_server
