"""The best plan of one drone by dynamic programming, given what it gains at each place and step."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from desim_uav.rowcode.kernels import maker, part

LOST = -1e9
"""The value of a crash, which no gain outweighs."""

EPS = 1e-9
"""The difference by which a later action must be better than an earlier one to be chosen."""

Ints = NDArray[np.int64]
Floats = NDArray[np.float64]


@part
def _charged_by(free: Ints, station: int, lands: int, takes: int) -> int:
    """Return the step in which a charge ends, which begins when a pad is free for all of it.

    ``free`` (stations, steps + 1): for how many steps from each one on a pad is free.
    """
    begins, last = lands, free.shape[1] - 1
    while begins < last and free[station, begins] < takes:
        begins += 1
    return begins + takes


@maker
def free_steps(busy: Ints, pads: int) -> Ints:
    """Return for how many steps, from each one on, a pad of each station is free.

    ``busy`` (stations, steps) counts the pads in use; all are free after the last step.
    """
    stations, steps = busy.shape
    free = np.full((stations, steps + 1), 2**30)
    for station in range(stations):
        for step in range(steps - 1, -1, -1):
            free[station, step] = free[station, step + 1] + 1
            if busy[station, step] >= pads:
                free[station, step] = 0
    return free


@maker
def _can_be(steps: int, drains: Ints, lasts: Ints, begins: int, full: int, units: int) -> Ints:
    """Return the units of battery that a drone can have in each step: (steps + 1, full + 2).

    The first number of a row is how many follow. A drone that begins with ``units`` may have
    charged before any later step.
    """
    can_be = np.zeros((steps + 1, full + 2), np.int64)
    may = np.zeros((steps + 1, full + 1), np.int8)
    may[begins, units] = 1
    may[begins + 1 :, full] = 1
    for t in range(begins, steps + 1):
        for b in range(full + 1):
            if may[t, b] == 1:
                can_be[t, 0] += 1
                can_be[t, can_be[t, 0]] = b
                for m in range(len(drains)):
                    if b > drains[m]:
                        may[min(t + lasts[m], steps), b - drains[m]] = 1
    return can_be


@part
def _move(
    top: Floats,
    which: NDArray[np.int8],
    move: int,
    gain: float,
    then: Floats,
    drain: int,
    can_be: Ints,
) -> None:
    """Let a drone move with each battery for which that is better than what is known so far."""
    for k in range(1, can_be[0] + 1):
        b = can_be[k]
        if b <= drain:
            continue
        worth = gain + then[b - drain]
        if worth > top[b] + EPS:
            top[b], which[b] = worth, move


@part
def _take(top: Floats, which: NDArray[np.int8], battery: int, action: int, worth: float) -> None:
    """Let a drone take an action if it is better than what is known so far."""
    if worth > top[battery] + EPS:
        top[battery], which[battery] = worth, action


@part
def _after(value: Floats, end: int, place: int, step_worth: float) -> float:
    """Return the value of a full battery at a place and step, which may be after the last one."""
    last = len(value) - 1
    worth: float = value[min(end, last), place, value.shape[2] - 1]
    return worth - max(0, end - last) * step_worth


@maker
def values_of(
    gained: Floats,
    after: Ints,
    rings: Ints,
    cells: Ints,
    drains: Ints,
    lasts: Ints,
    station_of: Ints,
    charges_at: Ints,
    returns: Ints,
    return_at: int,
    charge_us: Ints,
    step_us: int,
    needs: Ints,
    free: Ints,
    rates: tuple[float, float],
    start: tuple[int, int, int],
) -> tuple[Floats, NDArray[np.int8]]:
    """Return the value of each (step, place, units of battery), and the best action there.

    Only units that a drone can have that begins at ``start`` (step, place, units) have values.
    Action k < moves is a move, ``moves`` is the return to a station, ``moves`` + 1 the charge. A
    crash is worth ``LOST``. In the first half of a move that lasts for several steps, a drone
    counts as where it has begun. See ``Ground`` for the tables; a step here is a tick there.
    """
    steps = gained.shape[1]
    moves, places = after.shape
    full = len(charge_us) - 1
    value = np.empty((steps + 1, places, full + 1))
    best = np.full((steps, places, full + 1), -1, np.int8)
    for p in range(places):
        for b in range(full + 1):
            value[steps, p, b] = rates[0] * b + (0.0 if b >= needs[p] else LOST)
    units = _can_be(steps, drains, lasts, start[0], full, start[2])
    for t in range(steps - 1, start[0] - 1, -1):
        for p in range(places):
            top, which = value[t, p], best[t, p]
            top[:] = LOST
            station = charges_at[p]
            for m in range(moves):
                q = after[m, p]
                if q >= 0:
                    end = min(t + lasts[m], steps)
                    gain = gained[0, t, rings[p], cells[p]]
                    for k in range(t + 1, end):
                        at = p if 2 * (k - t) < lasts[m] else q
                        gain += gained[1, k - 1, rings[at], cells[at]]
                        gain += gained[0, k, rings[at], cells[at]]
                    gain += gained[1, end - 1, rings[q], cells[q]]
                    _move(top, which, m, gain, value[end, q], drains[m], units[t])
            if station >= 0:
                for k in range(1, units[t, 0] + 1):
                    b = units[t, k]
                    if b in (0, full):
                        continue
                    end = _charged_by(free, station, t, -(-charge_us[b] // step_us))
                    _take(top, which, b, moves + 1, _after(value, end, p, rates[1]))
            if returns[p, 3] == 1:
                q, flight_us, drain = returns[p, 0], returns[p, 1], returns[p, 2]
                for b in range(drain + 1, min(return_at, full) + 1):
                    lands = min(t + flight_us // step_us, steps)
                    takes = -(-(flight_us % step_us + charge_us[b - drain]) // step_us)
                    end = _charged_by(free, station_of[q], lands, takes)
                    _take(top, which, b, moves, _after(value, end, q, rates[1]))
    return value, best


@maker
def plan_of(
    best: NDArray[np.int8],
    after: Ints,
    drains: Ints,
    lasts: Ints,
    station_of: Ints,
    returns: Ints,
    charge_us: Ints,
    step_us: int,
    free: Ints,
    start: tuple[int, int, int],
) -> Ints:
    """Return the best plan from (step, place, units): (steps, 3), the action and the place of each.

    A step in which the drone does not decide has the action of the step before, and -1 if there is
    none. A drone that returns or charges is at its station's place. The third number is how many
    steps of a move are over, whose place is the one where it has begun.
    """
    steps, moves = len(best), len(after)
    plan = np.full((steps, 3), -1)
    t, p, b = start
    while t < steps:
        m = best[t, p, b]
        if m < 0:
            break
        plan[t, 0], plan[t, 1], plan[t, 2] = m, p, 0
        if m < moves:
            for k in range(t, min(t + lasts[m], steps)):
                plan[k, 0], plan[k, 1], plan[k, 2] = m, p, k - t
            t, p, b = t + lasts[m], after[m, p], b - drains[m]
            continue
        lands, takes = t, -(-charge_us[b] // step_us)
        if m == moves:
            flight_us, b = returns[p, 1], b - returns[p, 2]
            p, lands = returns[p, 0], min(t + flight_us // step_us, steps)
            takes = -(-(flight_us % step_us + charge_us[b]) // step_us)
        end = min(_charged_by(free, station_of[p], lands, takes), steps)
        for k in range(t, max(end, t + 1)):
            plan[k, 0], plan[k, 1], plan[k, 2] = m, p, 0
        t, b = max(end, t + 1), len(charge_us) - 1
    return plan
