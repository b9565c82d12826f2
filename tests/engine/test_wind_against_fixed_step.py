"""Flight in wind against the simulator with fixed time steps (``tests/reference``).

It finds the speeds over the ground by bisection, plans returns by Dijkstra's algorithm, and takes
the power at the air speed of each ``dt``. See ``test_energy_against_fixed_step.py``.
"""

from __future__ import annotations

import pytest

from desim_uav.model.rules import Mode
from tests.engine.test_against_fixed_step import check_coverage
from tests.engine.test_energy_against_fixed_step import most_w
from tests.reference.inputs import US
from tests.selection import by_default
from tests.verification.convergence import FINEST_S, SEEDS, case_of, sampled, slopes, windy
from tests.verification.figure import check


@pytest.mark.parametrize("seed", by_default([6], SEEDS))
def test_agrees_at_the_finest_dt(seed: int) -> None:
    case, result = case_of(seed, windy), sampled(seed, FINEST_S, windy)
    assert case.inputs.wind_mps != (0.0, 0.0)
    check_coverage(case, result, FINEST_S)
    begun = sorted(event[0] for event in case.log.events if event[2] in ("charge", "crash"))
    far_m = 2 * (case.inputs.max_speed_mps + 5.0) * FINEST_S
    for step in case.log.steps:
        record = result.records[step.step][step.drone]
        at = f"step {step.step}, drone {step.drone}"
        assert record.mode == step.mode.name.lower(), at
        assert record.action_taken == step.action_taken.name.lower(), at
        off = 1e-4 if step.mode is not Mode.CRASHED else far_m
        assert record.position_m[:2] == pytest.approx((step.x_m, step.y_m), abs=off), at
        if step.battery_us is not None:
            late = 1 + 3 * sum(t_us <= step.t_us for t_us in begun)
            bound_uj = 2 * late * most_w(case) * FINEST_S * US
            assert record.battery_us == pytest.approx(step.battery_us, abs=bound_uj), at
    assert (result.crashes, result.charges) == (case.log.crashes, case.log.charges)


@pytest.mark.slow
def test_converges_with_slope_one() -> None:
    check(slopes(range(24), 0.35, scenarios=windy, measures=("qoe3", "battery_s")))
