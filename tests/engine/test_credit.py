"""The reward qoe: what a drone's step adds to QoE1 and QoE3, by hand and from the log alone."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from desim_uav.engine.base import EpisodeLog, RunSettings
from desim_uav.engine.des import Simulation
from desim_uav.errors import ScenarioError, UsageError
from desim_uav.learning.training import Training
from desim_uav.optimum.process import refuse_what_is_random
from desim_uav.sample_path import draw
from desim_uav.scenario.load import load, loads
from desim_uav.shipped import scenario_path
from desim_uav.world import World, build_world
from tests.engine.helpers import (
    US,
    Flight,
    column,
    events,
    path_of,
    seen,
    some_command,
    strip,
)
from tests.selection import by_default

QOE = {"kind": "qoe"}


def terms(flight: Flight, name: str) -> list[tuple[float, ...]]:
    """A term of all drones, by step."""
    return [tuple(one[name] for one in shown.reward_terms) for shown in flight.shown[1:]]


# ---- by hand


def two_over_two(**reward: Any) -> Flight:
    """Two drones over users 0 and 1; in the second step drone 1 flies away to the east.

    Drone 0 holds both users. User 0 asks for 100 s at the start, and user 1 for nothing.
    """
    world = strip([(0, 0), (0, 0)], [(120, 120), (120, 100)], steps=2, reward=QOE | reward)
    flight = Flight(world)
    log = flight.episode(path_of(world, {0: [(0, 100, 0)]}), "hover hover", "hover right")
    assert seen(log, "exit")[:2] == events("72842270 2 exit 1 1\n73085693 2 exit 1 0")
    return flight


@pytest.mark.usefixtures("every_engine")
def test_a_drone_is_paid_for_those_whom_no_other_covers():
    # At 8.3 m/s after 2.075 s of acceleration at 4 m/s², drone 1 has flown the 97.979590 m to the
    # edge of its footprint for user 1 after 12.842 s, and the 100 m for user 0 after 13.086 s. From
    # then on drone 0 alone covers them. A fair share is one user for all of a step.
    flight = two_over_two()
    alone_us = (120 * US - 72_842_270) + (120 * US - 73_085_693)
    assert terms(flight, "qoe3") == [(0.0, 0.0), (alone_us * 2 / (2 * 60 * US), 0.0)]
    # The request of user 0 is served until 100 s, of which 26.9 s no other could have done. The
    # demand makes a request per user and episode: a fair share is half of one in each step.
    share = (100 * US - 73_085_693) / (100 * US)
    assert terms(flight, "qoe1") == [(0.0, 0.0), (pytest.approx(share * 2, abs=1e-15), 0.0)]
    assert terms(flight, "crash") == [(0.0, 0.0)] * 2
    assert flight.shown[2].rewards[0] == sum(flight.shown[2].reward_terms[0].values())


@pytest.mark.usefixtures("every_engine")
def test_without_a_difference_a_drone_is_paid_for_all_that_it_does():
    flight = two_over_two(difference=False, w1=0.5, w3=2.0)
    assert terms(flight, "qoe3") == [(2.0 * 2.0, 0.0)] * 2
    assert terms(flight, "qoe1") == [(0.5 * 0.6 * 2, 0.0), (pytest.approx(0.5 * 0.4 * 2), 0.0)]


@pytest.mark.usefixtures("every_engine")
def test_who_lands_is_paid_for_the_step_before():
    # The station is under the drone: it hovers for a step, and lands at 60 s.
    battery = {"autonomy_min": 10, "return_below": 1.0}
    world = strip([(4, 0)], [(1080, 120)], steps=2, battery=battery, reward=QOE)
    flight = Flight(world)
    flight.episode(path_of(world), "hover charge")
    assert terms(flight, "qoe3") == [(1.0,), (0.0,)]


@pytest.mark.usefixtures("every_engine")
def test_who_crashes_is_paid_until_then_and_punished_once():
    # 93 s of battery: the drone serves its user for 33 s of the second step.
    world = column({"respawn_after_min": 5.0}, users=[(120, 1080)], reward=QOE | {"crash": 4.0})
    flight = Flight(world)
    flight.episode(path_of(world))
    assert terms(flight, "qoe3") == [(1.0,), (33 / 60,), (0.0,)]
    assert terms(flight, "crash") == [(0.0,), (-4.0,), (0.0,)]


# ---- from the log alone


def alone_us(log: EpisodeLog, steps: int, step_us: int, senders: int) -> np.ndarray[Any, Any]:
    """The user-time that each sender alone covers in each step (steps, senders), from events."""
    covering: dict[int, dict[int, int]] = {}
    found = np.zeros((steps, senders), np.int64)
    since: dict[int, int] = {}

    def count(user: int, now_us: int) -> None:
        """Add the time since the last change of a user's covers, step by step."""
        start = since.get(user, 0)
        if len(covering.get(user, ())) == 1:
            (drone,) = covering[user]
            for step in range(steps):
                low, high = max(start, step * step_us), min(now_us, (step + 1) * step_us)
                found[step, drone] += max(0, high - low)
        since[user] = now_us

    for t_us, _, kind, drone, user, *_ in log.events or ():
        if kind in ("enter", "exit"):
            count(user, t_us)
            own = covering.setdefault(user, {})
            if kind == "enter":
                own[drone] = t_us
            else:
                own.pop(drone, None)
    return found


