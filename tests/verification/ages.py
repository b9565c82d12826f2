"""Ages of information against their closed forms.

The formulas of ``age_laws`` are first compared with what is printed of them, and with a queue that
shares no code with the simulator. The simulator's figures are those of scenario files: a drone
hovers over a sensor, whose updates of x Mbit take x s. Each replication is an episode of its own.
The tables of each are audited, and this queue has to have sent each update at the same microsecond.

Exponential and lognormal times are lists of 1,000 values, the means of the law in its parts of
equal probability.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd
from scipy import stats

import desim_uav as du
from desim_uav.scenario.load import loads
from desim_uav.world import build_world
from tests.audit.ages import audit_updates
from tests.verification import age_laws as laws
from tests.verification.age_queue import mean_age, received
from tests.verification.engines import differences, engines
from tests.verification.figure import Estimate, Exact, Figure
from tests.verification.tasks import EXPONENTIAL

FIRST_SEED = 100


def figures(quick: bool = False) -> Iterator[Figure]:
    """Return all; a replication is an episode of 5,000 s."""
    runs = 8 if quick else 20
    yield from printed()
    yield from queues(5 if quick else 20)
    yield from engines_are_equal()
    yield from curves(runs, 1 if quick else 5)
    yield from sources(runs)
    yield peaks(runs)
    yield from at_will(runs, (1.0,) if quick else (1.0, 1.5))
    yield from visits(runs)


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
QUEUES: dict[str, tuple[Any, ...]] = {
    "M/M/1": (laws.m_m_1(0.5), exponential(0.5), ONE, np.inf, "newest", False),
    "M/M/1, last first": (
        *(laws.m_m_1_last_first(0.5), exponential(0.5), ONE),
        *(np.inf, "newest", False, "last"),
    ),
    "M/D/1": (laws.m_d_1(0.5), exponential(0.5), fixed(1.0), np.inf, "newest", False),
    "D/M/1": (laws.d_m_1(0.5), fixed(2.0), ONE, np.inf, "newest", False),
    "M/M/1/1": (laws.m_m_1_1(0.5), exponential(0.5), ONE, 1, "oldest", False),
    "M/M/1/2": (laws.m_m_1_2(0.5), exponential(0.5), ONE, 2, "oldest", False),
    "M/M/1/2*": (laws.m_m_1_2_newest(0.5), exponential(0.5), ONE, 2, "newest", False),
    "M/M/1/2*, by last": (laws.m_m_1_2_newest(0.5), exponential(0.5), ONE, 9, "last", False),
    "preemptive": (laws.preempted(0.5), exponential(0.5), ONE, 9, "last", True),
}
"""Laws at a load of 0.5: the age, times between updates and of sending, and what ``received``
takes of the buffer and the order.
"""


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


# ---- scenario files

DRONE = """
map: {{size_m: [100, 100], cells: [1, 1], dimensions: 2}}
drones:
  count: 1
  battery: null
  radio:
    kind: link_classes
    bandwidth_mhz: 1
    classes: [{{snr_db: 0, bit_s_hz: 1}}]
    sharing: equal
stations: {{count: 0}}
"""
"""A drone that serves all with 1 Mbit/s."""
SCENARIO = (
    DRONE
    + """\
users: {{count: 1, mobility: {{kind: static}}}}
services:
  reading: {{kind: collect, updates: {updates}, size_mbit: {sizes}, {buffer}}}
