"""Tasks: requests that need processors, have deadlines, or lose what they have sent.

A task, or the part of it that is offloaded, is sent to the drone or access point to which its user
is attached, its *site*, and computed by the processor there. It stays there if the user is handed
over, unless it migrates (see ``rules.migration``). Its result then comes over the backhauls, or
waits for a link to the site. The other part is computed by the user's own processor meanwhile. All
of this is only kept if a service of the scenario needs it.
"""

from __future__ import annotations

from desim_uav.model.catalogue import drawn_amount
from desim_uav.model.services import COMPUTING, MOVING, NOWHERE
from desim_uav.rowcode.compiled_rows import call_for_float
from desim_uav.rowcode.kernels import rare_rule, rule
from desim_uav.rules import words
from desim_uav.rules.backhaul import reaches
from desim_uav.rules.due import deadline_slot, due, key, own_slot, undo
from desim_uav.rules.note import note
from desim_uav.rules.rows import Closed, Constants, Drone, State, User
from desim_uav.rules.stages import (
    begin_anew,
    count_stages,
    first_drawn,
    part_of,
    progress,
    scan_later,
)

AFTER_ALL = (1 << 24) - 2
"""Stands for a drone after all others, where the order of an instant's events is by drone."""


@rule
def forget_task(state: State, user: User) -> None:
    """Reset what is kept of a user's task."""
    task = state.tasks[user.index]
    task.part, task.site, task.target, task.deadline_us = 1.0, -1, -1, words.NEVER
    task.own = task.own_from_us = task.own_until_us = task.own_done = 0
    task.arrived_us = task.restarts = task.sending_us = task.uplink_us = task.computing_us = 0


@rare_rule
def open_task(world: Constants, state: State, user: User) -> None:
    """Begin to keep what belongs to a request that is made now, and schedule its deadline.

    Deadlines come after all completions of their instant: who is done then is not late.
    """
    forget_task(state, user)
    task, terms = state.tasks[user.index], world.terms[user.request.service]
    if terms.deadline_us < words.NEVER:
        task.deadline_us = state.now_us + terms.deadline_us
        if terms.drops and task.deadline_us <= world.horizon_us:
            place = key(words.COMPLETION, AFTER_ALL, user.index)
            due(state, deadline_slot(state, user.index), task.deadline_us, place)


@rare_rule
def close_task(state: State, user: User, phase: int, kind: int) -> None:
    """Cancel the deadline of a request that is closed now, and what is computed for it.

    A task that is done in time is to the credit of the drone to which its user is attached.
    """
    undo(state, deadline_slot(state, user.index))
    if state.keeps_credit and kind == words.ON_COMPLETE and user.holder >= 0:
        deadline_us = state.tasks[user.index].deadline_us
        if state.now_us <= deadline_us < words.NEVER:
            state.senders[user.holder].credit.in_time += 1
    if computes_alone(state, user):
        end_own(state, user, phase)


@rule
def has_begun(state: State, user: User) -> bool:
    """Return whether a processor has begun to compute a user's task, or a part of it."""
    task, request = state.tasks[user.index], user.request
    computes = request.line == COMPUTING and request.server >= 0
    return computes or task.computing_us > 0 or task.own > 0


@rule
def stands_at(state: State, user: User) -> int:
    """Return the sender in whose lines a user's request stands, if it stands in one, or -1."""
    if user.request.line == COMPUTING:
        return state.tasks[user.index].site
    return state.tasks[user.index].target if user.request.line == MOVING else user.holder


# ---- offloading


@rare_rule
def offload_again(world: Constants, state: State, user: User, phase: int) -> None:
    """Decide again which part of a task is offloaded, as its user is attached to a drone now.

    This is only so if nothing of the task has begun.
    """
    request, task = user.request, state.tasks[user.index]
    if request.t_first_us < 0 and request.server < 0 and task.site < 0 and task.own == 0:
        offload(world, state, user, phase)


