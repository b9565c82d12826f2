"""The log of events, if it is kept."""

from __future__ import annotations

from desim_uav.model.kernels import rule
from desim_uav.rules.rows import Constants, Drone, State
from desim_uav.rules.words import ON_LEG


@rule
def note(
    state: State, phase: int, kind: int, drone: int, user: int, request: int, station: int
) -> None:
    """Write an event of now to the log; numbers that do not apply are -1."""
    if state.keeps_events:
        event = state.events.added()
        event.t_us, event.phase, event.kind = state.now_us, phase, kind
        event.drone, event.user = drone, user
        event.request, event.station = request, station


@rule
def note_drone(state: State, phase: int, kind: int, drone: Drone) -> None:
    """Write an event that concerns a drone only."""
    note(state, phase, kind, drone.index, -1, -1, -1)


@rule
def note_leg(world: Constants, state: State, drone: Drone) -> None:
    """Write what a drone is about since ``since_us``: a transit, or to be where it is.

    It is an event of kind ON_LEG: its mode stands for the phase, then the places at which it
    begins and ends, and its duration.
    """
    if state.keeps_events:
        leg = state.events.added()
        leg.t_us, leg.phase, leg.kind, leg.drone = drone.since_us, drone.mode, ON_LEG, drone.index
        leg.user = place(world, drone.x, drone.y, drone.level)
        leg.request = place(world, drone.to_x, drone.to_y, drone.to_level)
        leg.station = world.transits[drone.transit].duration_us


@rule
def place(world: Constants, x: int, y: int, level: int) -> int:
    """Return the number of a place."""
    return (level * world.nx + x) * world.ny + y
