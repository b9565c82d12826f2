"""Processors against the queues of textbooks.

A task's input is one bit, which takes a microsecond, so that only the processor matters. Requests
are those of 5,000 users with a small rate each: together a Poisson stream, of which next to
nothing is left out because a user still has an open request. What this makes of mean times is taken
into account where the law is known exactly; elsewhere it is below 0.5 %.

Exponential service times are a list of 1,000 values, the means of the exponential law in its parts
of equal probability. Their mean is that of the law, and their second moment is 0.05 % smaller.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cache
from itertools import permutations
from typing import Any

import numpy as np
from numpy.typing import NDArray

from desim_uav.engine.base import RunSettings
from desim_uav.engine.choose import make_engine
from desim_uav.engine.episode import Engine
from desim_uav.model.rules import Outcome
from desim_uav.sample_path import draw
from desim_uav.scenario.load import loads
from desim_uav.world import World, build_world
from tests.engine.helpers import Ask, path_of
from tests.verification.engines import differences, engines
from tests.verification.figure import Estimate, Exact, Figure

US = 1_000_000
USERS = 5_000
FIRST_SEED = 100
INPUT_S = 1e-6
WARMING_S, COOLING_S = 400.0, 200.0
"""Requests of the first and of the last seconds of an episode are not counted."""

SCENARIO = """
map: {{size_m: [100, 100], cells: [1, 1], dimensions: 2}}
drones:
  count: 1
  battery: null
  processor: {{cores: {cores}, ghz: 0.1, sharing: {sharing}}}
  radio:
    kind: link_classes
    bandwidth_mhz: 1000
    classes: [{{snr_db: -50, bit_s_hz: 1}}]
    sharing: {links}
    uplink_mhz: {uplink}
stations: {{count: 0}}
users: {{count: {users}, mobility: {{kind: static}}}}
services:
  task: {service}
