"""Batteries: the autonomy that they hold at a time, and when they are depleted."""

from __future__ import annotations

from desim_uav.model.battery import charged_us
from desim_uav.model.compiled_rows import call_for_int
from desim_uav.model.kernels import rule
from desim_uav.rules.due import depletion_slot, due, key, undo
from desim_uav.rules.rows import Constants, Drone, State
from desim_uav.rules.words import CHARGING, DEPLETION, FLYING, RETURNING


@rule
def drained_us(world: Constants, drone: Drone, elapsed_us: int) -> int:
    """Return the autonomy in µs that the first ``elapsed_us`` of a drone's transit use."""
    return call_for_int(world.drained_us, (world, world.transits[drone.transit], elapsed_us))


@rule
def lasts_us(world: Constants, drone: Drone) -> int:
    """Return after how many µs of its transit a drone's battery is empty."""
    return call_for_int(world.lasts_us, (world, world.transits[drone.transit], drone.battery_us))


@rule
def battery_now(world: Constants, state: State, drone: Drone) -> int:
    """Return the charge of a drone's battery now, in µs of autonomy; 0 if it is unlimited."""
    if not world.limited:
        return 0
    elapsed_us = state.now_us - drone.since_us
    if drone.mode in (FLYING, RETURNING):
        # A model that drains faster than time passes may drain more than is left in a microsecond.
        return max(0, drone.battery_us - drained_us(world, drone, elapsed_us))
    if drone.mode == CHARGING:
        held_us, capacity_us = drone.battery_us, world.capacity_us
        return int(charged_us(held_us, elapsed_us, capacity_us, world.full_charge_us))
    return drone.battery_us


@rule
def change_mode(world: Constants, state: State, drone: Drone, mode: int) -> None:
    """Begin a new leg or mode: update the battery to now, and cancel the scheduled depletion."""
    drone.battery_us = battery_now(world, state, drone)
    drone.since_us = state.now_us
    drone.counted_m = 0.0
    drone.mode = mode
    undo(state, depletion_slot(state, drone.index))


@rule
def foresee_depletion(world: Constants, state: State, drone: Drone, span_us: int) -> None:
    """Schedule the depletion of the battery if it does not outlast a leg of ``span_us``."""
    if world.limited:
        lasts = lasts_us(world, drone)
        if lasts <= span_us:
            slot = depletion_slot(state, drone.index)
            due(state, slot, drone.since_us + lasts, key(DEPLETION, drone.index, -1))
