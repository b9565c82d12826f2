"""Ages of information against their closed forms.

The formulas of ``age_laws`` are first compared with what is printed of them, and with a queue that
shares no code with the simulator.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np

from tests.verification import age_laws as laws
from tests.verification.age_queue import Keeps, mean_age, received
from tests.verification.figure import Estimate, Exact, Figure

FIRST_SEED = 100


def figures(quick: bool = False) -> Iterator[Figure]:
    """Return all."""
    yield from printed()
    yield from queues(5 if quick else 20)


def printed() -> Iterator[Figure]:
    """Yield what the formulas here make of figures that are known."""
    least = {name: laws.least(getattr(laws, name)) for name in ("m_m_1", "m_d_1", "d_m_1")}
    known = {
        "M/M/1, load 0.5": (laws.m_m_1(0.5), 3.5),
        "M/M/1: least": (least["m_m_1"][0], 3.484435),
        "M/M/1: its load": (least["m_m_1"][1], 0.531010),
        "M/D/1, load 0.5": (laws.m_d_1(0.5), 3.148721),
        "M/D/1: least": (least["m_d_1"][0], 2.954064),
        "M/D/1: its load": (least["m_d_1"][1], 0.629076),
        "D/M/1, load 0.5": (laws.d_m_1(0.5), 2.255001),
        "D/M/1: least": (least["d_m_1"][0], 2.252621),
        "D/M/1: its load": (least["d_m_1"][1], 0.516885),
        "M/M/1/1, load 0.5": (laws.m_m_1_1(0.5), 3.333333),
        "M/M/1/2, load 0.5": (laws.m_m_1_2(0.5), 3.285714),
        "M/M/1/2*, load 0.5": (laws.m_m_1_2_newest(0.5), 3.174603),
        "preemptive, load 0.5": (laws.preempted(0.5), 3.0),
        "preemptive, 0.25 of a load of 0.5": (laws.preempted(0.5, 0.25), 6.0),
        "preemptive, 0.1 of a load of 0.8": (laws.preempted(0.8, 0.1), 18.0),
        "M/M/1, load 0.5: mean peak": (laws.peak_m_m_1(0.5), 4.0),
        "at will, lognormal, sigma 1": (laws.lognormal_at_will(1.0), 2.359141),
        "update or wait, sigma 1": (laws.lognormal_update_or_wait(1.0), 2.160535),
        "at will, lognormal, sigma 1.5": (laws.lognormal_at_will(1.5), 5.743868),
        "update or wait, sigma 1.5": (laws.lognormal_update_or_wait(1.5), 3.590879),
    }
    for what, (ours, theory) in known.items():
        yield Exact(f"{what}: formula", ours, theory, 5.1e-7)


# ---- the formulas against a queue of the tests

Draw = Callable[[np.random.Generator, int], np.ndarray]


def exponential(rate: float) -> Draw:
    """Return a law of exponential times."""
    return lambda rng, count: rng.exponential(1 / rate, count)


def fixed(time: float) -> Draw:
    """Return a law of equal times."""
    return lambda _, count: np.full(count, time)


ONE = exponential(1.0)
QUEUES: dict[str, tuple[float, Draw, Draw, float, Keeps, bool]] = {
    "M/M/1": (laws.m_m_1(0.5), exponential(0.5), ONE, np.inf, "newest", False),
    "M/D/1": (laws.m_d_1(0.5), exponential(0.5), fixed(1.0), np.inf, "newest", False),
    "D/M/1": (laws.d_m_1(0.5), fixed(2.0), ONE, np.inf, "newest", False),
    "M/M/1/1": (laws.m_m_1_1(0.5), exponential(0.5), ONE, 1, "oldest", False),
    "M/M/1/2": (laws.m_m_1_2(0.5), exponential(0.5), ONE, 2, "oldest", False),
    "M/M/1/2*": (laws.m_m_1_2_newest(0.5), exponential(0.5), ONE, 2, "newest", False),
    "M/M/1/2*, by last": (laws.m_m_1_2_newest(0.5), exponential(0.5), ONE, 9, "last", False),
    "preemptive": (laws.preempted(0.5), exponential(0.5), ONE, 9, "last", True),
}
"""Laws at a load of 0.5: the age, times between updates and of sending, and the buffer."""


def queues(runs: int, updates: int = 20_000) -> Iterator[Figure]:
    """Yield the mean age of each queue; the first tenth is not counted."""
    for what, (theory, between, needs, *buffer) in QUEUES.items():
        ages = []
        for seed in range(FIRST_SEED, FIRST_SEED + runs):
            rng = np.random.default_rng(seed)
            times = np.cumsum(between(rng, updates))
            come = received(times.tolist(), needs(rng, updates).tolist(), *buffer)
            ages.append(mean_age(times, come, times[updates // 10], times[-1]))
        yield Estimate.of(f"{what}, load 0.5: another queue", ages, theory)