def check_against_log(world: World, seed: int) -> None:
    """Two episodes of random commands, in which the reward is what the events say."""
    scenario = world.scenario
    drones, steps = scenario.drones.count, scenario.episode.steps
    told = RunSettings((True,) * drones, scenario.episode.carry_over, keep_events=True)
    engine, rng = Simulation(world, told), np.random.default_rng(seed)
    for episode in range(2):
        shown, paid = engine.reset(draw(world, seed, episode)), []
        while not (shown.terminated or shown.truncated):
            shown = engine.step([some_command(world, mask, rng) for mask in shown.masks])
            paid.append([one["qoe3"] for one in shown.reward_terms])
        senders = drones + len(scenario.access_points)
        found = alone_us(engine.log, len(paid), world.step_us, senders)[:, :drones]
        constants = engine.constants
        expected = found * constants.sharers / (len(world.homes) * world.step_us)
        assert paid == expected.tolist()
        assert steps >= len(paid)


@pytest.mark.parametrize("seed", by_default([5], range(12)))
def test_time_alone_is_that_of_the_events(seed: int):
    case = f"case{(seed + 7) % 9 + 1}"
    check_against_log(build_world(load(scenario_path(case), ["reward={kind: qoe}"]), seed), seed)


@pytest.mark.thorough
@pytest.mark.parametrize("first", range(0, 30, 10))
def test_time_alone_is_that_of_the_events_over_any_radio(first: int):
    from tests.engine.test_what_drones_know import random_world

    for seed in range(first, first + 10):
        check_against_log(random_world(seed), seed)


@pytest.mark.parametrize("case", by_default(["case8"], ["case1", "case4", "case9"]))
def test_all_that_drones_do_adds_up_to_the_measures(case: str):
    own = ["reward={kind: qoe, difference: false}"]
    world = build_world(load(scenario_path(case), own), 2)
    drones, steps = world.scenario.drones.count, world.scenario.episode.steps
    engine = Simulation(world, RunSettings((True,) * drones, False))
    rng, shown, total = np.random.default_rng(2), engine.reset(draw(world, 2, 0)), np.zeros(2)
    while not shown.truncated:
        shown = engine.step([some_command(world, mask, rng) for mask in shown.masks])
        for one in shown.reward_terms:
            total += one["qoe1"], one["qoe3"]
    shares = sum(request.done / request.required for request in engine.log.requests)
    asked = engine.constants.expected_requests
    measured = engine.measures()
    assert total[0] / drones / steps * asked == pytest.approx(shares)
    assert 100 * shares / engine.requests_made() == pytest.approx(measured.qoe1_percent)
    assert 100 * total[1] / drones / steps == pytest.approx(measured.qoe3_percent)


# ---- elsewhere


def test_training_with_it_is_the_same_in_both_engines():
    def trained(engine: str) -> Training:
        world = build_world(load(scenario_path("case4"), ["reward={kind: qoe, crash: 5}"]), 0)
        training = Training(world, 0, engine)
        rows = [row for _ in range(6) for row in training.play()]
        assert len(rows) == 6 * 2
        return training

    readable, compiled = trained("des"), trained("batch")
    assert compiled.fuses
    assert np.array_equal(readable.q, compiled.q)


def test_the_optimum_refuses_it():
    world = build_world(load(scenario_path("case1"), ["reward={kind: qoe}"]), 0)
    with pytest.raises(UsageError, match=r"reward.kind: .* not for 'qoe', which pays for what"):
        refuse_what_is_random(world)


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ("{kind: qoe, w1: -1}", "w1: -1: must be at least 0"),
        ("{kind: qoe, w3: 1e7}", "w3: 10000000: must be at most 1,000,000"),
        ("{kind: qoe, crash: -2}", "crash: -2: must be at least 0"),
        ("{kind: qoe, difference: maybe}", 'difference: "maybe": must be true or false'),
        ("{kind: qoe, w2: 1}", "w2: unknown key"),
    ],
)
def test_a_malformed_reward_names_the_key_and_what_is_allowed(text: str, problem: str):
    with pytest.raises(ScenarioError, match=problem):
        loads(f"reward: {text}")