demand: {{kind: poisson, rate_per_hour: {per_hour}, mix: {{task: 1}}}}
episode: {{steps: 1, step_s: {step_s}}}
"""


def exponential(values: int = 1000) -> NDArray[np.float64]:
    """Return the means of the exponential law in parts of equal probability; their mean is 1."""
    left = 1 - np.arange(values + 1) / values
    above = np.array([q - q * math.log(q) if q > 0 else 0.0 for q in left])
    return (above[:-1] - above[1:]) * values


FIXED = np.ones(1)
EXPONENTIAL = exponential()
TWO_SIZES = np.array([0.25] * 4 + [4.0])
"""Of mean 1, and with a second moment of 3.25."""


@dataclass(frozen=True)
class Queue:
    """A stream of ``rate`` tasks a second at a processor, of which one takes 1 s on the average."""

    rate: float
    times_s: tuple[float, ...] = (1.0,)
    sharing: str = "first_come"
    cores: int = 1
    more: str = ""
    service: str = ""
    links: str = "equal"
    uplink: str = "null"

    def text(self, users: int, step_s: float) -> str:
        """Return the scenario as a file has it. A core does 1e8 cycles in a second."""
        cycles = ", ".join(f"{1e8 * time_s:.0f}" for time_s in self.times_s)
        task = f"{{kind: compute, input_mbit: [1.0e-6], cycles_per_bit: [{cycles}]{self.more}}}"
        return SCENARIO.format(
            cores=self.cores,
            sharing=self.sharing,
            links=self.links,
            uplink=self.uplink,
            users=users,
            service=self.service or task,
            per_hour=self.rate * 3600 / users,
            step_s=step_s,
        )


def queue(rate: float, times_s: Sequence[float] | NDArray[np.float64], **changes: Any) -> Queue:
    """Return a stream of tasks that take one of these times."""
    return Queue(rate, tuple(np.asarray(times_s).tolist()), **changes)


# ---- episodes


@dataclass(frozen=True)
class Sample:
    """An episode's tasks: how long each was open and computed, what it needs, and if it is done.

    Times are in seconds.
    """

    open_s: NDArray[np.float64]
    needs_s: NDArray[np.float64]
    done: NDArray[np.bool_]

    @property
    def late(self) -> float:
        """The share that is not done."""
        return float(1 - self.done.mean())


@cache
def engine_of(told: Queue, users: int, step_s: float) -> Engine:
    """Return the compiled engine for a stream."""
    world = build_world(loads(told.text(users, step_s)), 0)
    return make_engine("batch", world, RunSettings((True,), False, keep_events=False))


def samples(
    told: Queue, runs: int, *, users: int = USERS, lasting_s: float = 4000.0
) -> list[Sample]:
    """Return independent episodes."""
    engine = engine_of(told, users, WARMING_S + lasting_s + COOLING_S)
    return [_sample(engine, seed) for seed in range(FIRST_SEED, FIRST_SEED + runs)]


def _sample(engine: Engine, seed: int) -> Sample:
    engine.reset(draw(engine.world, seed, 0))
    engine.step([0])
    log = engine.log
    begun, end = WARMING_S * US, log.duration_us - COOLING_S * US
    asked = [one for one in log.requests if begun <= one.t_request_us < end]
    assert log.suppressed <= 5e-3 * len(log.requests)
    assert all(one.t_end_us < log.duration_us for one in asked)
    return Sample(
        np.array([one.t_end_us - one.t_request_us for one in asked]) / US - INPUT_S,
        np.array([one.asked_cycles for one in asked]) / 1e11,
        np.array([one.outcome is Outcome.COMPLETED for one in asked]),
    )


def mean_of(what: str, told: Queue, theory: float, runs: int, **settings: Any) -> Estimate:
    """Return the mean time for which tasks are open."""
    found = samples(told, runs, **settings)
    assert all(one.done.all() for one in found)
    return Estimate.of(f"{what}: mean time, s", [one.open_s.mean() for one in found], theory)


# ---- the textbooks'


def pollaczek_s(rate: float, times_s: NDArray[np.float64]) -> float:
    """The mean time in an M/G/1 queue."""
    mean, second = times_s.mean(), (times_s**2).mean()
    return float(mean + rate * second / (2 * (1 - rate * mean)))


def birth_death_s(rate: float, cores: int, users: int = USERS) -> float:
    """The mean time in an M/M/c queue, whose services take 1 s, of users with one task at a time.

    It is that of processor sharing by c cores, too, whatever the distribution of service times.
    """
    shares = [1.0]
    while shares[-1] > 1e-16 or len(shares) <= 2 * cores:
        there = len(shares)
        shares.append(shares[-1] * rate * (users - there + 1) / users / min(there, cores))
    law = np.array(shares) / sum(shares)
    there = np.arange(len(law))
    return float(law @ there / (rate * (1 - law @ there / users)))


def wait_below(t_s: float, rate: float) -> float:
    """P(W <= t) in an M/D/1 queue whose services take 1 s: Erlang's sum."""
    sum_of = sum(
        (-rate * (t_s - k)) ** k / math.factorial(k) * math.exp(rate * (t_s - k))
        for k in range(math.floor(t_s) + 1)
    )
    return (1 - rate) * sum_of


def sharing_sd_s(rate: float, size_s: Any) -> Any:
    """The standard deviation of the time of a task of a size in an M/M/1 queue that shares."""
    left = 1 - rate
    variance = 2 * rate * size_s / left**3
    return np.sqrt(variance - 2 * rate / left**4 * (1 - np.exp(-left * size_s)))


def late_share(rate: float, deadline_s: float) -> float:
    """The share of tasks in an M/M/1 queue that are not done in time, and leave then.

    The work there never exceeds the deadline, below which its density is that of M/M/1.
    """
    k = math.exp(-(1 - rate) * deadline_s)
    return (1 - rate) * k / (1 - rate * k)


def unbegun_share(rate: float, patience_s: float) -> float:
    """The share of tasks in an M/M/1 queue that leave because they have not been begun in time."""
    k = math.exp(-(1 - rate) * patience_s)
    return (1 - rate) * rate * k / (1 - rate**2 * k)


# ---- the figures


