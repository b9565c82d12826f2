"""The best that one drone can earn in a run if each leg of each step has a price.

The drone is a relaxed one: it may do everything that a drone of an engine may do, and more. It
flies over the map without levels and buildings, never queues for a pad, may return to any station
by the shortest way, and chooses the station at which it is replaced after a crash. What it earns is
therefore at least what any drone of an engine earns in the same run.

At a decision epoch it is over the middle of a cell, and its battery lacks u units of its capacity.
Each leg takes a whole number of units, which is at most what it takes of a battery of an
engine, and a charge always ends with a full battery. Backward induction over the steps of the run
visits every state (step, cell, u).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from desim_uav.drone_type import DroneType
from desim_uav.errors import UsageError
from desim_uav.optimum.run.battery import (
    FINEST,
    Charges,
    crash_us,
    hop_of,
    refuse_other_batteries,
    relaxed_charges,
)
from desim_uav.optimum.run.legs import Shares, cells_ahead, leg_of
from desim_uav.rowcode.kernels import maker

LARGEST = 10**8
"""The largest number of states of a run that are visited."""

CHARGE, CRASH, STOP, HOME = 7, 8, 9, 10
"""Decisions that are no legs; HOME + s is a return to station s, and -1 - k a crash in leg k."""

ANYWHERE = -1
"""The start of a drone that may be in any state when the run begins."""

NEVER = -1e300

FORBIDDEN = 1e18
"""The toll of a crash that no drone may have."""


class Alone(NamedTuple):
    """What one drone can do, in whole steps.

    The places of the relaxed drone are cells; others may have several places over a cell. ``ahead``
    (places, legs): the place to which each leg leads, or -1; legs after the fifth lead to another
    level. ``over`` (places,): their cells. ``drains`` (legs,): the units that legs take of the
    battery, and ``full``: those that are taken after a charge. ``stations`` (S,): their places.
    ``charge`` (J,): how long a charge takes after so many units; ``home`` (places, S, J): a return
    with the charge at its end, or 0 if it is not allowed; ``crash`` (J,): a crash with the drone's
    replacement, which may come in a leg from ``doomed`` units on, and costs ``toll``. A
    ``relaxed`` drone may also crash, stay on a station with a full battery, or stop serving for
    ever. ``free`` (S, steps): for how many steps from each one on a pad is free; without steps, a
    pad always is. With an unlimited battery J is 1, and ``limited`` is False.
    """

    ahead: NDArray[np.int64]
    over: NDArray[np.int64]
    drains: NDArray[np.int64]
    full: int
    stations: NDArray[np.int64]
    charge: NDArray[np.int64]
    home: NDArray[np.int64]
    crash: NDArray[np.int64]
    doomed: int
    toll: float
    limited: bool
    relaxed: bool
    free: NDArray[np.int64]


class LonePlans(NamedTuple):
    """The values of states at the start of a run, and the decision in every state.

    ``airborne`` (places, J) are the values in the air, and ``landed`` (S, 2) those on a station
    with a battery that has been charged, or a new one. ``decisions`` has the shape
    (steps, places, J); ``waits`` (steps, S, 2) says where a landed drone waits for another step,
    and ``resumes`` the best station for a replacement in each step.
    """

    airborne: NDArray[np.float64]
    landed: NDArray[np.float64]
    decisions: NDArray[np.int16]
    waits: NDArray[np.bool_]
    resumes: NDArray[np.int16]

    def value(self, start: int) -> float:
        """Return the most that a drone earns from a place with a full battery, or from ANYWHERE."""
        if start != ANYWHERE:
            return float(self.airborne[start, 0])
        return max(float(self.airborne.max()), float(self.landed.max(initial=0.0)))


def alone_of(
    kind: DroneType, step_us: int, steps: int, toll: float = 0.0, finest: int = FINEST
) -> Alone:
    """Return what the relaxed drone of a type can do in a run of so many steps.

    A crash costs ``toll``, and the cheapest leg takes at most ``finest`` units of the battery, or
    one if the states would be too many.
    """
    if not kind.limited:
        return _without_battery(kind)
    charges, (nx, ny) = relaxed_charges(kind, step_us, finest), kind.grid.cells
    if steps * nx * ny * len(charges.most) > LARGEST:
        charges = relaxed_charges(kind, step_us, finest=1)
    return _with_battery(kind, step_us, charges, toll)


def refuse_unbounded(kind: DroneType, step_us: int, steps: int) -> None:
    """Refuse a type whose drones cannot be bounded in a run of so many steps.

    Raises UsageError, with the key, if its battery or its charging is not of a known kind, or if
    the states are too many.
    """
    if kind.limited:
        refuse_other_batteries(kind)
    levels = len(relaxed_charges(kind, step_us, finest=1).most) if kind.limited else 1
    nx, ny = kind.grid.cells
    if steps * nx * ny * levels > LARGEST:
        raise UsageError(
            f"map.cells: {steps} steps by {nx} x {ny} cells by {levels} levels of the battery are "
            f"more than {LARGEST} states"
        )


def _without_battery(kind: DroneType) -> Alone:
    """Return what the relaxed drone without a battery can do."""
    ahead, none = cells_ahead(kind.grid), np.zeros(1, np.int64)
    return Alone(
        ahead=ahead,
        over=np.arange(len(ahead)),
        drains=np.zeros(ahead.shape[1], np.int64),
        full=0,
        stations=np.zeros(0, np.int64),
        charge=none,
        home=np.zeros((len(ahead), 0, 1), np.int64),
        crash=none,
        doomed=0,
        toll=0.0,
        limited=False,
        relaxed=True,
        free=np.zeros((0, 0), np.int64),
    )


def _with_battery(kind: DroneType, step_us: int, charges: Charges, toll: float) -> Alone:
    """Return what the relaxed drone with a battery can do."""
    ahead, ny = cells_ahead(kind.grid), kind.grid.cells[1]
    stations = np.array([ix * ny + iy for ix, iy in kind.stations], np.int64)
    hops = {way: hop_of(kind, (*way, 0)) for way in ((1, 0), (-1, 0), (0, 1), (0, -1))}
    home = np.zeros((len(ahead), len(stations), len(charges.most)), np.int64)
    returns = np.flatnonzero(charges.least <= kind.return_charge).tolist()
    for cell in range(len(ahead)):
        for s, station in enumerate(stations.tolist()):
            dx, dy = station // ny - cell // ny, station % ny - cell % ny
            (x_us, taken_x), (y_us, taken_y) = hops[_sign(dx), 0], hops[0, _sign(dy)]
            flown_us = abs(dx) * x_us + abs(dy) * y_us
            taken = abs(dx) * taken_x + abs(dy) * taken_y
            for u in returns:
                arrives_with = int(charges.most[u]) - taken
                if arrives_with >= 0:
                    until_us = flown_us + kind.until_full_us(arrives_with)
                    home[cell, s, u] = steps_of(until_us, step_us)
    crash = [steps_of(int(us), step_us) for us in crash_us(kind, step_us, charges.least)]
    doomed = np.flatnonzero(charges.least <= charges.leg)
    return Alone(
        ahead=ahead,
        over=np.arange(len(ahead)),
        drains=charges.drains,
        full=charges.full,
        stations=stations,
        charge=charging_steps(kind, step_us, charges),
        home=home,
        crash=np.array(crash),
        doomed=int(doomed[0]) if len(doomed) else len(crash) - 1,
        toll=toll,
        limited=True,
        relaxed=True,
        free=np.zeros((len(stations), 0), np.int64),
    )


def charging_steps(kind: DroneType, step_us: int, charges: Charges) -> NDArray[np.int64]:
    """Return how many steps a charge takes, by the units that were taken before."""
    return np.array([steps_of(kind.until_full_us(int(each)), step_us) for each in charges.most])


def steps_of(duration_us: int, step_us: int) -> int:
    """Return the number of steps that a duration takes until the next decision epoch."""
    return max(1, -(-duration_us // step_us))


def _sign(number: int) -> int:
    """Return -1 for a number below 0, and 1 for all others."""
    return -1 if number < 0 else 1


@maker
def leg_number(decision: int) -> int:
    """Return the number of the leg of a decision to fly, whether it ends in a crash or not."""
    return decision if decision >= 0 else -1 - decision


def best_alone(alone: Alone, paid: NDArray[np.float64], steps: int) -> LonePlans:
    """Return what is best for a drone that is paid for each leg in each step.

    ``paid`` has the shape (steps, cells, 5), or (1, cells, 5) if all steps pay the same.
    """
    shape = steps, len(alone.ahead), len(alone.charge)
    longest = 1 + int(max(alone.charge.max(), alone.home.max(initial=0), alone.crash.max()))
    decisions = np.empty(shape, np.int16)
    waits = np.zeros((steps, len(alone.stations), 2), np.bool_)
    resumes = np.zeros(steps + longest, np.int16)
    airborne, landed = _induce(alone, paid, longest, decisions, waits, resumes)
    return LonePlans(airborne, landed, decisions, waits, resumes)


@maker
def _induce(
    alone: Alone,
    paid: NDArray[np.float64],
    longest: int,
    decisions: NDArray[np.int16],
    waits: NDArray[np.bool_],
    resumes: NDArray[np.int16],
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Write the decision in every state; return the values at the start, airborne and landed."""
    ahead, over, home = alone.ahead, alone.over, alone.home
    steps, places, levels = decisions.shape
    landed = np.zeros((steps + longest, len(alone.stations), 2))
    resumed = np.zeros(steps + longest)
    later, now = np.zeros((places, levels)), np.zeros((places, levels))
    far = 0
    while far < levels and not home[:, :, far].any():
        far += 1
    for t in range(steps - 1, -1, -1):
        pay = paid[t % len(paid)]
        for place in range(places):
            values, choices, earned = now[place], decisions[t, place], pay[over[place]]
            values[:], choices[:] = (0.0, STOP) if alone.relaxed else (NEVER, 0)
            for k in range(ahead.shape[1]):
                to = ahead[place, k]
                if to >= 0:
                    paid_for = earned[k if k < len(earned) else 0]
                    _offer(paid_for, later[to, alone.drains[k] :], k, values, choices)
            if alone.limited:
                _offer_battery(alone, t, place, far, earned, (landed, resumed), (values, choices))
        _take_off(alone, t, now, (landed, resumed), (waits, resumes))
        later, now = now, later
    return later, landed[0].copy()


