"""Tasks and sensors against the simulator with fixed time steps, which shares no code with them.

The scenarios are those of ``links.py``. Tasks are those of ``random_tasks`` at processors of all
disciplines; sensors send the updates of ``random_sensors``, beside users who ask for files.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from itertools import groupby, zip_longest
from operator import itemgetter
from typing import Any

import numpy as np

from desim_uav.rules.words import DELIVERED
from tests.engine import random_sensors, random_tasks
from tests.engine.random_parts import Dice
from tests.reference.inputs import US, Result
from tests.verification.convergence import (
    DTS_S,
    Case,
    Scenarios,
    case_of,
    sampled,
    share_of,
    slope,
)
from tests.verification.figure import Exact, Figure
from tests.verification.links import linked_scenario_of

OF_TASKS = ("delay_s", "computing_s", "own_s", "qoe1")
OF_SENSORS = ("age_s", "update_s")
MOST_S, MOST = 5.0, {"qoe1": 1.0}
"""The most that an error counts, in seconds, and of measures that are no times.

Where two completions fall into one step, what follows may be another order, and errors that do not
depend on dt, with a probability in proportion to dt. A mean of errors that are bounded therefore
goes with dt, too, and a few scenarios cannot decide it.
"""


def figures(quick: bool = False) -> Iterator[Figure]:
    """The slope of the error over dt, log over log."""
    seeds, tolerance = (range(8), 0.4) if quick else (range(64), 0.15)
    dts_s = DTS_S[:3] if quick else DTS_S
    yield from slopes(seeds, tolerance, dts_s, computing_scenario_of, OF_TASKS)
    yield from slopes(seeds, tolerance, dts_s, sensing_scenario_of, OF_SENSORS)


def slopes(
    seeds: range,
    tolerance: float,
    dts_s: tuple[float, ...],
    scenarios: Scenarios,
    measures: Sequence[str],
) -> Iterator[Figure]:
    """Of each measure, pooled over all requests, updates and sensors of all scenarios."""
    pooled: dict[str, list[float]] = {name: [] for name in measures}
    for dt_s in dts_s:
        found = [errors_of(case_of(k, scenarios), sampled(k, dt_s, scenarios)) for k in seeds]
        for name in measures:
            errors = np.concatenate([one[name] for one in found])
            pooled[name].append(np.minimum(errors, MOST.get(name, MOST_S)).mean())
    for name, errors in pooled.items():
        order = slope(np.array(errors), dts_s)
        yield Exact(f"{name}: order of the error in dt", order, 1.0, tolerance, cases=len(seeds))


def errors_of(case: Case, result: Result) -> dict[str, list[float]]:
    """How far each request, each delivered update and each sensor is off; of others, infinity.

    The first request of a user in one simulator is that in the other one, and so on.
    """
    log, horizon_us = case.log, case.world.horizon_us
    stages = [len(own) for own in case.world.services.stages]
    exact = [row(one, share_of(one, stages[one.service])) for one in log.requests]
    close = [row(one, one.share) for one in result.requests]
    updates = [
        (one.user, one.ended_us, (one.ended_us - one.generated_us) / US)
        for one in log.updates
        if one.fate == DELIVERED
    ]
    delivered = [(user, t_us, (t_us - taken_us) / US) for user, taken_us, t_us in result.delivered]
    ages = [one.area_us2 / 2 / horizon_us for one in log.sensors]
    return {
        **{name: differences(exact, close, 2 + k) for k, name in enumerate(OF_TASKS)},
        "update_s": differences(updates, delivered, 2),
        "age_s": [abs(a - b) / US for a, b in zip(ages, result.ages_us, strict=True)],
    }


def row(one: Any, share: float) -> tuple[Any, ...]:
    """A request of either simulator: its user, its time, and the measures of OF_TASKS."""
    delay_us = one.t_end_us - one.t_request_us
    times_us = (delay_us, one.computing_us, one.own_us)
    return (one.user, one.t_request_us, *(t_us / US for t_us in times_us), share)


def differences(
    exact: Iterable[tuple[Any, ...]], close: Iterable[tuple[Any, ...]], column: int
) -> list[float]:
    """The differences of a column, between rows that begin with a user and are ordered by time."""
    ours, theirs = (
        {user: [row[column] for row in rows] for user, rows in groupby(sorted(some), itemgetter(0))}
        for some in (exact, close)
    )
    return [
        np.inf if a is None or b is None else abs(a - b)
        for user in ours | theirs
        for a, b in zip_longest(ours.get(user, ()), theirs.get(user, ()))
    ]


def computing_scenario_of(seed: int) -> dict[str, Any]:
    """A random scenario whose drones and access points compute tasks, as users may."""
    mapping, dice = linked_scenario_of(seed), Dice(seed + 2_100_000)
    held = mapping["drones"]["radio"]["sharing"] == "held"
    discipline = dice.of(*random_tasks.DISCIPLINES)
    for each in [mapping["drones"], *mapping["access_points"]]:
        each["processor"] = {
            "cores": dice.of(1, 1, 2),
            "ghz": dice.of(0.05, 0.3),
            "sharing": discipline,
            "on_ground": dice.of(True, False),
        }
    mapping["users"]["processor"] = {"ghz": dice.of(0.02, 0.3)}
    mapping["offloading"] = dice.of("always", "always", "never", "shortest", "split")
    mapping["services"]["vision"] = random_tasks.task(dice, held)
    mix = {"vision": 3.0, **dice.of({}, {"file": 1.0})}
    mapping["demand"] = dice.of(
        {"kind": "poisson", "rate_per_hour": 90.0, "mix": mix},
        {"kind": "dynamic", "think_time_s": 20.0, "mix": mix},
    )
    return mapping


def uplinked_scenario_of(seed: int) -> dict[str, Any]:
    """One of the scenarios of tasks or of sensors, with bands for uploads alone."""
    mapping = (computing_scenario_of, sensing_scenario_of)[seed % 2](seed // 2)
    dice = Dice(seed + 2_300_000)
    for each in [mapping["drones"], *mapping["access_points"]]:
        each["radio"] = each["radio"] | {"uplink_mhz": dice.of(0.3, 0.3, 1.0, 2.5)}
    return mapping


def sensing_scenario_of(seed: int) -> dict[str, Any]:
    """A random scenario whose last users are sensors.

    Unless they take updates at will, these are no more than three a minute. Where a buffer always
    has one, each is sent later than the one before by a part of dt more, and which one is kept
    depends on that.
    """
    mapping, dice = linked_scenario_of(seed), Dice(seed + 2_200_000)
    held = mapping["drones"]["radio"]["sharing"] == "held"
    phones, sensors = {"name": "phones", **mapping["users"]}, dict(mapping["users"])
    phones["count"] = 6
    demand = {"kind": "sensing", "service": "reading"}
    sensors |= {"name": "meters", "count": dice.of(5, 10), "demand": demand}
    mapping["services"]["reading"] = service = random_sensors.updates(dice, held)
    often = {"mean_s": (2.5, 20), "every_s": (5, 30.25)}
    for key, (quick_s, slow_s) in often.items():
        if service["updates"].get(key) == quick_s:
            service["updates"][key] = slow_s
    if not mapping["drones"]["battery"] and not mapping["access_points"]:
        service["delivered"] = "drone"
    if service.get("delivered") == "ground":
        mapping["drones"]["store_mbit"] = dice.of(None, 9.5)
    mapping["users"] = [phones, sensors]
    return mapping
