"""Flights of two drones that make the least of the users' mean rates large.

Lengths are in units of the drones' height. A flight is a closed polygon with a place for each slot
of time. In each slot the time is divided among modes: one drone sends to a user, or both send, each
to a user of its own, and interfere with each other. The division is the optimum of a linear
program. Places and division are improved in turn: rates are linear in small shifts of the places,
so the best shifts within a trust region are the optimum of another linear program. Steps are taken
only if the least rate rises, so what is returned is a rate that is reached, at a local optimum.
"""

from __future__ import annotations

import math
from itertools import combinations
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linprog
from scipy.sparse import block_diag, coo_array, csr_array, hstack, kron, vstack

Array = NDArray[np.float64]

SIDES = 24
"""The disc of places that are reached within a slot counts as a polygon inside it."""

APART = 1.0
"""The least distance of the drones: 100 m."""

FIRST_STEP, LAST_STEP, LEAST_GAIN = 0.5, 0.01, 1e-4
"""The half width of the trust region, which is where the search begins and ends, and the share by
which a step must raise the least rate."""

LN2 = math.log(2.0)


class Flights(NamedTuple):
    """The places of both drones (drones, slots, 2), and the least rate in bit/s/Hz."""

    places: Array
    rate: float


def best_flights(users: Array, above: float, hop: float, slots: int) -> Flights:
    """Return flights of two drones at a local optimum.

    Args:
        users: The places of the users (users, 2), in units of the drones' height.
        above: The signal-to-noise ratio right below a drone that is alone.
        hop: The longest way within a slot.
        slots: The number of slots after which the flights begin again.
    """
    places = _first(users, hop, slots)
    shares, rate = divided(users, above, places)
    step = FIRST_STEP
    while step >= LAST_STEP:
        moved = places + _shifts(users, above, hop, places, shares, step)
        new_shares, new_rate = divided(users, above, moved)
        better = new_rate > rate * (1.0 + LEAST_GAIN) and _apart(moved) >= APART
        if better:
            places, shares, rate = moved, new_shares, new_rate
        step *= 1.5 if better else 0.5
    return Flights(places, rate)


def _apart(places: Array) -> float:
    return float(np.linalg.norm(places[0] - places[1], axis=1).min())


