"""Free flight in the engine against the simulator with fixed time steps (``tests/reference``).

Both fly the same random scenarios with the same commands: with buildings and zones, climbs at an
angle, wind, cruise speeds, returns round obstacles, batteries of time and of energy, static and
walking users. Obstacles are boxes along the axes, because these are grown in one way only. Legs are
closed forms in both, each with its own; what happens on them is noticed at ticks by the reference
(see ``test_against_fixed_step.py``). The energy of a leg is a sum over ``dt``, and that of a way
home a sum over slices of ramps, at the speed through the air
(``test_energy_against_fixed_step.py``).
"""

from __future__ import annotations

from collections.abc import Callable

import pytest

from desim_uav.model.rules import Mode
from tests.engine.test_against_fixed_step import check_battery
from tests.engine.test_energy_against_fixed_step import check_energy
from tests.reference.inputs import Record, Result
from tests.selection import by_default
from tests.verification.convergence import FINEST_S, Case, case_of, sampled
from tests.verification.figure import check
from tests.verification.flights import FREE
from tests.verification.freely import freely

SEEDS = range(56)
FEW_SEEDS = (0, 2, 7, 11, 22, 31, 34, 35, 38, 39, 45, 50)


def check_at(seed: int, dt_s: float) -> None:
    check_case(case_of(seed, freely), sampled(seed, dt_s, freely), dt_s)


def looks_home(record: Record) -> bool:
    """Return whether the time of the way home is that of the end of the step."""
    return record.return_drain is not None and record.mode != "returning"


def check_case(
    case: Case, result: Result, dt_s: float, looks_home: Callable[[Record], bool] = looks_home
) -> None:
    """Compare the steps of an episode with those of the reference.

    Ways home are compared in the records for which ``looks_home`` returns True.
    """
    for step in case.log.steps:
        record = result.records[step.step][step.drone]
        at = f"step {step.step}, drone {step.drone}"
        assert record.mode == step.mode.name.lower(), at
        assert record.action_taken == step.action_taken.name.lower(), at
        assert len(record.attached) == step.attached_users, at
        near_m = 20.0 * dt_s if record.mode == "crashed" else 1e-4  # noticed late, at speed
        where = (step.x_m, step.y_m, 0.0 if record.mode == "crashed" else step.z_m)
        seen = (*record.position_m[:2], 0.0 if record.mode == "crashed" else record.position_m[2])
        assert seen == pytest.approx(where, abs=near_m), at
        if looks_home(record) and case.inputs.rotor is None:
            assert record.return_drain == step.return_drain, at
    assert (result.crashes, result.charges) == (case.log.crashes, case.log.charges)
    if case.inputs.rotor is None:
        check_battery(case, result, dt_s)
    else:
        check_energy(case, result, dt_s)


@pytest.mark.parametrize("seed", by_default([0, 34], FEW_SEEDS))
def test_agrees_at_the_finest_dt(seed: int) -> None:
    check_at(seed, FINEST_S)


@pytest.mark.slow
def test_agrees_in_many_scenarios() -> None:
    """In one of them two users come so close after each other that it takes a finer dt."""
    coarse = [seed for seed in SEEDS if not agrees_at(seed, FINEST_S)]
    assert coarse == [40]
    check_at(40, 0.005)


def agrees_at(seed: int, dt_s: float) -> bool:
    try:
        check_at(seed, dt_s)
    except AssertionError:
        return False
    return True


@pytest.mark.thorough
def test_converges_with_slope_one() -> None:
    check(FREE.quick_orders())


@pytest.mark.slow
def test_converges_with_slope_one_in_many_scenarios() -> None:
    check(FREE.orders())


@pytest.mark.thorough
def test_the_scenarios_have_everything_in_them() -> None:
    cases = [case_of(seed, freely) for seed in SEEDS]
    steps = [step for case in cases for step in case.log.steps]
    assert {step.mode for step in steps} == set(Mode)
    assert sum(case.count("blocked") for case in cases) >= 20
    assert {case.inputs.rotor is None for case in cases} == {True, False}
    assert {case.inputs.wind_mps == (0.0, 0.0) for case in cases} == {True, False}
    assert {"aim_cruise" in case.world.commands.names for case in cases} == {True, False}
    assert {case.inputs.three_d for case in cases} == {True, False}
    returns = [leg for case in cases for leg in case.log.legs if leg.mode is Mode.RETURNING]
    assert len(returns) > 1.5 * sum(case.count("land") for case in cases)  # round obstacles
