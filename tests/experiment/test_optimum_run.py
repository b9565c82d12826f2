"""Bounds of runs: worked by hand, and against every sequence of commands in small worlds."""

from dataclasses import dataclass
from itertools import product

import numpy as np
import pytest

import desim_uav as du
from desim_uav.engine.base import RunSettings
from desim_uav.engine.des import Simulation
from desim_uav.errors import UsageError
from desim_uav.experiment.evaluate import evaluate
from desim_uav.model.energy.battery import Endurance
from desim_uav.model.mobility.mobility import RandomWalk
from desim_uav.model.rules import MOVES
from desim_uav.optimum.run.alone import ANYWHERE, best_alone, follow, pay_legs
from desim_uav.optimum.run.bound import BoundedRun
from desim_uav.optimum.run.covered import Covered
from desim_uav.optimum.run.legs import LEGS, leg_of, shares_of
from desim_uav.optimum.run.prices import lowest_bound
from desim_uav.optimum.run.served import Served, asked_in
from desim_uav.sample_path import draw
from desim_uav.scenario.load import from_mapping, load, to_plain
from desim_uav.shipped import find_table, scenario_path
from desim_uav.world import build_world
from tests.engine.helpers import path_of, strip
from tests.selection import by_default

# ---- worlds, and every sequence of commands in them


def small_world(seed, drones=2, steps=3, walking=False, **changes):
    """Up to four cells, users anywhere, a station, and batteries of about three steps."""
    rng = np.random.default_rng(seed)
    cells = [(3, 1), (2, 2), (4, 1)][seed % 3]
    size = 240.0 * np.array(cells)
    users = (rng.random((6, 2)) * size).tolist()
    starts = [[int(rng.integers(n)) for n in cells] for _ in range(drones)]
    battery = {
        "autonomy_min": float(rng.choice([2.5, 3, 3.2])),
        "return_below": 0.7,
        "respawn_after_min": 1.5,
    }
    stations = {
        "count": 1,
        "radius_m": 0,
        "pads": int(rng.integers(1, 3)),
        "full_charge_min": float(rng.choice([0.5, 2.0])),
    }
    drawn = {
        "battery": battery,
        "stations": stations,
        "timing": str(rng.choice(["minimum_time", "fill_epoch"])),
        "radius_m": float(rng.uniform(90, 260)),
    }
    world = strip(starts, users, cells, steps, **{**drawn, **changes})
    if not walking:
        return world
    crowd = world.scenario.users.model_copy(update={"mobility": RandomWalk(speed_mps=5.0)})
    return build_world(world.scenario.model_copy(update={"users": crowd}), 0)


def played(world, path, commands):
    engine = Simulation(world, RunSettings((True,) * world.scenario.drone_count, False))
    shown = engine.reset(path)
    for joint in commands:
        shown = engine.step(list(joint))
    return engine, shown


def choices(world, path, commands):
    """All joint commands after some others, without moves that are blocked, which are hovers."""
    engine, shown = played(world, path, commands)
    allowed = []
    for row, mask in zip(engine.state.drones, shown.masks, strict=True):
        own = []
        for index, (action, may) in enumerate(zip(world.actions, mask, strict=True)):
            dx, dy, dz = MOVES.get(action, (0, 0, 0))
            there = (row.x + dx, row.y + dy, row.level + dz)
            if may and (action not in MOVES or world.grid.can_enter(*there)):
                own.append(index)
        allowed.append(own)
    return product(*allowed)


def state_of(engine):
    """All that the future of the drones depends on."""
    now_us = engine.state.now_us
    rows = [
        (
            *(row.mode, row.x, row.y, row.level, row.to_x, row.to_y, row.charge),
            *(now_us - row.since_us, row.transit, row.route, row.route_end, row.respawns),
        )
        for row in engine.state.drones
    ]
    return (*rows, *(tuple(station.queue) for station in engine.state.stations))


