"""Planners: small worlds where the right commands are obvious, what they may know, and safety."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from desim_uav.engine.base import RunSettings
from desim_uav.engine.choose import make_engine
from desim_uav.errors import PolicyError
from desim_uav.experiment.command import label_of
from desim_uav.experiment.run import play, run
from desim_uav.experiment.sweep.plan import policy_digest
from desim_uav.measures.tally import headline
from desim_uav.model.geometry.coverage import WalkLeg, all_walked, walked
from desim_uav.model.random.streams import Purpose, Streams
from desim_uav.model.rules import Action, Mode
from desim_uav.model.services import COMPUTING, NOWHERE, SHARING
from desim_uav.policies import load_policy
from desim_uav.policies.base import as_seen, file_of
from desim_uav.policies.clairvoyant import Clairvoyant
from desim_uav.policies.greedy import Greedy
from desim_uav.policies.hover import Hover
from desim_uav.policies.planning.best_plan import (
    LOST,
    Ways,
    free_steps,
    plan_of,
    values_of,
)
from desim_uav.policies.planning.cover import covered_shares
from desim_uav.policies.planning.future import imagined
from desim_uav.policies.planning.ground import grounds_of
from desim_uav.policies.planning.sight import look
from desim_uav.policies.planning.team import Habits, TeamPlanner
from desim_uav.policies.rollout import Rollout
from desim_uav.rowcode.views import records
from desim_uav.sample_path import draw
from desim_uav.scenario.load import from_mapping, load
from desim_uav.world import World, build_world
from tests.engine.helpers import in_3d, path_of, strip
from tests.selection import by_default
from tests.verification.walked import velocities_of

Cell = tuple[int, int]


def flown(world: World, policy: Any, drone: int = 0) -> list[Cell]:
    """The cells of a drone after each step."""
    ((log, _),) = play(world, policy, "mine", seed=0, engine="batch")
    return [world.grid.cell_of(s.x_m, s.y_m) for s in log.steps if s.drone == drone]


def at(*cells: int) -> list[tuple[float, float]]:
    """Users in the middle of cells of a strip."""
    return [(240.0 * cell + 120.0, 120.0) for cell in cells]


# ---- greedy


def test_a_drone_flies_to_the_users_and_stays():
    world = strip([(0, 0)], at(4, 4), steps=6)
    assert flown(world, Greedy()) == [(1, 0), (2, 0), (3, 0), (4, 0), (4, 0), (4, 0)]


def test_two_drones_do_not_cover_the_same_users():
    world = strip([(3, 0), (5, 0)], at(2, 2, 2, 6, 6), steps=3)
    assert flown(world, Greedy(), 0)[-1] == (2, 0)
    assert flown(world, Greedy(), 1)[-1] == (6, 0)


def test_a_drone_leaves_users_to_another_and_takes_the_fewer():
    world = strip([(4, 0), (4, 0)], at(2, 2, 2, 6), steps=4)
    ends = {flown(world, Greedy(), drone)[-1] for drone in (0, 1)}
    assert ends == {(2, 0), (6, 0)}


def test_users_with_open_requests_count_more():
    demand = {"kind": "static", "none": 0.0}
    world = strip([(4, 0)], at(3, 5), steps=2, demand=demand)
    engine = make_engine("batch", world, RunSettings((True,), False))
    for asks, cell in (({0: [(0, 60, 0)]}, 3), ({1: [(0, 60, 0)]}, 5)):
        path = path_of(world, asks, thinking=True)
        policy = Greedy(waiting=2.0)
        policy.begin(world, Streams(0, Purpose.LEARNER))
        shown = engine.reset(path)
        policy.watch(engine)
        engine.step(policy.act_jointly(shown.observations, shown.masks))
        assert engine.drones[0].x == cell


def test_what_waits_for_no_link_does_not_count():
    """A task adds to a user's weight only while it waits for a link, its result for one drone."""
    world = strip(
        [(4, 0), (8, 0)],
        at(3, 4, 5),
        steps=2,
        drones={"processor": {}},
        services={
            "task": {
                "kind": "compute",
                "input_mbit": [1],
                "cycles_per_bit": [1000],
                "bandwidth_kbps": [100],
            }
        },
        demand={"kind": "static", "mix": {"task": 1}, "none": 0.0},
    )
    engine = make_engine("des", world, RunSettings((True, True), False))
    shown = engine.reset(draw(world, 0, 0))
    grounds = grounds_of(world)
    for number, (line, site) in enumerate(((COMPUTING, 0), (SHARING, 1), (NOWHERE, -1))):
        user, task = engine.state.users[number], engine.state.tasks[number]
        user.request.number, user.request.line, task.site = number, line, site
    sight = look(engine, grounds, shown.observations)
    assert (sight.backlog.tolist(), sight.only.tolist()) == ([0, 1, 0], [-1, 1, -1])
    team = TeamPlanner(grounds, sight, Habits(5, 2.0, 5.0, 2))
    assert team._worth_to(0)[0].tolist() == [1, 1, 1]
    assert team._worth_to(1)[0].tolist() == [1, 3, 1]


