"""Classes of links: 0 is no link, and a larger class carries more bits per hertz.

A user for whom the class of a drone's link is at least 1 is in the footprint of the drone.
"""

from __future__ import annotations

from desim_uav.rowcode.compiled_rows import call_for_int
from desim_uav.rowcode.kernels import apart, rare_rule, rule
from desim_uav.rowcode.rows import address
from desim_uav.rules.air import (
    foresee_in_air,
    keeps_rings,
    mark_all,
    note_classes,
    show_air,
)
from desim_uav.rules.attachment import detach
from desim_uav.rules.credit import credit_entry, credit_exit
from desim_uav.rules.due import crossing_slot, due, key, undo
from desim_uav.rules.links import begin_outage, end_outage, unsettle, unsettle_covered
from desim_uav.rules.note import note_class
from desim_uav.rules.rows import Constants, Drone, Path, State, User
from desim_uav.rules.service import regrade
from desim_uav.rules.standing import recall
from desim_uav.rules.transits import began_us, show_leg
from desim_uav.rules.walks import know_walks, walks_of
from desim_uav.rules.words import ENTRY, EXIT, LOST, NEVER, ON_CLASS, ON_ENTER, ON_EXIT


@rule
def foresee(
    world: Constants, path: Path, state: State, drone: Drone, span_us: int, phase: int
) -> None:
    """Compute and schedule all changes of class of a drone's links in the next ``span_us``.

    They are written to ``drone.ahead``, the next one last: by time, at the same time falls before
    rises, then by user. If the drone begins to serve, the users in its footprint enter it now.
    Changes at this very instant happen immediately and are logged under ``phase``. A drone may
    begin to serve in the middle of a transit, at the start of an episode.
    """
    if world.in_air and not keeps_rings(world, drone):
        foresee_in_air(world, path, state, drone, span_us)
    else:
        foresee_rings(world, path, state, drone, span_us)
    if began_us(state, drone) < state.now_us:
        _sum_up_past(state, drone)
    _begin_changes(world, state, drone, phase)


@rare_rule
def foresee_rings(world: Constants, path: Path, state: State, drone: Drone, span_us: int) -> None:
    """Write the changes on a leg to ``drone.ahead``, where they are those of rings."""
    tabulated = state.look.stand and len(world.known_at) > 0
    if tabulated and drone.serving and span_us == world.step_us:
        recall(world, state, drone)
        return
    ahead, until_us = drone.ahead, state.now_us + span_us
    know_walks(world, path, state, state.now_us, until_us)
    if path.stepwise and state.look.walking.lost:
        state.faults |= LOST
        ahead.clear()
        return
    show_leg(world, state, drone)
    scene, sky, space = address(world.scene), address(state.sky), ahead.space(state.sky.changes)
    of_leg = drone.index, began_us(state, drone), until_us
    count = call_for_int(world.foresee, (scene, sky, *space, *walks_of(path, state), *of_leg))
    ahead.fill(state.sky.changes, count)


@apart
def _sum_up_past(state: State, drone: Drone) -> None:
    """Let all users rise now to the classes to which the changes on a transit until now lead.

    The changes on the whole transit are known, as if the users had walked before the episode.
    """
    ahead, d = drone.ahead, drone.index
    while len(ahead) > 0 and ahead[len(ahead) - 1].t_us <= state.now_us:
        change = ahead.pop()
        state.users[change.user].classes[d] = abs(change.change)
    for u in range(len(state.users) - 1, -1, -1):
        link_class = state.users[u].classes[d]
        if link_class > 0:
            state.users[u].classes[d] = 0
            rise = ahead.added()
            rise.t_us, rise.user, rise.change = state.now_us, u, link_class


@rule
def _begin_changes(world: Constants, state: State, drone: Drone, phase: int) -> None:
    """Let changes at this very instant happen, and schedule the next one (see ``foresee``)."""
    drone.serving = 1
    ahead = drone.ahead
    if len(ahead) > 0 and ahead[len(ahead) - 1].t_us == state.now_us:
        _change_now(world, state, drone, phase)
    await_next(state, drone)
    if state.by_level:
        unsettle_covered(state, drone)


@rare_rule
def _change_now(world: Constants, state: State, drone: Drone, phase: int) -> None:
    """Let all changes of class that are due at this instant happen."""
    ahead = drone.ahead
    while len(ahead) > 0 and ahead[len(ahead) - 1].t_us == state.now_us:
        change = ahead.pop()
        change_class(world, state, drone, state.users[change.user], change.change, phase)