@maker
def _take_off(
    alone: Alone,
    t: int,
    now: NDArray[np.float64],
    full: tuple[NDArray[np.float64], NDArray[np.float64]],
    chosen: tuple[NDArray[np.bool_], NDArray[np.int16]],
) -> None:
    """Write what full batteries on each station are worth in a step, and a replacement."""
    (landed, resumed), (waits, resumes) = full, chosen
    for s in range(len(alone.stations)):
        for new in range(2):
            flies = now[alone.stations[s], 0 if new else alone.full]
            waits[t, s, new] = alone.relaxed and landed[t + 1, s, new] > flies
            landed[t, s, new] = landed[t + 1, s, new] if waits[t, s, new] else flies
        if landed[t, s, 1] > resumed[t]:
            resumed[t], resumes[t] = landed[t, s, 1], s


@maker
def _offer(
    pay: float,
    later: NDArray[np.float64],
    decision: int,
    values: NDArray[np.float64],
    choices: NDArray[np.int16],
) -> None:
    """Choose a decision in the states, by units that were taken, where it is better."""
    for j in range(len(later)):
        value = pay + later[j]
        better = value > values[j]
        values[j] = value if better else values[j]
        choices[j] = decision if better else choices[j]


@maker
def _charged_at(alone: Alone, t: int, station: int, taken: int) -> int:
    """Return the step in which a charge ends that begins in step t, or when a pad is free."""
    begins, takes, steps = t, alone.charge[taken], alone.free.shape[1]
    while begins < steps and alone.free[station, begins] < takes:
        begins += 1
    return int(begins + takes)