@pytest.mark.parametrize("engine", ["des", "batch"])
def test_a_sensor_counts_by_its_age_and_buffer(engine):
    sensors = {"kind": "collect", "updates": {"kind": "periodic", "every_s": 30, "offset": 0}}
    world = strip(
        [(4, 0)],
        at(3, 5),
        steps=3,
        services={"reading": {**sensors, "size_mbit": [1], "buffer": 9, "bandwidth_kbps": [100]}},
        demand={"kind": "sensing", "service": "reading"},
    )
    simulation = make_engine(engine, world, RunSettings((True,), False))
    simulation.reset(draw(world, 0, 0))
    left = list(world.actions).index(Action.LEFT)
    shown = simulation.step([left])  # to the first sensor, whose updates it receives
    shown = simulation.step([list(world.actions).index(Action.HOVER)])
    sight = look(simulation, grounds_of(world), shown.observations)
    assert sight.backlog[0] < sight.backlog[1] >= 4
    assert sight.ages.mean() == pytest.approx(1.0)
    assert sight.ages[0] < 0.5 < 1.5 < sight.ages[1]
    assert flown(world, Greedy())[-1] != (4, 0), "it flies to one of them"


def test_a_drone_flies_over_a_building():
    walls = [[1, 0, 30.0], [1, 1, 30.0]]
    users = [(600.0, 120.0), (600.0, 120.0)]
    world = in_3d([*walls, [0, 1, 50.0]], [(0, 0)], users=users, steps=4)
    assert flown(world, Greedy()) == [(0, 0), (1, 0), (2, 0), (2, 0)]


def test_a_drone_charges_before_its_battery_is_empty():
    battery = {"autonomy_min": 8, "return_below": 0.3}
    world = strip([(4, 0)], at(2), steps=60, battery=battery, stations={"full_charge_min": 2})
    ((log, _),) = play(world, Greedy(horizon=20), "mine", seed=0, engine="batch")
    assert log.crashes == 0
    # A cycle of 8 + 2 minutes, in which the drone has to fly two cells in both directions.
    assert log.charges in (5, 6)
    assert sum(step.attached_users for step in log.steps) >= 60 * 4 / 10


def test_two_drones_do_not_wait_for_one_pad():
    battery = {"autonomy_min": 8, "return_below": 0.3}
    stations = {"full_charge_min": 2, "pads": 1}
    episode = {"steps": 50, "carry_over": True}
    world = strip([(4, 0)] * 2, at(4, 4), battery=battery, stations=stations, episode=episode)
    ((log, _),) = play(world, Greedy(horizon=20), "mine", seed=0, engine="batch")
    assert log.crashes == 0
    assert log.queueing_us == 0
    qoe3 = log.attached_us / log.duration_us / 2
    assert qoe3 > 0.95, "one of them is always in the air"


