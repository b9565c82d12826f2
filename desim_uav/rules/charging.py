"""Charging: drones land on a station, queue for its pads, and charge until they are full."""

from __future__ import annotations

from desim_uav.rowcode.kernels import rare_rule, rule
from desim_uav.rules import words
from desim_uav.rules.battery import change_mode, until_full_us
from desim_uav.rules.coverage import silence
from desim_uav.rules.delivery import unload
from desim_uav.rules.due import arrival_slot, due, key
from desim_uav.rules.epochs import ask_at
from desim_uav.rules.flight import hover_at, station_under
from desim_uav.rules.note import note
from desim_uav.rules.rows import Constants, Drone, Path, State


@rare_rule
def land(world: Constants, path: Path, state: State, drone: Drone, phase: int) -> None:
    """Land a drone on the station beneath it, whose queue it joins."""
    silence(world, path, state, drone, words.COVERAGE)
    change_mode(world, state, drone, words.QUEUED)
    hover_at(drone, drone.x, drone.y, drone.level)
    station = station_under(world, drone)
    note(state, phase, words.ON_LAND, drone.index, -1, -1, station)
    if state.keeps_sensors:
        unload(world, state, drone, phase)
    drone.landed_in = phase
    state.stations[station].queue.append(drone.index)
    hand_on_pads(world, state, station)


def hand_on_pads(world: Constants, state: State, station: int) -> None:
    """Let the first drones in a station's queue begin to charge, as many as it has pads.

    This function does nothing in the SimPy engine, whose pads are a ``simpy.Resource``. The
    compiled engine has a function of its own in its place.
    """


@rule
def begin_charging(world: Constants, state: State, drone: Drone, station: int) -> int:
    """Begin to charge a queued drone on a pad; return the phase under which this is logged."""
    count_queueing(state, drone)
    phase = words.ARRIVAL if state.now_us > drone.since_us else drone.landed_in
    change_mode(world, state, drone, words.CHARGING)
    note(state, phase, words.ON_CHARGE, drone.index, -1, -1, station)
    return phase


@rule
def await_full(world: Constants, state: State, drone: Drone) -> bool:
    """Schedule the end of a charge; return False if the battery is full already."""
    rest_us = until_full_us(world, drone)
    if rest_us <= 0:
        return False
    slot, full_us = arrival_slot(state, drone.index), drone.since_us + rest_us
    due(state, slot, full_us, key(words.ARRIVAL, drone.index, -1))
    return True


@rule
def end_charging(world: Constants, state: State, drone: Drone, station: int, phase: int) -> None:
    """End the charge of a drone, which frees the pad and waits on the ground for a command."""
    change_mode(world, state, drone, words.CHARGED)
    note(state, phase, words.ON_CHARGED, drone.index, -1, -1, station)
    state.charges += 1
    state.stations[station].queue.remove(drone.index)
    drone.waits = 1
    if world.by_event:
        ask_at(state, state.now_us)


@rare_rule
def on_full(world: Constants, state: State, drone: Drone) -> None:
    """End a charge when it is due, and give the pad to the next drone in the queue."""
    station = station_under(world, drone)
    end_charging(world, state, drone, station, words.ARRIVAL)
    hand_on_pads(world, state, station)


@rule
def count_queueing(state: State, drone: Drone) -> None:
    """Add the time for which a drone has queued for a pad in this episode to ``queueing_us``."""
    state.queueing_us += state.now_us - max(drone.since_us, 0)
