"""Free flight in the engine against the simulator with fixed time steps (``tests/reference``).

Both fly the same random scenarios with the same commands: with buildings and zones, climbs at an
angle, wind, cruise speeds, returns round obstacles, batteries of time and of energy, static and
walking users. Obstacles are boxes along the axes, because these are grown in one way only. Legs are
closed forms in both, each with its own; what happens on them is noticed at ticks by the reference
(see ``test_against_fixed_step.py``).
"""

from __future__ import annotations

import pytest

from desim_uav.model.rules import Mode
from tests.reference.inputs import NEVER
from tests.selection import by_default
from tests.verification.convergence import DTS_S, FINEST_S, MEASURES, slope
from tests.verification.freely import case_of, pooled_errors, sampled

SEEDS = range(56)


@pytest.mark.parametrize("seed", by_default([0, 34, 45], SEEDS))
def test_agrees_at_the_finest_dt(seed: int) -> None:
    (case, _), result = case_of(seed), sampled(seed, FINEST_S)
    for step in case.log.steps:
        record = result.records[step.step][step.drone]
        at = f"step {step.step}, drone {step.drone}"
        assert record.mode == step.mode.name.lower(), at
        assert record.action_taken == step.action_taken.name.lower(), at
        assert len(record.attached) == step.attached_users, at
        near_m = 20.0 * FINEST_S if record.mode == "crashed" else 1e-4  # noticed late, at speed
        where = (step.x_m, step.y_m, 0.0 if record.mode == "crashed" else step.z_m)
        seen = (*record.position_m[:2], 0.0 if record.mode == "crashed" else record.position_m[2])
        assert seen == pytest.approx(where, abs=near_m), at
        resting = record.return_us not in (None, NEVER) and record.mode != "returning"
        if resting and case.inputs.rotor is None:
            assert record.return_us == pytest.approx(step.return_us, abs=20), at
    assert (result.crashes, result.charges) == (case.log.crashes, case.log.charges)


@pytest.mark.slow
def test_converges_with_slope_one() -> None:
    for measure, errors in pooled_errors(SEEDS, DTS_S, MEASURES).items():
        assert slope(errors, DTS_S) == pytest.approx(1.0, abs=0.35), (measure, errors)


@pytest.mark.thorough
def test_the_scenarios_have_everything_in_them() -> None:
    cases = [case_of(seed)[0] for seed in SEEDS]
    steps = [step for case in cases for step in case.log.steps]
    assert {step.mode for step in steps} == set(Mode)
    assert sum(case.count("blocked") for case in cases) >= 20
    assert {case.inputs.rotor is None for case in cases} == {True, False}
    assert {case.inputs.wind_mps == (0.0, 0.0) for case in cases} == {True, False}
    assert {case.world.chooses_cruise for case in cases} == {True, False}
    assert {case.inputs.three_d for case in cases} == {True, False}
    returns = [leg for case in cases for leg in case.log.legs if leg.mode is Mode.RETURNING]
    assert len(returns) > 1.5 * sum(case.count("land") for case in cases)  # round obstacles