def test_the_best_plan_of_a_line_by_hand():
    # Places 0, 1, 2; a station at 0; a step gains 1 at place 2. Two units are left at place 0.
    gained = np.zeros((2, 6, 1, 3))
    gained[:, :, 0, 2] = 0.5
    after = np.array([[0, 1, 2], [1, 2, -1], [-1, 0, 1]])
    ones = np.ones(3, np.int64)
    stations, charge_ticks = np.array([0, -1, -1]), np.array([1, 1, 1, 1, 1, 0])
    no_return = np.zeros((3, 4), np.int64), np.zeros((3, 6), np.int64), -1
    rings, cells = np.zeros(3, np.int64), np.arange(3)
    ways = Ways(after, ones, ones, rings, cells, stations, charge_ticks, stations, *no_return)
    free, rates = free_steps(np.zeros((1, 6), np.int64), 1), (0.0, 0.0)
    value = values_of(gained, ways, np.array([1, 2, 3]), free, rates, 0)
    # It charges for a step (to five units), flies to place 2 and at once back, which takes it to
    # place 1 with two units: half a step's gain on the way there and half on the way back.
    assert value[0, 0, 2] == 1.0
    plan = plan_of(gained, value, ways, free, rates, (0, 0, 2))
    assert np.count_nonzero(plan[:, 1] == 2) == 1
    assert value[0, 2, 1] <= LOST, "a unit does not take it home from there"


def test_the_share_of_users_in_a_footprint():
    places = np.zeros((3, 1, 2))
    shares = covered_shares(
        places, np.array([0.0, 50.0, 50.0]), np.array([[30.0, 40.0], [100.0, 0.0]]),
        np.array([[100.0]]),
    )  # fmt: skip
    assert shares[0, 0, :, 0].tolist()[0] == 1.0
    assert shares[1, 0, 1, 0] == 0.5, "at the edge"
    assert shares[2, 0, 0, 0] == pytest.approx(0.8413447, abs=1e-6)  # one standard deviation


def test_a_ground_knows_the_way_home():
    battery = {"autonomy_min": 10, "return_below": 0.5}
    ground = grounds_of(strip(battery=battery))[0]
    assert ground.needs.tolist() == [5, 4, 3, 2, 1, 2, 3, 4, 5]
    assert ground.full == 10
    assert ground.return_at == 5
    assert ground.spread_m.tolist() == [0.0] * 4


# ---- what a rollout may know


def _walking(steps: int = 6) -> World:
    scenario = {
        "drones": {"count": 2, "battery": None},
        "users": {"count": 4, "clusters": {"count": 1}},
        "demand": {"kind": "dynamic", "think_time_s": 60},
        "position_noise": {"probability": 0.3, "sigma_cells": 1.0},
        "episode": {"steps": steps},
    }
    return build_world(from_mapping(scenario), 0)


def test_an_imagined_future_depends_on_the_past_only():
    world = _walking()
    path = draw(world, 1, 0)
    other = draw(world, 2, 0)
    now_us = 2 * world.step_us
    walks, later = path.walks, other.walks
    legs, offsets = [], [0]
    for user in range(4):
        own = walks.legs[walks.offsets[user] : walks.offsets[user + 1]]
        legs.append(own[own["begin_us"] < now_us])
        x, y = walked(legs[-1][-1], now_us)
        legs.append(records(WalkLeg, [now_us, x, y, 0.1, 0.2]))
        offsets.append(offsets[-1] + len(legs[-2]) + 1)
    rows = path.requests.rows.copy()
    firsts = path.requests.offsets[:-1]
    rows[np.setdiff1d(np.arange(len(rows)), firsts)] += [7_000_000, 0, 60_000_000, 5]
    requests = path.requests._replace(rows=rows)
    assert path.position_error is not None and other.position_error is not None
    errors = other.position_error.copy()
    errors[:, :3] = path.position_error[:, :3]
    changed = replace(
        path,
        walking=type(walks)(np.concatenate(legs), np.array(offsets)),
        requests=requests,
        position_error=errors,
    )
    seen = []
    for each in (path, changed):
        engine = make_engine("batch", world, RunSettings((True, True), False))
        engine.reset(each)
        for _ in range(2):
            engine.step([4, 4])
        seen.append([imagined(engine.save(), 5, sample) for sample in (0, 0, 1)])
    (one, same, next_one), (again, *_) = seen
    for first, second in ((one, same), (one, again)):
        assert first.rows == second.rows
        assert np.array_equal(first.path.walks.legs, second.path.walks.legs)
        assert np.array_equal(first.path.requests.rows, second.path.requests.rows)
        assert np.array_equal(first.path.position_error, second.path.position_error)
    assert not np.array_equal(one.path.walks.legs, next_one.path.walks.legs)
    assert not np.array_equal(later.legs, one.path.walks.legs)
    true = path.walks.legs[path.walks.legs["begin_us"] < now_us]
    kept = one.path.walks.legs[one.path.walks.legs["begin_us"] < now_us]
    assert np.array_equal(true, kept), "the past is the true one"