@rare_rule
def retune(world: Constants, path: Path, state: State, phase: int) -> None:
    """Foresee the classes of all drones anew, because others interfere with them than before.

    They are known until the first of the drones' legs ends, when interference changes again.
    """
    state.retunes, until_us = 0, NEVER
    for d in range(len(state.senders)):
        if state.senders[d].serving:
            until_us = min(until_us, state.senders[d].until_us)
    if until_us == NEVER:
        return
    _foresee_all(world, path, state, until_us)
    for d in range(len(state.senders)):
        if state.senders[d].serving:
            _begin_changes(world, state, state.senders[d], phase)


@rule
def _foresee_all(world: Constants, path: Path, state: State, end_us: int) -> None:
    """Write the changes of all drones that serve to their ``ahead``."""
    visible, senders = show_air(world, path, state, end_us), len(state.senders)
    for d in range(senders):
        drone = state.senders[d]
        state.sky.legs[d].sought = 0
        if drone.serving and keeps_rings(world, drone):
            foresee_rings(world, path, state, drone, end_us - state.now_us)
        elif drone.serving:
            drone.ahead.clear()
            if visible:
                mark_all(world, path, state, drone, end_us)
                note_classes(state, drone)
                state.sky.legs[d].sought = 1
    if not visible:
        return
    places = address(world.scene), address(state.sky), *walks_of(path, state)
    call_for_int(world.foresee_all, (*places, state.now_us, end_us))
    room = len(state.sky.changes) // senders
    for d in range(senders):
        leg = state.sky.legs[d]
        if leg.sought:
            state.senders[d].ahead.take(state.sky.changes, d * room, leg.changes)


@rule
def await_next(state: State, drone: Drone) -> None:
    """Schedule the next change of class on the drone's leg, if there is one."""
    ahead, slot = drone.ahead, crossing_slot(state, drone.index)
    if len(ahead) == 0:
        undo(state, slot)
    else:
        change = ahead[len(ahead) - 1]
        phase = ENTRY if change.change > 0 else EXIT
        due(state, slot, change.t_us, key(phase, drone.index, change.user))


@rule
def change_class(
    world: Constants, state: State, drone: Drone, user: User, change: int, phase: int
) -> None:
    """Let the link between a drone and a user rise or fall to a class (see ``Change``)."""
    if change == 0:
        leave(state, drone, user, phase)
        return
    before = user.classes[drone.index]
    user.classes[drone.index] = abs(change)
    if before == 0:
        _enter(state, drone, user, phase)
    else:
        _pass(world, state, drone, user, phase)


@apart
def _pass(world: Constants, state: State, drone: Drone, user: User, phase: int) -> None:
    """Log that a link has passed to another class, and adapt the user's request to it."""
    note_class(state, phase, ON_CLASS, drone, user)
    if user.holder == drone.index and user.request.number >= 0:
        regrade(world, state, drone, user)


@rule
def _enter(state: State, drone: Drone, user: User, phase: int) -> None:
    """Let a user enter a footprint; one who is not attached to a drone becomes loose.

    It is loose already if another footprint covers it.
    """
    if state.keeps_credit:
        credit_entry(state, drone, user)
    if user.covering[drone.index] < 0:
        user.covered += 1
    user.covering[drone.index] = state.now_us
    note_class(state, phase, ON_ENTER, drone, user)
    if user.request.number >= 0:
        drone.asking[user.request.service] += 1
    if state.keeps_links:
        end_outage(state, user, phase)
        unsettle(state, user)
    if user.holder < 0 and user.covered == 1:
        state.loose.append(user.index)


@rule
def leave(state: State, drone: Drone, user: User, phase: int) -> None:
    """Let a user leave a footprint; if it was attached to this drone, it is detached."""
    if state.keeps_credit:
        credit_exit(state, drone, user)
    if user.covering[drone.index] >= 0:
        user.covered -= 1
    user.covering[drone.index] = -1
    user.classes[drone.index] = 0
    note_class(state, phase, ON_EXIT, drone, user)
    if user.request.number >= 0:
        drone.asking[user.request.service] -= 1
    if user.holder == drone.index:
        detach(state, drone, user, phase)
    if state.keeps_links:
        unsettle(state, user)
        begin_outage(state, user, phase)
