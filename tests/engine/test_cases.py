"""Whole runs under the audit: the nine cases, and random scenarios. Nothing is worked by hand here;
after every event the invariants must hold, and what is logged must be what the events add up to.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, assume, event, given, settings
from hypothesis import strategies as st

from desim_uav.engine.base import RunSettings
from desim_uav.engine.des import Simulation
from desim_uav.errors import ScenarioError
from desim_uav.experiment.run import decide, run_settings
from desim_uav.model.random.streams import Purpose, Streams
from desim_uav.model.rules import Action, Mode
from desim_uav.model.state import Snapshot
from desim_uav.policies import load_policy
from desim_uav.sample_path import draw
from desim_uav.scenario.load import from_mapping, load
from desim_uav.shipped import scenario_path
from desim_uav.world import build_world
from tests.audit.invariants import audit
from tests.engine.helpers import US, check_log, count, scenarios, some_command
from tests.selection import by_default

CASES = [f"case{number}" for number in range(1, 10)]


@pytest.mark.parametrize("seed", by_default([0], range(5)))
@pytest.mark.parametrize("policy_name", by_default(["baseline"], ["baseline", "random", "hover"]))
@pytest.mark.parametrize("case", CASES)
def test_every_case_keeps_the_invariants(case: str, policy_name: str, seed: int):
    world = build_world(load(scenario_path(case)), seed)
    policy = load_policy(policy_name)
    engine = Simulation(world, run_settings(world, policy, keep_events=True), audit=audit)
    assert engine.settings.carry_over
    for episode in range(2):
        policy.begin(world, Streams(seed, Purpose.LEARNER, episode))
        shown = engine.reset(draw(world, seed, episode))
        while not (shown.terminated or shown.truncated):
            commands = decide(policy, shown, world)
            before, shown = shown, engine.step(commands)
            check_step(engine, before, commands)
        check_episode(engine)
        check_demand(engine, case)


def obeyed(command: int, legal: tuple[bool, ...], allowed: tuple[Action, ...]) -> Action:
    """What the model says a command leads to: itself if allowed, else the only one, or hover."""
    if 0 <= command < len(legal) and legal[command]:
        return allowed[command]
    return allowed[legal.index(True)] if sum(legal) == 1 else Action.HOVER


def check_step(engine: Simulation, before: Snapshot, commands: list[int]) -> None:
    """The step's records against what was shown before it and told."""
    actions = engine.world.actions
    records = engine.log.steps[-len(commands) :]
    for record, command, mask in zip(records, commands, before.masks, strict=True):
        assert any(mask)
        assert record.step == before.step
        assert record.t_us == (before.step + 1) * engine.world.step_us
        assert record.action_taken is obeyed(command, mask, actions)
        assert mask[actions.index(record.action_taken)]
        if record.mode is not Mode.FLYING:
            assert record.attached_users == record.served_requests == record.used_hz == 0


def check_episode(engine: Simulation) -> None:
    """The log of an episode that has ended."""
    world, log = engine.world, engine.log
    state = engine.state
    assert state.opened == len(log.requests), "every opened request closes"
    assert all(user.request.number == user.holder == -1 for user in state.users)
    assert all(user.covered == 0 for user in state.users)
    assert all(drone.attached_users == 0 and not drone.waiting for drone in state.drones)
    assert log.duration_us == state.step * world.step_us
    assert len(log.steps) == state.step * len(state.drones)
    assert log.crashes == count(log, "crash") == count(log, "deplete")
    assert log.charges == count(log, "charged")
    check_log(world, log)
    in_order = [request.t_request_us for request in log.requests]
    assert in_order == sorted(in_order)


def check_demand(engine: Simulation, case: str) -> None:
    """What the case asks for: all of the episode, once, or again and again."""
    users, log = len(engine.world.homes), engine.log
    number = int(case.removeprefix("case"))
    if number <= 7:
        assert [request.user for request in log.requests] == list(range(users))
        assert all(request.t_request_us == 0 for request in log.requests)
    else:
        assert len(log.requests) > users
    if number <= 5:
        assert {request.required for request in log.requests} == {1800 * US}
        assert {request.bandwidth_bps for request in log.requests} == {0}
    assert log.suppressed == 0


# ---- random scenarios


def check_random_scenario(scenario: dict[str, Any], seed: int, episodes: int) -> None:
    try:
        world = build_world(from_mapping(scenario), seed)
    except ScenarioError as error:
        told = str(error)
        assert "stand on one cell" in told or "leaves the free cells connected" in told, told
        assume(False)
    rng = np.random.default_rng(seed)
    ceilings = tuple(bool(rng.random() < 0.6) for _ in range(world.scenario.drones.count))
    carry_over = world.scenario.episode.carry_over
    engine = Simulation(world, RunSettings(ceilings, carry_over, keep_events=True), audit=audit)
    for episode in range(episodes):
        shown = engine.reset(draw(world, seed, episode))
        assert (shown.step, shown.t_us) == (0, 0)
        while not (shown.terminated or shown.truncated):
            commands = [some_command(world, mask, rng) for mask in shown.masks]
            before, shown = shown, engine.step(commands)
            check_step(engine, before, commands)
        check_episode(engine)
        for kind in ("crash", "respawn", "charged", "blocked", "refuse"):
            if count(engine.log, kind):
                event(kind)
        if engine.log.queueing_us:
            event("queue")
        if any(len(request.drones) > 1 for request in engine.log.requests):
            event("handover")
        if any(request.interruptions for request in engine.log.requests):
            event("interruption")
        if shown.terminated:
            event("terminated")


@pytest.mark.parametrize("examples", by_default([25], [25, 100]))
def test_random_scenarios_keep_the_invariants(examples: int):
    settings(
        max_examples=examples,
        deadline=None,
        derandomize=True,
        suppress_health_check=[HealthCheck.too_slow, HealthCheck.filter_too_much],
    )(
        given(scenario=scenarios(), seed=st.integers(0, 10**6), episodes=st.integers(1, 3))(
            check_random_scenario
        )
    )()
