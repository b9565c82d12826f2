"""The best policy of one drone: by hand, against value iteration, and flown on the engine."""

import math
from dataclasses import dataclass
from itertools import product

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from desim_uav.engine.base import RunSettings
from desim_uav.engine.des import Simulation
from desim_uav.errors import ScenarioError, UsageError
from desim_uav.model.energy.battery import Endurance
from desim_uav.model.rules import Action
from desim_uav.optimum.gain import _chain, best_policy, long_run
from desim_uav.optimum.graph import explore, unlimited
from desim_uav.optimum.horizon import best_episode, episode_total
from desim_uav.optimum.itinerary import in_an_episode, in_the_long_run
from desim_uav.optimum.process import DroneProcess
from desim_uav.sample_path import draw
from desim_uav.scenario.load import from_mapping
from desim_uav.world import build_world
from tests.engine.helpers import strip
from tests.experiment.test_optimum_process import lone_drones

BY_R1 = {"reward": {"kind": "coverage"}}


def graph_of(world):
    process = DroneProcess(world)
    limited = world.scenario.limited_battery
    return process, explore(process) if limited else unlimited(process)


def share(world, graph):
    """What actions bring of QoE3, a step being 1."""
    return graph.attached_us / (world.step_us * len(world.homes))


def gains(world):
    """(best reward a step, best share of attached time), both as proven."""
    _, graph = graph_of(world)
    found = [best_policy(graph, brings) for brings in (graph.reward, share(world, graph))]
    for best in found:
        assert best.low <= best.gain <= best.high <= best.low + 1e-9
    return tuple(best.gain for best in found)


# ---- worked by hand


def on_one_cell(autonomy_min, **battery):
    """A user under the station; an empty battery charges in a minute."""
    battery = {"autonomy_min": autonomy_min, "return_below": 1.0, **battery}
    stations = {"full_charge_min": 1}
    return strip(users=[(120, 120)], cells=(1, 1), battery=battery, stations=stations, **BY_R1)


@pytest.mark.parametrize(("autonomy_min", "best"), [(2, 1 / 2), (3, 2 / 3), (10, 9 / 10)])
def test_hover_and_charge(autonomy_min, best):
    """Served until a minute is left, then charged for a step: the last minute would be a crash."""
    assert gains(on_one_cell(autonomy_min)) == pytest.approx((best, best), abs=1e-12)


def test_where_a_crash_is_the_fastest_recharge():
    """Replaced at once, as in the paper's code: the step of the crash is unpaid, but until its
    end the user is attached.
    """
    world = on_one_cell(3, respawn_after_min=0)
    assert gains(world) == pytest.approx((2 / 3, 1.0), abs=1e-12)


def test_replaced_by_lot():
    """A station at either end of three cells, a user at one of them; 1.5 min of battery.

    A hover is paid at the user's end, the next one ends in a crash, after which the drone begins
    at either end: 1 in every second life of two steps, 1/4. A charge after the first hover takes a
    step, and the drone is still there: 1/2; but not where it takes ten.
    """
    battery = {"autonomy_min": 1.5, "return_below": 1.0, "respawn_after_min": 0}
    stations = {"count": 2, "radius_m": 240, "full_charge_min": 1}
    size = {"cells": (1, 3), "users": [(120, 120)]}
    charging = strip(**size, battery=battery, stations=stations, **BY_R1)
    assert gains(charging)[0] == pytest.approx(1 / 2, abs=1e-12)
    stations["full_charge_min"] = 15
    lots = strip(**size, battery=battery, stations=stations, **BY_R1)
    assert gains(lots)[0] == pytest.approx(1 / 4, abs=1e-12)
    process, graph = graph_of(lots)
    told = in_the_long_run(process, graph, best_policy(graph, graph.reward).choice)
    assert told.again_from is None and told.rows[-1]["mode"] == "crashed"


@pytest.mark.parametrize("on_crash", ["remove", "end_episode"])
def test_what_follows_a_crash(on_crash):
    """Charging takes 11 steps of 12. Nobody comes: charge. The next episode begins: two steps."""
    battery = {"autonomy_min": 1.5, "return_below": 1.0, "on_crash": on_crash}
    stations = {"full_charge_min": 15}
    world = strip(users=[(120, 120)], cells=(1, 1), battery=battery, stations=stations, **BY_R1)
    best = {"remove": 1 / 11, "end_episode": 1 / 2}[on_crash]
    assert gains(world)[0] == pytest.approx(best, abs=1e-12)


