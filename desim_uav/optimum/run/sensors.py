"""The least ages of sensors at the ground, if they pay drones for what these do.

A sensor chooses which of its updates are delivered. For each of them it pays a drone for the step
in which the last bit is sent and for the landing after it, and it pays for the Mbit of the update
in the cheapest step between that in which the update was taken and that of the last bit.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from desim_uav.model.demand.requests import DUE_US, REQUIRED_US, Requests
from desim_uav.model.services import MICROBITS
from desim_uav.optimum.run.trips import Payments
from desim_uav.rowcode.kernels import maker


class Updates(NamedTuple):
    """The updates of sensors in an episode, each sensor's in the order of time.

    Those of sensor u are ``first[u]:first[u + 1]``. ``taken`` and ``whole`` (updates,): the steps
    at which each was taken, and after which its last bit can come; ``size``: its Mbit. ``most``
    (sensors, steps): the Mbit that a sensor can send in a step.
    """

    first: NDArray[np.int64]
    taken: NDArray[np.float64]
    whole: NDArray[np.float64]
    size: NDArray[np.float64]
    most: NDArray[np.float64]


def updates_of(
    requests: Requests,
    sensors: list[int],
    last_only: list[bool],
    steps: int,
    step_us: int,
    mbps: NDArray[np.float64],
) -> Updates:
    """Return the updates of sensors, who send at ``mbps`` (sensors,) at most.

    A sensor sends in a step what it takes in this step, and what it has: no more than two updates
    if it keeps the last one only, and else no more than all before.
    """
    first, parts, most = [0], [], np.zeros((len(sensors), steps))
    for row, user in enumerate(sensors):
        own = requests.rows[requests.offsets[user] : requests.offsets[user + 1]]
        own = own[own[:, DUE_US] < steps * step_us]
        own = own[np.argsort(own[:, DUE_US], kind="stable")]
        taken, size = own[:, DUE_US] / step_us, own[:, REQUIRED_US] / MICROBITS
        lasts = size / mbps[row] * (1e6 / step_us) if mbps[row] > 0.0 else np.full(len(own), np.inf)
        parts.append(np.stack([taken, taken + lasts, size]))
        first.append(first[-1] + len(own))
        in_step = np.bincount(taken.astype(np.int64), size, minlength=steps)[:steps]
        before = np.cumsum(in_step) - in_step
        has = np.minimum(before, 2.0 * size.max(initial=0.0)) if last_only[row] else before
        most[row] = in_step + has
    taken, whole, sizes = np.ascontiguousarray(np.concatenate(parts, axis=1))
    return Updates(np.array(first), taken, whole, sizes, most)


@maker
def least_ages(
    updates: Updates, flown: NDArray[np.float64], prices: Payments, used: Payments
) -> float:
    """Return the least sum of ages over time, in steps squared, and of what sensors pay.

    What they pay for is added to ``used``.
    """
    steps, total = prices.near.shape[1], 0.0
    for u in range(len(prices.near)):
        total += 0.5 * steps * steps + _least_age(updates, u, flown, prices, used)
    return total


@maker
def _least_age(
    updates: Updates,
    u: int,
    flown: NDArray[np.float64],
    prices: Payments,
    used: Payments,
) -> float:
    """Return the least age of a sensor and what it pays, less its age without deliveries.

    The value of an update is this, if it is the last one that is delivered.
    """
    _, steps, _, flights = prices.near.shape
    first, number = updates.first[u], updates.first[u + 1] - updates.first[u]
    value, chosen = np.zeros(number + 1), np.full((number + 1, 5), -1)
    least, before = np.zeros((steps, flights)), np.full((steps, flights), -1)
    best = number  # no update
    for j in range(number):
        value[j] = _deliver(updates, first + j, u, flown, prices, (least, before), chosen[j])
        best = j if value[j] < value[best] else best
        for r in range(steps):
            for m in range(flights):
                trial = value[j] + updates.taken[first + j] * max(0.0, steps - r - flown[m])
                if trial < least[r, m]:
                    least[r, m], before[r, m] = trial, j
    last = best if best < number else -1
    while last >= 0:
        t, n, m, cheapest, earlier = chosen[last]
        used.landed[u, t + 1 + n, m] += 1.0
        used.near[u, t, n, m] += 1.0
        used.bits[u, cheapest] += updates.size[first + last]
        last = earlier
    return float(value[best])


@maker
def _deliver(
    updates: Updates,
    j: int,
    u: int,
    flown: NDArray[np.float64],
    prices: Payments,
    earlier: tuple[NDArray[np.float64], NDArray[np.int64]],
    chosen: NDArray[np.int64],
) -> float:
    """Return the value of an update, and write how it is delivered.

    ``earlier`` has the least value of updates before, by the landing with which this one comes, and
    which they are. ``chosen`` gets the step of the last bit, the steps until the drone sets out
    after it, its flight, the cheapest step for bits, and the update before.
    """
    _, steps, longest, flights = prices.near.shape
    least, before = earlier
    value, cheapest = np.inf, int(updates.taken[j])
    for t in range(int(updates.taken[j]), steps - 1):
        if prices.bits[u, t] < prices.bits[u, cheapest]:
            cheapest = t
        if updates.whole[j] > t + 1:
            continue
        pays = updates.size[j] * prices.bits[u, cheapest]
        for n in range(min(longest, steps - 1 - t)):
            r = t + 1 + n
            for m in range(flights):
                falls = updates.taken[j] * max(0.0, steps - r - flown[m])
                asks = pays + prices.near[u, t, n, m] + prices.landed[u, r, m]
                trial = least[r, m] - falls + asks
                if trial < value:
                    value = trial
                    chosen[0], chosen[1], chosen[2] = t, n, m
                    chosen[3], chosen[4] = cheapest, before[r, m]
    return float(value)