demand: {{kind: sensing, service: reading}}
episode: {{steps: 1, step_s: {lasts_s}}}
"""
)
LASTS_S, WARMING_S = 5_000, 500.0
"""Ages of the first seconds of an episode, which begin at 0, are not counted."""

BUFFERS: dict[str, dict[str, Any]] = {
    "all": {"buffer": 1000, "keeps": "newest"},
    "last first": {"buffer": 1000, "keeps": "newest", "sends": "last"},
    "1": {"buffer": 1, "keeps": "oldest"},
    "2": {"buffer": 2, "keeps": "oldest"},
    "2*": {"buffer": 2, "keeps": "newest"},
    "last": {"buffer": 3, "keeps": "last"},
    "preemptive": {"buffer": 3, "keeps": "last", "preempt": "true"},
}


@dataclass(frozen=True)
class Sensor:
    """A sensor with updates, sizes in Mbit and a buffer of BUFFERS, as a scenario file has them."""

    updates: str
    sizes: Sequence[float]
    keeps: str = "all"

    def text(self, lasts_s: float = LASTS_S) -> str:
        """Return the scenario."""
        sizes = [round(float(size), 6) for size in self.sizes]
        buffer = ", ".join(f"{key}: {value}" for key, value in BUFFERS[self.keeps].items())
        return SCENARIO.format(updates=self.updates, sizes=sizes, buffer=buffer, lasts_s=lasts_s)


def poisson(load: float, sizes: Sequence[float], keeps: str = "all") -> Sensor:
    """Return a sensor with Poisson updates."""
    return Sensor(f"{{kind: poisson, mean_s: {1 / load!r}}}", sizes, keeps)


def periodic(load: float, sizes: Sequence[float], keeps: str = "all") -> Sensor:
    """Return a sensor with updates at equal intervals."""
    return Sensor(f"{{kind: periodic, every_s: {1 / load!r}}}", sizes, keeps)


def ages_of(sensor: Sensor, runs: int) -> list[float]:
    """Return the mean age of each replication, whose tables are audited."""
    flown = flown_of(sensor.text(), runs)
    return [
        mean_age(own["t_generated_s"], arrived(own), WARMING_S, LASTS_S)
        for own in audited(flown, sensor)
    ]


def flown_of(text: str, runs: int, policy: str = "hover") -> du.RunResult:
    """Return the run of a scenario with a seed for each replication."""
    seeds = range(FIRST_SEED, FIRST_SEED + runs)
    return du.run(loads(text), policy=policy, seeds=seeds, engine="batch", progress=False)


def arrived(updates: pd.DataFrame) -> np.ndarray:
    """Return when updates were delivered; infinity if they were not."""
    return updates["t_delivered_s"].fillna(np.inf).to_numpy()


def audited(flown: du.RunResult, sensor: Sensor) -> Iterator[pd.DataFrame]:
    """Yield the updates of each replication, after an audit and another simulation."""
    tables = [flown.updates, flown.sensors, flown.episodes]
    for seed in flown.episodes["seed"]:
        own, sensors, episodes = (each[each["seed"] == seed] for each in tables)
        audit_updates(own, sensors, episodes, {"reading": BUFFERS[sensor.keeps]})
        if "at_will" not in sensor.updates:
            _again(own, sensor)
        yield own


def _again(own: pd.DataFrame, sensor: Sensor) -> None:
    """Check that the queue of the tests sends all updates at the same microsecond."""
    columns = ("t_generated_s", "size_mbit")
    generated, needs = ((own[name] * 1e6).round().astype(int).tolist() for name in columns)
    keys = BUFFERS[sensor.keeps]
    order = ("preempt" in keys, keys.get("sends", "first"))
    come = received(generated, needs, keys["buffer"], keys["keeps"], *order)
    until = round(LASTS_S * 1e6)
    expected = [t / 1e6 if t <= until else math.inf for t in come]
    assert np.allclose(arrived(own), expected, rtol=0, atol=1e-7), "another queue sends otherwise"


def lognormal(sigma: float, values: int = 1000) -> np.ndarray:
    """Return the means of the lognormal law of mean 1 in parts of equal probability."""
    edges = stats.norm.ppf(np.arange(values + 1) / values)
    return -values * np.diff(stats.norm.cdf(sigma - edges))


# ---- the figures of the simulator

Law = Callable[[float], float]
CURVES: dict[str, tuple[Law, Callable[[float], Sensor], tuple[float, ...]]] = {
    "M/M/1": (laws.m_m_1, lambda load: poisson(load, EXPONENTIAL), (0.5, 0.2, 0.35, 0.65, 0.8)),
    "M/M/1, last first": (
        *(laws.m_m_1_last_first, lambda load: poisson(load, EXPONENTIAL, "last first")),
        (0.5, 0.2, 0.35, 0.65, 0.8),
    ),
    "M/D/1": (laws.m_d_1, lambda load: poisson(load, [1.0]), (0.5, 0.2, 0.35, 0.65, 0.8)),
    "D/M/1": (laws.d_m_1, lambda load: periodic(load, EXPONENTIAL), (0.5, 0.2, 0.35, 0.65, 0.8)),
    "M/M/1/1": (
        *(laws.m_m_1_1, lambda load: poisson(load, EXPONENTIAL, "1")),
        (0.5, 0.25, 1.0, 1.5, 2.0),
    ),
    "M/M/1/2": (
        *(laws.m_m_1_2, lambda load: poisson(load, EXPONENTIAL, "2")),
        (0.5, 0.25, 1.0, 1.5, 2.0),
    ),
    "M/M/1/2*": (
        *(laws.m_m_1_2_newest, lambda load: poisson(load, EXPONENTIAL, "2*")),
        (0.5, 0.25, 1.0, 1.5, 2.0),
    ),
    "M/M/1/2*, by last": (
        *(laws.m_m_1_2_newest, lambda load: poisson(load, EXPONENTIAL, "last")),
        (0.5,),
    ),
    "preemptive": (
        *(laws.preempted, lambda load: poisson(load, EXPONENTIAL, "preemptive")),
        (0.5, 0.25, 1.0, 1.5, 2.0),
    ),
}
"""The curves of Kaul et al. 2012 (the first three) and of Costa et al. 2016 (the next ones)."""


def engines_are_equal() -> Iterator[Figure]:
    """Return in how many episodes the engines differ, with each buffer."""
    for name in BUFFERS:
        world = build_world(loads(poisson(0.8, EXPONENTIAL, name).text(500)), 0)
        unlike = [bool(differences(*engines(world, (True,)), seed, 0)) for seed in range(2)]
        yield Exact(f"buffer {name}: episodes in which engines differ", sum(unlike), 0, cases=2)


def curves(runs: int, most: int) -> Iterator[Figure]:
    """Yield the age over the load, at ``most`` loads."""
    for name, (law, sensor, points) in CURVES.items():
        for load in points[:most]:
            yield Estimate.of(
                f"{name}, load {load}: age, s", ages_of(sensor(load), runs), law(load)
            )


SOURCES = (
    DRONE
    + """\
