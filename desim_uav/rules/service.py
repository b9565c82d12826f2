"""Requests: how they are opened, wait in a drone's queue, are served, and are closed."""

from __future__ import annotations

from desim_uav.model.kernels import rule
from desim_uav.rules import words
from desim_uav.rules.due import ask_slot, completion_slot, due, key, undo
from desim_uav.rules.note import note
from desim_uav.rules.rows import Constants, Drone, Path, Request, State, User


@rule
def wait(state: State, drone: Drone, user: User) -> None:
    """Insert a user's request into a drone's queue: by the time it was made, then by user."""
    waiting, asked_us = drone.waiting, user.request.t_request_us
    place = len(waiting)
    while place > 0:
        before = state.users[waiting[place - 1]].request
        if before.t_request_us < asked_us:
            break
        if before.t_request_us == asked_us and before.user < user.index:
            break
        place -= 1
    waiting.insert(place, user.index)


@rule
def scan_later(state: State, drone: Drone) -> None:
    """Let a drone scan its queue, to admit requests, when this instant is settled."""
    if not drone.scan:
        drone.scan = 1
        state.to_scan += 1


@rule
def serve(world: Constants, state: State, drone: Drone, user: User, phase: int) -> None:
    """Begin to serve a user's request, and schedule its completion."""
    request, now_us = user.request, state.now_us
    drone.free_bps -= request.bandwidth_bps
    drone.used_bps += request.bandwidth_bps
    drone.served[request.service] += 1
    request.server = drone.index
    request.started_us = now_us
    state.in_service += 1
    state.served_us -= now_us
    note(state, phase, words.ON_SERVE, drone.index, user.index, request.number, -1)
    done_us = now_us + request.required_us - request.served_us
    if done_us <= world.horizon_us:
        slot = completion_slot(state, user.index)
        due(state, slot, done_us, key(words.COMPLETION, drone.index, user.index))


@rule
def stop(state: State, user: User, phase: int) -> None:
    """Stop serving a user's request. A service of 0 µs is no interruption and no handover."""
    request, now_us = user.request, state.now_us
    drone = state.drones[request.server]
    request.server = -1
    undo(state, completion_slot(state, user.index))
    elapsed_us = now_us - request.started_us
    if elapsed_us > 0:
        request.served_us += elapsed_us
        if request.t_first_us < 0:
            request.t_first_us = request.started_us
        elif request.started_us > request.stopped_us:
            request.interruptions += 1
        if request.last_server != drone.index:
            request.last_server = drone.index
            _log_handover(state, request)
        request.stopped_us = now_us
    state.in_service -= 1
    state.served_us += now_us
    user.share = request.served_us / request.required_us
    state.bandwidth_us_bps += elapsed_us * request.bandwidth_bps
    drone.free_bps += request.bandwidth_bps
    drone.used_bps -= request.bandwidth_bps
    drone.served[request.service] -= 1
    note(state, phase, words.ON_STOP, drone.index, user.index, request.number, -1)


@rule
def open_request(path: Path, state: State, user: User, number: int) -> None:
    """Open a user's request as row ``number`` of the sample path's requests describes it."""
    ask, request, now_us = path.asks[number], user.request, state.now_us
    request.number = state.opened
    request.service = ask.service
    request.required_us = ask.required_us
    request.bandwidth_bps = ask.bandwidth_bps
    request.t_request_us = now_us
    request.served_us = request.attached_us = request.interruptions = 0
    request.t_first_us = request.started_us = request.stopped_us = -1
    request.server = request.last_server = -1
    state.opened += 1
    state.open_us -= now_us
    state.open_requests[ask.service] += 1
    count_asking(state, user, 1)


@rule
def close(world: Constants, path: Path, state: State, user: User, phase: int, kind: int) -> None:
    """Close a user's request, completed or not, and log it under a kind of event.

    If the demand says so (``after_previous``), the user's next request is scheduled from now on.
    """
    request, now_us = user.request, state.now_us
    if user.holder >= 0:
        count_attached(state, user)
    if 0 < request.served_us < request.required_us and now_us > request.stopped_us:
        request.interruptions += 1
    state.closed_qoe1 += request.served_us / request.required_us
    user.share = 0.0
    state.open_us += now_us
    state.open_requests[request.service] -= 1
    count_asking(state, user, -1)
    _log_request(state, request)
    note(state, phase, kind, user.holder, user.index, request.number, -1)
    request.number = -1
    if path.after_previous:
        foresee_request(world, path, state, user, now_us)


@rule
def foresee_request(world: Constants, path: Path, state: State, user: User, from_us: int) -> None:
    """Schedule a user's next request if there is one before the episode's end.

    Its time in the sample path counts from ``from_us``.
    """
    if user.next_ask < path.asks_at[user.index + 1]:
        due_us = from_us + path.asks[user.next_ask].due_us
        if due_us < world.horizon_us:
            due(state, ask_slot(state, user.index), due_us, key(words.REQUEST, -1, user.index))


@rule
def count_asking(state: State, user: User, by: int) -> None:
    """Count an open request for all drones that cover its user (``by`` 1), or no longer (-1)."""
    service, left, d = user.request.service, user.covered, 0
    while left > 0:
        if user.covering[d] >= 0:
            state.drones[d].asking[service] += by
            left -= 1
        d += 1


@rule
def count_attached(state: State, user: User) -> None:
    """Add the part of a user's present attachment that is during its request to ``attached_us``."""
    request = user.request
    request.attached_us += state.now_us - max(user.held_since_us, request.t_request_us)


@rule
def _log_request(state: State, request: Request) -> None:
    """Log a request that is closed now, if requests are logged."""
    if state.keeps_requests:
        closed = state.closed.added()
        closed.number = request.number
        closed.user = request.user
        closed.service = request.service
        closed.bandwidth_bps = request.bandwidth_bps
        closed.required_us = request.required_us
        closed.served_us = request.served_us
        closed.attached_us = request.attached_us
        closed.t_request_us = request.t_request_us
        closed.t_first_us = request.t_first_us
        closed.t_end_us = state.now_us
        closed.interruptions = request.interruptions


@rule
def _log_handover(state: State, request: Request) -> None:
    """Log a drone that has served a request, if requests are logged."""
    if state.keeps_requests:
        handover = state.handovers.added()
        handover.number = request.number
        handover.drone = request.last_server