def best_qoe3(world, path):
    """The largest QoE3 of all sequences of commands, by the number of crashes in them.

    Coverage adds up over steps. So of two sequences that lead to the same state of all drones with
    as many crashes, only the one with more coverage can be the beginning of the best.
    """
    layer, best = [(0.0, ())], {}
    for step in range(1, world.scenario.episode.steps + 1):
        following = {}
        for _, commands in layer:
            for joint in choices(world, path, commands):
                engine, _ = played(world, path, (*commands, joint))
                crashes = engine.log.crashes
                reached = step * engine.measures().qoe3_percent
                key = crashes, *state_of(engine)
                if key not in following or following[key][0] < reached:
                    following[key] = reached, (*commands, joint)
                if step == world.scenario.episode.steps:
                    mean = reached / step
                    best[crashes] = max(best.get(crashes, 0.0), mean)
        layer = following.values()
    return best


def check_bounds(world, seed):
    """The best QoE3 of all commands, and the bounds, which no commands and no price exceed."""
    run = BoundedRun(world, seed, 1, rounds=100)
    found, best = run.bound(), best_qoe3(world, draw(world, seed, 0))
    assert max(best.values()) <= found.qoe3_at_most_percent + 1e-9
    assert best.get(0, 0.0) <= found.crash_free_at_most_percent + 1e-9
    assert found.crash_free_at_most_percent <= found.qoe3_at_most_percent
    assert (found.schedule_qoe3_percent or 0.0) <= best.get(0, 0.0) + 1e-9
    for price in (0.05, 0.3):
        each = 100.0 * price / world.scenario.drone_count
        priced = max(qoe3 - each * crashes for crashes, qoe3 in best.items())
        assert priced <= 100.0 * run.qoe3(price) + 1e-9
    return max(best.values()), found


def best_qoe1(world, path):
    """The largest QoE1 of all sequences of commands, each of which is played to its end."""
    sequences, best = [()], 0.0
    for _ in range(world.scenario.episode.steps):
        sequences = [
            (*commands, joint) for commands in sequences for joint in choices(world, path, commands)
        ]
    for commands in sequences:
        closed = played(world, path, commands)[0].log.requests
        shares = [request.done / request.required for request in closed]
        best = max(best, 100.0 * sum(shares) / max(1, len(shares)))
    return best


@pytest.mark.thorough
def test_no_commands_cover_more():
    """Neither do they if prices are any others, which only make the bound higher."""
    world = small_world(0)
    best, found = check_bounds(world, 0)
    assert 0.0 < best < found.qoe3_at_most_percent < 100.0
    run, rng = BoundedRun(world, 0, 1), np.random.default_rng(0)
    for _ in range(20):
        prices = rng.random((run.steps, len(world.homes)))
        bound, _ = lowest_bound(Covered(), run.fleet, prices, lambda _: False)
        assert 100.0 * (bound + run.slack) >= best


@pytest.mark.thorough
def test_no_commands_cover_more_of_users_who_walk():
    check_bounds(small_world(1, walking=True), seed=1)


@pytest.mark.parametrize("seed", by_default([], [3, 5], at_most=1))
def test_no_commands_cover_more_in_longer_runs(seed):
    check_bounds(small_world(seed, steps=4, walking=seed % 2 > 0), seed)


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(6, 40))
def test_no_commands_cover_more_in_many_runs(seed):
    check_bounds(small_world(seed, steps=4, walking=seed % 2 > 0), seed)


CHARGING = (
    {"kind": "cc_cv", "power_w": 400.0},
    {"kind": "constant", "full_charge_min": 3.0},
    {"kind": "swap", "minutes": 1.5},
)


def energy_world(seed, steps=3, mixed=True, **changes):
    """Rotary wings that last for two or three steps; with ``mixed`` each drone has its own type."""
    rng = np.random.default_rng(seed)

    def battery():
        return {
            "kind": "rotary_wing",
            "capacity_wh": float(rng.choice([5.0, 6.5, 8.4])),
            "return_below": float(rng.choice([0.5, 0.9])),
            "respawn_after_min": float(rng.choice([0.0, 0.6, 1.5])),
        }

    stations = {"count": 1, "radius_m": 0, "pads": 1, "charging": CHARGING[seed % 3]}
    world = small_world(seed, steps=steps, battery=battery(), stations=stations, **changes)
    if not mixed:
        return world
    plain = to_plain(world.scenario)
    own = {key: value for key, value in plain["drones"].items() if key != "start_cells"}
    types = [
        own | {"name": f"type{k}", "count": 1, "start_cells": [[*start]], "battery": battery()}
        for k, start in enumerate(world.starts)
    ]
    types[1] |= {"footprint_radius_m": 150.0, "battery": None if seed % 5 == 4 else battery()}
    return build_world(from_mapping(plain | {"drones": types}), 0)


