"""The event log, which is written only if the run settings keep it."""

from __future__ import annotations

from desim_uav.rowcode.kernels import apart, rule
from desim_uav.rules.rows import Constants, Drone, State, User
from desim_uav.rules.transits import flight_of
from desim_uav.rules.words import ON_LEG, ON_STAGE, REST


@rule
def note(
    state: State, phase: int, kind: int, drone: int, user: int, request: int, station: int
) -> None:
    """Append an event at the present time to the log; a number that does not apply is -1."""
    if state.keeps_events:
        _append(state, phase, kind, drone, user, request, station)


@apart
def _append(
    state: State, phase: int, kind: int, drone: int, user: int, request: int, station: int
) -> None:
    """Append an event (see ``note``)."""
    event = state.events.added()
    event.t_us, event.phase, event.kind = state.now_us, phase, kind
    event.drone, event.user = drone, user
    event.request, event.station = request, station
    event.link_class = -1


@rule
def note_class(state: State, phase: int, kind: int, drone: Drone, user: User) -> None:
    """Append an event of a link between a drone and a user to the log, with the link's class."""
    if state.keeps_events:
        note(state, phase, kind, drone.index, user.index, -1, -1)
        state.events[len(state.events) - 1].link_class = user.classes[drone.index]


@rule
def note_stage(state: State, phase: int, drone: int, user: User) -> None:
    """Append the beginning of a stage of a user's request, by its number in ``station``."""
    request = user.request
    note(state, phase, ON_STAGE, drone, user.index, request.number, request.stage)


@rule
def note_drone(state: State, phase: int, kind: int, drone: Drone) -> None:
    """Append an event that concerns a drone only, at the present time, to the log."""
    note(state, phase, kind, drone.index, -1, -1, -1)


@rule
def note_leg(world: Constants, state: State, drone: Drone) -> None:
    """Append a drone's leg since ``since_us``, a transit or a rest, to the log.

    It is an event of kind ON_LEG with the drone's mode as ``phase``, the places at which the leg
    begins and ends as ``user`` and ``request``, and its duration in µs as ``station``. Legs of free
    flight are kept by themselves.
    """
    if state.keeps_events:
        _append_leg(world, state, drone)


@apart
def _append_leg(world: Constants, state: State, drone: Drone) -> None:
    """Append a leg (see ``note_leg``)."""
    if drone.off_grid:
        _note_free_leg(world, state, drone)
        return
    leg = state.events.added()
    leg.t_us, leg.phase, leg.kind, leg.drone = drone.since_us, drone.mode, ON_LEG, drone.index
    leg.user = place(world, drone.x, drone.y, drone.level)
    leg.request = place(world, drone.to_x, drone.to_y, drone.to_level)
    leg.station = world.transits[drone.transit].duration_us
    leg.link_class = -1


@rule
def _note_free_leg(world: Constants, state: State, drone: Drone) -> None:
    """Append a drone's leg of free flight since ``since_us`` to ``flown``."""
    leg, course = state.flown.added(), drone.course
    leg.t_us, leg.drone, leg.mode = drone.since_us, drone.index, drone.mode
    leg.duration_us = 0 if drone.transit == REST else flight_of(world, drone).duration_us
    leg.x0_m, leg.y0_m, leg.z0_m = course.x0_m, course.y0_m, course.z0_m
    leg.x1_m, leg.y1_m, leg.z1_m = course.x1_m, course.y1_m, course.z1_m


@rule
def place(world: Constants, x: int, y: int, level: int) -> int:
    """Return the number of a place (see ``Constants``)."""
    return (level * world.nx + x) * world.ny + y