def test_an_imagined_future_can_be_played_and_is_of_the_model():
    world = build_world(load("case8"), 0)
    engine = make_engine("batch", world, RunSettings((True,) * 3, True, keep_steps=False))
    inner = make_engine("batch", world, RunSettings((True,) * 3, True, keep_steps=False))
    engine.reset(draw(world, 0, 0))
    for _ in range(10):
        engine.step([4] * 3)
    saved, opened = engine.save(), []
    for sample in range(6):
        shown = inner.restore(imagined(saved, 0, sample))
        assert shown.step == 10
        assert inner.measures() == engine.measures()
        before = inner.requests_made()
        while not shown.truncated:
            shown = inner.step([4] * 3)
        opened.append(inner.requests_made() - before)
    truth = []
    for episode in range(6):
        shown = engine.reset(draw(world, 1, episode))
        for step in range(30):
            if step == 10:
                before = engine.requests_made()
            shown = engine.step([4] * 3)
        truth.append(engine.requests_made() - before)
    assert abs(np.mean(opened) - np.mean(truth)) < 3 * (np.std(opened) + np.std(truth)) / 6**0.5
    assert len(set(opened)) > 1


def test_an_imagined_future_goes_on_from_here_and_from_now():
    """A stationary start would put users elsewhere, and the day would begin once more."""
    changes = [
        "users.mobility={kind: random_waypoint, speed_mps: [1, 9], pause_s: [0, 60]}",
        "demand={kind: profile, profiles: [[[0, 0], [0.25, 60]]]}",
    ]
    world = build_world(load("case8", changes), 0)
    engine = make_engine("batch", world, RunSettings((True,) * 3, False))
    engine.reset(draw(world, 0, 0))
    for _ in range(10):
        engine.step([4] * 3)
    saved, now_us = engine.save(), 10 * world.step_us
    true, future = saved.path, imagined(saved, 0, 0).path
    here_m = all_walked(*true.walks, now_us)
    assert all_walked(*future.walks, now_us) == pytest.approx(here_m, abs=1e-4)
    assert not np.allclose(all_walked(*future.walks, now_us + 10**8), here_m, atol=1.0)
    arrivals_us = future.requests.rows[:, 0]
    assert len(arrivals_us) > 100
    assert 900_000_000 <= arrivals_us.min() < 960_000_000  # as the day goes, not the future
    assert grounds_of(world)[0].spread_m[0] == 0.0


def test_a_rollout_of_hovering_flies_to_the_users():
    world = strip([(3, 0)], at(4, 4), steps=3)
    policy = Rollout(base=Hover(), samples=1, horizon=3)
    assert flown(world, policy) == [(4, 0), (4, 0), (4, 0)]
    assert policy.name == "rollout:desim_uav.policies.hover:Hover"


@pytest.mark.parametrize("base", ["case8.npz", "ppo_case8.npz"])
def test_a_table_or_a_network_from_a_file_is_a_base(base: str):
    """The run has the observation of the network, and is warned of what the base warns of."""
    name = f"rollout:{base}+samples=1+horizon=2"
    scenario = as_seen(load("case8", ["episode.steps=2"]), name)
    assert scenario.observation == as_seen(load("case8"), base).observation
    found = run(build_world(scenario, 0), load_policy(name), name, 3, 1, engine="batch")
    alone = run(build_world(scenario, 0), load_policy(base), base, 3, 1, engine="batch")
    reached, least = (headline(one.requests, one.episodes) for one in (found, alone))
    assert reached["qoe3_percent"] > 0.9 * least["qoe3_percent"] > 0
    said = [load_policy(one).notice(build_world(scenario, 1)) for one in (name, base)]
    assert said[0] == said[1] and "in another world" in said[0]
    assert file_of(name) == file_of(base) and policy_digest(name) == policy_digest(base)
    assert label_of(name) == f"rollout-{base.removesuffix('.npz')}+samples=1+horizon=2"