def figures(quick: bool = False) -> Iterator[Figure]:
    """Return all; a replication is an episode of 4,000 s that are counted."""
    runs = 10 if quick else 40
    yield from printed()
    yield from engines_are_equal()
    yield from first_come(runs)
    yield from shared(runs, (0.8,) if quick else (0.5, 0.8))
    yield from tandem(runs, quick)
    yield from waits(runs)
    yield from deadlines(runs)
    yield earliest_deadline(50 if quick else 200)


def printed() -> Iterator[Figure]:
    """Yield what the formulas here make of figures that are known."""
    found = {
        "M/D/1 -> D/1 -> D/1: formula, s": (TANDEM_S, 2.328571),
        "M/M/2, load 0.8: formula, s": (birth_death_s(1.6, 2, 10**12), 1 / (1 - 0.8**2)),
        "M/M/1 shared, load 0.8: formula of the deviation for 2 s, s": (
            *(float(sharing_sd_s(0.8, 2.0)), 8.385705),
        ),
        "M/M/1, load 0.5: formula for not begun in 1 s": (unbegun_share(0.5, 1.0), 0.178735),
        "M/M/1, load 0.8: formula for not begun in 2 s": (unbegun_share(0.8, 2.0), 0.187832),
        "M/M/1, load 1.2: formula for not begun in 2 s": (unbegun_share(1.2, 2.0), 0.311818),
    }
    for what, (ours, theory) in found.items():
        yield Exact(what, ours, theory, 5.1e-7)
    for t_s, theory in ((0.0, 0.2), (0.5, 0.298365), (1.0, 0.445108), (2.0, 0.63452), (3, 0.7621)):
        yield Exact(
            f"M/D/1, load 0.8: formula of P(W <= {t_s:g} s)", wait_below(t_s, 0.8), theory, 5e-7
        )


EQUAL = {
    "first come": queue(0.8, EXPONENTIAL),
    "two cores": queue(1.5, EXPONENTIAL, cores=2),
    "sharing": queue(0.8, EXPONENTIAL, sharing="processor_sharing"),
    "earliest deadline": queue(
        0.8, TWO_SIZES, sharing="earliest_deadline", more=", deadline_s: 3, on_deadline: drop"
    ),
}


def engines_are_equal() -> Iterator[Figure]:
    """Return in how many episodes the engines differ, of each discipline."""
    for name, told in EQUAL.items():
        world = build_world(loads(told.text(100, 500.0)), 0)
        unlike = [bool(differences(*engines(world, (True,)), seed, 0)) for seed in range(2)]
        yield Exact(f"{name}: episodes in which engines differ", sum(unlike), 0, cases=2)


def first_come(runs: int) -> Iterator[Figure]:
    """Yield mean times in queues with one core or several."""
    yield mean_of("M/D/1, load 0.8", queue(0.8, FIXED), pollaczek_s(0.8, FIXED), runs)
    waits = (1 + float(EXPONENTIAL.var())) / 2
    for cores in (1, 2, 4):
        told = queue(0.8 * cores, EXPONENTIAL, cores=cores)
        theory = 1 + waits * (birth_death_s(0.8 * cores, cores) - 1)
        yield mean_of(f"M/M/{cores}, load 0.8", told, theory, runs)


def shared(runs: int, rates: Sequence[float]) -> Iterator[Figure]:
    """Yield times under processor sharing, whose means do not depend on the distribution.

    Their deviations are those at some ``rates``.
    """
    for name, times_s in {"exponential": EXPONENTIAL, "two sizes": TWO_SIZES}.items():
        told = queue(0.8, times_s, sharing="processor_sharing")
        yield mean_of(f"M/G/1 shared, {name}, load 0.8", told, birth_death_s(0.8, 1), runs)
    for name, times_s in {"fixed": FIXED, "two sizes": TWO_SIZES}.items():
        told = queue(1.6, times_s, sharing="processor_sharing", cores=2)
        theory = birth_death_s(1.6, 2)
        yield mean_of(f"M/G/2 shared, {name}, load 0.8", told, theory, runs)
    for rate in rates:
        for size_s in (0.5, 1.0, 2.0):
            yield sharing_sd(rate, size_s, runs)