@maker
def is_new(alone: Alone, taken: int) -> int:
    """Return 1 if a battery of which so much was taken has more than a charge gives, and else 0."""
    return int(taken == 0 or taken < alone.full)


@maker
def _offer_battery(
    alone: Alone,
    t: int,
    place: int,
    far: int,
    earned: NDArray[np.float64],
    later: tuple[NDArray[np.float64], NDArray[np.float64]],
    best: tuple[NDArray[np.float64], NDArray[np.int16]],
) -> None:
    """Choose to charge, to crash, to return, or a leg that ends in a crash where this is better.

    ``later`` has the values with a full battery: on each station, and of a new drone.
    """
    (landed, resumed), (values, choices) = later, best
    if alone.relaxed:
        _offer_crashes(alone, t, place, earned, resumed, best)
    for s in range(len(alone.stations)):
        if alone.stations[s] == place:
            for j in range(len(values)):
                value = landed[_charged_at(alone, t, s, j), s, is_new(alone, j)]
                if value > values[j]:
                    values[j], choices[j] = value, CHARGE
        for j in range(far, len(values)):
            if alone.home[place, s, j] > 0:
                value = landed[t + alone.home[place, s, j], s, 0]
                if value > values[j]:
                    values[j], choices[j] = value, HOME + s


