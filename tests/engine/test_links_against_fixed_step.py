"""Links with classes against an independent simulator by fixed time steps (``tests/reference``).

What the two must have in common is what ``test_against_fixed_step.py`` says. The reference looks up
each class from the ratio where the user is, at each tick, and sums what is delivered from tick to
tick; it knows neither rings nor searches. Levels of two drones that are close, or classes that
change at nearly the same time, may lead to another number of handovers, but seldom.
"""

from __future__ import annotations

import pytest

from tests.engine.test_against_fixed_step import check_battery, check_coverage
from tests.selection import by_default
from tests.verification.convergence import DTS_S, FINEST_S, case_of, sampled, slopes
from tests.verification.figure import check
from tests.verification.links import (
    MEASURES,
    linked_scenario_of,
    narrow_scenario_of,
    staged_scenario_of,
)

SEEDS = range(24)


@pytest.mark.parametrize("seed", by_default([1, 3], SEEDS))
def test_agrees_at_the_finest_dt(seed: int) -> None:
    case = case_of(seed, linked_scenario_of)
    result = sampled(seed, FINEST_S, linked_scenario_of)
    for step in case.log.steps:
        record = result.records[step.step][step.drone]
        assert record.mode == step.mode.name.lower()
        if record.mode != "crashed":
            where = (step.x_m, step.y_m, step.z_m)
            assert record.position_m == pytest.approx(where, abs=1e-4)
    assert (result.crashes, result.charges) == (case.log.crashes, case.log.charges)
    # A request that is noticed to end late is followed by the next one late.
    assert abs(len(result.requests) - len(case.log.requests)) <= 1
    check_battery(case, result, FINEST_S)
    check_coverage(case, result, FINEST_S)


@pytest.mark.slow
def test_handovers_are_as_many() -> None:
    """In all but two of the scenarios."""
    unlike = []
    for seed in SEEDS:
        counts = case_of(seed, linked_scenario_of).log.links
        assert counts is not None
        if sampled(seed, FINEST_S, linked_scenario_of).handovers != counts.handovers:
            unlike.append(seed)
    assert len(unlike) <= 2


@pytest.mark.slow
def test_converges_with_slope_one() -> None:
    check(slopes(SEEDS, 0.35, DTS_S[1:], linked_scenario_of, MEASURES))


@pytest.mark.slow
def test_converges_with_slope_one_in_many_scenarios() -> None:
    check(slopes(range(96), 0.25, DTS_S, linked_scenario_of, MEASURES))


@pytest.mark.parametrize("seed", by_default([2], range(12)))
def test_services_of_several_stages_agree_too(seed: int) -> None:
    case = case_of(seed, staged_scenario_of)
    result = sampled(seed, FINEST_S, staged_scenario_of)
    assert abs(len(result.requests) - len(case.log.requests)) <= 1
    check_battery(case, result, FINEST_S)
    check_coverage(case, result, FINEST_S)


@pytest.mark.parametrize("seed", by_default([1], range(12)))
def test_backhauls_agree_too(seed: int) -> None:
    case = case_of(seed, narrow_scenario_of)
    result = sampled(seed, FINEST_S, narrow_scenario_of)
    assert abs(len(result.requests) - len(case.log.requests)) <= 1
    check_battery(case, result, FINEST_S)
    check_coverage(case, result, FINEST_S)


@pytest.mark.slow
def test_backhauls_converge_with_slope_one() -> None:
    check(slopes(SEEDS, 0.35, DTS_S[1:], narrow_scenario_of, MEASURES))


@pytest.mark.slow
def test_services_of_several_stages_converge_with_slope_one() -> None:
    check(slopes(SEEDS, 0.35, DTS_S[1:], staged_scenario_of, MEASURES))


@pytest.mark.thorough
def test_the_scenarios_have_everything_in_them() -> None:
    """A check of the checks: what nobody flies nobody compares."""
    cases = [case_of(seed, linked_scenario_of) for seed in SEEDS]
    radios = [case.world.scenario.drones.radio for case in cases]
    assert {type(radio.sharing).__name__ for radio in radios} == {
        *("Held", "Equal", "MaxMin", "ProportionalFair", "MaxRate")
    }
    assert {radio.reuse for radio in radios} == {0, 1, 2}
    assert {len(radio.ladder) for radio in radios} == {1, 15, 18}  # type: ignore[attr-defined]
    associations = {type(case.world.scenario.association).__name__ for case in cases}
    assert associations == {"EnteredFirst", "Strongest", "A3"}
    assert {len(case.world.scenario.access_points) for case in cases} == {0, 1, 2}
    counts = [case.log.links for case in cases if case.log.links is not None]
    assert sum(count.handovers for count in counts) > 100
    assert sum(count.outages for count in counts) > 100
    assert sum(case.count("class") for case in cases) > 1000
    assert any(case.log.crashes for case in cases)
