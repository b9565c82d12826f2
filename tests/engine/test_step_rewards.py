"""What an engine counts and pays at a decision epoch: by hand, and from its events alone."""

from __future__ import annotations

import math
from collections import Counter
from dataclasses import dataclass
from fractions import Fraction
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, assume, given, settings
from hypothesis import strategies as st

from desim_uav.engine.base import RunSettings, Step
from desim_uav.engine.des import Simulation
from desim_uav.errors import ScenarioError, SimulationError
from desim_uav.experiment import tables
from desim_uav.model.rules import Mode
from desim_uav.model.state import Facts, Observation, Snapshot
from desim_uav.model.sums import in_order
from desim_uav.sample_path import draw
from desim_uav.scenario.load import from_mapping
from desim_uav.world import World, build_world
from tests.audit.invariants import audit
from tests.engine.helpers import (
    Flight,
    column,
    count,
    path_of,
    returning,
    scenarios,
    some_command,
    strip,
)
from tests.engine.replay import Counts, counts
from tests.selection import at_length

R1, R2 = {"kind": "coverage"}, {"kind": "coverage_battery"}


# ---- by hand


@pytest.mark.usefixtures("every_engine")
def test_a_drone_is_paid_for_whom_it_holds_when_the_step_ends():
    # Two drones for three users: a fair share of 1.5. Drone 0 leaves its two users for a cell
    # without any, drone 1 holds its one.
    users = [(120, 120), (120, 100), (1080, 120)]
    world = strip([(0, 0), (4, 0)], users, steps=3, reward=R1)
    flight = Flight(world)
    flight.episode(path_of(world), "hover right left")
    paid = [snapshot.rewards for snapshot in flight.shown]
    assert paid == [(), (1.0, 1 / 1.5), (0.0, 1 / 1.5), (1.0, 1 / 1.5)]
    assert flight.shown[0].reward_terms == ()
    assert flight.shown[2].reward_terms == ({"users": 0.0}, {"users": 1 / 1.5})


class Undefined:
    """A reward that divides by the users it holds."""

    def terms(self, drone: Observation, *_: Any) -> dict[str, float]:
        held = drone.attached_users
        return {"share": 1 / held if held else math.nan}


def test_a_reward_that_is_no_number_ends_the_simulation():
    world = strip(users=[(120, 120)], reward={"kind": f"{__name__}:Undefined"})
    with pytest.raises(SimulationError, match=r"reward 'Undefined' gave .*nan.*must be a number"):
        Flight(world).episode(path_of(world), "hover right")


@pytest.mark.usefixtures("every_engine")
def test_the_reward_comes_before_the_commands():
    # At 60 s it is told to return, and lets go of its user only then.
    world = returning(steps=2, users=[(120, 120)], reward=R1)
    log = Flight(world).episode(path_of(world), "hover goto")
    assert [step.reward for step in log.steps] == [1.0, 0.0]


@pytest.mark.usefixtures("every_engine")
def test_the_reward_comes_before_the_respawn():
    # Empty at 93 s; at 120 s it is down, and another takes its place in the same instant.
    world = column({"respawn_after_min": 0.0}, users=[(120, 360)], steps=3, reward=R1)
    flight = Flight(world)
    log = flight.episode(path_of(world, respawn=[[1]]))
    assert [step.mode for step in log.steps] == [Mode.FLYING, Mode.CRASHED, Mode.FLYING]
    assert [step.reward for step in log.steps] == [0.0, 0.0, 1.0]
    assert flight.shown[2].observations[0].mode is Mode.FLYING
    assert flight.shown[2].rewards == (0.0,)


@pytest.mark.usefixtures("every_engine")
def test_the_way_home_costs_as_the_battery_runs_low():
    # 150 s of battery; c1 = 75, c2 = 50, c3 = 33.3, c4 = 22.2 s, the station a hop of 30.990663 s
    # away. At 60 s it holds 90 s: service alone. At 120 s it holds 30 s: n_B is more than that.
    battery = {"autonomy_min": 2.5, "return_below": 1.0}
    reward = {**R2, "low_battery": 0.5}
    world = strip([(3, 0)], [(840, 120), (0, 120)], battery=battery, steps=3, reward=reward)
    flight = Flight(world)
    log = flight.episode(path_of(world))
    assert [step.charge for step in log.steps] == [90_000_000, 30_000_000, 0]
    assert [step.return_drain for step in log.steps][:2] == [30_990_663] * 2
    assert flight.shown[1].reward_terms == ({"users": 0.5, "return": 0.0},)
    assert flight.shown[2].reward_terms == ({"users": 0.0, "return": -1.0},)
    assert [step.reward for step in log.steps] == [0.5, -1.0, 0.0]