def test_nobody_comes_and_that_is_best():
    """Nobody is in reach, and under c1 (all of the battery) the way home costs: down costs less."""
    battery = {"autonomy_min": 2, "return_below": 0.01, "on_crash": "remove"}
    reward = {"kind": "coverage_battery", "low_battery": 1.0}
    stations = {"full_charge_min": 600}
    users = [(2000, 120)]
    world = strip([(0, 0)], users, battery=battery, stations=stations, reward=reward)
    process, graph = graph_of(world)
    best = best_policy(graph, graph.reward)
    assert best.gain == 0.0
    assert in_the_long_run(process, graph, best.choice).again_from is None


def between_two_cells(**changes):
    """A user half-way between two cells, out of reach (100 m) of either one."""
    users = [(240, 120)]
    return strip(users=users, cells=(2, 1), timing="fill_epoch", **BY_R1 | changes)


def test_to_and_fro_beats_hovering():
    """240 m in 60 s at 4.07 m/s: the user is in reach for the 200 m in the middle."""
    process, graph = graph_of(between_two_cells())
    best = best_policy(graph, share(process.world, graph))
    speed_mps = 4.068986
    assert best.gain == pytest.approx(200 / speed_mps / 60, rel=1e-6)
    told = in_the_long_run(process, graph, best.choice)
    assert [row["action"] for row in told.rows] == ["right", "left"]
    assert told.again_from == 0
    assert best_policy(graph, graph.reward).gain == 0.0


# ---- against value iteration


def unrolled(process):
    """One step at a time: {state: [(reward, attached share, [(probability, next state)])]}.

    Forced steps are states of their own.
    """
    world = process.world
    at_stations = [((*cell, 0), world.only_type.capacity) for cell in world.stations]
    per_step = world.step_us * len(world.homes)
    chains, waiting = {}, [process.start]
    while waiting:
        state = waiting.pop()
        if state in chains:
            continue
        chains[state] = []
        for action in process.allowed(state):
            steps, follows = process.outcome(state, action)
            if follows is not None:
                ends = [(1.0, follows)]
            elif world.only_type.on_crash == "respawn":
                ends = [(1 / len(at_stations), end) for end in at_stations]
            elif world.only_type.on_crash == "end_episode":
                ends = [(1.0, process.start)]
            else:
                nothing = ("nothing", steps[-1].reward)
                chains[nothing] = [(steps[-1].reward, 0.0, [(1.0, nothing)])]
                ends = [(1.0, nothing)]
            waiting += [end for _, end in ends if end[0] != "nothing"]
            names = [(state, action, k) for k in range(1, len(steps))]
            for k, step in enumerate(steps):
                then = [(1.0, names[k])] if k < len(names) else ends
                row = (step.reward, step.attached_us / per_step, then)
                if k == 0:
                    chains[state].append(row)
                else:
                    chains[names[k - 1]] = [row]
    return chains


def by_value_iteration(process, measure):
    """Bounds on the best average from the start; steps are taken with probability 1/2 only."""
    chains = unrolled(process)
    number = {state: k for k, state in enumerate(chains)}
    width = max(len(rows) for rows in chains.values())
    ways = max(len(row[2]) for rows in chains.values() for row in rows)
    brings = np.full((len(chains), width), -np.inf)
    chance, leads = (np.zeros((len(chains), width, ways), t) for t in (float, int))
    for state, rows in chains.items():
        for a, row in enumerate(rows):
            brings[number[state], a] = row[measure]
            for way, (probability, end) in enumerate(row[2]):
                chance[number[state], a, way] = probability
                leads[number[state], a, way] = number[end]
    value = np.zeros(len(chains))
    for _ in range(40_000):
        ahead = (chance * value[leads]).sum(axis=2)
        better = 0.5 * value + 0.5 * (brings + ahead).max(axis=1)
        change = 2.0 * (better - value)
        value = better - better[0]
        if change.max() - change.min() < 1e-7:
            break
    return change.min(), change.max()


@pytest.mark.thorough
@settings(max_examples=40, deadline=None)
@given(lone_drones())
def test_against_value_iteration(scenario):
    battery = scenario["drones"]["battery"]
    if battery is not None:
        battery["on_crash"] = "respawn"  # then every state leads to every other one
    try:
        world = build_world(from_mapping(scenario), 0)
    except ScenarioError:
        return
    process, graph = graph_of(world)
    for measure, brings in enumerate((graph.reward, share(world, graph))):
        best = best_policy(graph, brings)
        low, high = by_value_iteration(process, measure)
        assert low - 1e-9 <= best.gain <= high + 1e-9
        assert high - low < 1e-3
        assert best.low <= best.gain <= best.high <= best.low + 1e-9