users:
- {{name: one, count: 1, mobility: {{kind: static}}, demand: {{kind: sensing, service: one}}}}
- {{name: two, count: 1, mobility: {{kind: static}}, demand: {{kind: sensing, service: two}}}}
services:
  one: {{kind: collect, updates: {one}, size_mbit: {sizes}, keeps: last, preempt: all}}
  two: {{kind: collect, updates: {two}, size_mbit: {sizes}, keeps: last, preempt: all}}
episode: {{steps: 1, step_s: {lasts_s}}}
"""
)
"""Two sensors that share a server: an update of either replaces what is being sent."""


def shared(loads_of_both: tuple[float, float], lasts_s: float = LASTS_S) -> str:
    """Return the scenario of two sources with these loads."""
    one, two = (poisson(load, EXPONENTIAL).updates for load in loads_of_both)
    sizes = [round(float(size), 6) for size in EXPONENTIAL]
    return SOURCES.format(one=one, two=two, sizes=sizes, lasts_s=lasts_s)


def sources(runs: int) -> Iterator[Figure]:
    """Yield the ages of sources that share a server with preemption, and compare the engines."""
    world = build_world(loads(shared((0.25, 0.25), 500)), 0)
    unlike = [bool(differences(*engines(world, (True,)), seed, 0)) for seed in range(2)]
    yield Exact("two sources: episodes in which engines differ", sum(unlike), 0, cases=2)
    for both, users in (((0.25, 0.25), (0,)), ((0.1, 0.7), (0, 1))):
        flown = flown_of(shared(both), runs)
        for user in users:
            ages = []
            for seed, own in flown.updates.groupby("seed"):
                if user == 0:
                    _audit_sources(flown, seed)
                mine = own[own["user"] == user]
                ages.append(mean_age(mine["t_generated_s"], arrived(mine), WARMING_S, LASTS_S))
            what = f"two sources, {both[user]} of a load of {sum(both):g}: age, s"
            yield Estimate.of(what, ages, laws.preempted(sum(both), both[user]))


def _audit_sources(flown: du.RunResult, seed: int) -> None:
    """Audit a replication: an update is delivered unless another one comes while it is sent."""
    tables = (flown.updates, flown.sensors, flown.episodes)
    own, sensors, episodes = (each[each["seed"] == seed] for each in tables)
    keys = {"keeps": "last", "preempt": "all"}
    audit_updates(own, sensors, episodes, {"one": keys, "two": keys})
    born = (own["t_generated_s"] * 1e6).round().astype(int).to_numpy()
    done = born + (own["size_mbit"] * 1e6).round().astype(int).to_numpy()
    whole = done <= np.append(born[1:], round(LASTS_S * 1e6))
    expected = np.where(whole, done / 1e6, np.inf)
    assert np.allclose(arrived(own), expected, rtol=0, atol=1e-7), "another server sends otherwise"


def peaks(runs: int) -> Figure:
    """Return the mean peak in M/M/1."""
    flown = flown_of(poisson(0.5, EXPONENTIAL).text(), runs)
    found = flown.episodes["peak_age_s"]
    return Estimate.of("M/M/1, load 0.5: mean peak, s", found, laws.peak_m_m_1(0.5))


def at_will(runs: int, sigmas: Sequence[float]) -> Iterator[Figure]:
    """Yield ages if the next update is taken when the last is delivered, or somewhat later."""
    for sigma in sigmas:
        sizes = np.round(lognormal(sigma), 6)
        least, beta = laws.update_or_wait(sizes)
        for what, wait_s, theory in (
            ("at will", 0.0, laws.at_will(sizes)),
            ("update or wait", round(beta, 6), least),
        ):
            sensor = Sensor(f"{{kind: at_will, wait_s: {wait_s}}}", sizes)
            yield Estimate.of(f"{what}, sigma {sigma}: age, s", ages_of(sensor, runs), theory)


VISITED = """
map: {{size_m: [720, 240], cells: [3, 1], dimensions: 2, levels: {{min_altitude_m: 20}}}}
drones:
  count: 1
  start_cells: [[0, 0]]
  battery: null
  motion: {{max_speed_mps: 8.3, max_acceleration_mps2: 4, timing: minimum_time}}
  radio:
    kind: link_classes
    power_dbm: 100
    bandwidth_mhz: 1
    noise_figure_db: 0
    noise_dbm_per_hz: -60
    path_loss: {{kind: log_distance, exponent: 2, at_1m_db: 0}}
    classes: [{{snr_db: 64, bit_s_hz: 1}}]
    sharing: equal