@rare_rule
def offload(world: Constants, state: State, user: User, phase: int) -> None:
    """Decide which part of a task is offloaded; the user begins to compute the rest at once."""
    request, task = user.request, state.tasks[user.index]
    cycles = cycles_of(world, state, user, 1.0)
    if cycles == 0 or world.clocks[user.index] == 0:
        return
    part = call_for_float(world.share, (world, state, user))
    if not 0.0 <= part <= 1.0:
        state.faults |= words.NO_SHARE
        part = 1.0
    if part < 1.0:
        if part == 0.0 or not begin_anew(world, state, user, part):
            part, request.line = 0.0, NOWHERE
            request.stage = request.stages = request.done = 0
            request.required = 1
        task.part, task.own = part, cycles - cycles_of(world, state, user, part)
        _begin_own(world, state, user, phase)


@rule
def cycles_of(world: Constants, state: State, user: User, part: float) -> int:
    """Return how many thousandths of a cycle a part of a user's task takes."""
    cycles, request, first = 0, user.request, first_drawn(world, user)
    for k in range(count_stages(world, request)):
        stage = world.stages[world.first_stages[request.service] + k]
        if stage.line == COMPUTING:
            cycles += part_of(drawn_amount(stage, state.drawn, first), part)
    return cycles


@rule
def _begin_own(world: Constants, state: State, user: User, phase: int) -> None:
    """Let a user's own processor begin its part of a task, which nothing interrupts."""
    task, now_us, clock = state.tasks[user.index], state.now_us, world.clocks[user.index]
    task.own_from_us = now_us
    task.own_until_us = now_us + (task.own + clock - 1) // clock
    if user.request.t_first_us < 0:
        user.request.t_first_us = now_us
    state.in_service += 1
    state.served_us -= now_us
    note(state, phase, words.ON_COMPUTE, -1, user.index, user.request.number, -1)
    if task.own_until_us <= world.horizon_us:
        place = key(words.COMPLETION, -1, user.index)
        due(state, own_slot(state, user.index), task.own_until_us, place)


@rule
def end_own(state: State, user: User, phase: int) -> None:
    """End the computation of a user's own processor, done or not."""
    task, request, now_us = state.tasks[user.index], user.request, state.now_us
    undo(state, own_slot(state, user.index))
    note(state, phase, words.ON_COMPUTED, -1, user.index, request.number, -1)
    if request.server < 0:
        state.in_service -= 1
        state.served_us += now_us
    request.served_us += now_us - task.own_from_us


@rule
def computes_alone(state: State, user: User) -> bool:
    """Return whether a user's own processor is computing a part of its task."""
    task = state.tasks[user.index]
    return task.own > 0 and not task.own_done


@rare_rule
def stands_elsewhere(world: Constants, state: State, drone: Drone, user: User) -> bool:
    """Return whether a request has no place in the lines of the link to a user's drone.

    It stands at a processor, where it arrives now if it has no site yet, or it waits for the link
    to its site, if nothing leads from there to the user's drone. If what was sent to another drone
    is lost, its stage begins anew.
    """
    task, request = state.tasks[user.index], user.request
    if request.line == COMPUTING and task.site < 0:
        arrive(world, state, drone, user)
    if request.line >= COMPUTING:
        return True
    if task.site >= 0 and not reaches(world, state, drone, task.site):
        return True
    if world.terms[request.service].restarts and request.last_server != drone.index:
        request.done = 0
        if state.keeps_credit:
            state.credited[user.index] = 0
        user.share = progress_of(state, user, 0)
    return False


@rare_rule
def arrive(world: Constants, state: State, drone: Drone, user: User) -> None:
    """Let a task stand in the line of a drone's processor, which is its site from now on.

    A line is by arrival, or by deadline first; ties: the lowest user.
    """
    task, by_deadline = state.tasks[user.index], world.processors[drone.radio].by_deadline
    task.site, task.arrived_us = drone.index, state.now_us
    user.request.queued = 1
    place = len(drone.computing)
    while place > 0 and _is_before(state, user.index, drone.computing[place - 1], by_deadline):
        place -= 1
    drone.computing.insert(place, user.index)
    scan_later(state, drone)