def test_the_clairvoyant_waits_where_users_will_be():
    world = strip([(4, 0)], at(3, 3), steps=4, radius_m=150.0)
    engine = make_engine("batch", world, RunSettings((True,), False))
    path = path_of(world, walks={u: [(0, 840.0, 120.0, 4.0, 0.0)] for u in (0, 1)})
    policy = Clairvoyant(tries=40)
    policy.begin(world, Streams(0, Purpose.LEARNER))
    shown = engine.reset(path)
    policy.watch(engine)
    cells = []
    while not shown.truncated:
        shown = engine.step([policy.act(shown.observations[0], shown.masks[0])])
        cells.append(engine.drones[0].x)
    # They walk a cell per minute, from cell 3 to cell 7. It lets them come, and goes with them.
    assert cells[-1] == 7
    assert engine.log.attached_us > 0.8 * 2 * engine.log.duration_us


# ---- names, options and what is refused


@pytest.mark.parametrize(
    ("name", "says"),
    [
        ("greedy:horizn=3", "greedy has no option 'horizn' (did you mean 'horizon'?)"),
        ("greedy:horizon=0", "horizon: '0': must be a whole number from 1 to 1000"),
        ("greedy:waiting=nan", "waiting: 'nan': must be a number from 0 to 1000"),
        ("greedy:waiting", "write an option as key=value"),
        ("greedy:rounds=1+rounds=2", "rounds: it is given twice"),
        ("rollout", "a rollout needs its base"),
        ("rollout:gredy", "unknown policy 'gredy' (did you mean 'greedy'?)"),
        ("rollout:greedy+sample=2", "rollout has no option 'sample' (did you mean 'samples'?)"),
        ("rollout:rollout:greedy", "must not be a rollout or a clairvoyant"),
        ("rollout:clairvoyant", "must not be a rollout or a clairvoyant"),
        ("clairvoyant:tries=1.5", "tries: '1.5': must be a whole number"),
    ],
)
def test_names_and_options_that_are_refused(name: str, says: str):
    with pytest.raises(PolicyError) as refused:
        load_policy(name)
    assert says in str(refused.value)


def test_what_planners_know_is_told():
    assert "no future" in load_policy("greedy").information  # type: ignore[attr-defined]
    assert "not a competitor" in load_policy("clairvoyant").information  # type: ignore[attr-defined]


def test_a_scenario_that_is_too_large_for_plans_is_refused():
    world = strip(cells=(300, 300), users=[(120.0, 120.0)] * 100)
    with pytest.raises(PolicyError, match="the scenario is too large: 90,000 cells by 100 users"):
        load_policy("greedy").begin(world, Streams(0, Purpose.LEARNER))


# ---- safety, determinism, engines


def _small(seed: int) -> World:
    """A random small world with short batteries."""
    rng = np.random.default_rng(seed)
    cells = [int(rng.integers(4, 7)), int(rng.integers(4, 7))]
    scenario = {
        "map": {"size_m": [240 * n for n in cells], "cells": cells, "dimensions": 3},
        "drones": {
            "count": int(rng.integers(1, 4)),
            "battery": {"kind": "endurance", "autonomy_min": int(rng.integers(9, 16)),
                        "return_below": float(rng.uniform(0.1, 0.6))},
            "motion": {"kind": "bang_coast_bang",
                       "timing": str(rng.choice(["fill_epoch", "minimum_time"]))},
        },
        "stations": {"count": int(rng.integers(1, 3)), "radius_m": 240,
                     "pads": int(rng.integers(1, 3)), "full_charge_min": float(rng.uniform(1, 5))},
        "users": {"count": 10, "clusters": {"count": 2, "radius_m": [100, 200]}},
        "position_noise": {"probability": 0.3} if rng.random() < 0.4 else None,
        "episode": {"steps": 20, "carry_over": bool(rng.random() < 0.7)},
    }  # fmt: skip
    return build_world(from_mapping(scenario), seed)


