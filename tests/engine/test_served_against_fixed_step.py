"""Tasks and sensors against an independent simulator by fixed time steps (``tests/reference``).

What the two must have in common is what ``test_against_fixed_step.py`` says. The reference knows
no completion and no deadline beforehand: it counts cycles and bits from tick to tick, and looks at
what is left.
"""

from __future__ import annotations

from collections import Counter

import pytest

from desim_uav.model.rules import Outcome
from tests.reference.inputs import US
from tests.selection import by_default
from tests.verification.convergence import (
    DTS_S,
    FINEST_S,
    Scenarios,
    case_of,
    sampled,
)
from tests.verification.figure import check
from tests.verification.parting import OF_SENSORS, OF_TASKS, orders
from tests.verification.served import (
    computing_scenario_of,
    migrating_scenario_of,
    sensing_scenario_of,
    uplinked_scenario_of,
)

SEEDS = range(24)
FINER_S = (FINEST_S, FINEST_S / 5, FINEST_S / 25)
"""The steps at which scenarios have to agree: at the first one, or else at a finer one."""


def check_services(seed: int, scenarios: Scenarios) -> None:
    """The two agree at the finest step, or where they part, they no longer do so at finer ones.

    Two completions within a step may decide who computes or sends first, and much that follows. An
    engine that does something else than the reference parts from it at every step.
    """
    *coarse, last_s = FINER_S
    if not any(is_close(seed, scenarios, dt_s) for dt_s in coarse):
        assert is_close(seed, scenarios, last_s)


def is_close(seed: int, scenarios: Scenarios, dt_s: float) -> bool:
    """Whether requests are as many, and the sums of delays and of ages are off by little."""
    case, result = case_of(seed, scenarios), sampled(seed, dt_s, scenarios)
    ours, theirs = case.log.requests, result.requests
    exact_us, close_us = (
        sum(one.t_end_us - one.t_request_us for one in some) for some in (ours, theirs)
    )
    ages_us = [one.area_us2 / 2 / case.world.horizon_us for one in case.log.sensors]
    return bool(
        abs(len(theirs) - len(ours)) <= 1 + 0.03 * len(ours)
        and close_us == pytest.approx(exact_us, rel=0.05, abs=3 * dt_s * US * len(ours))
        and sum(result.ages_us) == pytest.approx(sum(ages_us), rel=0.02, abs=US * len(ages_us))
    )


@pytest.mark.parametrize("seed", by_default([2], SEEDS, at_most=6))
def test_tasks_agree_at_the_finest_dt(seed: int) -> None:
    check_services(seed, computing_scenario_of)


@pytest.mark.parametrize("seed", by_default([2], SEEDS, at_most=6))
def test_sensors_agree_at_the_finest_dt(seed: int) -> None:
    check_services(seed, sensing_scenario_of)


@pytest.mark.parametrize("seed", by_default([], SEEDS, at_most=4))
def test_uploads_in_their_own_bands_agree(seed: int) -> None:
    check_services(seed, uplinked_scenario_of)


@pytest.mark.parametrize("seed", by_default([], (0, 1, 6)))
def test_tasks_that_migrate_agree(seed: int) -> None:
    assert case_of(seed, migrating_scenario_of).count("move") > 0
    check_services(seed, migrating_scenario_of)


@pytest.mark.slow
def test_tasks_converge_with_slope_one() -> None:
    check(orders(range(64), 0.15, DTS_S, computing_scenario_of, OF_TASKS))


@pytest.mark.slow
def test_sensors_converge_with_slope_one() -> None:
    check(orders(range(64), 0.15, DTS_S, sensing_scenario_of, OF_SENSORS, alike=False))


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("scenarios", "measures"),
    [(computing_scenario_of, ("delay_s",)), (sensing_scenario_of, OF_SENSORS)],
)
def test_few_scenarios_converge(scenarios: Scenarios, measures: tuple[str, ...]) -> None:
    check(orders(range(8), 0.15, DTS_S[:3], scenarios, measures))


@pytest.mark.thorough
def test_the_scenarios_have_everything_in_them() -> None:
    """A check of the checks: what nobody computes or sends nobody compares."""
    counted: Counter[str] = Counter()
    for seed in SEEDS:
        mapping, log = computing_scenario_of(seed), case_of(seed, computing_scenario_of).log
        processor, vision = mapping["drones"]["processor"], mapping["services"]["vision"]
        counted.update((processor["sharing"], mapping["offloading"], f"late {vision['handover']}"))
        counted.update(f"ground {processor['on_ground']}" for _ in range(1))
        counted.update(one.outcome.name for one in log.requests)
        counted["restarts"] += sum(one.restarts for one in log.requests)
        log = case_of(seed, sensing_scenario_of).log
        mapping = sensing_scenario_of(seed)
        service, joined = mapping["services"]["reading"], "backhaul" in mapping["drones"]
        stored = joined and service.get("delivered") == "ground"
        counted["over a backhaul"] += stored and sum(one.delivered for one in log.sensors)
        counted.update((service["updates"]["kind"], service.get("keeps", "newest")))
        counted["dropped"] += sum(one.dropped for one in log.sensors)
        counted[service.get("delivered", "drone")] += sum(one.delivered for one in log.sensors)
    kinds = ("first_come", "processor_sharing", "earliest_deadline", "ground True", "ground False")
    kinds += ("always", "never", "shortest", "split", "late resume", "late restart", "restarts")
    kinds += (Outcome.LATE.name, "poisson", "periodic", "at_will", "newest", "oldest", "last")
    kinds += ("late migrate", "over a backhaul")
    assert all(counted[kind] > 0 for kind in (*kinds, "dropped", "drone", "ground")), counted