def sharing_sd(rate: float, size_s: float, runs: int) -> Estimate:
    """Return the standard deviation of times of tasks of about a size, scaled to this size.

    The variances about the means that theory has are averaged; the error is that of their root. As
    a few busy times count most in a variance, more episodes than elsewhere are needed.
    """
    runs *= 6 if rate < 0.6 else 2
    found = samples(queue(rate, EXPONENTIAL, sharing="processor_sharing"), runs)
    theory, squares = float(sharing_sd_s(rate, size_s)), []
    for one in found:
        alike = np.abs(one.needs_s - size_s) < 0.2 * size_s
        needs_s = one.needs_s[alike]
        away_s = one.open_s[alike] - needs_s / (1 - rate)
        squares.append(np.mean((away_s / sharing_sd_s(rate, needs_s)) ** 2))
    scaled = Estimate.of("", squares, 1.0)
    root = math.sqrt(scaled.ours)
    what = f"M/M/1 shared, load {rate}: standard deviation for {size_s:g} s, s"
    return Estimate(what, theory * root, theory, theory * scaled.error / (2 * root), runs)


TANDEM_S = 1.3 + 0.9 * 0.8**2 / (2 * (1 - 0.9 * 0.8))
"""M/D/1 -> D/1 -> D/1 with 0.9 arrivals a second and services of 0.3, 0.8 and 0.2 s."""


def tandem(runs: int, quick: bool) -> Iterator[Figure]:
    """Yield the mean time through a link, a processor and a pause, and what their order changes.

    Each task takes the same time in any order, and it makes no difference which one takes longest.
    """
    orders = list(map("".join, permutations("lcp")))[:: 2 if quick else 1]
    first, *others = (
        samples(tandem_of(order, slow), runs if order == orders[0] else 2)
        for order in orders
        for slow in "cl"
    )
    means = [one.open_s.mean() + INPUT_S for one in first]
    yield Estimate.of("M/D/1 -> D/1 -> D/1, load 0.72: mean time, s", means, TANDEM_S)
    pairs = [both for other in others for both in zip(first, other, strict=False)]
    away_s = max(float(np.abs(one.open_s - other.open_s).max()) for one, other in pairs)
    what = "M/D/1 -> D/1 -> D/1: a task's time in another order, s"
    yield Exact(what, away_s, 0.0, 1e-5, cases=len(pairs))
    means = [one.open_s.mean() for one in samples(UP_AND_DOWN, runs)]
    what = "M/D/1 -> D/1 -> D/1 in two bands: mean time, s"
    yield Estimate.of(what, means, TANDEM_S)


UP_AND_DOWN = queue(
    0.9,
    FIXED,
    service="{kind: compute, input_mbit: [320], cycles_per_bit: [0.25], output_mbit: [180]}",
    links="max_rate",
    uplink="1000",
)
"""Tasks that are sent in 0.32 s, computed in 0.8 s, and come back in 0.18 s.

In one band, the link would be one more queue: inputs would wait for results, and for inputs.
"""


def tandem_of(order: str, slow: str) -> Queue:
    """Return a stream through a link, a processor and a pause; the ``slow`` one takes 0.8 s."""
    link_s, core_s = (0.3, 0.8) if slow == "c" else (0.8, 0.3)
    service = (
        f"{{kind: 'tests.staged:Tandem', order: {order}, link_s: {link_s}, core_s: {core_s}, "
        "pause_s: 0.2}"
    )
    return queue(0.9, FIXED, service=service, links="max_rate")


def waits(runs: int) -> Iterator[Figure]:
    """Yield the distribution of waits in M/D/1."""
    found = samples(queue(0.8, FIXED), runs)
    for t_s in (0.0, 0.5, 1.0, 2.0, 3.0):
        shares = [np.mean(one.open_s - 1 <= t_s + 3 * INPUT_S) for one in found]
        yield Estimate.of(f"M/D/1, load 0.8: P(W <= {t_s:g} s)", shares, wait_below(t_s, 0.8))


IMPATIENT = ((0.5, 1.0), (0.8, 2.0), (1.2, 2.0))
"""Loads, and the times after which tasks leave."""