@pytest.mark.thorough
def test_no_commands_of_a_mixed_fleet_on_energy_cover_more():
    best, found = check_bounds(energy_world(0), 0)
    assert 0.0 < best < found.qoe3_at_most_percent < 100.0


@pytest.mark.parametrize("seed", by_default((), range(1, 5), 2))
def test_no_commands_of_other_fleets_on_energy_cover_more(seed):
    check_bounds(energy_world(seed, mixed=seed != 2), seed)


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(5, 35))
def test_no_commands_on_energy_cover_more_in_many_runs(seed):
    check_bounds(energy_world(seed, steps=4, mixed=seed % 3 > 0, walking=seed % 2 > 0), seed)


BUSY = {
    "demand": {"kind": "dynamic", "think_time_s": 20, "mix": {"call": 1}},
    "services": {"call": {"kind": "hold", "duration_min": [0.5, 1, 2], "bandwidth_kbps": [100]}},
}
ARRIVING = {
    "demand": {"kind": "poisson", "rate_per_hour": 60, "mix": {"call": 1}},
    "services": BUSY["services"],
}
ONCE = {"demand": {"kind": "static", "mix": {"call": 1}}, "services": BUSY["services"]}


def check_qoe1(world, seed):
    best, found = best_qoe1(world, draw(world, seed, 0)), 100.0 * BoundedRun(world, seed, 1).qoe1()
    assert best <= found + 1e-9
    return best, found


thoroughly = pytest.mark.thorough


@pytest.mark.thorough
def test_bounds_hold_with_a_backhaul():
    """It lets drones serve less, and cover as much: 100 kbit/s are one call at a time."""
    free = small_world(3, battery=None, radius_m=200.0, **BUSY)
    backhaul = {"kind": "capacity", "kbps": 100}
    scenario = free.scenario.model_dump(mode="json", exclude_unset=True)
    scenario["drones"]["backhaul"] = backhaul
    narrow = build_world(from_mapping(scenario), 0)
    bounds = [
        (100.0 * run.qoe1(), run.bound().qoe3_at_most_percent)
        for run in (BoundedRun(world, 0, 1, rounds=100) for world in (narrow, free))
    ]
    assert bounds[0] == bounds[1]
    rng, path = np.random.default_rng(0), draw(narrow, 0, 0)
    for _ in range(6):
        commands = [tuple(rng.integers(len(MOVES) + 1, size=2).tolist()) for _ in range(3)]
        (held, covered), (more, as_much) = (
            played(world, path, commands)[0].measures()[::2] for world in (narrow, free)
        )
        assert held <= min(more, bounds[0][0] + 1e-9)
        assert covered == as_much <= bounds[0][1] + 1e-9


@pytest.mark.thorough
@pytest.mark.parametrize(
    "demand",
    [BUSY, pytest.param(ARRIVING, marks=thoroughly), pytest.param(ONCE, marks=thoroughly)],
    ids=["dynamic", "poisson", "static"],
)
def test_no_commands_serve_more(demand):
    """Two drones without batteries in a row of three cells, of which each covers one."""
    best, found = check_qoe1(small_world(3, battery=None, radius_m=90.0, **demand), 0)
    assert best > 0.0 and found < 100.0


@pytest.mark.thorough
@pytest.mark.parametrize("seed", range(3))
def test_no_commands_serve_more_with_a_battery(seed):
    demand = (BUSY, ARRIVING, ONCE)[seed % 3]
    check_qoe1(small_world(seed, drones=1, steps=4, walking=seed % 2 > 0, **demand), seed)


# ---- worked by hand


def two_ends(**changes):
    """Four users over cell 0, four over cell 8, one drone over each, a station in the middle."""
    users = [(120, 120)] * 4 + [(2040, 120)] * 4
    return strip([(0, 0), (8, 0)], users, (9, 1), **changes)


