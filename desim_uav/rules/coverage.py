"""Coverage: users enter and leave the footprints of serving drones."""

from __future__ import annotations

from typing import Any

from desim_uav.model.compiled_rows import call
from desim_uav.model.kernels import rule
from desim_uav.rules.attachment import detach, settle_after
from desim_uav.rules.due import crossing_slot, due, key, undo
from desim_uav.rules.note import note
from desim_uav.rules.rows import Constants, Drone, Path, State, User
from desim_uav.rules.words import ENTRY, EXIT, ON_ENTER, ON_EXIT


def look_anew(world: Any, path: Any, state: Any) -> None:
    """Discard an engine's data about the users' walks, at the start of an episode.

    In the SimPy engine this does nothing; the compiled engine has a function of its own.
    """


@rule
def track(
    world: Constants, path: Path, state: State, drone: Drone, span_us: int, phase: int
) -> None:
    """Compute and schedule all crossings of a drone's footprint in the next ``span_us``.

    They are written to ``drone.ahead``, the next one last: by time, at the same time exits before
    entries, then by user. If the drone begins to serve, the users in its footprint enter it now.
    Crossings at this very instant happen immediately and are logged under ``phase``.
    """
    call(world.foresee, (world, path, state, drone, span_us))
    drone.serving = 1
    ahead = drone.ahead
    while len(ahead) > 0 and ahead[len(ahead) - 1].t_us == state.now_us:
        crossing = ahead.pop()
        user = state.users[crossing.user]
        if crossing.enters:
            _enter(state, drone, user, phase)
        else:
            _leave(state, drone, user, phase)
    _await_next(state, drone)
    settle_after(world, path, state, phase)


@rule
def _await_next(state: State, drone: Drone) -> None:
    """Schedule the next crossing of the drone's leg, if there is one."""
    ahead, slot = drone.ahead, crossing_slot(state, drone.index)
    if len(ahead) == 0:
        undo(state, slot)
    else:
        crossing = ahead[len(ahead) - 1]
        phase = ENTRY if crossing.enters else EXIT
        due(state, slot, crossing.t_us, key(phase, drone.index, crossing.user))


@rule
def on_crossing(world: Constants, path: Path, state: State, drone: Drone) -> None:
    """Let the user of the crossing that is now due enter or leave the drone's footprint."""
    crossing = drone.ahead.pop()
    user, enters = state.users[crossing.user], crossing.enters
    _await_next(state, drone)
    if enters:
        _enter(state, drone, user, ENTRY)
    else:
        _leave(state, drone, user, EXIT)
    settle_after(world, path, state, ENTRY)


@rule
def _enter(state: State, drone: Drone, user: User, phase: int) -> None:
    """Let a user enter a footprint; a user who is not attached to a drone becomes loose."""
    if user.covering[drone.index] < 0:
        user.covered += 1
    user.covering[drone.index] = state.now_us
    note(state, phase, ON_ENTER, drone.index, user.index, -1, -1)
    if user.request.number >= 0:
        drone.asking[user.request.service] += 1
    if user.holder < 0:
        state.loose.append(user.index)


@rule
def _leave(state: State, drone: Drone, user: User, phase: int) -> None:
    """Let a user leave a footprint; if it was attached to this drone, it is detached."""
    if user.covering[drone.index] >= 0:
        user.covered -= 1
    user.covering[drone.index] = -1
    note(state, phase, ON_EXIT, drone.index, user.index, -1, -1)
    if user.request.number >= 0:
        drone.asking[user.request.service] -= 1
    if user.holder == drone.index:
        detach(state, drone, user, phase)


@rule
def silence(world: Constants, path: Path, state: State, drone: Drone, phase: int) -> None:
    """End the service of a drone: all users leave its footprint, which no longer exists."""
    if not drone.serving:
        return
    drone.serving = 0
    drone.ahead.clear()
    undo(state, crossing_slot(state, drone.index))
    for u in range(len(state.users)):
        if state.users[u].covering[drone.index] >= 0:
            _leave(state, drone, state.users[u], phase)
    settle_after(world, path, state, phase)


@rule
def leave_all(state: State, phase: int) -> None:
    """Let all users leave all footprints, at the end of an episode."""
    for u in range(len(state.users)):
        user, d = state.users[u], 0
        while user.covered > 0:
            if user.covering[d] >= 0:
                _leave(state, state.drones[d], user, phase)
            d += 1
