"""Energy in the engine against the simulator with fixed time steps (``tests/reference``).

Both fly the same scenarios with the same commands (see ``test_against_fixed_step.py``). The
reference takes the power at the mean speed of each ``dt``, and lets a charge grow at the rate that
it has at the beginning of each ``dt``. A crash, a landing and a full battery are noticed at the
next tick, so that a battery is wrong by no more than some ``dt`` of hovering and of charging. What
a return takes, n_B, is wrong by the slices into which the reference cuts each ramp.
"""

from __future__ import annotations

from typing import Any

import pytest

from desim_uav.model.rules import Mode
from tests.reference.inputs import US, Result
from tests.selection import by_default
from tests.verification.convergence import (
    FINEST_S,
    SEEDS,
    Case,
    case_of,
    energetic,
    sampled,
)
from tests.verification.figure import check
from tests.verification.flights import ENERGY

LIMITED = [seed for seed in SEEDS if seed % 4 != 1]
FEW_SEEDS = (0, 6, 11, 14, 19, 22, 27, 30)


def most_w(case: Case) -> float:
    """The largest power of a drone, in flight or on a pad."""
    inputs, up_mps = case.inputs, case.inputs.max_speed_mps
    if case.space is not None:
        up_mps = case.space.climb_mps
    climbing = max(inputs.rotor.power_w(mps, up_mps) for mps in (0.0, inputs.max_speed_mps))
    charge_s = inputs.charge_us / US
    rate = 1 / charge_s if inputs.charger is None else inputs.charger.rate_per_s
    return max(climbing, rate * inputs.capacity / 1e6)


def check_energy(case: Case, result: Result, dt_s: float) -> None:
    """What is in batteries of energy, and what the ways home would take."""
    begun = sorted(event[0] for event in case.log.events if event[2] in ("charge", "crash"))
    for step in case.log.steps:
        record = result.records[step.step][step.drone]
        at = f"step {step.step}, drone {step.drone}"
        late = 1 + 3 * sum(t_us <= step.t_us for t_us in begun)
        bound_uj = late * most_w(case) * dt_s * US
        assert record.charge == pytest.approx(step.charge, abs=bound_uj), at
        if record.mode not in ("returning", "crashed"):
            assert record.return_drain == like_return(case, step.return_drain), at


def like_return(case: Case, exact: float | None) -> Any:
    """What a way home takes from a battery: the same time, or nearly the same energy."""
    if exact is None or case.inputs.rotor is None:
        return exact
    return pytest.approx(exact, rel=1e-5)


def check_at(seed: int) -> None:
    case, result = case_of(seed, energetic), sampled(seed, FINEST_S, energetic)
    check_energy(case, result, FINEST_S)
    for step in case.log.steps:
        record = result.records[step.step][step.drone]
        at = f"step {step.step}, drone {step.drone}"
        assert record.mode == step.mode.name.lower(), at
        assert record.action_taken == step.action_taken.name.lower(), at
    assert (result.crashes, result.charges) == (case.log.crashes, case.log.charges)


@pytest.mark.parametrize("seed", by_default([6, 27], FEW_SEEDS))
def test_agrees_at_the_finest_dt(seed: int) -> None:
    check_at(seed)


@pytest.mark.slow
def test_agrees_at_the_finest_dt_in_many_scenarios() -> None:
    for seed in LIMITED:
        check_at(seed)


@pytest.mark.thorough
def test_converges_with_slope_one() -> None:
    check(ENERGY.quick_orders())


@pytest.mark.slow
def test_converges_with_slope_one_in_many_scenarios() -> None:
    check(ENERGY.orders())


@pytest.mark.thorough
def test_the_scenarios_have_everything_in_them() -> None:
    cases = [case_of(seed, energetic) for seed in LIMITED]
    steps = [step for case in cases for step in case.log.steps]
    assert {step.mode for step in steps} == set(Mode)
    assert {case.inputs.charger is None for case in cases} == {True, False}
    assert {case.inputs.rotor.climbs for case in cases} == {True, False}
    assert any(case.inputs.three_d for case in cases)