def deadlines(runs: int) -> Iterator[Figure]:
    """Yield shares of tasks that are late: at their end, or not begun in time."""
    laws = {"drop": ("done", late_share), "leave": ("begun", unbegun_share)}
    for rate, deadline_s in IMPATIENT:
        for kind, (what, law) in laws.items():
            more = f", deadline_s: {deadline_s}, on_deadline: {kind}"
            shares = [one.late for one in samples(queue(rate, EXPONENTIAL, more=more), runs)]
            name = f"M/M/1, load {rate}: not {what} in {deadline_s:g} s"
            yield Estimate.of(name, shares, law(rate, deadline_s))


# ---- earliest deadline against all schedules

SLACK_S = 5e-4
"""What inputs of a microsecond may take before a deadline in whole seconds."""
MOST_S = 12


@dataclass(frozen=True)
class Job:
    """A task that comes at a second, takes some of them, and has to be done in time."""

    from_s: int
    takes_s: int
    until_s: int


def earliest_deadline(sets: int, engine_name: str = "des") -> Figure:
    """Return for how many sets of tasks it is wrong whether some order is in time."""
    wrong = feasible = 0
    for seed in range(sets):
        jobs = jobs_of(seed)
        possible = any_order(jobs)
        feasible += possible
        wrong += in_time(jobs, engine_name) != possible
    assert sets / 10 < feasible < 9 * sets / 10
    return Exact("earliest deadline: sets in time unlike the best order", wrong, 0, cases=sets)


def jobs_of(seed: int) -> tuple[Job, ...]:
    """Return three to six random tasks."""
    rng = np.random.default_rng([12, seed])
    jobs = []
    for _ in range(rng.integers(3, 7)):
        from_s, takes_s = int(rng.integers(0, 8)), int(rng.integers(1, 4))
        until_s = from_s + min(takes_s + int(rng.integers(0, 8)), MOST_S)
        jobs.append(Job(from_s, takes_s, until_s))
    return tuple(jobs)


def any_order(jobs: tuple[Job, ...]) -> bool:
    """Return whether one core can do all in time, in any order and with any interruptions.

    In each second it does one of those that are there; all ways are tried.
    """

    @cache
    def can(now_s: int, left: tuple[int, ...]) -> bool:
        if not any(left):
            return True
        late = any(n > 0 and now_s + n > job.until_s for n, job in zip(left, jobs, strict=True))
        if late:
            return False
        there = [k for k, job in enumerate(jobs) if left[k] > 0 and job.from_s <= now_s]
        ways = [tuple(n - (i == k) for i, n in enumerate(left)) for k in there] or [left]
        return any(can(now_s + 1, way) for way in ways)

    return can(0, tuple(job.takes_s for job in jobs))


@cache
def _deadline_world() -> World:
    """A service for each deadline from 1 s on, at a processor that goes by deadline."""
    told = Queue(1.0, sharing="earliest_deadline")
    text = told.text(8, 3600.0)
    services = "".join(
        f"\n  within{k}: {{kind: compute, input_mbit: [1.0e-6], cycles_per_bit: [1.0e+8], "
        f"deadline_s: {k + SLACK_S}}}"
        for k in range(1, MOST_S + 1)
    )
    return build_world(loads(text.replace("\ndemand:", f"{services}\ndemand:")), 0)


@cache
def _deadline_engine(name: str) -> Engine:
    return make_engine(name, _deadline_world(), RunSettings((True,), False, keep_events=False))


def in_time(jobs: Sequence[Job], engine_name: str = "des") -> bool:
    """Return whether the simulator does all in time. Service k has a deadline of k seconds."""
    asks: dict[int, list[Ask]] = {
        user: [(job.from_s, 0.0, 0.0, job.until_s - job.from_s, 1, 10**11 * job.takes_s, 0)]
        for user, job in enumerate(jobs)
    }
    engine = _deadline_engine(engine_name)
    engine.reset(path_of(engine.world, asks))
    engine.step([0])
    assert [one.outcome for one in engine.log.requests] == [Outcome.COMPLETED] * len(jobs)
    return all(one.t_end_us <= one.deadline_us for one in engine.log.requests)
