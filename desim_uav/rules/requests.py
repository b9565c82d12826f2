"""When requests are made and closed, and the quality of experience so far."""

from __future__ import annotations

from desim_uav.model.services import COMPUTING, NOWHERE
from desim_uav.rowcode.kernels import apart, rare_rule, rule
from desim_uav.rules import words
from desim_uav.rules.ages import is_sensor
from desim_uav.rules.delivery import deliver_first
from desim_uav.rules.note import note, note_stage
from desim_uav.rules.power import power
from desim_uav.rules.rows import Constants, Drone, Path, State, User
from desim_uav.rules.service import (
    close,
    foresee_request,
    open_request,
    scan_if_used,
    stop,
    wait,
)
from desim_uav.rules.settle import settle_after
from desim_uav.rules.stages import leave, next_stage, scan_later
from desim_uav.rules.tasks import (
    arrive,
    computes_alone,
    end_own,
    has_begun,
    offload,
    part_offloaded,
    progress_of,
    stands_at,
)
from desim_uav.rules.updates import receive, take_update


@rule
def foresee_asking(world: Constants, path: Path, state: State, user: User) -> None:
    """Schedule a user's first request, at the start of an episode."""
    user.next_ask = path.asks_at[user.index]
    foresee_request(world, path, state, user, 0)


@rule
def on_request(world: Constants, path: Path, state: State, user: User) -> None:
    """Open a user's next request, or drop it if the user still has an open request.

    Requests are dropped, and counted as ``suppressed``, only if their times do not depend on the
    previous ones (demand ``poisson`` and ``trace``).
    """
    number = user.next_ask
    user.next_ask = number + 1
    if not path.follows[user.index]:
        foresee_request(world, path, state, user, 0)
    if is_sensor(state, user):
        take_update(world, path, state, user, number)
        settle_after(world, path, state, words.REQUEST)
        return
    if user.request.number >= 0:
        state.suppressed += 1
        return
    open_request(world, path, state, user, number)
    note(state, words.REQUEST, words.ON_REQUEST, -1, user.index, user.request.number, -1)
    if state.keeps_tasks:
        offload(world, state, user, words.REQUEST)
    if user.request.stage > 0:
        _begin_stage(state, words.REQUEST, -1, user)
    if user.holder >= 0:
        drone = state.senders[user.holder]
        wait(world, state, drone, user)
        settle_after(world, path, state, words.REQUEST)


@rule
def on_completion(world: Constants, path: Path, state: State, user: User) -> None:
    """Pass a user's request on to its next stage, or complete it, as all of its stage is done."""
    drone = state.senders[user.request.server]
    stop(state, user, words.COMPLETION)
    leave(state, drone, user)
    if state.keeps_tasks:
        power(world, state, drone)
    if next_stage(world, state, user, part_offloaded(state, user)):
        _begin_stage(state, words.COMPLETION, drone.index, user)
        if user.request.line == COMPUTING:
            arrive(world, state, drone, user)
        elif user.holder >= 0:
            wait(world, state, state.senders[user.holder], user)
    elif state.keeps_tasks and computes_alone(state, user):
        user.request.line = NOWHERE
    else:
        close(world, path, state, user, words.COMPLETION, words.ON_COMPLETE)
        if is_sensor(state, user):
            receive(world, state, drone, user)
    _divide_anew(world, path, state, drone)


@rule
def _divide_anew(world: Constants, path: Path, state: State, drone: Drone) -> None:
    """Let a drone divide anew what a request has left, if there are others that might get it."""
    scan_if_used(state, drone)
    if len(drone.computing) > 0:
        scan_later(state, drone)
    if state.to_scan > 0:
        settle_after(world, path, state, words.COMPLETION)


@rare_rule
def on_deadline(world: Constants, path: Path, state: State, user: User) -> None:
    """Close a user's task, which is late, and free what it held, unless it stays."""
    request, sender = user.request, stands_at(state, user)
    if world.terms[request.service].stays_begun and has_begun(state, user):
        return
    if request.server >= 0:
        stop(state, user, words.COMPLETION)
    if sender >= 0:
        leave(state, state.senders[sender], user)
        power(world, state, state.senders[sender])
    close(world, path, state, user, words.COMPLETION, words.ON_LATE)
    if sender >= 0:
        _divide_anew(world, path, state, state.senders[sender])


@rare_rule
def on_own_completion(world: Constants, path: Path, state: State, user: User) -> None:
    """End what a user's own processor computes, and complete the task if all of it is done."""
    end_own(state, user, words.COMPLETION)
    state.tasks[user.index].own_done = 1
    if user.request.line == NOWHERE:
        user.request.done = user.request.required
        close(world, path, state, user, words.COMPLETION, words.ON_COMPLETE)


@apart
def on_delivery(world: Constants, path: Path, state: State, drone: Drone) -> None:
    """Deliver the first update in a sender's store, as its backhaul has carried the last bit."""
    deliver_first(world, state, drone)
    if state.to_scan > 0:
        settle_after(world, path, state, words.COMPLETION)


@rule
def _begin_stage(state: State, phase: int, drone: int, user: User) -> None:
    """Count and log that a user's request has passed to a stage, of which nothing is done."""
    user.share = progress_of(state, user, 0)
    note_stage(state, phase, drone, user)


@rule
def close_all(world: Constants, path: Path, state: State) -> None:
    """Close all open requests, at the end of an episode."""
    for u in range(len(state.users)):
        user = state.users[u]
        if user.request.number >= 0:
            if user.request.server >= 0:
                stop(state, user, words.RECORD)
            close(world, path, state, user, words.RECORD, words.ON_CLOSE)


@rule
def doing(user: User) -> int:
    """Return what a user is doing (see ``UserState``)."""
    if user.request.number >= 0:
        return words.SERVED if user.request.server >= 0 else words.OPEN
    return words.IDLE if user.holder < 0 else words.ATTACHED


@rule
def done_share(state: State, user: User) -> float:
    """Return which share of a user's open request has been done until now."""
    request = user.request
    if request.server >= 0:
        amount = request.done + (state.now_us - request.counted_us) * request.rate
        return progress_of(state, user, min(amount, request.required))
    if state.keeps_tasks and request.number >= 0:
        return progress_of(state, user, request.done)
    return user.share


@rule
def measures(world: Constants, state: State) -> tuple[float, float, float]:
    """Return QoE1 in percent, QoE2 in steps and QoE3 in percent, from the start until now.

    Open requests count with their service so far. A measure that is not defined yet is NaN. Python
    and compiled code divide whole numbers of more than 53 bits differently, so they become floats.
    """
    now_us, qoe1, users, open_now, attached = state.now_us, state.closed_qoe1, state.users, 0, 0
    for u in range(len(users)):
        qoe1 += done_share(state, users[u])
    for k in range(world.services):
        open_now += state.open_requests[k]
    for d in range(len(state.senders)):
        attached += state.senders[d].attached_users
    open_us = state.open_us + open_now * now_us
    served_us = state.served_us + state.in_service * now_us
    attached_us = state.attached_us + attached * now_us - state.attached_from_us
    lasted_us = len(users) * now_us
    first = second = third = float("nan")
    if state.opened > 0:
        first = 100 * qoe1 / state.opened
        second = float(open_us - served_us) / float(world.step_us) / state.opened
    if lasted_us > 0:
        third = 100.0 * float(attached_us) / float(lasted_us)
    return first, second, third
