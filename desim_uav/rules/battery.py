"""Batteries: the charge that they hold at a time, and when they are depleted.

A charge is a whole number, of microseconds of autonomy or, by some energy models, of microjoules.
"""

from __future__ import annotations

from desim_uav.rowcode.compiled_rows import call_for_int
from desim_uav.rowcode.kernels import rare_rule, rule
from desim_uav.rules.due import depletion_slot, due, key, undo
from desim_uav.rules.rows import Constants, Drone, State, TypeRow
from desim_uav.rules.separation import part
from desim_uav.rules.transits import flight_of
from desim_uav.rules.words import AIRBORNE, CHARGING, DEPLETION, NEVER

MILLION = 1_000_000
"""The picojoules in a microjoule, as microwatts are picojoules per microsecond."""

# ---- what a drone's type says


@rule
def type_of(world: Constants, drone: Drone) -> TypeRow:
    """Return the type of a drone."""
    return world.types[drone.type]


@rule
def is_limited(world: Constants, drone: Drone) -> bool:
    """Return whether a drone's battery is limited, so that it has to charge."""
    return world.types[drone.type].limited != 0


@rule
def capacity_of(world: Constants, drone: Drone) -> int:
    """Return what a drone's full battery holds; 0 if it is unlimited."""
    return world.types[drone.type].capacity


@rule
def drain_per_s_of(world: Constants, drone: Drone) -> int:
    """Return the charge that a second of hovering takes."""
    return world.types[drone.type].drain_per_s


# ---- the charge


@rule
def until_full_us(world: Constants, drone: Drone) -> int:
    """Return for how long a drone has to charge until its battery is full, at most until NEVER."""
    charge, capacity = drone.charge, capacity_of(world, drone)
    return min(call_for_int(world.until_full_us, (world, charge, capacity)), NEVER)


@rule
def drain_of(world: Constants, drone: Drone, elapsed_us: int) -> int:
    """Return the charge that the first ``elapsed_us`` of a drone's transit use."""
    own = world.types[drone.type]
    return call_for_int(own.drain_of, (own, flight_of(world, drone), elapsed_us))


@rule
def lasts_us(world: Constants, drone: Drone) -> int:
    """Return after how many µs of its transit a drone's battery is empty."""
    own, flight = world.types[drone.type], flight_of(world, drone)
    return call_for_int(own.lasts_us, (own, flight, drone.charge))


@rule
def battery_now(world: Constants, state: State, drone: Drone) -> int:
    """Return the charge of a drone's battery now; 0 if it is unlimited."""
    if not is_limited(world, drone):
        return 0
    elapsed_us = state.now_us - drone.since_us
    if drone.mode in AIRBORNE:
        # A model that drains faster than time passes may drain more than is left in a microsecond.
        charge = drone.charge - drain_of(world, drone, elapsed_us)
        if state.keeps_tasks:
            charge -= _computed_uj(drone, state.now_us)
        return max(0, charge)
    if drone.mode == CHARGING:
        charge, capacity = drone.charge, capacity_of(world, drone)
        return call_for_int(world.charged, (world, charge, elapsed_us, capacity))
    return drone.charge


@rule
def change_mode(world: Constants, state: State, drone: Drone, mode: int) -> None:
    """Begin a new leg or mode: update the battery to now, and cancel the scheduled depletion."""
    if world.separation_m > 0.0:
        part(world, state, drone)
    if is_limited(world, drone):
        _hold(world, state, drone)
    drone.since_us = state.now_us
    drone.counted_m = 0.0
    drone.mode = mode


@rule
def _hold(world: Constants, state: State, drone: Drone) -> None:
    """Update a limited battery to now, and cancel its scheduled depletion."""
    if state.keeps_tasks:
        count_computing(state, drone)
    charge = battery_now(world, state, drone)
    count_charge(drone, charge)
    drone.charge, drone.counted = charge, 0
    undo(state, depletion_slot(state, drone.index))


@rule
def count_charge(drone: Drone, charge: int) -> None:
    """Count what a battery, which holds so much now, has lost or gained since it was counted."""
    loss = drone.charge - charge - drone.counted
    drone.counted += loss
    if loss > 0:
        drone.used += loss
    else:
        drone.gained -= loss


@rule
def begin_count(world: Constants, state: State, drone: Drone) -> None:
    """Begin to count anew what a battery loses and gains, with what it holds now."""
    drone.began = battery_now(world, state, drone)
    drone.counted = drone.charge - drone.began
    drone.used = drone.gained = 0


@rule
def refill(world: Constants, drone: Drone) -> None:
    """Give a drone a full battery, which is not counted as charging."""
    capacity = capacity_of(world, drone)
    drone.began += capacity - drone.charge
    drone.charge, drone.counted = capacity, 0


@rule
def foresee_depletion(world: Constants, state: State, drone: Drone, span_us: int) -> None:
    """Schedule the depletion of the battery if it does not outlast a leg of ``span_us``."""
    if is_limited(world, drone):
        drone.span_us = span_us
        lasts = lasts_us(world, drone)
        if drone.power_uw > 0:
            lasts = _lasts_computing_us(world, drone, min(lasts, span_us))
        if lasts <= span_us:
            slot = depletion_slot(state, drone.index)
            due(state, slot, drone.since_us + lasts, key(DEPLETION, drone.index, -1))


# ---- what a processor draws


@rule
def _computed_uj(drone: Drone, now_us: int) -> int:
    """Return what a drone's processor has drawn since this was counted last, in microjoules.

    It draws nothing from the battery on the ground, where the station supplies it.
    """
    elapsed_us = now_us - drone.drawn_us
    return drone.power_uw // MILLION * elapsed_us + _rest_pj(drone, elapsed_us) // MILLION


@rule
def _rest_pj(drone: Drone, elapsed_us: int) -> int:
    """Return what a processor has drawn besides whole watts, in picojoules.

    Whole watts are counted apart in ``_computed_uj``, so that neither product exceeds 64 bits.
    """
    return drone.power_uw % MILLION * elapsed_us + drone.rest_pj


@rare_rule
def count_computing(state: State, drone: Drone) -> None:
    """Take what a drone's processor has drawn until now from its battery.

    Less than a microjoule of it is kept for later.
    """
    if drone.mode in AIRBORNE:
        drawn_uj = _computed_uj(drone, state.now_us)
        drone.rest_pj = _rest_pj(drone, state.now_us - drone.drawn_us) % MILLION
        drone.charge -= drawn_uj
        drone.used += drawn_uj
    drone.drawn_us = state.now_us


@rare_rule
def draw_power(world: Constants, state: State, drone: Drone, power_uw: int) -> None:
    """Let the processor of a drone draw a power from its battery from now on, in microwatts."""
    if power_uw != drone.power_uw:
        count_computing(state, drone)
        drone.power_uw = power_uw
        if drone.mode in AIRBORNE:
            undo(state, depletion_slot(state, drone.index))
            foresee_depletion(world, state, drone, drone.span_us)


@rare_rule
def _lasts_computing_us(world: Constants, drone: Drone, most_us: int) -> int:
    """Return after how many µs of its transit a drone's battery is empty while it computes.

    If that is after ``most_us``, one more is returned.
    """
    low_us, high_us = drone.drawn_us - drone.since_us, most_us + 1
    while low_us < high_us:
        middle_us = (low_us + high_us) // 2
        left = drone.charge - drain_of(world, drone, middle_us)
        if left <= _computed_uj(drone, drone.since_us + middle_us):
            high_us = middle_us
        else:
            low_us = middle_us + 1
    return low_us
