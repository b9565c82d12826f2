"""Tasks that follow their users from one processor to another, over the backhauls of both.

A task that has arrived at a processor, which has not begun to compute it, moves to the drone that
its user is attached to now, if its terms say so (``Terms.migrates``) and both have backhauls. It
leaves the line of its site, stands in the line MOVING of the other drone until all that was sent to
its site has come over, and arrives at the processor there. It moves at one rate, which counts at
both; as for results (see ``rules.backhaul``), each keeps an equal part of its backhaul for it.

Until then its site still has all of it. So it turns, from the beginning, if its user is attached to
a third drone with a backhaul, and arrives at its site again if its user comes back, or if the drone
that it moves to crashes. If its user is attached to nothing, or to a drone without a backhaul, it
goes on.
"""

from __future__ import annotations

from desim_uav.model.catalogue import drawn_amount
from desim_uav.model.services import COMPUTING, MOVING, SHARING
from desim_uav.rowcode.kernels import rare_rule, rule
from desim_uav.rules import words
from desim_uav.rules.backhaul import part_bps, reaches
from desim_uav.rules.note import note, note_stage
from desim_uav.rules.rows import Constants, Drone, State, User
from desim_uav.rules.service import give_rate, stop
from desim_uav.rules.stages import count_moving, first_drawn, leave, next_stage, part_of, scan_later
from desim_uav.rules.tasks import arrive, stands_at


@rare_rule
def follow(world: Constants, state: State, drone: Drone, user: User, phase: int) -> None:
    """Let a task follow its user, who is attached to a drone now, if it can."""
    request, task = user.request, state.tasks[user.index]
    if not world.terms[request.service].migrates or task.site < 0 or task.computing_us > 0:
        return
    is_there = request.line == COMPUTING and request.server < 0
    if not is_there and request.line != MOVING:
        return
    if stands_at(state, user) == drone.index or not reaches(world, state, drone, task.site):
        return
    _leave(state, user, phase)
    volume = _received(world, state, user, task.part)
    if drone.index == task.site or volume == 0:
        _arrive(world, state, drone, user, phase)
        return
    request.required, request.done = volume, 0
    request.line, request.queued, task.target = MOVING, 1, drone.index
    drone.moving.append(user.index)
    count_moving(state, user, 1)
    note(state, phase, words.ON_MOVE, drone.index, user.index, request.number, -1)


@rare_rule
def move(world: Constants, state: State, drone: Drone, phase: int) -> None:
    """Give rates to the tasks that move to a drone."""
    for k in range(len(drone.moving)):
        user = state.users[drone.moving[k]]
        site = state.senders[state.tasks[user.index].site]
        bps = min(part_bps(drone), part_bps(site))
        give_rate(world, state, drone, user, 0, bps, phase)


@rule
def is_moving_to(state: State, user: User, drone: Drone) -> bool:
    """Return whether a user's task moves to a drone."""
    return user.request.line == MOVING and state.tasks[user.index].target == drone.index


@rare_rule
def call_back(world: Constants, state: State, user: User, phase: int) -> None:
    """Let a task that moves arrive at its site again, because its target has crashed."""
    _leave(state, user, phase)
    _arrive(world, state, state.senders[state.tasks[user.index].site], user, phase)


@rule
def _leave(state: State, user: User, phase: int) -> None:
    """Let a task leave its line, as one that is not computed, and does not move."""
    if user.request.server >= 0:
        stop(state, user, phase)
    line = state.senders[stands_at(state, user)]
    leave(state, line, user)
    scan_later(state, line)


@rule
def _arrive(world: Constants, state: State, drone: Drone, user: User, phase: int) -> None:
    """Let a task arrive at a processor, and begin the stage there."""
    if user.request.line == MOVING:
        next_stage(world, state, user, state.tasks[user.index].part)
    note_stage(state, phase, drone.index, user)
    arrive(world, state, drone, user)


@rule
def _received(world: Constants, state: State, user: User, part: float) -> int:
    """Return the volume that was sent to the site of a user's task, in millionths of a bit."""
    volume, request, first = 0, user.request, first_drawn(world, user)
    for k in range(request.stage):
        stage = world.stages[world.first_stages[request.service] + k]
        if stage.line <= SHARING and not stage.timed:
            volume += part_of(drawn_amount(stage, state.drawn, first), part)
    return volume