@pytest.mark.thorough
def test_drones_that_cover_all():
    found = BoundedRun(two_ends(steps=5), 0, 1).bound()
    assert found.qoe3_at_most_percent == pytest.approx(100.0, abs=1e-4)
    assert found.schedule_qoe3_percent == 100.0
    assert found.gap_percent == pytest.approx(0.0, abs=1e-4)


def test_one_drone_for_two_ends():
    """It covers one end: half the users, and flies to no other within 5 steps."""
    users = [(120, 120)] * 4 + [(2040, 120)] * 4
    found = BoundedRun(strip([(0, 0)], users, (9, 1), steps=5), 0, 1).bound()
    assert found.qoe3_at_most_percent == pytest.approx(50.0, abs=0.01)
    assert found.schedule_qoe3_percent == 50.0


def test_a_battery_and_its_charge():
    """Users on the station's cell, 3 min of battery, and a charge of a step after two steps.

    In 6 steps: two of service, a charge, and three of service, the last of which ends in a crash.
    Without a crash the drone charges twice.
    """
    battery = {"autonomy_min": 3, "return_below": 1.0, "respawn_after_min": 30}
    world = strip(
        *([(1, 0)], [(360, 120)] * 3, (3, 1)),
        steps=6,
        battery=battery,
        stations={"full_charge_min": 1.5},
    )
    found = BoundedRun(world, 0, 1).bound()
    assert found.qoe3_at_most_percent == pytest.approx(100.0 * 5 / 6, abs=0.01)
    assert found.crash_free_at_most_percent == pytest.approx(100.0 * 4 / 6, abs=0.01)
    assert found.schedule_qoe3_percent == pytest.approx(100.0 * 4 / 6)


def test_energy_and_a_swap():
    """Two drones over all users and a station; hovers of 10,109 J, and 1 min to swap a battery.

    One battery lasts for two and a half steps, the other for none: of six steps the drone serves
    two, swaps, and serves three, the last of which ends in a crash. The other one is replaced at
    the end of each step, so that it may serve in all of them in the relaxed problem.
    """
    world = strip(
        *([(0, 0), (0, 0)], [(120, 120)] * 3, (1, 1)),
        steps=6,
        battery={"kind": "rotary_wing", "capacity_wh": 2.5 * 10109.05 / 3600},
        stations={"charging": {"kind": "swap", "minutes": 1.0}},
    )
    short = {"kind": "rotary_wing", "capacity_wh": 0.5 * 10109.05 / 3600, "respawn_after_min": 0.2}
    plain = to_plain(world.scenario)
    own = plain["drones"] | {"count": 1, "start_cells": [[0, 0]]}
    types = [own | {"name": "long"}, own | {"name": "short", "battery": short}]
    assert BoundedRun(world, 0, 1).qoe3() == pytest.approx(1.0, abs=1e-3)  # they take turns
    for number, bound in ((0, 5 / 6), (1, 1.0)):
        alone = build_world(from_mapping(plain | {"drones": [types[number]]}), 0)
        assert BoundedRun(alone, 0, 1).qoe3() == pytest.approx(bound, abs=1e-3)
    both = BoundedRun(build_world(from_mapping(plain | {"drones": types}), 0), 0, 1)
    assert [len(each.alone.charge) for each in both.fleet.types] == [3, 1]
    assert [each.alone.doomed for each in both.fleet.types] == [2, 0]


def test_a_carried_run_may_begin_anywhere():
    """The same with carry-over: at best the run begins as the second step does."""
    world = two_ends(steps=5, episode={"carry_over": True, "steps": 5})
    run = BoundedRun(world, 0, 2)
    (drones,) = run.fleet.types
    assert drones.starts == [(ANYWHERE, 2)] and run.fleet.steps == 10
    assert run.bound().episodes == 2


def test_shares_are_the_times_of_the_engine():
    """A drone flies from cell 0 to cell 1: the log's attachment time is the leg's share."""
    world = strip([(0, 0)], [(150, 120), (500, 120)], (3, 1), steps=1, radius_m=200.0)
    shares = shares_of(world, world.only_type, [draw(world, 0, 0).walks], 1, lambda: None)
    right = leg_of(shares, 0, 0) + 3
    part = slice(shares.first[right], shares.first[right + 1])
    engine, _ = played(world, draw(world, 0, 0), [[2]])
    assert shares.users[part].tolist() == [0, 1]
    attached_s = engine.log.attached_us / 1e6
    assert 60.0 * shares.shares[part].sum() == pytest.approx(attached_s, abs=1e-5)