@maker
def _offer_crashes(
    alone: Alone,
    t: int,
    place: int,
    earned: NDArray[np.float64],
    resumed: NDArray[np.float64],
    best: tuple[NDArray[np.float64], NDArray[np.int16]],
) -> None:
    """Choose to crash, at once or in a leg, where this is better."""
    values, choices = best
    for j in range(len(values)):
        value = resumed[t + alone.crash[j]] - alone.toll
        if value > values[j]:
            values[j], choices[j] = value, CRASH
        if j < alone.doomed:
            continue
        for k in range(len(earned)):
            if alone.ahead[place, k] >= 0 and value + earned[k] > values[j]:
                values[j], choices[j] = value + earned[k], -1 - k


def follow(
    alone: Alone,
    plan: LonePlans,
    shares: Shares,
    begin: int,
    start: int,
    covered: NDArray[np.float64],
    busy: NDArray[np.int64] | None = None,
) -> None:
    """Add the shares of steps for which a drone with a plan covers users to (steps, users).

    The plan begins in step ``begin`` of the shares. The charges of the drone are added to ``busy``
    (stations, steps).
    """
    place, j, station, new = start, 0, -1, 0
    if start == ANYWHERE:
        place, j = divmod(int(plan.airborne.argmax()), plan.airborne.shape[1])
        if plan.landed.max(initial=0.0) > plan.airborne[place, j]:
            station, new = divmod(int(plan.landed.argmax()), 2)
    charges = np.zeros((len(alone.stations), 0), np.int64) if busy is None else busy
    _follow(alone, plan, shares, begin, (place, j), (station, new), covered, charges)


@maker
def _follow(
    alone: Alone,
    plan: LonePlans,
    shares: Shares,
    begin: int,
    start: tuple[int, int],
    landed: tuple[int, int],
    covered: NDArray[np.float64],
    busy: NDArray[np.int64],
) -> None:
    """Follow a plan from a place and the units taken, or from a station if this is not -1."""
    (place, j), (station, new) = start, landed
    steps, t = len(plan.decisions), 0
    while t < steps:
        if station >= 0:
            if plan.waits[t, station, new]:
                t += 1
                continue
            place, j, station = alone.stations[station], 0 if new else alone.full, -1
        decision = plan.decisions[t, place, j]
        if decision < CHARGE:
            k = leg_number(decision)
            leg = leg_of(shares, begin + t, alone.over[place]) + (k if k < 5 else 0)
            for i in range(shares.first[leg], shares.first[leg + 1]):
                covered[t, shares.users[i]] += shares.shares[i]
            if decision >= 0:
                place, j, t = alone.ahead[place, k], j + alone.drains[k], t + 1
        if decision == CRASH or decision < 0:
            t += alone.crash[j]
            station, new = plan.resumes[min(t, steps)], 1
        elif decision == CHARGE:
            station, new = int(np.argmax(alone.stations == place)), is_new(alone, j)
            t = _charged_at(alone, t, station, j)
            if t - alone.charge[j] < busy.shape[1]:
                busy[station, t - alone.charge[j] : t] += 1
        elif decision == STOP:
            break
        elif decision >= HOME:
            station, new = decision - HOME, 0
            t += alone.home[place, station, j]


@maker
def pay_legs(
    shares: Shares, begin: int, prices: NDArray[np.float64], paid: NDArray[np.float64]
) -> None:
    """Write what each leg earns, (steps, cells, 5), at prices (steps, users).

    The first of these steps is step ``begin`` of the shares.
    """
    for t in range(len(paid)):
        for cell in range(paid.shape[1]):
            for k in range(paid.shape[2]):
                leg, total = leg_of(shares, begin + t, cell) + k, 0.0
                for i in range(shares.first[leg], shares.first[leg + 1]):
                    total += shares.shares[i] * prices[t, shares.users[i]]
                paid[t, cell, k] = total
