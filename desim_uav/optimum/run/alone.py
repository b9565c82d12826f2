"""The best that one drone can earn in a run if each leg of each step has a price.

The drone is a relaxed one: it may do everything that a drone of an engine may do, and more. It
flies over the map without levels and buildings, never queues for a pad, may return to any station
by the shortest way, and chooses the station at which it is replaced after a crash. What it earns is
therefore at least what any drone of an engine earns in the same run.

At a decision epoch it is over the middle of a cell, j steps after its battery was full, because a
step of serving flight drains a battery by the length of the step, and a charge always ends with a
full battery. Backward induction over the steps of the run visits every state (step, cell, j).
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from desim_uav.errors import UsageError
from desim_uav.model.battery import Endurance, PerAction
from desim_uav.model.kernels import maker
from desim_uav.model.planner import time_on_open_map
from desim_uav.optimum.run.legs import Shares, cells_ahead, leg_of
from desim_uav.world import World

LARGEST = 10**8
"""The largest number of states of a run that are visited."""

CHARGE, CRASH, HOME = 7, 8, 9
"""Decisions that are no legs; HOME + s is a return to station s."""

ANYWHERE = -1
"""The start of a drone that may be in any state when the run begins."""

NEVER = -1e300


class Alone(NamedTuple):
    """What one drone can do, in whole steps.

    The places of the relaxed drone are cells; others may have several places over a cell. ``ahead``
    (places, legs): the place to which each leg leads, or -1; legs after the fifth lead to another
    level. ``over`` (places,): their cells. ``stations`` (S,): their places. ``charge`` (J,): how
    long a charge takes after j steps of flight; ``home`` (places, S, J): a return with the charge
    at its end, or 0 if it is not allowed; ``crash`` (J,): a crash with the drone's replacement. A
    drone that ``may_wait`` stays on a station for a step with a full battery. With an unlimited
    battery J is 1, and ``limited`` is False.
    """

    ahead: NDArray[np.int64]
    over: NDArray[np.int64]
    stations: NDArray[np.int64]
    charge: NDArray[np.int64]
    home: NDArray[np.int64]
    crash: NDArray[np.int64]
    limited: bool
    may_wait: bool = True


class Plan(NamedTuple):
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


def alone_in(world: World, steps: int) -> Alone:
    """Return what the relaxed drone of a world can do in a run of so many steps.

    Raises UsageError, with the key, if its battery is not of a known kind, or if the states are too
    many.
    """
    nx, ny = world.grid.cells
    begun = -(-world.capacity_us // world.step_us) if world.scenario.limited_battery else 1
    if steps * nx * ny * begun > LARGEST:
        raise UsageError(
            f"map.cells: {steps} steps by {nx} x {ny} cells by {begun} levels of the battery are "
            f"more than {LARGEST} states"
        )
    ahead = cells_ahead(world)
    nothing, cells = np.zeros((len(ahead), 0, 1), np.int64), np.arange(len(ahead))
    none = np.zeros(1, np.int64)
    if not world.scenario.limited_battery:
        return Alone(ahead, cells, np.zeros(0, np.int64), none, nothing, none, False)
    _refuse_other_batteries(world)
    return _with_battery(world, ahead, begun)


def _refuse_other_batteries(world: World) -> None:
    battery: Any = world.only_type.drones.battery
    if type(battery) not in (Endurance, PerAction):
        raise UsageError(
            f"drones.battery.kind: {type(battery).__name__}: a run can be bounded only with "
            "endurance or per_action, where a step of serving flight takes its length of autonomy"
        )
    if world.on_crash == "end_episode":
        raise UsageError(
            "drones.battery.on_crash: a run cannot be bounded with 'end_episode', because its "
            "length depends on the policy"
        )


def _with_battery(world: World, ahead: NDArray[np.int64], begun: int) -> Alone:
    full_us, step_us, ny = world.capacity_us, world.step_us, world.grid.cells[1]
    left_us = full_us - np.arange(begun) * step_us

    def steps_of(duration_us: int) -> int:
        return max(1, -(-duration_us // step_us))

    def charge_us(battery_us: int) -> int:
        return world.until_full_us(battery_us)

    stations = np.array([ix * ny + iy for ix, iy in world.stations], np.int64)
    hop_us = np.array(world.planner.hop_us)
    home = np.zeros((len(ahead), len(stations), begun), np.int64)
    for cell in range(len(ahead)):
        for s, station in enumerate(stations.tolist()):
            dx, dy = station // ny - cell // ny, station % ny - cell % ny
            flown_us = int(time_on_open_map(hop_us, dx, dy, 0))
            for j in range(begun):
                arrives_with_us = int(left_us[j]) - flown_us
                if left_us[j] <= world.return_below_us and arrives_with_us >= 0:
                    home[cell, s, j] = steps_of(flown_us + charge_us(arrives_with_us))
    charge = np.array([steps_of(charge_us(int(battery_us))) for battery_us in left_us])
    # A return by per_action drains faster than time passes, so that a crash may come at any time.
    battery: Any = world.only_type.drones.battery
    even = type(battery) is Endurance
    crash = np.array([steps_of(int(left) * even + world.respawn_after_us) for left in left_us])
    return Alone(ahead, np.arange(len(ahead)), stations, charge, home, crash, True)


def best_alone(alone: Alone, paid: NDArray[np.float64], steps: int) -> Plan:
    """Return what is best for a drone that is paid for each leg in each step.

    ``paid`` has the shape (steps, cells, 5), or (1, cells, 5) if all steps pay the same.
    """
    shape = steps, len(alone.ahead), len(alone.charge)
    longest = 1 + int(max(alone.charge.max(), alone.home.max(initial=0), alone.crash.max()))
    decisions = np.empty(shape, np.int16)
    waits = np.zeros((steps, len(alone.stations)), np.bool_)
    resumes = np.zeros(steps + longest, np.int16)
    airborne, landed = _induce(alone, paid, longest, decisions, waits, resumes)
    return Plan(airborne, landed, decisions, waits, resumes)


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
    ahead, over, stations, _, home, _, limited, may_wait = alone
    steps, places, begun = decisions.shape
    landed = np.zeros((steps + longest, len(stations)))
    resumed = np.zeros(steps + longest)
    later, now = np.zeros((places, begun)), np.zeros((places, begun))
    shift, far = int(limited), 0
    while far < begun and not home[:, :, far].any():
        far += 1
    for t in range(steps - 1, -1, -1):
        pay = paid[t % len(paid)]
        for place in range(places):
            values, chosen, earned = now[place], decisions[t, place], pay[over[place]]
            values[:], chosen[:] = NEVER, 0
            for k in range(ahead.shape[1]):
                to = ahead[place, k]
                if to >= 0:
                    paid_for = earned[k if k < len(earned) else 0]
                    _offer(paid_for, later[to, shift:], k, values, chosen)
            if limited:
                _offer_battery(alone, t, place, far, earned, (landed, resumed), (values, chosen))
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
    chosen: NDArray[np.int16],
) -> None:
    """Choose a decision in the states, by steps since the battery was full, where it is better."""
    for j in range(len(later)):
        value = pay + later[j]
        better = value > values[j]
        values[j] = value if better else values[j]
        chosen[j] = decision if better else chosen[j]


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
    """Choose to charge, to crash, or to return where this is better, and the last leg before that.

    ``later`` has the values with a full battery: on each station, and on the best one.
    """
    (landed, resumed), (values, chosen) = later, best
    last = len(values) - 1
    for k in range(len(earned)):
        if alone.ahead[place, k] >= 0:
            value = resumed[t + alone.crash[last]] + earned[k]
            if value > values[last]:
                values[last], chosen[last] = value, k
    for j in range(len(values)):
        if resumed[t + alone.crash[j]] > values[j]:
            values[j], chosen[j] = resumed[t + alone.crash[j]], CRASH
    for s in range(len(alone.stations)):
        if alone.stations[s] == place:
            for j in range(1, len(values)):
                value = landed[t + alone.charge[j], s]
                if value > values[j]:
                    values[j], chosen[j] = value, CHARGE
        for j in range(far, len(values)):
            if alone.home[place, s, j] > 0:
                value = landed[t + alone.home[place, s, j], s]
                if value > values[j]:
                    values[j], chosen[j] = value, HOME + s


def follow(
    alone: Alone,
    plan: Plan,
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
    plan: Plan,
    shares: Shares,
    begin: int,
    place: int,
    j: int,
    station: int,
    covered: NDArray[np.float64],
) -> None:
    """Follow a plan from a place, or from a station if this is not -1 (see ``follow``)."""
    ahead, over, stations, charge, home, crash, limited, _ = alone
    steps, _, begun = plan.decisions.shape
    t = 0
    while t < steps:
        if station >= 0:
            if plan.waits[t, station]:
                t += 1
                continue
            place, j, station = stations[station], 0, -1
        decision = plan.decisions[t, place, j]
        if decision < CHARGE:
            leg = leg_of(shares, begin + t, over[place]) + (decision if decision < 5 else 0)
            for i in range(shares.first[leg], shares.first[leg + 1]):
                covered[t, shares.users[i]] += shares.shares[i]
            if limited and j + 1 == begun:
                t += crash[j]
                station = plan.resumes[min(t, steps)]
            else:
                place, j, t = ahead[place, decision], j + 1 if limited else 0, t + 1
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
