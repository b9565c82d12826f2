"""The most that one drone can earn by gathering data and carrying them to the ground.

The drone is a relaxed one: it flies over the map without buildings, lands on any station by the
shortest way, and never queues for a pad. A *trip* lasts from a take-off to a landing. Backward
induction visits every state (step, cell, landing), where a landing is the step in which the drone
sets out for a station and the time that it flies there.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from desim_uav.drone_type import DroneType
from desim_uav.optimum.run.alone import ANYWHERE, steps_of
from desim_uav.optimum.run.battery import crash_us, hop_of, relaxed_charges
from desim_uav.optimum.run.rates import PIECES, Rates
from desim_uav.rowcode.kernels import maker

MOST_FLIGHTS = 6
"""The largest number of times of flight to a station; longer flights count as the longest."""

NEVER = -1e300


class Trips(NamedTuple):
    """What a drone can do that gathers data.

    ``flight`` (cells, stations) is the number of the time of flight to each station, and ``flown``
    (flights,) these times in steps. ``away`` (flights,): the steps from the one in which the drone
    sets out to the one in which it can take off again. ``stations``: their cells. ``longest`` is
    the largest number of steps of a trip, and ``respawn`` the steps from a crash to a replacement.
    ``heard[first_heard[i]:first_heard[i + 1]]`` are the sensors that can send in some piece of leg
    i; the legs are those from cell 0, then from cell 1, and so on.
    """

    ahead: NDArray[np.int64]
    mbit: NDArray[np.float64]
    flight: NDArray[np.int64]
    flown: NDArray[np.float64]
    away: NDArray[np.int64]
    stations: NDArray[np.int64]
    longest: int
    respawn: int
    first_heard: NDArray[np.int64]
    heard: NDArray[np.int64]


class Payments(NamedTuple):
    """What sensors pay drones for, or how much of it they buy.

    ``landed`` (users, steps, flights): for a landing, by the step in which the drone sets out for
    the station, and the number of its flight there. ``near`` (users, steps, longest, flights): for
    a step on a leg on which the sensor can send, by the steps from its end until the drone sets
    out, and the number of its flight. ``bits`` (users, steps): for a Mbit that is sent in a step.
    At most ``most`` (users, steps) Mbit are sent.
    """

    landed: NDArray[np.float64]
    near: NDArray[np.float64]
    bits: NDArray[np.float64]
    most: NDArray[np.float64]


def trips_of(kind: DroneType, rates: Rates, step_us: int) -> Trips:
    """Return what the relaxed drone of a type can do."""
    ny = kind.grid.cells[1]
    stations = np.array([ix * ny + iy for ix, iy in kind.stations], np.int64)
    hop_us = {way: hop_of(kind, (*way, 0))[0] for way in ((1, 0), (-1, 0), (0, 1), (0, -1))}
    cells = np.arange(len(rates.ahead))
    dx, dy = (stations // ny - (cells // ny)[:, None]), (stations % ny - (cells % ny)[:, None])
    flown_us = np.abs(dx) * np.where(dx < 0, hop_us[-1, 0], hop_us[1, 0])
    flown_us += np.abs(dy) * np.where(dy < 0, hop_us[0, -1], hop_us[0, 1])
    times_us = np.unique(flown_us)[:MOST_FLIGHTS]
    charges = relaxed_charges(kind, step_us, finest=1)
    full_us = kind.until_full_us(int(charges.most[min(1, len(charges.most) - 1)]))
    away = [steps_of(int(us) + full_us, step_us) for us in times_us]
    return Trips(
        rates.ahead,
        rates.mbps * (step_us / 1e6 / PIECES),
        np.searchsorted(times_us, flown_us, side="right") - 1,
        times_us / step_us,
        np.array(away),
        stations,
        len(charges.most),
        steps_of(int(crash_us(kind, step_us, charges.least[-1:])[0]), step_us),
        *_heard(rates),
    )


def _heard(rates: Rates) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return the sensors that can send on each leg, as ``Trips`` keeps them."""
    can_send = rates.mbps.max(2).reshape(rates.ahead.size, -1) > 0.0
    first = np.concatenate([[0], np.cumsum(can_send.sum(1))])
    return first, np.nonzero(can_send)[1]


@maker
def _heard_on(trips: Trips, cell: int, k: int) -> NDArray[np.int64]:
    """Return the sensors that can send on a leg from a cell."""
    leg = cell * trips.ahead.shape[1] + k
    return trips.heard[trips.first_heard[leg] : trips.first_heard[leg + 1]]