@pytest.mark.usefixtures("every_engine")
def test_without_caps_more_than_a_fair_share_is_worth_more_than_one():
    # Two drones for three users, one of them with two: 2 / 1.5 and 1 / 1.5.
    users = [(120, 120), (120, 100), (1080, 120)]
    world = strip([(0, 0), (4, 0)], users, steps=1, reward=R1 | {"capped": False})
    flight = Flight(world)
    flight.episode(path_of(world))
    assert flight.shown[1].rewards == (2 / 1.5, 1 / 1.5)


@pytest.mark.parametrize("kind", ["coverage_battery", "multi_service"])
@pytest.mark.usefixtures("every_engine")
def test_without_caps_a_way_home_can_cost_more_than_one(kind: str):
    # At 60 s the battery holds 30 s, and a station is two hops of 30.990663 s away.
    battery = {"autonomy_min": 1.5, "return_below": 1.0}
    reward = {"kind": kind, "low_battery": 0.5, "capped": False}
    world = strip([(2, 0)], [(120, 120)], battery=battery, steps=1, reward=reward)
    flight = Flight(world)
    flight.episode(path_of(world))
    assert flight.shown[1].reward_terms[0]["return"] == -(2 * 30.990663) / 30


@pytest.mark.usefixtures("every_engine")
def test_who_returns_pays_for_the_rest_of_the_way():
    # 300 s of battery, all of it low (c1 = 300, c2 = 200 s): a return of four hops from 60 s on.
    # At 120 s it is 29.0 s into its second hop and believes itself in the cell it flies to, two
    # hops from home, with 180 s left (c3 = 133.3 s): half weight.
    battery = {"autonomy_min": 5, "return_below": 1.0}
    reward = {**R2, "low_battery": 1.0}
    world = strip([(0, 0)], [(120, 120)], battery=battery, steps=2, reward=reward)
    log = Flight(world).episode(path_of(world), "hover goto")
    first, second = log.steps
    assert first.reward == pytest.approx(0.8 - 0.2 * 4 * 30.990663 / 240)
    assert (second.mode, second.charge) == (Mode.RETURNING, 180_000_000)
    assert second.reward == pytest.approx(-0.5 * 2 * 30.990663 / 180)


@pytest.mark.usefixtures("every_engine")
def test_the_share_of_a_services_open_requests():
    # A band of 400 kbit/s serves two of user 0's, 1's and 2's requests for 200; user 3 asks out of
    # reach. Then s = 2/4 of throughput, and the drone holds 3 of its 4 users.
    users = [(120, 120), (120, 100), (120, 80), (1080, 120)]
    world = strip([(0, 0)], users, steps=2, bandwidth_kbps=400)
    flight = Flight(world)
    asks = {user: [(0, 100, 200)] for user in range(4)}
    log = flight.episode(path_of(world, asks))
    after = flight.shown[1]
    (drone,) = after.observations
    assert after.open_requests == (4, 0, 0)
    assert (drone.asking, drone.served, drone.served_requests) == ((3, 0, 0), (2, 0, 0), 2)
    assert after.reward_terms[0]["users"] == 0.5 * 3 / 4
    assert after.reward_terms[0]["throughput"] == 0.2 * 2 / 4
    assert log.steps[0].reward == pytest.approx(0.375 + 0.1)
    # At 100 s two are done and the third is served: s = 1/2 at 120 s.
    assert flight.shown[2].open_requests == (2, 0, 0)
    assert flight.shown[2].observations[0].asking == (1, 0, 0)
    assert log.steps[1].reward == pytest.approx(0.375 + 0.1)


