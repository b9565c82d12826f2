"""QoE1 as a measure that prices bound.

QoE1 is the sum over requests of the share that is served, divided by their number, which may depend
on the policy. It is at most θ if no policy makes the sum over requests of (share - θ) positive. A
user pays its price for the time in which it is served, and a drone earns it. Whatever drones do,
the sum is at most what users gain if each chooses freely when to be served and how many of its
requests are made, and what drones earn at most. The bound is the θ at which these add up to zero.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from desim_uav.model.demand.requests import DUE_US, REQUIRED_US, Requests
from desim_uav.optimum.run.prices import Prices, Slope
from desim_uav.rowcode.kernels import maker

HIGHEST = 4.0
"""The largest θ that is looked for; prices may also prove nothing, with a θ above 1."""

HALVINGS = 45
"""How often the interval that contains θ is halved."""


class Chains(NamedTuple):
    """The requests of a run. A chain is those of one user in one episode.

    The requests of chain i, whose user is ``users[i]``, are ``first[i]:first[i + 1]``. Each can be
    made at ``earliest``, requires a time of service, and can be served until ``ends``; times are in
    steps from the start of the run. If ``after_previous[i]``, a request is made only if the
    previous one of its chain has been served completely; otherwise all but the first may be
    dropped.
    """

    first: NDArray[np.int64]
    users: NDArray[np.int64]
    earliest: NDArray[np.float64]
    required: NDArray[np.float64]
    ends: NDArray[np.int64]
    after_previous: NDArray[np.bool_]


def asked_in(episodes: Sequence[Requests], steps: int, step_us: int) -> Chains:
    """Return the requests of episodes of so many steps, which follow upon each other.

    A request is made at the earliest if all previous ones of its user are served at once.
    """
    first, users, rows = [0], [], []
    follows = np.concatenate([requests.follows for requests in episodes])
    for episode, requests in enumerate(episodes):
        for user in range(len(requests.offsets) - 1):
            own, t_us = requests.rows[requests.offsets[user] : requests.offsets[user + 1]], 0
            for row in own.tolist():
                t_us = t_us + row[DUE_US] if requests.follows[user] else row[DUE_US]
                if t_us >= steps * step_us:
                    break
                earliest = episode * steps + t_us / step_us
                rows.append((earliest, row[REQUIRED_US] / step_us, (episode + 1) * steps))
                t_us += row[REQUIRED_US]
            users.append(user)
            first.append(len(rows))
    table = np.array(rows, float).reshape(-1, 3)
    return Chains(
        np.array(first),
        np.array(users, np.int64),
        table[:, 0].copy(),
        table[:, 1].copy(),
        table[:, 2].astype(np.int64),
        follows,
    )


class Served:
    """The mean share of the requests of a run that is served."""

    most = np.inf

    def __init__(self, chains: Chains) -> None:
        self.chains = chains

    def at_most(self, prices: Prices, earned: float) -> Slope:
        """Return the bound on QoE1, and its slope."""
        chains, needed = self.chains, np.zeros_like(prices)
        gains = np.empty((len(chains.required), 2))
        _gains(chains, prices, gains)
        low, theta = 0.0, HIGHEST
        for _ in range(HALVINGS):
            middle = 0.5 * (low + theta)
            if _choose(chains, prices, gains, middle, needed, False)[0] + earned > 0.0:
                low = middle
            else:
                theta = middle
        _, requests = _choose(chains, prices, gains, theta, needed, True)
        return Slope(theta, needed, float(max(requests, 1)))


@maker
def _buy(
    prices: Prices, user: int, window: tuple[float, int], most: float, worth: float
) -> tuple[NDArray[np.int64], NDArray[np.float64], float, float]:
    """Buy service for a user in a window, at the lowest prices, as long as they are below a worth.

    Returns the steps, the time bought in each, and the time and the price of all of it.
    """
    earliest, end = window
    begin = int(earliest)
    steps = begin + np.argsort(prices[begin:end, user], kind="mergesort")
    times = np.zeros(len(steps))
    bought = paid = 0.0
    for i in range(len(steps)):
        t = steps[i]
        if bought >= most or prices[t, user] >= worth:
            break
        times[i] = min(most - bought, 1.0 if t > begin else begin + 1 - earliest)
        bought += times[i]
        paid += times[i] * prices[t, user]
    return steps, times, bought, paid


@maker
def _gains(chains: Chains, prices: Prices, gains: NDArray[np.float64]) -> None:
    """Write the largest gain of each request, if it is served completely and otherwise."""
    for chain in range(len(chains.users)):
        user = chains.users[chain]
        for k in range(chains.first[chain], chains.first[chain + 1]):
            window, required = (chains.earliest[k], chains.ends[k]), chains.required[k]
            _, _, bought, paid = _buy(prices, user, window, required, np.inf)
            whole = required <= chains.ends[k] - chains.earliest[k] + 1e-9
            gains[k, 0] = 1.0 - paid if whole else -np.inf
            _, _, bought, paid = _buy(prices, user, window, required, 1.0 / required)
            gains[k, 1] = bought / required - paid


@maker
def _choose(
    chains: Chains,
    prices: Prices,
    gains: NDArray[np.float64],
    theta: float,
    needed: Prices,
    write: bool,
) -> tuple[float, int]:
    """Return the sum of what users gain, θ per request deducted, and the requests that are made.

    If ``write`` is true, the times of service are added to ``needed`` (steps, users).
    """
    total, requests = 0.0, 0
    for chain in range(len(chains.users)):
        first, stop = chains.first[chain], chains.first[chain + 1]
        if first == stop:
            continue
        best, last, served = -np.inf, first, 0.0
        for k in range(first, stop):
            if chains.after_previous[chain]:
                gain = served + gains[k, 1] - theta * (k - first + 1)
                served += gains[k, 0]
                if gain > best:
                    best, last = gain, k
            elif k == first:
                best = gains[k, 1] - theta
            else:
                best += max(0.0, gains[k, 1] - theta)
        total += best
        for k in range(first, stop):
            whole = chains.after_previous[chain] and k < last
            part = k == last or (not chains.after_previous[chain] and gains[k, 1] > theta)
            if not (whole or part):
                continue
            requests += 1
            if write:
                worth = np.inf if whole else 1.0 / chains.required[k]
                window = (chains.earliest[k], chains.ends[k])
                steps, times, _, _ = _buy(
                    prices, chains.users[chain], window, chains.required[k], worth
                )
                for i in range(len(steps)):
                    needed[steps[i], chains.users[chain]] += times[i]
    return total, requests