def test_what_a_plan_earns_is_what_it_covers():
    """The value of the best plan is the price of all that it covers, also over crashes."""
    world = small_world(4, steps=12)
    run, rng = BoundedRun(world, 0, 1), np.random.default_rng(1)
    prices = rng.random((run.steps, len(world.homes)))
    ((alone, shares, _),) = run.fleet.types
    paid = np.empty((run.steps, len(alone.ahead), LEGS))
    pay_legs(shares, 0, prices, paid)
    plan = best_alone(alone, paid, run.steps)
    for start in (ANYWHERE, 0):
        covered = np.zeros_like(prices)
        follow(alone, plan, shares, 0, start, covered)
        assert (covered * prices).sum() == pytest.approx(plan.value(start))


@pytest.mark.thorough
def test_requests_by_hand():
    """A user asks for 2 steps at once, then after 1 step of thought for 1 step; a step costs 0.1.

    One request gains 1 - 0.2 - θ; both gain 2 - 0.3 - 2 θ, which is more until θ = 0.9.
    """
    world = strip([(0, 0)], [(120, 120)], (1, 1), steps=5)
    path = path_of(world, {0: [(0, 120, 1), (60, 60, 1)]}, thinking=True)
    asked = asked_in([path.requests], 5, world.step_us)
    assert asked.earliest.tolist() == [0.0, 3.0] and asked.required.tolist() == [2.0, 1.0]
    found = Served(asked).at_most(np.full((5, 1), 0.1), 0.0)
    assert found.bound == pytest.approx(0.85, abs=1e-9)
    assert found.needed.sum() == pytest.approx(3.0) and found.scale == 2.0


def test_a_request_that_comes_too_late_by_hand():
    """Half of a request for 2 steps fits before the end."""
    world = strip([(0, 0)], [(120, 120)], (1, 1), steps=5)
    path = path_of(world, {0: [(240, 120, 1)]}, thinking=True)
    found = Served(asked_in([path.requests], 5, world.step_us)).at_most(np.zeros((5, 1)), 0.0)
    assert found.bound == pytest.approx(0.5, abs=1e-9)


def test_no_requests():
    world = strip([(0, 0)], [(120, 120)], (1, 1), steps=5, **ONCE)
    quiet = small_world(0, demand={"kind": "static", "none": 1.0})
    assert BoundedRun(quiet, 0, 1).bound(schedule=False).qoe1_at_most_percent is None
    assert BoundedRun(world, 0, 1).qoe1() == pytest.approx(1.0, abs=1e-4)


# ---- what is refused


@pytest.mark.parametrize(
    ("keys", "key"),
    [
        ({"drones.battery.on_crash": "end_episode"}, "drones.battery.on_crash"),
        ({"drones.battery.kind": "tests.experiment.test_optimum_run:Own"}, "drones.battery.kind"),
        ({"map.cells": [400, 400], "map.size_m": [96000, 96000]}, "map.cells"),
    ],
)
def test_what_cannot_be_bounded(keys, key):
    with pytest.raises(UsageError, match=f"^{key}: "):
        du.find_bounds("case8", keys, seeds=1, episodes=1)


@dataclass(frozen=True)
class Own(Endurance):
    """A battery of one's own, of which nothing is known."""


# ---- every policy of the cases


@pytest.mark.thorough
@pytest.mark.parametrize("case", ["case4", "case8"])
def test_no_policy_of_a_case_is_better(case):
    """Learned tables, the baseline and others on the sample paths that the bound is for."""
    found = du.find_bounds(case, seeds=1, episodes=3)
    (row,) = found["seeds"]
    scenario = load(scenario_path(case))
    for policy in (find_table(f"{case}.npz"), "baseline", "hover", "random"):
        measured = evaluate(scenario, policy, 0, 3, 1)
        assert measured["qoe3_percent"] <= row["qoe3_at_most_percent"]
        assert measured["qoe1_percent"] <= row["qoe1_at_most_percent"]
    assert row["gap_percent"] <= 12.0