@rule
def _is_before(state: State, user: int, other: int, by_deadline: int) -> bool:
    """Return whether the task of a user comes before that of another one."""
    one, two = state.tasks[user], state.tasks[other]
    if by_deadline and one.deadline_us != two.deadline_us:
        return one.deadline_us < two.deadline_us
    if one.arrived_us != two.arrived_us:
        return one.arrived_us < two.arrived_us
    return user < other


# ---- what is counted


@rule
def part_offloaded(state: State, user: User) -> float:
    """Return which part of a user's request passes through its stages."""
    return state.tasks[user.index].part if state.keeps_tasks else 1.0


@rule
def own_parts(state: State, user: User) -> int:
    """Return 1 if the user's own processor has a part of its task, else 0."""
    return int(state.tasks[user.index].own > 0) if state.keeps_tasks else 0


@rule
def progress_of(state: State, user: User, amount: int) -> float:
    """Return the progress of a user's request, of whose present stage ``amount`` has been done.

    While a task moves, nothing of its stage is done.
    """
    if state.keeps_tasks:
        done = 0 if user.request.line == MOVING else amount
        return _progress_of_parts(state, user, done)
    return progress(user.request, amount)


@rare_rule
def _progress_of_parts(state: State, user: User, amount: int) -> float:
    """Return the progress of a task, in which the part that the user computes is one more stage."""
    request, task = user.request, state.tasks[user.index]
    if task.own == 0:
        return progress(request, amount)
    stages = 0.0
    if task.part > 0.0:
        stages = float(request.stage) + float(amount) / float(request.required)
    return (stages + _own_share(state, user)) / float(request.stages + 1)


@rule
def _own_share(state: State, user: User) -> float:
    """Return which share of its own part of a task a user has computed."""
    task = state.tasks[user.index]
    if task.own_done:
        return 1.0
    lasts_us = task.own_until_us - task.own_from_us
    return float(min(state.now_us, task.own_until_us) - task.own_from_us) / float(lasts_us)


@rare_rule
def count_task(state: State, user: User, elapsed_us: int) -> None:
    """Count a time in which a user's task was sent or computed, just counted as served.

    What the user has computed meanwhile is counted when that ends, so that no time counts twice.
    """
    request, task = user.request, state.tasks[user.index]
    if request.line == COMPUTING:
        task.computing_us += elapsed_us
    else:
        task.sending_us += elapsed_us
        if task.site < 0:
            task.uplink_us += elapsed_us
    if task.own > 0:
        begins_us = state.now_us - elapsed_us
        both_us = min(state.now_us, task.own_until_us) - max(begins_us, task.own_from_us)
        request.served_us -= max(both_us, 0)


@rule
def log_task(world: Constants, state: State, user: User, closed: Closed) -> None:
    """Write what was kept of a user's task into the log of its request."""
    closed.deadline_us, closed.part = words.NEVER, 1.0
    closed.sending_us = closed.uplink_us = closed.computing_us = closed.restarts = 0
    closed.own_us, closed.own_share, closed.asked_cycles = 0, 0.0, 0
    if state.keeps_tasks:
        closed.asked_cycles = cycles_of(world, state, user, 1.0)
        request, task = user.request, state.tasks[user.index]
        if request.line == MOVING:
            stage = world.stages[world.first_stages[request.service] + request.stage]
            closed.done = 0
            amount = drawn_amount(stage, state.drawn, first_drawn(world, user))
            closed.required = part_of(amount, task.part)
        closed.deadline_us, closed.restarts = task.deadline_us, task.restarts
        closed.sending_us, closed.uplink_us = task.sending_us, task.uplink_us
        closed.computing_us, closed.part = task.computing_us, task.part
        if task.own > 0:
            closed.own_us = min(state.now_us, task.own_until_us) - task.own_from_us
            closed.own_share = _own_share(state, user)