def _first(users: Array, hop: float, slots: int) -> Array:
    """Return two circles, each round the middle of a half of the users, with no hop too long.

    The halves are those whose users are nearest to their middles.
    """
    count = len(users)

    def halves(chosen: tuple[int, ...]) -> tuple[Array, Array]:
        rest = [k for k in range(count) if k not in chosen]
        return users[list(chosen)], users[rest]

    def spread(chosen: tuple[int, ...]) -> float:
        return sum(float(((half - half.mean(axis=0)) ** 2).sum()) for half in halves(chosen))

    angles = np.arange(slots) * (2.0 * math.pi / slots)
    ring = np.column_stack([np.cos(angles), np.sin(angles)])
    circles = []
    for half in halves(min(combinations(range(count), count // 2), key=spread)):
        middle = half.mean(axis=0)
        reach = float(np.linalg.norm(half - middle, axis=1).mean())
        circles.append(middle + min(reach, 0.9 * hop * slots / (2.0 * math.pi)) * ring)
    return np.array(circles)


# ---- modes


def _modes(count: int) -> NDArray[np.int64]:
    """Return the users to whom the drones send in each mode, -1 for a drone that is silent."""
    return np.array(
        [(i, j) for i in range(-1, count) for j in range(-1, count) if i != j], dtype=np.int64
    )


def _gains(users: Array, above: float, places: Array) -> Array:
    """Return the received powers over the noise (drones, slots, users)."""
    squares = ((places[:, :, None] - users) ** 2).sum(axis=3)
    return np.asarray(above / (1.0 + squares), dtype=np.float64)


def _rates(users: Array, above: float, places: Array) -> tuple[NDArray[np.int64], Array, Array]:
    """Return modes, the rate of each drone in them (drones, modes, slots), and its derivatives.

    The derivatives (drones, modes, slots, 2) are those with respect to the power received from
    the drone and that of the interference.
    """
    modes = _modes(len(users))
    gains = _gains(users, above, places)
    rates, slopes = [], []
    for drone in range(2):
        user, other = modes[:, drone], modes[:, 1 - drone]
        signal = np.where(user[:, None] >= 0, gains[drone][:, user].T, 0.0)
        noise = 1.0 + np.where(other[:, None] >= 0, gains[1 - drone][:, user].T, 0.0)
        rates.append(np.log2(1.0 + signal / noise))
        total = (noise + signal) * LN2
        slopes.append(np.stack([1.0 / total, -signal / (noise * total)], axis=2))
    return modes, np.array(rates), np.array(slopes)


def divided(users: Array, above: float, places: Array) -> tuple[Array, float]:
    """Return the best division of each slot among modes (modes, slots), and the least rate."""
    modes, rates, _ = _rates(users, above, places)
    slots = places.shape[1]
    carried = [
        np.where(modes[:, 0] == user, rates[0].T, 0.0)
        + np.where(modes[:, 1] == user, rates[1].T, 0.0)
        for user in range(len(users))
    ]
    gains = hstack(
        [np.ones((len(users), 1)), -csr_array(np.array([one.ravel() for one in carried])) / slots]
    )
    times = hstack(
        [csr_array((slots, 1)), kron(csr_array(np.eye(slots)), np.ones((1, len(modes))))]
    )
    wanted = np.zeros(1 + len(modes) * slots)
    wanted[0] = -1.0
    solved = linprog(
        wanted,
        A_ub=vstack([gains, times]).tocsr(),
        b_ub=np.concatenate([np.zeros(len(users)), np.ones(slots)]),
    )
    return solved.x[1:].reshape(slots, len(modes)).T, float(-solved.fun)


# ---- shifts


def _shifts(
    users: Array, above: float, hop: float, places: Array, shares: Array, step: float
) -> Array:
    """Return the shifts of all places, at most ``step`` along each axis, that seem best.

    They make the least rate largest if the rates are taken as linear, and keep to the hop and,
    to the first order, to the distance of the drones.
    """
    modes, rates, slopes = _rates(users, above, places)
    slots, count = places.shape[1], len(users)
    base, turned = np.zeros(count), np.zeros((count, 2, slots, 2))
    towards = -2.0 * (places[:, :, None] - users)
    by_place = (_gains(users, above, places) ** 2 / above)[..., None] * towards
    for drone in range(2):
        for mode, pair in enumerate(modes):
            user, part = pair[drone], shares[mode] / slots
            if user < 0 or not part.any():
                continue
            base[user] += float(part @ rates[drone, mode])
            weight = part[:, None] * slopes[drone, mode]
            turned[user, drone] += weight[:, :1] * by_place[drone, :, user]
            if pair[1 - drone] >= 0:
                turned[user, 1 - drone] += weight[:, 1:] * by_place[1 - drone, :, user]
    gains = hstack([np.ones((count, 1)), csr_array(-turned.reshape(count, -1))])
    fast, slack = _no_faster(places, hop)
    near, room = _not_nearer(places)
    still = vstack([fast, near])
    limits = vstack([gains, hstack([csr_array((still.shape[0], 1)), still])])
    wanted = np.zeros(1 + places.size)
    wanted[0] = -1.0
    solved = linprog(
        wanted,
        A_ub=limits.tocsr(),
        b_ub=np.concatenate([base, slack, room]),
        bounds=[(None, None), *[(-step, step)] * places.size],
    )
    if solved.x is None:
        return np.zeros_like(places)
    return np.asarray(solved.x[1:].reshape(places.shape), dtype=np.float64)


def _no_faster(places: Array, hop: float) -> tuple[csr_array, Array]:
    """Return the rows and the slack of: no place is farther from the next one than a hop."""
    angles = (np.arange(SIDES) + 0.5) * (2.0 * math.pi / SIDES)
    sides = np.column_stack([np.cos(angles), np.sin(angles)])
    slots = places.shape[1]
    onwards = csr_array(np.roll(np.eye(slots), 1, axis=1) - np.eye(slots))
    of_one = kron(onwards, sides)
    hops = np.roll(places, -1, axis=1) - places
    longest = hop * math.cos(math.pi / SIDES)
    return csr_array(block_diag([of_one, of_one])), longest - (hops @ sides.T).ravel()


def _not_nearer(places: Array) -> tuple[csr_array, Array]:
    """Return the rows and the slack of: the drones are never nearer than the least distance."""
    between = places[0] - places[1]
    lengths = np.linalg.norm(between, axis=1)
    slots = places.shape[1]
    at, ahead = np.arange(slots).repeat(2), (between / lengths[:, None]).ravel()
    own = coo_array((-ahead, (at, np.arange(2 * slots))), shape=(slots, 2 * slots))
    return csr_array(hstack([own, -own])), lengths - APART
