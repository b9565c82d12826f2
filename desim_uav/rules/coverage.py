"""Coverage: users enter and leave the footprint of a drone that serves."""

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
    """At the start of an episode: forget where users are."""


@rule
def track(
    world: Constants, path: Path, state: State, drone: Drone, span_us: int, phase: int
) -> None:
    """Foresee the crossings of a drone that serves on a leg of ``span_us`` from now on.

    They are written to ``ahead`` with the next one last: by time, at one time exits before
    entries, then by user. A drone that has not served until now also enters the users in its
    footprint. Crossings of this very instant happen at once, in ``phase``.
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
    """Let the next crossing of the drone's leg happen at its time."""
    ahead, slot = drone.ahead, crossing_slot(state, drone.index)
    if len(ahead) == 0:
        undo(state, slot)
    else:
        crossing = ahead[len(ahead) - 1]
        phase = ENTRY if crossing.enters else EXIT
        due(state, slot, crossing.t_us, key(phase, drone.index, crossing.user))


@rule
def on_crossing(world: Constants, path: Path, state: State, drone: Drone) -> None:
    """The next crossing of a drone's leg happens."""
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
    """A drone stops serving: its footprint is gone."""
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
    """At the end of an episode: all users leave all footprints."""
    for u in range(len(state.users)):
        user, d = state.users[u], 0
        while user.covered > 0:
            if user.covering[d] >= 0:
                _leave(state, state.drones[d], user, phase)
            d += 1