def test_a_way_from_a_worse_cycle_to_one_that_is_worse_still():
    """A cycle with gain 0.7 may be left, for a high reward once, to a place with gain 0.

    A crashed drone is removed, so no way leads back to the best cycle.
    """
    lost = {"map": {"size_m": [1200, 1440], "cells": [5, 6], "dimensions": 3}}
    lost["map"]["levels"] = {"min_altitude_m": 20, "step_m": 10}
    lost["map"]["obstacles"] = {"coverage": [0.0, 0.4], "height_m": [5, 60]}
    battery = {"autonomy_min": 5, "return_below": 0.5, "on_crash": "remove"}
    lost["drones"] = {
        "count": 1,
        "start_cells": [[0, 0]],
        "bandwidth_kbps": None,
        "motion": {"kind": "bang_coast_bang", "timing": "minimum_time"},
        "battery": battery | {"respawn_after_min": 0},
    }
    lost["stations"] = {"count": 2, "radius_m": 480.0, "full_charge_min": 0.7}
    lost["users"] = {"count": 2, "clusters": {"count": 2, "radius_m": [60, 400]}}
    lost["users"]["mobility"] = {"kind": "static"}
    lost |= {"demand": {"kind": "continuous"}, "reward": {"kind": "coverage"}}
    lost["episode"] = {"steps": 1, "carry_over": True}
    world = build_world(from_mapping(lost), 0)
    _, graph = graph_of(world)
    for brings in (graph.reward, share(world, graph)):
        best = best_policy(graph, brings)
        assert best.low <= best.gain <= best.high <= best.low + 1e-9
        assert long_run(graph, brings, best.choice) == best.gain


@pytest.mark.thorough
@settings(max_examples=60, deadline=None)
@given(lone_drones(), st.integers(0, 2**20))
def test_no_policy_beats_the_bound(scenario, seed):
    try:
        world = build_world(from_mapping(scenario), 0)
    except ScenarioError:
        return
    _, graph = graph_of(world)
    rng = np.random.default_rng(seed)
    allowed = graph.target < len(graph.states) + len(graph.renewals) + 1
    policy = (rng.random(allowed.shape) * allowed).argmax(axis=1)
    for brings in (graph.reward, share(world, graph)):
        best = best_policy(graph, brings)
        assert long_run(graph, brings, policy) <= best.high
        assert long_run(graph, brings, best.choice) == best.gain
        steps = 12
        most = best_episode(graph, brings, [], steps)
        choices = np.tile(policy, (steps + 1, 1))
        assert episode_total(graph, brings, [], choices) <= most.high
        assert episode_total(graph, brings, [], most.choices) == most.total


@settings(max_examples=100, deadline=None)
@given(st.integers(1, 8), st.integers(0, 2**20))
def test_the_worth_of_a_chain(count, seed):
    """gain = leads gain, bias = gained - gain · steps + leads bias, whatever its classes."""
    from scipy.sparse import csr_array

    rng = np.random.default_rng(seed)
    leads = rng.random((count, count)) * (rng.random((count, count)) < 0.3)
    leads[leads.sum(axis=1) == 0, rng.integers(count)] = 1.0
    leads /= leads.sum(axis=1)[:, None]
    gained, steps = rng.normal(size=count), rng.integers(1, 9, count).astype(float)
    gain, bias = _chain(gained, steps, csr_array(leads))
    assert gain == pytest.approx(leads @ gain, abs=1e-9)
    assert bias == pytest.approx(gained - gain * steps + leads @ bias, abs=1e-7)


# ---- flown on the engine


def flown(world, rows):
    """(Rewards, attached time) of rows told to an engine."""
    engine = Simulation(world, RunSettings((True,), carry_over=False))
    shown = engine.reset(draw(world, 0, 0))
    rewards = []
    for row in rows:
        action = Action.HOVER if row["action"] is None else Action[row["action"].upper()]
        shown = engine.step([world.actions.index(action)])
        rewards.append(engine.log.steps[-1].reward)
        seen = shown.observations[0]
        assert [list(seen.cell), seen.level] == [row["cell"], row["level"]]
    return rewards, engine.measures().qoe3_percent * len(rows)