@pytest.mark.usefixtures("every_engine")
def test_requests_that_are_covered_can_count_instead_of_those_served():
    # As above, and user 0, whom the first drone holds, is in the footprint of the second one, 240 m
    # away: they cover 3/4 and 1/4 of the requests.
    users = [(120, 120), (120, 100), (120, 80), (1080, 120)]
    starts, reward = [(0, 0), (1, 0)], {"kind": "multi_service", "served_only": False}
    world = strip(starts, users, steps=1, radius_m=240.5, bandwidth_kbps=400, reward=reward)
    flight = Flight(world)
    flight.episode(path_of(world, {user: [(0, 100, 200)] for user in range(4)}))
    first, second = flight.shown[1].observations
    assert (first.served[0], first.asking[0]) == (2, 3)
    assert (second.served[0], second.asking[0]) == (0, 1)
    terms = [terms["throughput"] for terms in flight.shown[1].reward_terms]
    assert terms == [0.2 * (3 / 4), 0.2 * (1 / 4)]


@pytest.mark.usefixtures("every_engine")
def test_asking_counts_all_users_in_the_footprint_whoever_holds_them():
    # Two drones over one user; a third user's request ends, and a drone that charges counts none.
    users = [(120, 120), (120, 100)]
    world = strip([(0, 0), (0, 0)], users, steps=2)
    flight = Flight(world)
    flight.episode(path_of(world, {0: [(0, 300, 0)], 1: [(0, 30, 0)]}), "hover", "hover right")
    start, after = flight.shown[0], flight.shown[1]
    assert [drone.asking for drone in start.observations] == [(2, 0, 0)] * 2
    assert [drone.served for drone in start.observations] == [(2, 0, 0), (0, 0, 0)]
    assert [drone.asking for drone in after.observations] == [(1, 0, 0)] * 2
    gone = flight.shown[2].observations[1]
    assert (gone.asking, gone.attached_users) == ((0, 0, 0), 0)


# ---- rewards of one's own


@dataclass(frozen=True)
class Battery:
    """Two terms out of what the drone and the world are."""

    weight: float = 1.0

    def terms(
        self, drone: Observation, open_requests: tuple[int, ...], facts: Facts
    ) -> dict[str, float]:
        assert len(open_requests) == len(facts.services)
        assert drone.battery_s is not None and facts.capacity_s is not None
        return {
            "battery": self.weight * drone.battery_s / facts.capacity_s,
            "open": -float(sum(open_requests)),
        }


def test_a_reward_of_ones_own_is_named_in_the_scenario():
    reward = {"kind": f"{__name__}:Battery", "weight": 2.0}
    world = strip(steps=2, battery={"autonomy_min": 10}, reward=reward)
    flight = Flight(world)
    log = flight.episode(path_of(world, {0: [(70, 20, 0)]}))
    assert flight.shown[1].reward_terms == ({"battery": 1.8, "open": 0.0},)
    assert flight.shown[2].reward_terms == ({"battery": 1.6, "open": -1.0},)
    assert [step.reward for step in log.steps] == pytest.approx([1.8, 0.6])
    assert tables.steps_table([log], world)["reward"].tolist() == [
        step.reward for step in log.steps
    ]
    episodes = tables.episodes_table([log], world, tables.requests_table([log], world))
    assert episodes["reward"].tolist() == pytest.approx([2.4])


# ---- from the events alone, in random scenarios

REWARDS = (
    {"kind": "coverage"},
    {"kind": "coverage_battery"},
    {"kind": "coverage_battery", "cost_sign": 1, "low_battery": 0.8},
    {"kind": "multi_service"},
    {"kind": "multi_service", "low_battery": 1.0},
    {"kind": "multi_service", "cost_sign": 1, "low_battery": 0.5},
    {"kind": "multi_service", "low_battery": 0.8, "capped": False, "served_only": False},
)


