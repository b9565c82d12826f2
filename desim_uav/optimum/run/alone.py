"""The best that one drone can earn in a run if each leg of each step has a price.

The drone is a relaxed one: it may do everything that a drone of an engine may do, and more. It
flies over the map without levels and buildings, never queues for a pad, may return to any station
by the shortest way, and chooses the station at which it is replaced after a crash. What it earns is
therefore at least what any drone of an engine earns in the same run.

At a decision epoch it is over the middle of a cell, j steps after its battery was full. A step of
serving flight drains a battery by the length of the step, or by a known energy at least, and a
charge always ends with a full battery. Backward induction over the steps of the run visits every
state (step, cell, j).
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from desim_uav.drone_type import DroneType
from desim_uav.errors import UsageError
from desim_uav.model.energy.battery import Endurance, PerAction
from desim_uav.model.energy.charging import Constant, Swap, Tapered
from desim_uav.model.energy.rotary_wing import RotaryWing
from desim_uav.optimum.run.legs import Shares, cells_ahead, leg_of
from desim_uav.rowcode.kernels import maker

LARGEST = 10**8
"""The largest number of states of a run that are visited."""

CHARGE, CRASH, HOME = 7, 8, 9
"""Decisions that are no legs; HOME + s is a return to station s, and -1 - k a crash in leg k."""

ROUNDED = 4
"""By how many units the drain of a leg may differ that is computed in parts, each rounded down."""

ANYWHERE = -1
"""The start of a drone that may be in any state when the run begins."""

NEVER = -1e300


class Alone(NamedTuple):
    """What one drone can do, in whole steps.

    The places of the relaxed drone are cells; others may have several places over a cell. ``ahead``
    (places, legs): the place to which each leg leads, or -1; legs after the fifth lead to another
    level. ``over`` (places,): their cells. ``stations`` (S,): their places. ``charge`` (J,): how
    long a charge takes after j steps of flight; ``home`` (places, S, J): a return with the charge
    at its end, or 0 if it is not allowed; ``crash`` (J,): a crash with the drone's replacement,
    which may come in a leg from j = ``doomed`` on. A drone that ``may_wait`` stays on a station for
    a step with a full battery. With an unlimited battery J is 1, and ``limited`` is False.
    """

    ahead: NDArray[np.int64]
    over: NDArray[np.int64]
    stations: NDArray[np.int64]
    charge: NDArray[np.int64]
    home: NDArray[np.int64]
    crash: NDArray[np.int64]
    doomed: int
    limited: bool
    may_wait: bool = True


class LonePlans(NamedTuple):
    """The values of states at the start of a run, and the decision in every state.

    ``airborne`` (places, J) are the values in the air, and ``landed`` (S,) those with a full
    battery on a station. ``decisions`` has the shape (steps, places, J); ``waits`` (steps, S) says
    where a landed drone waits for another step, and ``resumes`` the best station in each step.
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


