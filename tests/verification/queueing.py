"""Charging stations against the M/D/c queue."""

from __future__ import annotations

from collections.abc import Iterator
from statistics import fmean

import numpy as np
import simpy
from scipy import stats

from desim_uav.engine.base import EpisodeLog
from desim_uav.engine.des.clock import Clock
from desim_uav.world import World
from tests.engine.helpers import US, fly, path_of, seen, strip
from tests.verification.figure import Estimate, Exact, Figure

MINUTE = 60 * US
HOLD_MIN = 30

MD_C = [(2, 0.04, 8.79108), (1, 0.02, 22.5)]
"""Pads, arrivals a minute, mean wait: M/D/2, and M/D/1 by Pollaczek and Khinchine."""

ROOMY = [(1, 1), (2, 2), (3, 3), (2, 5)]
"""Drones and pads, at least as many."""


def figures(quick: bool = False) -> Iterator[Figure]:
    """Worked by hand, and the textbooks' waits of Poisson arrivals."""
    log = charged_together(drones=3, pads=1)
    landed, begun = ({e[3]: e[0] for e in seen(log, kind)} for kind in ("land", "charge"))
    for drone, waits_s in enumerate((0, 90, 180)):
        waited_s = (begun[drone] - landed[drone]) / US
        yield Exact(f"three drones, one pad: wait of drone {drone}, s", waited_s, waits_s)
    waited_us = max(charged_together(*each).queueing_us for each in ROOMY)
    yield Exact("no more drones than pads: total wait, µs", waited_us, 0, cases=len(ROOMY))
    for pads, rate, _ in MD_C:
        means = [mean_wait_min(pads, rate, seed) for seed in range(30 if quick else 600)]
        yield Estimate.of(f"M/D/{pads}: mean wait, min", means, md_c_wait_min(pads, rate))


# ---- by hand


def queueing(drones: int, pads: int, steps: int, full_charge_min: float = 15.0, **changes) -> World:
    """Drones on the station in the middle (cell 4), 600 s of battery."""
    return strip(
        changes.pop("starts", [(4, 0)] * drones),
        battery={"autonomy_min": 10, "return_below": 1.0},
        stations={"pads": pads, "full_charge_min": full_charge_min},
        steps=steps,
        **changes,
    )


def charged_together(drones: int, pads: int) -> EpisodeLog:
    """After a step of hovering all land at once: 60 s are missing, full in D = 90 s."""
    world = queueing(drones, pads, steps=6)
    return fly(world, path_of(world), *["hover charge"] * drones)


# ---- the textbooks'


def waits_min(pads: int, rate: float, customers: int, seed: int) -> list[float]:
    """Waits, in minutes, of Poisson arrivals (``rate`` a minute) that hold a pad for 30 minutes."""
    clock = Clock(0)
    station = simpy.Resource(clock, pads)
    gaps_us = np.rint(np.random.default_rng([pads, seed]).exponential(MINUTE / rate, customers))
    waits = []

    def drone() -> Iterator[object]:
        landed_us = clock.now
        with station.request() as pad:
            yield pad
            waits.append((clock.now - landed_us) / MINUTE)
            yield clock.timeout(HOLD_MIN * MINUTE)

    def arrivals() -> Iterator[object]:
        for gap_us in gaps_us.astype(int).tolist():
            yield clock.timeout(gap_us)
            clock.process(drone())

    clock.process(arrivals())
    clock.run()
    assert len(waits) == customers
    return waits


def mean_wait_min(pads: int, rate: float, seed: int) -> float:
    """Of 1,500 drones after the first 200."""
    return fmean(waits_min(pads, rate, 1700, seed)[200:])


def md_c_wait_min(servers: int, rate: float, hold_min: float = HOLD_MIN, most: int = 400) -> float:
    """The mean wait of an M/D/c queue, by Crommelin's equations and Little's law.

    Whoever is in service now is gone in ``hold_min``, nobody else is: of n there, the n - c who
    wait are left then, and those who came. The stationary law of that chain is of n at any time.
    """
    arriving = stats.poisson(rate * hold_min).pmf(np.arange(most))
    moves = np.zeros((most, most))
    for there in range(most):
        left = max(there - servers, 0)
        moves[there, left:] = arriving[: most - left]
    balance = moves.T - np.eye(most)
    balance[-1] = 1.0
    law = np.linalg.solve(balance, np.eye(most)[-1])
    return float(law @ np.arange(most)) / rate - hold_min
