"""Free flight with decisions by event against the simulator with fixed time steps.

Both fly the same random scenarios with the same commands of each drone: those of
``test_free_against_fixed_step.py``, with buildings, zones, wind, batteries of time and of energy,
asked as those of ``test_by_event_against_fixed_step.py`` are.
"""

from __future__ import annotations

import pytest

from desim_uav.model.rules import Mode
from tests.engine.test_by_event_against_fixed_step import check_decisions
from tests.selection import by_default
from tests.verification.asked import decisions_of
from tests.verification.convergence import (
    DTS_S,
    FINEST_S,
    case_of,
    pooled_errors,
    sampled,
)
from tests.verification.figure import check
from tests.verification.flights import FREE_BY_EVENT
from tests.verification.freely import freely_by_event

SEEDS = range(44)
FEW_SEEDS = (0, 3, 10, 11, 34, 35, 38, 39)


def check_at(seed: int, dt_s: float) -> None:
    case = case_of(seed, freely_by_event)
    result = sampled(seed, dt_s, freely_by_event)
    check_decisions(case, result, dt_s)
    _, exact = decisions_of(case.log, case.inputs)
    assert result.rest == pytest.approx(exact, abs=0.1)


@pytest.mark.parametrize("seed", by_default([34], FEW_SEEDS))
def test_agrees_at_the_finest_dt(seed: int) -> None:
    check_at(seed, FINEST_S)


@pytest.mark.slow
def test_agrees_at_the_finest_dt_in_many_scenarios() -> None:
    for seed in SEEDS:
        check_at(seed, FINEST_S)


@pytest.mark.thorough
def test_converges_with_slope_one() -> None:
    check(FREE_BY_EVENT.quick_orders())


@pytest.mark.slow
def test_converges_with_slope_one_in_many_scenarios() -> None:
    check(FREE_BY_EVENT.orders())


@pytest.mark.slow
@pytest.mark.parametrize("measure", ["battery_s", "gained"])
def test_what_decisions_see_converges_at_least_as_fast(measure: str) -> None:
    """A drone takes off full, however late: what is left is the error in the power of ramps.

    Rewards are paid for the users at decision epochs, which are seldom others.
    """
    errors = pooled_errors(FREE_BY_EVENT.seeds, DTS_S, freely_by_event, [measure])[measure]
    assert (errors[1:] <= 0.6 * errors[:-1]).all()


@pytest.mark.thorough
def test_the_scenarios_have_everything_in_them() -> None:
    cases = [case_of(seed, freely_by_event) for seed in SEEDS]
    steps = [step for case in cases for step in case.log.steps]
    assert {step.mode for step in steps} == set(Mode)
    assert sum(case.count("respawn") for case in cases) >= 3
    assert sum(case.count("blocked") for case in cases) >= 20
    assert {case.inputs.rotor is None for case in cases} == {True, False}
    assert {case.inputs.wind_mps == (0.0, 0.0) for case in cases} == {True, False}
    assert {case.inputs.three_d for case in cases} == {True, False}
    # Legs that are over before the patience is, and legs that take longer.
    legs = [
        (leg.duration_us, case.inputs.patience_us)
        for case in cases
        for leg in case.log.legs
        if leg.mode is Mode.FLYING and leg.duration_us
    ]
    assert {lasts_us > patience_us for lasts_us, patience_us in legs} == {True, False}
