"""How far two simulators of one episode are from each other, and when they part.

An error of a simulator with fixed time steps is of one of two kinds. Everything is noticed by up to
dt too late, so times are off by a few dt: this goes with dt in each single episode. But where two
things happen within a few dt, the other one may come first, and whatever follows may be quite
different, by an amount that does not depend on dt. The two have then *parted*. How likely that is
goes with dt, because the time between two events has a density at 0.

The mean over all requests mixes both: few episodes that have parted decide it. So they are examined
apart. What ends before the two part, at any of the steps, is the same at each step, and its mean
error has the slope 1 without much scatter. The rate of parting, the number of episodes that part
over the time until they do, has the slope 1 as well, with the scatter of a count, if the scenarios
are about equally likely to part. In the last five seconds of an episode nothing parts: what is done
in time in one simulator only ends at nearly the same time in the other one, with the episode.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import groupby, zip_longest
from operator import itemgetter
from typing import Any

import numpy as np

from desim_uav.rules.words import DELIVERED
from tests.reference.inputs import US, Result
from tests.verification.convergence import Case, Scenarios, case_of, sampled, share_of, slope
from tests.verification.figure import ERRORS, Estimate, Exact, Figure

OF_TASKS = ("delay_s", "computing_s", "own_s", "qoe1")
OF_SENSORS = ("age_s", "update_s")
MOST_US = 5 * US
"""By how much times may differ before the two have parted."""
Row = tuple[int, ...]
"""A request or an update: its user, when it was made, its end, and what must be the same."""


@dataclass(frozen=True)
class Comparison:
    """An episode of both, at one step, and the time at which they part.

    ``pairs`` are requests: the end in µs, and the differences of the measures ``OF_TASKS``.
    ``updates`` are those that were delivered: the end, and the difference of their ages.
    ``delivered`` are the deliveries of the engine, and of the reference.
    """

    parted_us: int
    pairs: list[tuple[int, tuple[float, ...]]]
    updates: list[tuple[int, tuple[float, ...]]]
    delivered: tuple[list[Row], list[Row]]

    def sums(self, until_us: int) -> dict[str, float]:
        """The sums of the errors of what ends before a time, and of mean ages until then."""
        pairs = [errors for end_us, errors in self.pairs if end_us < until_us]
        updates = [errors for end_us, errors in self.updates if end_us < until_us]
        exact, close = (ages_us(some, until_us) for some in self.delivered)
        away = [abs(exact.get(user, 0.0) - close.get(user, 0.0)) for user in exact | close]
        return {
            **{name: sum(errors[k] for errors in pairs) for k, name in enumerate(OF_TASKS)},
            "update_s": sum(errors[0] for errors in updates),
            "age_s": sum(away) / US,
        }


def compare(case: Case, result: Result) -> Comparison:
    """Compare an episode of the engine with the same one of the reference."""
    log, horizon_us = case.log, case.world.horizon_us
    stages = [len(own) for own in case.world.services.stages]
    exact = [measured(one, share_of(one, stages[one.service])) for one in log.requests]
    close = [measured(one, one.share) for one in result.requests]
    updates = [
        (one.user, one.generated_us, one.ended_us) for one in log.updates if one.fate == DELIVERED
    ]
    delivered = [(user, taken_us, t_us) for user, taken_us, t_us in result.delivered]
    parted_us, pairs = paired(exact, close)
    fate_us, of_updates = paired(in_order(updates), in_order(delivered))
    return Comparison(
        min(parted_us, fate_us, horizon_us),
        [(a[2], tuple(abs(x - y) for x, y in zip(a[4:], b[4:], strict=True))) for a, b in pairs],
        [(a[2], (abs((a[2] - a[1]) - (b[2] - b[1])) / US,)) for a, b in of_updates],
        (updates, delivered),
    )


def measured(one: Any, share: float) -> tuple[Any, ...]:
    """A request of either simulator, and the measures ``OF_TASKS``."""
    completed = getattr(one, "completed", None)
    if completed is None:
        completed = one.outcome.name == "COMPLETED"
    delay_us = one.t_end_us - one.t_request_us
    times_s = [t_us / US for t_us in (delay_us, one.computing_us, one.own_us)]
    return (int(one.user), one.t_request_us, one.t_end_us, completed, *times_s, share)


def in_order(updates: Iterable[Row]) -> list[Row]:
    """Updates in the order in which they were delivered."""
    return sorted(updates, key=itemgetter(0, 2, 1))


def paired(exact: Sequence[Any], close: Sequence[Any]) -> tuple[int, list[tuple[Any, Any]]]:
    """When the two part for the first time, and the pairs of what is the same.

    The first row of a user in one simulator is that in the other one, and so on.
    """
    ours, theirs = (
        {user: list(rows) for user, rows in groupby(sorted(some, key=itemgetter(0)), itemgetter(0))}
        for some in (exact, close)
    )
    parted_us, pairs = 2**62, []
    for user in sorted(ours | theirs):
        for a, b in zip_longest(ours.get(user, ()), theirs.get(user, ())):
            if a is None or b is None or not same(a, b):
                parted_us = min([parted_us, *(one[2] for one in (a, b) if one is not None)])
            else:
                pairs.append((a, b))
    return parted_us, pairs


def same(a: Any, b: Any) -> bool:
    """Whether two rows are of the same request or update."""
    near = abs(a[1] - b[1]) <= MOST_US and abs(a[2] - b[2]) <= MOST_US
    return near and a[3:4] == b[3:4]


def ages_us(delivered: Iterable[Row], until_us: int) -> dict[int, float]:
    """The mean age of each sensor until a time, less that of one from which nothing comes."""
    found: dict[int, float] = {}
    for user, rows in groupby(in_order(delivered), itemgetter(0)):
        fresh_us = since_us = 0
        area = 0.0
        for _, taken_us, t_us in rows:
            if t_us >= until_us:
                break
            area += (t_us - since_us) * (t_us + since_us - 2 * fresh_us) / 2
            since_us, fresh_us = t_us, max(fresh_us, taken_us)
        area += (until_us - since_us) * (until_us + since_us - 2 * fresh_us) / 2
        found[user] = area / until_us - until_us / 2
    return found


# ---- over many scenarios


def orders(
    seeds: range,
    tolerance: float,
    dts_s: tuple[float, ...],
    scenarios: Scenarios,
    measures: Sequence[str],
    alike: bool = True,
) -> Iterator[Figure]:
    """The order in dt of each measure's error until the two part, and of the rate of parting.

    Standard errors are those of the jackknife over scenarios. If the scenarios are not ``alike``,
    so that some part at every step and others at none, the rate need only fall with dt.
    """
    found = [
        [compare(case_of(k, scenarios), sampled(k, dt_s, scenarios)) for dt_s in dts_s]
        for k in seeds
    ]
    sums = [[at.sums(min(one.parted_us for one in row)) for at in row] for row in found]
    for name in measures:
        errors = np.array([[at[name] for at in row] for row in sums])
        order, error = jackknifed(lambda kept: kept.sum(axis=0), errors, dts_s)
        what = f"{name}: order of the error in dt (s.e. {error:.2g})"
        yield Exact(what, order, 1.0, tolerance, cases=len(seeds))
    ends_us = np.array([[case_of(k, scenarios).world.horizon_us - MOST_US] for k in seeds])
    parted_us = np.minimum([[one.parted_us for one in row] for row in found], ends_us)
    parted = parted_us < ends_us
    if parted.sum(axis=0).min() > 1:
        both = np.stack((parted, parted_us / US), axis=1)
        order, error = jackknifed(rate, both, dts_s)
        if alike:
            yield Estimate("rate of parting: order in dt", order, 1.0, error, len(seeds))
        else:
            what = "rate of parting: order in dt is above 0 by four standard errors"
            yield Exact(what, float(order > ERRORS * error), 1.0, cases=len(seeds))


def rate(kept: np.ndarray) -> np.ndarray:
    """How many scenarios part, over the time until they do, or until they end."""
    parted, until_s = kept.sum(axis=0)
    return np.asarray(parted / until_s)


def jackknifed(
    of: Callable[[np.ndarray], np.ndarray], values: np.ndarray, dts_s: tuple[float, ...]
) -> tuple[float, float]:
    """A slope and its standard error; the values are of scenarios, of which each is left out."""
    count = len(values)
    left_out = [slope(of(np.delete(values, k, axis=0)), dts_s) for k in range(count)]
    error = np.sqrt((count - 1) * np.var(left_out))
    return slope(of(values), dts_s), float(error)