class Plan(NamedTuple):
    """The best decisions of a drone, and what it earns by them.

    ``aloft`` (longest + 1, flights, cells): what it earns from step 0 on, by the steps until it
    sets out for a station; ``lost`` (cells,): if it never does, or crashes before; ``landed``
    (steps, stations): from any step on. ``legs`` (steps, longest + 1, flights, cells) and
    ``astray`` (steps, cells) are the legs that it flies; -1 - k is leg k, in which it crashes.
    ``leaves`` (steps, stations, 2): the steps of the trip for which it takes off, and its flight;
    the steps are -1 if it waits, and 0 if the trip never ends. ``replaced`` (steps,): the station
    of a replacement.
    """

    aloft: NDArray[np.float64]
    lost: NDArray[np.float64]
    landed: NDArray[np.float64]
    legs: NDArray[np.int8]
    astray: NDArray[np.int8]
    leaves: NDArray[np.int64]
    replaced: NDArray[np.int64]

    def value(self, start: int) -> float:
        """Return what a drone earns from a cell on, or from ANYWHERE."""
        if start != ANYWHERE:
            return max(float(self.aloft[:, :, start].max()), float(self.lost[start]))
        return max(float(part.max()) for part in (self.aloft, self.lost, self.landed[0]))


@maker
def fill(
    trips: Trips,
    leg: tuple[int, int],
    price: NDArray[np.float64],
    most: NDArray[np.float64],
    sent: NDArray[np.float64],
) -> float:
    """Return what the best use of the band on a leg earns, and write the Mbit that each user sends.

    ``leg`` is a cell and the number of a leg. In each piece those send first of whom a second of
    the band earns most. A leg whose pieces are alike is one piece.
    """
    sent[:] = 0.0
    cell, k = leg
    mbit, heard = trips.mbit[cell, k], _heard_on(trips, cell, k)
    pieces, alike = len(mbit), True
    for u in heard:
        for p in range(1, pieces):
            alike = alike and mbit[p, u] == mbit[0, u]
    scale, total = (float(pieces) if alike else 1.0), 0.0
    done = np.full(len(price), -1)
    for p in range(1 if alike else pieces):
        left = 1.0
        while left > 0.0:
            best, earns = -1, 0.0
            for u in heard:
                if done[u] != p and mbit[p, u] * price[u] > earns:
                    best, earns = u, mbit[p, u] * price[u]
            if best < 0:
                break
            done[best] = p
            part = min(left * scale * mbit[p, best], most[best])
            sent[best] += part
            total += part * price[best]
            left -= part / (scale * mbit[p, best])
    return total


def best_trips(trips: Trips, prices: Payments) -> Plan:
    """Return the best decisions of a drone at these prices."""
    _, steps, longest, flights = prices.near.shape
    cells, stations = trips.flight.shape
    aloft = np.full((longest + 1, flights, cells), NEVER)
    beyond = steps + 1 + max(int(trips.away.max()), trips.respawn)
    plan = Plan(
        aloft,
        np.zeros(cells),
        np.zeros((beyond, stations)),
        np.zeros((steps, *aloft.shape), np.int8),
        np.full((steps, cells), -1, np.int8),
        np.full((steps, stations, 2), -1),
        np.zeros(beyond, np.int64),
    )
    _induce(trips, prices, plan)
    return plan


@maker
def _induce(trips: Trips, prices: Payments, plan: Plan) -> None:
    """Write the plan, from the last step to the first."""
    users, steps, longest, flights = prices.near.shape
    cells, ways = trips.ahead.shape
    aloft, lost, sent = plan.aloft.copy(), plan.lost.copy(), np.zeros(users)
    paid = np.zeros(longest * flights)
    near = prices.near.reshape(users, steps, longest * flights)
    for t in range(steps - 1, -1, -1):
        again = _set_out(trips, prices, t, plan, aloft)
        lost[:] = NEVER
        most = min(longest, steps - 1 - t)
        for c in range(cells):
            for k in range(ways):
                to = trips.ahead[c, k]
                if to < 0:
                    continue
                own = fill(trips, (c, k), prices.bits[:, t], prices.most[:, t], sent)
                paid[:] = own
                for u in _heard_on(trips, c, k):
                    for i in range(most * flights):
                        paid[i] += near[u, t, i]
                flies_on, crashes = own + plan.lost[to], own + again
                if max(flies_on, crashes) > lost[c]:
                    lost[c] = max(flies_on, crashes)
                    plan.astray[t, c] = k if flies_on >= crashes else -1 - k
                for n in range(most):
                    for m in range(flights):
                        value = paid[n * flights + m] + plan.aloft[n, m, to]
                        if value > aloft[n + 1, m, c]:
                            aloft[n + 1, m, c], plan.legs[t, n + 1, m, c] = value, k
        plan.aloft[:], plan.lost[:] = aloft, lost
        _take_off(trips, t, plan)


