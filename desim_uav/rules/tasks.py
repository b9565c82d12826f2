"""Tasks: requests that need processors, have deadlines, or lose what they have sent.

A task is sent to the drone or access point to which its user is attached, its *site*, and computed
by the processor there. It stays there if the user is handed over, so that its result waits for a
link to the site. All of this is only kept if a service of the scenario needs it.
"""

from __future__ import annotations

from desim_uav.model.services import COMPUTING
from desim_uav.rowcode.kernels import rare_rule, rule
from desim_uav.rules import words
from desim_uav.rules.due import deadline_slot, due, key, undo
from desim_uav.rules.rows import Closed, Constants, Drone, Request, State, User
from desim_uav.rules.stages import progress, scan_later

AFTER_ALL = (1 << 24) - 2
"""Stands for a drone after all others, where the order of an instant's events is by drone."""


@rule
def forget_task(state: State, user: User) -> None:
    """Reset what was kept of a task of the previous episode."""
    task = state.tasks[user.index]
    task.site, task.deadline_us = -1, words.NEVER
    task.arrived_us = task.restarts = task.sending_us = task.computing_us = 0


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
def close_task(state: State, user: User) -> None:
    """Cancel the deadline of a request that is closed now."""
    undo(state, deadline_slot(state, user.index))


@rare_rule
def stands_elsewhere(world: Constants, state: State, drone: Drone, user: User) -> bool:
    """Return whether a request has no place in the lines of the link to a user's drone.

    It stands at a processor, where it arrives now if it has no site yet, or it waits for the link
    to its site. If what was sent to another drone is lost, its stage begins anew.
    """
    task, request = state.tasks[user.index], user.request
    if request.line == COMPUTING:
        if task.site < 0:
            arrive(world, state, drone, user)
        return True
    if task.site >= 0:
        return task.site != drone.index
    if world.terms[request.service].restarts and request.last_server != drone.index:
        request.done = request.credited = 0
        user.share = progress(request, 0)
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


@rare_rule
def count_task(state: State, request: Request, elapsed_us: int) -> None:
    """Count a time in which a task was sent or computed."""
    task = state.tasks[request.user]
    if request.line == COMPUTING:
        task.computing_us += elapsed_us
    else:
        task.sending_us += elapsed_us


@rule
def log_task(state: State, request: Request, closed: Closed) -> None:
    """Write what was kept of a task into the log of its request."""
    closed.deadline_us = words.NEVER
    closed.sending_us = closed.computing_us = closed.restarts = 0
    if state.keeps_tasks:
        task = state.tasks[request.user]
        closed.deadline_us, closed.restarts = task.deadline_us, task.restarts
        closed.sending_us, closed.computing_us = task.sending_us, task.computing_us