stations: {{count: 0}}
users: {{positions_m: [[120, 120]], mobility: {{kind: static}}}}
services:
  reading: {{kind: collect, updates: {updates}, size_mbit: [1.0e-6], buffer: 1, keeps: newest}}
demand: {{kind: sensing, service: reading}}
episode: {{steps: 400, step_s: 60}}
"""
"""The drone flies from cell 0 to cell 2 and back in 4 steps, and hovers after each flight."""

EVERY_S, BETWEEN_S = 240.0, 37.0
RANGE_M = math.sqrt(10 ** ((100 - 64) / 10) - 20**2)
HOVERS_S = 60 - (240 / 8.3 + 8.3 / 4)
STAYS_S = HOVERS_S + 2 * (RANGE_M / 8.3 + 8.3 / (2 * 4))
"""How long the drone is in range: a hover, and twice the time from rest to the range."""


def visits(runs: int) -> Iterator[Figure]:
    """Yield the age of a sensor that a drone visits every 240 s."""
    for kind, updates in {
        "Poisson": f"{{kind: poisson, mean_s: {BETWEEN_S}}}",
        "periodic": f"{{kind: periodic, every_s: {BETWEEN_S}}}",
    }.items():
        flown = flown_of(VISITED.format(updates=updates), runs, "baseline")
        ages = [
            mean_age(own["t_generated_s"], arrived(own), 4 * EVERY_S, 100 * EVERY_S)
            for _, own in flown.updates.groupby("seed")
        ]
        theory = laws.visits(EVERY_S, BETWEEN_S, STAYS_S, periodic=kind == "periodic")
        yield Estimate.of(f"a visit every 240 s, {kind} updates: age, s", ages, theory)
