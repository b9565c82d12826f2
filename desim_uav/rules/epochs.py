"""Decision epochs: drones are asked at each step, or whenever one of them is free."""

from __future__ import annotations

from desim_uav.rowcode.kernels import apart, rare_rule, rule
from desim_uav.rules import words
from desim_uav.rules.battery import type_of
from desim_uav.rules.due import key, run_until
from desim_uav.rules.rows import Constants, Drone, State, TransitRow
from desim_uav.rules.transits import flight_of


@rule
def await_epoch(world: Constants, state: State) -> None:
    """Schedule the next decision epoch: a step from now or, by event, when a drone is free.

    By event, only the end of the episode and the replacements of crashed drones are known now. All
    other drones request an epoch when their time is known (``ask_at``).
    """
    state.next_us = state.now_us + world.step_us
    if world.by_event:
        _await_replacement(world, state)
    _schedule(state)


@apart
def _await_replacement(world: Constants, state: State) -> None:
    """Let the next epoch be at the end of the episode, or when a crashed drone can be replaced."""
    state.next_us = world.horizon_us
    for d in range(len(state.drones)):
        if state.drones[d].mode == words.CRASHED:
            state.next_us = min(state.next_us, asked_after_crash_us(world, state.drones[d]))


@rule
def ask_at(state: State, t_us: int) -> None:
    """Bring the next decision epoch forward to ``t_us`` if it would be later."""
    if t_us < state.next_us:
        state.next_us = t_us
        _schedule(state)


@rule
def _schedule(state: State) -> None:
    run_until(state, state.next_us, key(words.RECORD, -1, -1))


@rule
def span_of(world: Constants, drone: Drone) -> int:
    """Return for how long a drone follows a command whose transit it begins, in microseconds.

    This is a step or, if decisions are by event, the transit or a hover of ``patience_us``. In free
    flight, whose legs may be short, it is at least ``patience_us``.
    """
    if not world.by_event:
        return world.step_us
    return span_of_flight(world, flight_of(world, drone), drone.off_grid)


@rule
def span_of_flight(world: Constants, flight: TransitRow, off_grid: int) -> int:
    """Return for how long a drone would follow a command with such a flight, in microseconds."""
    if not world.by_event:
        return world.step_us
    if flight.distance_m == 0.0:
        return world.patience_us
    return max(flight.duration_us, world.patience_us) if off_grid else flight.duration_us


@rare_rule
def asked_after_crash_us(world: Constants, drone: Drone) -> int:
    """Return when drones are asked because one has crashed: when it is replaced, or at the end."""
    own = type_of(world, drone)
    if own.on_crash == words.RESPAWNS:
        return drone.since_us + own.respawn_after_us
    return drone.since_us if own.on_crash == words.ENDS_EPISODE else world.horizon_us
