"""Flight in wind against the simulator with fixed time steps (``tests/reference``).

It finds the speeds over the ground by bisection, plans returns by Dijkstra's algorithm, and takes
the power at the air speed of each ``dt``. See ``test_energy_against_fixed_step.py``.
"""

from __future__ import annotations

import pytest

from desim_uav.model.rules import Action, Mode
from tests.engine.test_against_fixed_step import check_coverage
from tests.engine.test_energy_against_fixed_step import check_energy
from tests.selection import by_default
from tests.verification.convergence import (
    FINEST_S,
    SEEDS,
    case_of,
    sampled,
    windy,
)
from tests.verification.figure import check
from tests.verification.flights import WIND

FEW_SEEDS = (3, 6, 9, 11, 14, 18, 23, 27)


def check_at(seed: int, dt_s: float) -> None:
    case, result = case_of(seed, windy), sampled(seed, dt_s, windy)
    check_coverage(case, result, dt_s)
    far_m = 2 * (case.inputs.max_speed_mps + 5.0) * dt_s
    for step in case.log.steps:
        record = result.records[step.step][step.drone]
        at = f"step {step.step}, drone {step.drone}"
        assert record.mode == step.mode.name.lower(), at
        assert record.action_taken == step.action_taken.name.lower(), at
        off = 1e-4 if step.mode is not Mode.CRASHED else far_m
        assert record.position_m[:2] == pytest.approx((step.x_m, step.y_m), abs=off), at
    if case.inputs.rotor is not None:
        check_energy(case, result, dt_s)
    assert (result.crashes, result.charges) == (case.log.crashes, case.log.charges)


@pytest.mark.parametrize("seed", by_default([6], FEW_SEEDS))
def test_agrees_at_the_finest_dt(seed: int) -> None:
    check_at(seed, FINEST_S)


@pytest.mark.slow
def test_agrees_at_the_finest_dt_in_many_scenarios() -> None:
    for seed in SEEDS:
        check_at(seed, FINEST_S)


@pytest.mark.thorough
def test_converges_with_slope_one() -> None:
    check(WIND.quick_orders())


@pytest.mark.slow
def test_converges_with_slope_one_in_many_scenarios() -> None:
    check(WIND.orders())


@pytest.mark.thorough
def test_the_scenarios_have_everything_in_them() -> None:
    """Wind of every direction, from the side too; and all that becomes of drones in it."""
    cases = [case_of(seed, windy) for seed in FEW_SEEDS]
    steps = [step for case in cases for step in case.log.steps]
    assert {step.mode for step in steps} == set(Mode)
    moves = {Action.FORWARD, Action.BACKWARD, Action.LEFT, Action.RIGHT, Action.UP, Action.DOWN}
    assert moves <= {step.action_taken for step in steps}
    winds = [case.inputs.wind_mps for case in cases]
    assert {(east > 0.0, north > 0.0) for east, north in winds} == {
        (one, other) for one in (True, False) for other in (True, False)
    }
    assert {case.inputs.rotor is None for case in cases} == {True, False}
    assert {case.inputs.fill_epoch for case in cases} == {True, False}
