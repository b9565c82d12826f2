"""The best plan of one drone by dynamic programming, given what it gains at each place and step."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from desim_uav.rowcode.kernels import maker, part

LOST = -1e9
"""The value of a crash, which no gain outweighs."""

EPS = 1e-9
"""The difference by which a later action must be better than an earlier one to be chosen."""

Ints = NDArray[np.int64]
Floats = NDArray[np.float64]


class Ways(NamedTuple):
    """What drones of a type can do at each place: tables of ``Ground``, where times are in ticks.

    ``charge_ticks`` (units + 1,) is the time to a full battery at a station. A return to the place
    ``returns[p, 0]`` lands after ``returns[p, 1]`` ticks with ``returns[p, 2]`` units less, if
    ``returns[p, 3]`` is 1; ``return_ticks`` (places, units + 1) is the time from then to a full
    battery, by the units with which the return begins.
    """

    after: Ints
    lasts: Ints
    drains: Ints
    rings: Ints
    cells: Ints
    charges_at: Ints
    charge_ticks: Ints
    station_of: Ints
    returns: Ints
    return_ticks: Ints
    return_at: int


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


@part
def _end_of(gained: Floats, ways: Ways, step: int, move: int) -> int:
    """Return the step in which a move is over, which is the last one at most."""
    end: int = min(step + ways.lasts[move], gained.shape[1])
    return end


@part
def _gain_of(gained: Floats, ways: Ways, step: int, place: int, move: int) -> float:
    """Return what a move gains.

    In the first half of a move that lasts for several steps, a drone counts as where it has begun.
    """
    to, lasts, rings, cells = ways.after[move, place], ways.lasts[move], ways.rings, ways.cells
    end = _end_of(gained, ways, step, move)
    gain: float = gained[0, step, rings[place], cells[place]]
    for k in range(step + 1, end):
        at = place if 2 * (k - step) < lasts else to
        gain += gained[1, k - 1, rings[at], cells[at]]
        gain += gained[0, k, rings[at], cells[at]]
    gain += gained[1, end - 1, rings[to], cells[to]]
    return gain


@part
def _full_at(value: Floats, end: int, place: int, step_worth: float) -> float:
    """Return the value of a full battery at a place and step, which may be after the last one."""
    last = len(value) - 1
    worth: float = value[min(end, last), place, value.shape[2] - 1]
    return worth - max(0, end - last) * step_worth


@part
def _charged(
    value: Floats, ways: Ways, free: Ints, rates: tuple[float, float], t: int, p: int, b: int
) -> float:
    """Return what a charge is worth that begins at a station in step ``t`` with ``b`` units."""
    end = _charged_by(free, ways.charges_at[p], t, ways.charge_ticks[b])
    worth: float = _full_at(value, end, p, rates[1])
    return worth


@part
def _returned(
    value: Floats, ways: Ways, free: Ints, rates: tuple[float, float], t: int, p: int, b: int
) -> float:
    """Return what a return is worth that begins in step ``t`` with ``b`` units, with its charge."""
    to = ways.returns[p, 0]
    lands = min(t + ways.returns[p, 1], len(value) - 1)
    end = _charged_by(free, ways.station_of[to], lands, ways.return_ticks[p, b])
    worth: float = _full_at(value, end, to, rates[1])
    return worth


@part
def _move(top: Floats, gain: float, then: Floats, drain: int) -> None:
    """Let a drone move with each battery for which that is better than what is known so far."""
    here, left = top[drain + 1 :], then[1:]
    for k in range(len(here)):  # without a branch, so that several are done at once
        worth = gain + left[k]
        here[k] = worth if worth > here[k] + EPS else here[k]


@part
def _better(most: float, worth: float) -> float:
    """Return what is known to be the greatest worth after another action has been looked at."""
    return worth if worth > most + EPS else most


@part
def _go_back(
    value: Floats, gained: Floats, ways: Ways, free: Ints, rates: tuple[float, float], begins: int
) -> None:
    """Compute the values of all steps from those after the last one (see ``values_of``)."""
    steps, full = gained.shape[1], len(ways.charge_ticks) - 1
    moves, places = ways.after.shape
    for t in range(steps - 1, begins - 1, -1):
        for p in range(places):
            top = value[t, p]
            top[:] = LOST
            for m in range(moves):
                if ways.after[m, p] >= 0:
                    then = value[_end_of(gained, ways, t, m), ways.after[m, p]]
                    _move(top, _gain_of(gained, ways, t, p, m), then, ways.drains[m])
            if ways.charges_at[p] >= 0:
                for b in range(1, full):
                    top[b] = _better(top[b], _charged(value, ways, free, rates, t, p, b))
            if ways.returns[p, 3] == 1:
                for b in range(ways.returns[p, 2] + 1, min(ways.return_at, full) + 1):
                    top[b] = _better(top[b], _returned(value, ways, free, rates, t, p, b))


@maker
def values_of(
    gained: Floats,
    ways: Ways,
    needs: Ints,
    free: Ints,
    rates: tuple[float, float],
    begins: int,
) -> Floats:
    """Return the value of each (step, place, units of battery) from step ``begins`` on.

    A crash is worth ``LOST``. ``gained`` (2, steps, rings, cells) is what a drone gains in a step
    by its start and by its end, ``needs`` (places,) are the units that it needs after the last
    step, and ``rates`` what a unit is worth then, and a step of charging. A step here is a tick.
    """
    steps, full = gained.shape[1], len(ways.charge_ticks) - 1
    places = len(needs)
    value = np.empty((steps + 1, places, full + 1))
    for p in range(places):
        for b in range(full + 1):
            value[steps, p, b] = rates[0] * b + (0.0 if b >= needs[p] else LOST)
    _go_back(value, gained, ways, free, rates, begins)
    return value


@maker
def best_of(
    gained: Floats,
    value: Floats,
    ways: Ways,
    free: Ints,
    rates: tuple[float, float],
    at: tuple[int, int, int],
) -> int:
    """Return the best action at (step, place, units), of which the first that is best counts.

    Action k < moves is a move, ``moves`` is the return to a station, ``moves`` + 1 the charge; -1
    if each leads to a crash.
    """
    t, p, b = at
    moves, full = len(ways.after), len(ways.charge_ticks) - 1
    best, most = -1, LOST
    for m in range(moves):
        if ways.after[m, p] >= 0 and b > ways.drains[m]:
            end = _end_of(gained, ways, t, m)
            then = value[end, ways.after[m, p], b - ways.drains[m]]
            worth = _gain_of(gained, ways, t, p, m) + then
            if worth > most + EPS:
                best, most = m, worth
    if ways.charges_at[p] >= 0 and 0 < b < full:
        worth = _charged(value, ways, free, rates, t, p, b)
        if worth > most + EPS:
            best, most = moves + 1, worth
    may_return = ways.returns[p, 3] == 1 and ways.returns[p, 2] < b <= ways.return_at
    if may_return and _returned(value, ways, free, rates, t, p, b) > most + EPS:
        best = moves
    return best


@maker
def plan_of(
    gained: Floats,
    value: Floats,
    ways: Ways,
    free: Ints,
    rates: tuple[float, float],
    start: tuple[int, int, int],
) -> Ints:
    """Return the best plan from (step, place, units): (steps, 3), the action and the place of each.

    A step in which the drone does not decide has the action of the step before, and -1 if there is
    none. A drone that returns or charges is at its station's place. The third number is how many
    steps of a move are over, whose place is the one where it has begun.
    """
    steps, moves = gained.shape[1], len(ways.after)
    plan = np.full((steps, 3), -1)
    t, p, b = start
    while t < steps:
        m = best_of(gained, value, ways, free, rates, (t, p, b))
        if m < 0:
            break
        plan[t, 0], plan[t, 1], plan[t, 2] = m, p, 0
        if m < moves:
            for k in range(t, _end_of(gained, ways, t, m)):
                plan[k, 0], plan[k, 1], plan[k, 2] = m, p, k - t
            t, p, b = t + ways.lasts[m], ways.after[m, p], b - ways.drains[m]
            continue
        lands, takes = t, ways.charge_ticks[b]
        if m == moves:
            lands, takes = min(t + ways.returns[p, 1], steps), ways.return_ticks[p, b]
            p = ways.returns[p, 0]
        end = min(_charged_by(free, ways.station_of[p], lands, takes), steps)
        for k in range(t, max(end, t + 1)):
            plan[k, 0], plan[k, 1], plan[k, 2] = m, p, 0
        t, b = max(end, t + 1), len(ways.charge_ticks) - 1
    return plan
