"""Decisions by event against the simulator with fixed time steps (``tests/reference``).

Both fly the same random scenarios with the same commands of each drone (see
``test_against_fixed_step.py``): half of them with batteries of energy, with static and walking
users, queues at stations, crashes, replacements, blocked moves and position errors.

A drone that moves or hovers is free at a time that both know exactly. The reference notices the end
of a charge and a crash at the next tick, so that every charge and every crash before it can make a
decision late: by ``dt`` for a tick, and by what is missing in the battery because of a late
landing. Which action is taken, and where, is the same.
"""

from __future__ import annotations

import pytest

from desim_uav.env import SkipForcedParallel, UavParallelEnv
from desim_uav.model.rules import Action, Mode
from desim_uav.scenario.load import from_mapping
from tests.engine.test_energy_against_fixed_step import like_return
from tests.reference.inputs import US, Result
from tests.selection import by_default
from tests.verification.asked import decisions_of
from tests.verification.convergence import (
    DTS_S,
    FINEST_S,
    Case,
    asked_by_event,
    case_of,
    pooled_errors,
    sampled,
)
from tests.verification.figure import check
from tests.verification.flights import BY_EVENT

SEEDS = range(32)
FEW_SEEDS = (0, 3, 6, 7, 10, 13, 18, 27)


def late_us(case: Case, dt_s: float) -> float:
    """How late a decision can be: by so much for each charge and crash of the episode."""
    inputs, slowest = case.inputs, 1.0
    if inputs.charger is not None:
        slowest = inputs.charger.rate_per_s / inputs.charger.rate(inputs.charger.full_at)
    return 1 + 2 * slowest * dt_s * US * case.count("charge", "crash")


def most_w(case: Case) -> float:
    """The largest power in flight; of a battery in seconds, 1."""
    rotor = case.inputs.rotor
    if rotor is None:
        return 1.0
    up_mps = case.inputs.max_speed_mps if case.space is None else case.space.climb_mps
    return max(rotor.power_w(level_mps, up_mps) for level_mps in (0.0, case.inputs.max_speed_mps))


def check_decisions(case: Case, result: Result, dt_s: float) -> None:
    """Same drones, same actions, same places; times and batteries late by some ``dt``."""
    bound_us = late_us(case, dt_s)
    exact, _ = decisions_of(case.log, case.inputs)
    for drone, (ours, theirs) in enumerate(zip(exact, result.decisions, strict=True)):
        assert len(ours) == len(theirs), f"drone {drone}"
        for k, (one, other) in enumerate(zip(ours, theirs, strict=True)):
            at = f"drone {drone}, decision {k}"
            assert other.t_us == pytest.approx(one.t_us, abs=bound_us), at
            assert one.action_taken == other.action_taken, at
            if one.charge is not None:
                bound = (bound_us + 2 * dt_s * US) * most_w(case)
                assert other.charge == pytest.approx(one.charge, abs=bound), at
            if one.position_m is not None:
                assert other.position_m == pytest.approx(one.position_m, abs=1e-4), at
                assert other.return_drain == like_return(case, one.return_drain), at
                assert len(one.attached) == len(other.attached), at
    assert (result.crashes, result.charges) == (case.log.crashes, case.log.charges)


def check_at(seed: int) -> None:
    case, result = case_of(seed, asked_by_event), sampled(seed, FINEST_S, asked_by_event)
    check_decisions(case, result, FINEST_S)
    _, exact = decisions_of(case.log, case.inputs)
    assert result.rest == pytest.approx(exact, abs=0.1)


@pytest.mark.parametrize("seed", by_default([0, 3], FEW_SEEDS))
def test_agrees_at_the_finest_dt(seed: int) -> None:
    check_at(seed)


@pytest.mark.slow
def test_agrees_at_the_finest_dt_in_many_scenarios() -> None:
    for seed in SEEDS:
        check_at(seed)


@pytest.mark.thorough
def test_converges_with_slope_one() -> None:
    check(BY_EVENT.quick_orders())


@pytest.mark.slow
def test_converges_with_slope_one_in_many_scenarios() -> None:
    check(BY_EVENT.orders())


@pytest.mark.slow
def test_batteries_at_decisions_converge_at_least_as_fast() -> None:
    """A drone takes off full, however late: what is left is the error in the power of ramps."""
    errors = pooled_errors(SEEDS, DTS_S, asked_by_event, ("battery_s",))["battery_s"]
    assert (errors[1:] <= 0.6 * errors[:-1]).all()


@pytest.mark.thorough
def test_the_scenarios_have_everything_in_them() -> None:
    cases = [case_of(seed, asked_by_event) for seed in SEEDS]
    steps = [step for case in cases for step in case.log.steps]
    assert {step.mode for step in steps} == set(Mode)
    assert sum(case.count("respawn") for case in cases) >= 3
    assert sum(case.count("blocked") for case in cases) >= 20
    assert sum(case.log.queueing_us > 0 for case in cases) >= 3
    assert {case.inputs.rotor is None for case in cases} == {True, False}
    assert {case.inputs.charger is None for case in cases} == {True, False}
    assert {case.inputs.position_error is None for case in cases} == {True, False}
    assert {len(legs) > 1 for case in cases for legs in case.inputs.legs} == {True, False}
    assert {case.inputs.three_d for case in cases} == {True, False}
    assert {case.inputs.fill_epoch for case in cases} == {True, False}


@pytest.mark.parametrize("seed", by_default([4], range(0, 16, 2)))
def test_environments_pay_for_the_time_between_decisions(seed: int) -> None:
    """``SkipForcedParallel`` discounts by this time, as the reference does."""
    case, result = case_of(seed, asked_by_event), sampled(seed, FINEST_S, asked_by_event)
    mapping, gamma = asked_by_event(seed), case.inputs.gamma
    env = SkipForcedParallel(UavParallelEnv(from_mapping(mapping), world_seed=seed), gamma)
    _, infos = env.reset(seed=seed)
    paid = {agent: [0.0] for agent in env.agents}
    while env.agents:
        actions = {}
        for drone, agent in enumerate(env.agents):
            asked = result.decisions[drone][len(paid[agent]) - 1 :]
            word = "hover" if infos[agent]["forced"] else asked[0].action_taken
            actions[agent] = case.world.actions.index(Action[word.upper()])
        _, rewards, _, _, infos = env.step(actions)
        for agent, info in infos.items():
            if not info["forced"] or not env.agents:
                paid[agent].append(rewards[agent])
    for own, decisions, rest in zip(paid.values(), result.decisions, result.rest, strict=True):
        expected = [*(decision.gained for decision in decisions), rest]
        assert sum(own) == pytest.approx(sum(expected), abs=0.02)
        assert own == pytest.approx(expected, abs=0.35)
        off = [abs(a - b) > 0.01 for a, b in zip(own, expected, strict=True)]
        assert sum(off) <= 1
