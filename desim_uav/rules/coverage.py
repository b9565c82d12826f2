"""Coverage: users enter and leave the footprints of serving drones."""

from __future__ import annotations

from desim_uav.rowcode.kernels import rare_rule, rule
from desim_uav.rules.classes import await_next, change_class, foresee, leave
from desim_uav.rules.due import crossing_slot, undo
from desim_uav.rules.processing import halt_processor, start_processor
from desim_uav.rules.rows import Constants, Drone, Path, State
from desim_uav.rules.settle import settle_after
from desim_uav.rules.words import ENTRY, EXIT


@rule
def track(
    world: Constants, path: Path, state: State, drone: Drone, span_us: int, phase: int
) -> None:
    """Let a drone serve users on a leg that begins now, and schedule all changes of class on it.

    Users are attached once all drones have begun their legs (see ``rules.settle``); if drones
    interfere with one another, classes of links wait for that too.
    """
    drone.until_us = state.now_us + span_us
    if state.keeps_tasks:
        start_processor(world, state, drone)
    if world.reuse > 0:
        drone.serving = 1
        drone.ahead.clear()
        undo(state, crossing_slot(state, drone.index))
        state.retunes = 1
        return
    foresee(world, path, state, drone, span_us, phase)


@rule
def on_crossing(world: Constants, path: Path, state: State, drone: Drone) -> None:
    """Let the link of the change that is now due pass to its new class."""
    crossing = drone.ahead.pop()
    user, change = state.users[crossing.user], crossing.change
    await_next(state, drone)
    change_class(world, state, drone, user, change, ENTRY if change > 0 else EXIT)
    settle_after(world, path, state, ENTRY)


@rare_rule
def silence(world: Constants, path: Path, state: State, drone: Drone, phase: int) -> None:
    """End the service of a drone: all users leave its footprint, which no longer exists."""
    if not drone.serving:
        return
    drone.serving = 0
    if state.keeps_tasks:
        halt_processor(world, state, drone, phase)
    state.retunes = int(world.reuse > 0)
    drone.ahead.clear()
    undo(state, crossing_slot(state, drone.index))
    for u in range(len(state.users)):
        if state.users[u].covering[drone.index] >= 0:
            leave(state, drone, state.users[u], phase)
    settle_after(world, path, state, phase)


@rule
def leave_all(state: State, phase: int) -> None:
    """Let all users leave all footprints, at the end of an episode."""
    for u in range(len(state.users)):
        user, d = state.users[u], 0
        while user.covered > 0:
            if user.covering[d] >= 0:
                leave(state, state.senders[d], user, phase)
            d += 1
