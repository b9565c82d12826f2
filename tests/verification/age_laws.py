"""Closed forms of the age of information. This module shares no code with the simulator.

Updates come at a rate ``load`` and are sent at a rate of 1, so all times are in mean times of
sending. Sources: Kaul, Yates and Gruteser 2012 (one queue); Costa, Codreanu and Ephremides 2016
(small buffers); Yates and Kaul 2019 (several sources that share a server); Sun et al. 2017 (update
or wait).
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq, minimize_scalar


def m_m_1(load: float) -> float:
    """Poisson updates, exponential sending, and a buffer for all."""
    return 1 + 1 / load + load**2 / (1 - load)


def m_m_1_last_first(load: float) -> float:
    """Poisson updates, exponential sending, all are kept, and the last one is always sent next.

    The age exceeds a if nothing that was taken after now - a has been sent. So its mean is that of
    the time from any instant until the first update that is taken later has been sent: one has to
    be taken; if another one is being sent then, its rest of mean 1 has to be waited for; and the
    last one that has come by then is sent. The queue at that instant is geometric, and loses one
    update after the other until the next one comes, so that it is not empty then with probability
    load^2.
    """
    return 1 / load + 1 + load**2


def m_d_1(load: float) -> float:
    """Poisson updates, sending in a fixed time, and a buffer for all."""
    return 1 / (2 * (1 - load)) + 0.5 + (1 - load) * math.exp(load) / load


def d_m_1(load: float) -> float:
    """Periodic updates, exponential sending, and a buffer for all.

    beta is the root of beta = exp(-(1 - beta) / load) between 0 and 1.
    """
    beta = brentq(lambda b: b - math.exp(-(1 - b) / load), 0.0, 1 - 1e-6)
    return 1 / (2 * load) + 1 / (1 - beta)


def m_m_1_1(load: float) -> float:
    """No buffer: what comes while another one is sent is dropped."""
    return 1 / load + 2 - 1 / (1 + load)


def m_m_1_2(load: float) -> float:
    """One may wait, and what comes then is dropped."""
    return 1 / load + 3 - 2 * (1 + load) / (1 + load + load**2)


def m_m_1_2_newest(load: float) -> float:
    """M/M/1/2*: one may wait, and is replaced by what comes then."""
    waits = load / (1 + load) ** 2 + 1 / (1 + load)
    return 1 / load + 2 + waits - 2 * (1 + load) / (1 + load + load**2)


def preempted(load: float, own: float | None = None) -> float:
    """Each update replaces the one that is sent; ``own`` is what a source contributes to the load.

    Without ``own`` there is one source.
    """
    return (1 + load) / (load if own is None else own)


def peak_m_m_1(load: float) -> float:
    """The mean age just before a delivery in M/M/1."""
    return 1 / load + 1 / (1 - load)


def at_will(times: NDArray[np.float64], beta: float = 0.0) -> float:
    """The next update is taken when the last is delivered, but not before ``beta`` after it began.

    ``times`` are equally likely times of sending. With ``beta = 0`` nobody waits.
    """
    cycles = np.maximum(times, beta)
    return float((cycles**2).mean() / (2 * cycles.mean()) + times.mean())


def update_or_wait(times: NDArray[np.float64]) -> tuple[float, float]:
    """The least age of ``at_will``, and its beta."""
    most = 20.0 * float(times.mean())
    found = minimize_scalar(lambda beta: at_will(times, beta), bounds=(0.0, most), method="bounded")
    return float(found.fun), float(found.x)


def visits(every: float, between: float, stays: float = 0.0, *, periodic: bool = False) -> float:
    """A drone comes ``every`` so often and takes the newest update at once, as long as it stays.

    Updates come at random, or with a period that has nothing to do with the visits, a mean time
    ``between`` apart. While the drone is there, the age is that of the newest update.
    """
    return (every - stays) ** 2 / (2 * every) + (between / 2 if periodic else between)


def least(law: Callable[[float], float]) -> tuple[float, float]:
    """The least age over all loads, and the load at which it is."""
    found = minimize_scalar(law, bounds=(0.05, 0.95), method="bounded", options={"xatol": 1e-10})
    return float(found.fun), float(found.x)


def lognormal_at_will(sigma: float, beta: float = 0.0) -> float:
    """``at_will`` with lognormal times of sending of mean 1."""
    if beta <= 0:
        return math.exp(sigma**2) / 2 + 1
    middle = -(sigma**2) / 2
    below = (math.log(beta) - middle) / sigma
    first = beta * _normal(below) + _normal(sigma - below)
    second = beta**2 * _normal(below) + math.exp(sigma**2) * _normal(2 * sigma - below)
    return second / (2 * first) + 1


def lognormal_update_or_wait(sigma: float) -> float:
    """The least age of ``lognormal_at_will``."""
    found = minimize_scalar(
        lambda beta: lognormal_at_will(sigma, beta), bounds=(0.01, 30.0), method="bounded"
    )
    return float(found.fun)


def _normal(x: float) -> float:
    """The distribution function of the normal law."""
    return 0.5 * math.erfc(-x / math.sqrt(2))