def alone_of(kind: DroneType, step_us: int, steps: int) -> Alone:
    """Return what the relaxed drone of a type can do in a run of so many steps.

    Raises UsageError, with the key, if its battery or its charging is not of a known kind, or if
    the states are too many.
    """
    if kind.limited:
        _refuse_other_batteries(kind)
    nx, ny = kind.grid.cells
    drain = drain_of(kind, step_us)
    levels = -(-kind.capacity // drain.least) if kind.limited else 1
    if steps * nx * ny * levels > LARGEST:
        raise UsageError(
            f"map.cells: {steps} steps by {nx} x {ny} cells by {levels} levels of the battery are "
            f"more than {LARGEST} states"
        )
    ahead = cells_ahead(kind.grid)
    nothing, cells = np.zeros((len(ahead), 0, 1), np.int64), np.arange(len(ahead))
    none = np.zeros(1, np.int64)
    if not kind.limited:
        return Alone(ahead, cells, np.zeros(0, np.int64), none, nothing, none, 0, False)
    return _with_battery(kind, step_us, ahead, levels)


class Drain(NamedTuple):
    """What a step of serving flight takes from a battery at least and at most, in its units.

    If it is ``exact``, both are equal, and batteries are full at their capacity.
    """

    least: int
    most: int
    exact: bool


def drain_of(kind: DroneType, step_us: int) -> Drain:
    """Return what a step of serving flight takes from the battery of a type."""
    battery: Any = kind.drones.battery
    if type(battery) is not RotaryWing:
        return Drain(step_us, step_us, kind.full == kind.capacity)
    used = [
        int(battery.drain_of(flight, step_us))
        for flight in (kind.rest, *kind.epoch_transits.values())
    ]
    return Drain(max(1, min(used) - ROUNDED), max(used) + ROUNDED, False)


def _refuse_other_batteries(kind: DroneType) -> None:
    battery: Any = kind.drones.battery
    charging: Any = kind.scenario.charging
    if type(battery) not in (Endurance, PerAction, RotaryWing):
        raise UsageError(
            f"drones.battery.kind: {type(battery).__name__}: a run can be bounded only with "
            "endurance, per_action or rotary_wing, whose drain in a step is known"
        )
    if kind.on_crash == "end_episode":
        raise UsageError(
            "drones.battery.on_crash: a run cannot be bounded with 'end_episode', because its "
            "length depends on the policy"
        )
    if type(charging) not in (Constant, Tapered, Swap):
        raise UsageError(
            f"stations.charging.kind: {type(charging).__name__}: a run can be bounded only with "
            "constant, cc_cv or swap, with which a charge takes no longer if the battery has more"
        )


def _with_battery(kind: DroneType, step_us: int, ahead: NDArray[np.int64], levels: int) -> Alone:
    drain, ny = drain_of(kind, step_us), kind.grid.cells[1]
    left = kind.capacity - np.arange(levels) * drain.least

    def steps_of(duration_us: int) -> int:
        return max(1, -(-duration_us // step_us))

    stations = np.array([ix * ny + iy for ix, iy in kind.stations], np.int64)
    hops = {way: _hop(kind, (*way, 0)) for way in ((1, 0), (-1, 0), (0, 1), (0, -1))}
    home = np.zeros((len(ahead), len(stations), levels), np.int64)
    for cell in range(len(ahead)):
        for s, station in enumerate(stations.tolist()):
            dx, dy = station // ny - cell // ny, station % ny - cell % ny
            (x_us, taken_x), (y_us, taken_y) = hops[_sign(dx), 0], hops[0, _sign(dy)]
            flown_us = abs(dx) * x_us + abs(dy) * y_us
            for j in range(levels):
                arrives_with = int(left[j]) - abs(dx) * taken_x - abs(dy) * taken_y
                may_return = kind.full - j * drain.most <= kind.return_charge
                if may_return and arrives_with >= 0:
                    home[cell, s, j] = steps_of(flown_us + kind.until_full_us(arrives_with))
    charge = np.array([steps_of(kind.until_full_us(int(each))) for each in left])
    # Where the battery has no exact charge, or a return by per_action drains it faster than time
    # passes, a crash may come at any time.
    battery: Any = kind.drones.battery
    even = type(battery) is Endurance and drain.exact
    crash = np.array([steps_of(int(each) * even + kind.respawn_after_us) for each in left])
    doomed = min(levels, max(1, -(-kind.full // drain.most))) - 1
    return Alone(ahead, np.arange(len(ahead)), stations, charge, home, crash, doomed, True)


def _sign(number: int) -> int:
    """Return -1 for a number below 0, and 1 for all others."""
    return -1 if number < 0 else 1


def _hop(kind: DroneType, axis: tuple[int, int, int]) -> tuple[int, int]:
    """Return the time of a hop of a return, and what it takes from the battery at least."""
    flight = kind.return_transits[axis]
    battery: Any = kind.drones.battery
    if type(battery) is not RotaryWing:
        return flight.duration_us, flight.duration_us
    return flight.duration_us, battery.drain_of(flight, flight.duration_us) - ROUNDED


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
    waits = np.zeros((steps, len(alone.stations)), np.bool_)
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
    ahead, over, stations, _, home, _, _, limited, may_wait = alone
    steps, places, levels = decisions.shape
    landed = np.zeros((steps + longest, len(stations)))
    resumed = np.zeros(steps + longest)
    later, now = np.zeros((places, levels)), np.zeros((places, levels))
    shift, far = int(limited), 0
    while far < levels and not home[:, :, far].any():
        far += 1
    for t in range(steps - 1, -1, -1):
        pay = paid[t % len(paid)]
        for place in range(places):
            values, choices, earned = now[place], decisions[t, place], pay[over[place]]
            values[:], choices[:] = NEVER, 0
            for k in range(ahead.shape[1]):
                to = ahead[place, k]
                if to >= 0:
                    paid_for = earned[k if k < len(earned) else 0]
                    _offer(paid_for, later[to, shift:], k, values, choices)
            if limited:
                _offer_battery(alone, t, place, far, earned, (landed, resumed), (values, choices))
        for s in range(len(stations)):
            waits[t, s] = may_wait and landed[t + 1, s] > now[stations[s], 0]
            landed[t, s] = landed[t + 1, s] if waits[t, s] else now[stations[s], 0]
            if landed[t, s] > resumed[t]:
                resumed[t], resumes[t] = landed[t, s], s
        later, now = now, later
    return later, landed[0].copy()


@maker
def _offer(
    pay: float,
    later: NDArray[np.float64],
    decision: int,
    values: NDArray[np.float64],
    choices: NDArray[np.int16],
) -> None:
    """Choose a decision in the states, by steps since the battery was full, where it is better."""
    for j in range(len(later)):
        value = pay + later[j]
        better = value > values[j]
        values[j] = value if better else values[j]
        choices[j] = decision if better else choices[j]


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

    ``later`` has the values with a full battery: on each station, and on the best one.
    """
    (landed, resumed), (values, choices) = later, best
    _offer_doomed(alone, t, place, earned, resumed, best)
    for j in range(len(values)):
        if resumed[t + alone.crash[j]] > values[j]:
            values[j], choices[j] = resumed[t + alone.crash[j]], CRASH
    for s in range(len(alone.stations)):
        if alone.stations[s] == place:
            for j in range(1, len(values)):
                value = landed[t + alone.charge[j], s]
                if value > values[j]:
                    values[j], choices[j] = value, CHARGE
        for j in range(far, len(values)):
            if alone.home[place, s, j] > 0:
                value = landed[t + alone.home[place, s, j], s]
                if value > values[j]:
                    values[j], choices[j] = value, HOME + s


@maker
def _offer_doomed(
    alone: Alone,
    t: int,
    place: int,
    earned: NDArray[np.float64],
    resumed: NDArray[np.float64],
    best: tuple[NDArray[np.float64], NDArray[np.int16]],
) -> None:
    """Choose a leg that ends in a crash where this is better."""
    values, choices = best
    for j in range(alone.doomed, len(values)):
        for k in range(len(earned)):
            if alone.ahead[place, k] >= 0:
                value = resumed[t + alone.crash[j]] + earned[k]
                if value > values[j]:
                    values[j], choices[j] = value, -1 - k


def follow(
    alone: Alone,
    plan: LonePlans,
    shares: Shares,
    begin: int,
    start: int,
    covered: NDArray[np.float64],
) -> None:
    """Add the shares of steps for which a drone with a plan covers users to (steps, users).

    The plan begins in step ``begin`` of the shares.
    """
    place, j, station = start, 0, -1
    if start == ANYWHERE:
        place, j = divmod(int(plan.airborne.argmax()), plan.airborne.shape[1])
        if plan.landed.max(initial=0.0) > plan.airborne[place, j]:
            station = int(plan.landed.argmax())
    _follow(alone, plan, shares, begin, place, j, station, covered)


@maker
def _follow(
    alone: Alone,
    plan: LonePlans,
    shares: Shares,
    begin: int,
    place: int,
    j: int,
    station: int,
    covered: NDArray[np.float64],
) -> None:
    """Follow a plan from a place, or from a station if this is not -1 (see ``follow``)."""
    ahead, over, stations, charge, home, crash, _, limited, _ = alone
    steps, t = len(plan.decisions), 0
    while t < steps:
        if station >= 0:
            if plan.waits[t, station]:
                t += 1
                continue
            place, j, station = stations[station], 0, -1
        decision = plan.decisions[t, place, j]
        if decision < CHARGE:
            k = leg_number(decision)
            leg = leg_of(shares, begin + t, over[place]) + (k if k < 5 else 0)
            for i in range(shares.first[leg], shares.first[leg + 1]):
                covered[t, shares.users[i]] += shares.shares[i]
            if decision < 0:
                t += crash[j]
                station = plan.resumes[min(t, steps)]
            else:
                place, j, t = ahead[place, k], j + 1 if limited else 0, t + 1
        elif decision == CRASH:
            t += crash[j]
            station = plan.resumes[min(t, steps)]
        elif decision == CHARGE:
            for s in range(len(stations)):
                if stations[s] == place:
                    station = s
            t += charge[j]
        else:
            station = decision - HOME
            t += home[place, station, j]


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