@pytest.mark.thorough
@pytest.mark.parametrize("kind", ["coverage", "coverage_battery", "multi_service"])
@pytest.mark.parametrize("timing", ["fill_epoch", "minimum_time"])
@pytest.mark.parametrize("dimensions", [2, 3])
def test_as_the_engine_pays(kind, timing, dimensions):
    """Row by row; and a second round of the cycle brings the promised averages once more."""
    scenario = {
        "map": {"dimensions": dimensions},
        "drones": {
            "count": 1,
            "bandwidth_kbps": None,
            "motion": {"kind": "bang_coast_bang", "timing": timing},
        },
        "users": {"count": 24, "clusters": {"count": 3}, "mobility": {"kind": "static"}},
        "demand": {"kind": "continuous"},
        "reward": {"kind": kind},
        "episode": {"steps": 500},
    }
    world = build_world(from_mapping(scenario), 4)
    process, graph = graph_of(world)
    covered = share(world, graph)
    for goal, other in ((graph.reward, covered), (covered, graph.reward)):
        best = best_policy(graph, goal)
        told = in_the_long_run(process, graph, best.choice)
        first, again = told.rows[: told.again_from], told.rows[told.again_from :]
        reward, percent = {}, {}
        for times in (1, 2):
            rows = first + again * times
            rewards, percent[times] = flown(world, rows)
            assert rewards == [row["reward"] for row in rows]
            reward[times] = math.fsum(rewards)
        a_step = [(x[2] - x[1]) / len(again) for x in (reward, percent)]
        promised = [best.gain, 100 * long_run(graph, other, best.choice)]
        if goal is covered:
            promised = [long_run(graph, other, best.choice), 100 * best.gain]
        assert a_step == pytest.approx(promised, abs=1e-9)


# ---- in an episode


@dataclass(frozen=True)
class Thirsty(Endurance):
    """Moving costs twice what hovering does."""

    def drain_of(self, flight, elapsed_us):
        return elapsed_us * (1 if flight.duration_us == 0 else 2)

    def lasts_us(self, flight, charge):
        return charge if flight.duration_us == 0 else -(-charge // 2)


@dataclass(frozen=True)
class Tireless(Endurance):
    """Hovering costs nothing."""

    def drain_of(self, flight, elapsed_us):
        return 0 if flight.duration_us == 0 else elapsed_us

    def lasts_us(self, flight, charge):
        return 10**15 if flight.duration_us == 0 else charge


@pytest.mark.thorough
@pytest.mark.parametrize("kind", ["endurance", f"{__name__}:Thirsty"])
@pytest.mark.parametrize("after_min", [0, 2])
def test_the_best_episode(kind, after_min):
    """Every sequence of five commands flown on the engine."""
    battery = {"kind": kind, "autonomy_min": 3.2, "return_below": 1.0}
    battery["respawn_after_min"] = after_min
    world = strip(
        starts=[(1, 0)],
        users=[(200, 120), (480, 120), (520, 120)],
        cells=(3, 1),
        steps=5,
        battery=battery,
        reward={"kind": "coverage_battery"},
        stations={"full_charge_min": 2},
    )
    process, graph = graph_of(world)
    most = best_episode(graph, graph.reward, graph.forced, 5)
    covered = best_episode(graph, share(world, graph), [], 5)
    names = ["RIGHT", "LEFT", "HOVER", "GOTO_CHARGING_STATION", "CHARGE"]
    indices = [world.actions.index(Action[name]) for name in names]
    engine = Simulation(world, RunSettings((True,), carry_over=False))
    path = draw(world, 0, 0)
    rewards, percents = [], []
    for commands in product(indices, repeat=5):
        engine.reset(path)
        for command in commands:
            engine.step([command])
        rewards.append(math.fsum(step.reward for step in engine.log.steps))
        percents.append(engine.log.attached_us / (world.step_us * len(world.homes)))
    assert most.total == pytest.approx(max(rewards), abs=1e-12)
    assert covered.total == pytest.approx(max(percents), abs=1e-12)
    told = in_an_episode(process, graph, most.choices, 5)
    assert math.fsum(row["reward"] for row in told.rows) == pytest.approx(most.total, abs=1e-12)


# ---- what is refused


def test_too_many_states():
    with pytest.raises(UsageError, match=r"^map\.cells: more than 20 states"):
        explore(DroneProcess(on_one_cell(30)), largest=20)


def test_a_step_that_drains_nothing():
    world = strip(battery={"kind": f"{__name__}:Tireless"}, **BY_R1)
    with pytest.raises(UsageError, match=r"^drones\.battery: a step drains nothing"):
        explore(DroneProcess(world))