@maker
def _set_out(
    trips: Trips, prices: Payments, t: int, plan: Plan, aloft: NDArray[np.float64]
) -> float:
    """Write what a drone earns that sets out for a station in a step.

    Returns what it earns after a crash in this step.
    """
    aloft[:] = NEVER
    paid = np.zeros(len(trips.flown))
    for u in range(len(prices.landed)):
        paid += prices.landed[u, t]
    for c in range(len(trips.flight)):
        for s in range(len(trips.stations)):
            m = trips.flight[c, s]
            aloft[0, m, c] = max(aloft[0, m, c], paid[m] + plan.landed[t + trips.away[m], s])
    again = t + trips.respawn
    plan.replaced[again] = np.argmax(plan.landed[again])
    return float(plan.landed[again, plan.replaced[again]])


@maker
def _take_off(trips: Trips, t: int, plan: Plan) -> None:
    """Write what a drone earns on each station in a step, and whether it takes off."""
    for s in range(len(trips.stations)):
        best, home = plan.landed[t + 1, s], trips.stations[s]
        if plan.lost[home] > best:
            best, plan.leaves[t, s, 0] = plan.lost[home], 0
        for n in range(1, plan.aloft.shape[0]):
            for m in range(plan.aloft.shape[1]):
                if plan.aloft[n, m, home] > best:
                    best = plan.aloft[n, m, home]
                    plan.leaves[t, s, 0], plan.leaves[t, s, 1] = n, m
        plan.landed[t, s] = best


def follow_trips(trips: Trips, prices: Payments, plan: Plan, start: int, used: Payments) -> None:
    """Add to ``used`` what a drone is paid for by a plan."""
    cell, n, m, station = start, 0, 0, -1
    if start == ANYWHERE:
        best = [float(part.max()) for part in (plan.aloft, plan.lost, plan.landed[0])]
        where = int(np.argmax(best))
        if where == 0:
            n, m, cell = map(int, np.unravel_index(plan.aloft.argmax(), plan.aloft.shape))
        cell = int(plan.lost.argmax()) if where == 1 else cell
        n = -1 if where == 1 else n
        station = int(plan.landed[0].argmax()) if where == 2 else -1
    else:
        n, m = map(int, np.unravel_index(plan.aloft[:, :, start].argmax(), plan.aloft.shape[:2]))
        n = -1 if plan.lost[start] >= plan.aloft[n, m, start] else n
    _follow(trips, prices, plan, (cell, n, m, station), used)


@maker
def _follow(
    trips: Trips,
    prices: Payments,
    plan: Plan,
    start: tuple[int, int, int, int],
    used: Payments,
) -> None:
    """Follow a plan from a cell and the steps until it sets out (-1: never), or from a station."""
    cell, n, m, station = start
    t, steps, sent = 0, len(plan.legs), np.zeros(len(prices.bits))
    while t < steps:
        if station >= 0:
            n, m = plan.leaves[t, station]
            if n < 0:
                t += 1
                continue
            cell, station = trips.stations[station], -1
            n = n if n > 0 else -1
        if n == 0:
            used.landed[:, t, m] += 1.0
            best = t + trips.away[m]
            for s in range(len(trips.stations)):
                better = station < 0 or plan.landed[best, s] > plan.landed[best, station]
                if trips.flight[cell, s] == m and better:
                    station = s
            t = best
            continue
        k = plan.legs[t, n, m, cell] if n > 0 else plan.astray[t, cell]
        crashes = k < 0
        k = -1 - k if crashes else k
        fill(trips, (cell, k), prices.bits[:, t], prices.most[:, t], sent)
        used.bits[:, t] += sent
        if n > 0:
            for u in _heard_on(trips, cell, k):
                used.near[u, t, n - 1, m] += 1.0
        cell, n, t = trips.ahead[cell, k], (n - 1 if n > 0 else n), t + 1
        if crashes:
            t += trips.respawn - 1
            station = plan.replaced[t]
