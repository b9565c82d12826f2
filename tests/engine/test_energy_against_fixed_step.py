"""Energy in the engine against the simulator with fixed time steps (``tests/reference``).

Both fly the same scenarios with the same commands (see ``test_against_fixed_step.py``). The
reference takes the power at the mean speed of each ``dt``, and lets a charge grow at the rate that
it has at the beginning of each ``dt``. A crash, a landing and a full battery are noticed at the
next tick, so that a battery is wrong by no more than some ``dt`` of hovering and of charging.
"""

from __future__ import annotations

import pytest

from desim_uav.model.rules import Mode
from tests.reference.inputs import US
from tests.selection import by_default
from tests.verification.convergence import (
    FINEST_S,
    SEEDS,
    Case,
    case_of,
    energetic,
    sampled,
    slopes,
)
from tests.verification.figure import check

LIMITED = [seed for seed in SEEDS if seed % 4 != 1]


def most_w(case: Case) -> float:
    """The largest power of a drone, in flight or on a pad."""
    inputs = case.inputs
    climbing = inputs.rotor.power_w(0.0, inputs.max_speed_mps)
    charge_s = inputs.charge_us / US
    rate = 1 / charge_s if inputs.charger is None else inputs.charger.rate_per_s
    return max(climbing, rate * inputs.capacity_us / 1e6)


@pytest.mark.parametrize("seed", by_default([6, 27], LIMITED, at_most=6))
def test_agrees_at_the_finest_dt(seed: int) -> None:
    case, result = case_of(seed, energetic), sampled(seed, FINEST_S, energetic)
    begun = sorted(event[0] for event in case.log.events if event[2] in ("charge", "crash"))
    for step in case.log.steps:
        record = result.records[step.step][step.drone]
        at = f"step {step.step}, drone {step.drone}"
        assert record.mode == step.mode.name.lower(), at
        assert record.action_taken == step.action_taken.name.lower(), at
        late = 1 + 3 * sum(t_us <= step.t_us for t_us in begun)
        bound_uj = late * most_w(case) * FINEST_S * 1e6
        assert record.battery_us == pytest.approx(step.battery_us, abs=bound_uj), at
    assert (result.crashes, result.charges) == (case.log.crashes, case.log.charges)


@pytest.mark.slow
def test_converges_with_slope_one() -> None:
    check(slopes(range(24), 0.35, scenarios=energetic, measures=("battery_s",)))


@pytest.mark.thorough
def test_the_scenarios_have_everything_in_them() -> None:
    cases = [case_of(seed, energetic) for seed in LIMITED]
    steps = [step for case in cases for step in case.log.steps]
    assert {step.mode for step in steps} == set(Mode)
    assert {case.inputs.charger is None for case in cases} == {True, False}
    assert {case.inputs.rotor.climbs for case in cases} == {True, False}
    assert any(case.inputs.three_d for case in cases)