def paid(world: World, step: Step, drone: int, counted: Counts) -> float:
    """A step's reward from its record and what was counted in the events."""
    if step.mode not in (Mode.FLYING, Mode.RETURNING):
        return 0.0
    reward: Any = world.scenario.reward
    fair = len(world.homes) / world.scenario.drones.count
    most = 1.0 if reward.capped else math.inf
    users = min(most, counted.attached[drone] / fair)
    if reward.kind == "coverage":
        return users
    weight, danger = 1.0, 0.0
    if step.charge is not None:
        assert step.return_drain is not None
        c1 = Fraction(str(reward.low_battery)) * world.only_type.capacity
        bounds = [round(c1 / Fraction(3, 2) ** k) for k in range(4)]
        band = sum(step.charge <= bound for bound in bounds)  # 0: above c1 … 4: at or below c4
        safe = step.charge > step.return_drain
        weight = (1.0, 0.8, 0.5, 0.2, 0.0)[band] if safe or band == 0 else 0.0
        if step.charge == 0 or math.isinf(step.return_drain):
            danger = 1.0
        else:
            danger = min(most, step.return_drain / step.charge)
    worth = users
    if reward.kind == "multi_service":
        had = counted.served if reward.served_only else counted.asking
        shares = zip(had[drone], counted.open_requests, strict=True)
        weights = (0.2, 0.2, 0.1)  # in the order of the services
        worth = 0.5 * users + sum(
            w * (share / asked if asked else 0.0)
            for w, (share, asked) in zip(weights, shares, strict=True)
        )
    return weight * worth + reward.cost_sign * (1 - weight) * danger


def check_epochs(engine: Simulation, shown: list[Snapshot], seen: Counter[str]) -> None:
    """Every snapshot and step against what the log's events add up to."""
    world, log = engine.world, engine.log
    steps = [
        log.steps[k : k + len(engine.state.drones)]
        for k in range(0, len(log.steps), len(engine.state.drones))
    ]
    assert len(shown) == len(steps) + 1
    for epoch, (snapshot, counted) in enumerate(zip(shown, counts(world, log), strict=True)):
        assert snapshot.open_requests == tuple(counted.open_requests)
        for drone in snapshot.observations:
            assert drone.attached_users == counted.attached[drone.drone]
            assert drone.served == tuple(counted.served[drone.drone])
            assert drone.served_requests == sum(drone.served)
            assert drone.asking == tuple(counted.asking[drone.drone])
            seen["asking"] += any(drone.asking)
            seen["asks elsewhere"] += drone.asking != snapshot.open_requests
            seen["waits"] += drone.served != drone.asking
        if epoch == 0:
            assert snapshot.rewards == snapshot.reward_terms == ()
            continue
        for step in steps[epoch - 1]:
            terms = snapshot.reward_terms[step.drone]
            assert step.reward == snapshot.rewards[step.drone] == in_order(terms.values())
            assert step.reward == pytest.approx(paid(world, step, step.drone, counted), abs=1e-12)
            seen[step.mode.name] += 1
            seen["reward"] += step.reward > 0
            seen["danger"] += terms.get("return", 0.0) != 0


MANY = 150
"""Examples among which everything that the random scenarios are for is met."""


@pytest.mark.parametrize("examples", at_length(25, MANY))
def test_what_is_counted_and_paid_is_what_the_events_add_up_to(examples: int):
    seen: Counter[str] = Counter()

    @settings(
        max_examples=examples,
        deadline=None,
        derandomize=True,
        suppress_health_check=[HealthCheck.too_slow, HealthCheck.filter_too_much],
    )
    @given(scenario=scenarios(), reward=st.sampled_from(REWARDS), seed=st.integers(0, 10**6))
    def check(scenario: dict[str, Any], reward: dict[str, Any], seed: int) -> None:
        try:
            world = build_world(from_mapping({**scenario, "reward": reward}), seed)
        except ScenarioError:
            assume(False)
        rng = np.random.default_rng(seed)
        settings_ = RunSettings((True,) * len(world.starts), True, keep_events=True)
        engine = Simulation(world, settings_, audit=audit)
        for episode in range(2):
            shown = [engine.reset(draw(world, seed, episode))]
            while not (shown[-1].terminated or shown[-1].truncated):
                commands = [some_command(world, mask, rng) for mask in shown[-1].masks]
                shown.append(engine.step(commands))
            check_epochs(engine, shown, seen)
            seen["respawn"] += count(engine.log, "respawn")

    check()
    expected = {"asking", "asks elsewhere", "waits", "reward", "danger", "respawn"}
    modes = {mode.name for mode in Mode}
    assert examples < MANY or min(seen[what] for what in expected | modes) > 0, seen