def _crashes(worlds: int, episodes: int) -> int:
    crashes = 0
    for seed in range(worlds):
        world = _small(seed)
        for log, _ in play(world, Greedy(horizon=18), "greedy", seed, episodes, engine="batch"):
            crashes += log.crashes
            assert all(step.charge > 0 for step in log.steps if step.mode is not Mode.CRASHED)
    return crashes


def test_no_drone_crashes():
    assert _crashes(worlds=4, episodes=2) == 0


@pytest.mark.parametrize("worlds", by_default([], [10, 40], at_most=1))
def test_no_drone_crashes_in_random_episodes(worlds: int):
    assert _crashes(worlds=worlds, episodes=5) == 0


ROLLOUT = pytest.param("rollout:baseline+samples=1+horizon=2", marks=pytest.mark.thorough)


@pytest.mark.parametrize("name", ["greedy:horizon=12", ROLLOUT])
def test_both_engines_and_two_runs_give_the_same_tables(name: str):
    scenario = load("case9")
    episode = scenario.episode.model_copy(update={"steps": 5})
    world = build_world(scenario.model_copy(update={"episode": episode}), 0)
    results = [
        run(world, load_policy(name), name, 3, 2, engine=e) for e in ("batch", "des", "batch")
    ]
    for other in results[1:]:
        assert results[0].requests.equals(other.requests)
        assert results[0].steps.equals(other.steps)


@pytest.mark.parametrize("name", ["rollout:hover+samples=1+horizon=2", "clairvoyant:tries=1"])
def test_an_event_log_changes_nothing(name: str):
    """What a planner imagines has no log: it once took all memory for that of the true episode."""
    scenario = load("tiny")
    episode = scenario.episode.model_copy(update={"steps": 3})
    world = build_world(scenario.model_copy(update={"episode": episode}), 0)
    tables = [
        run(world, load_policy(name), name, 3, keep_events=events, engine="batch")
        for events in (True, False)
    ]
    assert tables[0].events is not None
    assert tables[0].requests.equals(tables[1].requests)
    assert tables[0].steps.equals(tables[1].steps)


@pytest.mark.thorough
def test_planners_are_better_than_what_they_are_made_of():
    world = build_world(load("case8"), 0)
    reached = {}
    for name in ("case8.npz", "rollout:case8.npz+samples=2", "greedy"):
        found = run(world, load_policy(name), name, 50, 2, engine="batch")
        reached[name] = headline(found.requests, found.episodes)
        assert reached[name]["crashes"] == 0
    for name in ("rollout:case8.npz+samples=2", "greedy"):
        for measure in ("qoe1_percent", "qoe3_percent"):
            assert reached[name][measure] > reached["case8.npz"][measure] + 2.0


def test_an_imagined_future_continues_each_group_by_its_own_models():
    scenario = {
        "users": [
            {"name": "people", "count": 5, "mobility": {"kind": "random_walk", "speed_mps": 5}},
            {
                "name": "meters",
                "count": 4,
                "mobility": {"kind": "static"},
                "demand": {"kind": "poisson", "rate_per_hour": 90, "mix": {"throughput": 1}},
            },
        ],
        "episode": {"steps": 6},
    }
    futures = []
    for count in (5, 8):
        scenario["users"][0]["count"] = count  # type: ignore[index]
        world = build_world(from_mapping(scenario), 0)
        engine = make_engine("des", world, RunSettings((True,) * 3, False))
        engine.reset(draw(world, 0, 0))
        for _ in range(2):
            engine.step([4] * 3)
        path = imagined(engine.save(), 0, 0).path
        futures.append((path.walks, path.requests, count))
    for walks, requests, count in futures:
        assert not velocities_of(walks.legs[walks.offsets[count] :]).any(), "meters stay"
        assert requests.follows.tolist() == count * [True] + 4 * [False]
        meters = requests.rows[requests.offsets[count] :]
        assert (meters[:, 0] >= 2 * 60_000_000).all(), "arrivals are in the future"
        assert (meters[:, 1] == 0).all(), "by the mix of the group"
        assert len(meters) > 0
    one, other = ([w, r, r.rows[r.offsets[c] :].tolist()] for w, r, c in futures)
    assert one[2] == other[2], "whatever the size of the other group"
