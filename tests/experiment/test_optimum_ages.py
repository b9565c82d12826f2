"""Bounds of the mean age at the ground, which no commands are below."""

from itertools import product

import numpy as np
import pytest

import desim_uav as du
from desim_uav.engine.base import RunSettings
from desim_uav.engine.choose import make_engine
from desim_uav.errors import ScenarioError, UsageError
from desim_uav.experiment.bounds import bounds, work_of
from desim_uav.optimum.run.ages import BoundedAges
from desim_uav.optimum.run.sensors import updates_of
from desim_uav.optimum.run.trips import Payments, best_trips, follow_trips
from desim_uav.report.optimum import runs_in_words
from desim_uav.sample_path import draw
from desim_uav.scenario.load import from_mapping
from desim_uav.shipped import bench_folder
from desim_uav.world import build_world
from tests.selection import by_default


def farm(steps=8, cells=(2, 1), sensors=2, **changes):
    """A drone, a station, and sensors that take an update of 4 Mbit each minute."""
    plain = {
        "name": "farm",
        "map": {"dimensions": 2, "size_m": [300 * n for n in cells], "cells": list(cells)},
        "drones": {
            "count": 1,
            "radio": {"kind": "link_classes", "power_dbm": 0, "bandwidth_mhz": 1}
            | {"path_loss": {"kind": "al_hourani", "environment": "suburban"}, "sharing": "equal"},
            "motion": {"kind": "bang_coast_bang", "max_speed_mps": 15},
            "battery": {"kind": "rotary_wing", "capacity_wh": 12, "return_below": 1.0},
        },
        "stations": {"count": 1, "pads": 1, "charging": {"kind": "swap", "minutes": 1}},
        "users": {"count": sensors, "mobility": {"kind": "static"}},
        "demand": {"kind": "sensing", "service": "reading"},
        "services": {
            "reading": {"kind": "collect", "updates": {"kind": "periodic", "every_s": 60}}
            | {"size_mbit": [4], "keeps": "last", "delivered": "ground"}
        },
        "reward": {"kind": "age"},
        "episode": {"steps": steps},
    }
    return from_mapping({**plain, **changes})


def age_s(engine, path, commands):
    """The mean age if the first drones get these commands."""
    engine.reset(path)
    for step in commands:
        engine.step(list(step))
    ages = [sensor.area_us2 / 2.0 for sensor in engine.log.sensors]
    return float(np.mean(ages)) / engine.log.duration_us / 1e6


def least_age_s(world, path):
    """The least mean age of all sequences of commands of one drone that lead to another cell."""
    engine = make_engine("batch", world, RunSettings((False,), False))
    nx, ny = world.grid.cells
    blocked = {"RIGHT", "LEFT"} if nx == 1 else set()
    blocked |= {"FORWARD", "BACKWARD"} if ny == 1 else set()
    actions = [k for k, action in enumerate(world.actions) if action.name not in blocked]
    all_commands = product(actions, repeat=world.scenario.episode.steps)
    return min(age_s(engine, path, [(action,) for action in each]) for each in all_commands)


@pytest.mark.parametrize("seed", by_default([0], [1, 2, 3], at_most=4))
def test_no_commands_of_a_small_farm_have_a_lower_age(seed):
    """In one cell a drone hovers and lands: all 3^7 sequences; the bound is not far below."""
    world = build_world(farm(steps=7, cells=(1, 1)), seed)
    best = least_age_s(world, draw(world, seed, 0))
    bound = BoundedAges(world, seed, 1, 200).age_at_least_s()
    assert 0.6 * best < bound <= best < 210.0  # 210 s without a delivery


@pytest.mark.thorough
@pytest.mark.parametrize("seed", range(3))
def test_no_commands_between_two_cells_have_a_lower_age(seed):
    """All sequences of five actions in five steps, of which two are flights."""
    world = build_world(farm(steps=5, sensors=1), seed)
    best = least_age_s(world, draw(world, seed, 0))
    assert 0.0 < BoundedAges(world, seed, 1).age_at_least_s() <= best


def test_no_prices_give_more_than_some_commands_reach():
    world = build_world(farm(steps=6, cells=(1, 1)), 0)
    best, rng = least_age_s(world, draw(world, 0, 0)), np.random.default_rng(0)
    run = BoundedAges(world, 0, 1)
    updates = of_run(run)
    for scale in (0.01, 0.1, 1.0):
        prices = scale * rng.random(len(run.first_prices()))
        assert 60.0 * run.at_least(updates, prices)[0] / (2 * run.steps) <= best


def of_run(run):
    """The updates of the first episode of a run."""
    return updates_of(
        *(run.paths[0].requests, run.sensors, run.last_only),
        *(run.steps, run.world.step_us, run.mbps),
    )


@pytest.mark.parametrize("drawn", [0.0, 0.1, 1.0])
def test_what_a_drone_earns_is_what_it_is_paid_for(drawn):
    """Also in trips that end in a crash, which pay if bits alone have a price."""
    world = build_world(farm(steps=20, cells=(3, 3), sensors=4), 1)
    run, rng = BoundedAges(world, 1, 1), np.random.default_rng(0)
    most = of_run(run).most
    landed, near, bits = (rng.random(shape) for shape in run.shapes)
    prices = Payments(drawn * landed, drawn * near, bits, most)
    used = Payments(*map(np.zeros, run.shapes), most)
    plan = best_trips(run.trips, prices)
    ((start, _),) = run.starts
    follow_trips(run.trips, prices, plan, start, used)
    earned = sum((own * price).sum() for own, price in zip(used[:3], prices[:3], strict=True))
    assert earned == pytest.approx(plan.value(start)) and earned > 0.0


@pytest.mark.thorough
@pytest.mark.parametrize("size", ["small", "medium"])
def test_no_policy_of_the_benchmark_has_a_lower_age(size):
    path = bench_folder() / f"harvest-{size}.yaml"
    bounds = du.find_bounds(path, seeds=2, first_seed=100, episodes=1)
    assert bounds["means"]["age_at_least_s"]["mean"] > 30.0
    for policy in ("baseline", "greedy", "tour", "random", "hover"):
        for row in bounds["seeds"]:
            run = du.run(path, policy=policy, seeds=[row["seed"]], episodes=1, engine="batch")
            assert run.episodes["age_s"].mean() >= row["age_at_least_s"]


def test_the_command_shows_the_bound():
    path = bench_folder() / "harvest-small.yaml"
    found = du.find_optimum(path, {"episode.steps": 6}, episodes=1)
    assert found["cover"] is None and list(found["runs"]["means"]) == ["age_at_least_s"]
    assert 0.0 < found["runs"]["means"]["age_at_least_s"]["mean"] < 180.0
    assert found.frame["the best"].tolist() == ["mean age, in a run of 1 episode(s)"]
    assert "no policy has a mean age below" in runs_in_words(found["runs"])


@pytest.mark.parametrize(
    ("key", "value", "named"),
    [
        ("services.reading.delivered", "drone", "services.reading.kind: collect: the optimum"),
        ("users.mobility", {"kind": "random_walk"}, "users.mobility"),
        ("decisions", "event", "decisions: event"),
        ("map.dimensions", 3, "map.dimensions: 3"),
        ("drones.radio.line_of_sight", "drawn", "drones.radio.kind"),
        ("drones.backhaul", {"kind": "capacity", "kbps": 100}, "drones.backhaul"),
    ],
)
def test_what_is_refused(key, value, named):
    plain = farm().model_dump(mode="json", exclude_unset=True)
    with pytest.raises(ScenarioError, match=named):
        du.find_bounds(plain, {key: value}, seeds=1, episodes=1)


def test_progress_counts_the_rounds_of_all_episodes():
    rounds: list[int] = []
    bounds(farm(steps=3), [1, 2], 3, on_work=lambda: rounds.append(1))
    assert len(rounds) == work_of(farm(), 2, 3) == 2 * (200 + 100 + 100)


def test_more_prices_than_fit_in_memory_are_refused(monkeypatch):
    monkeypatch.setattr("desim_uav.optimum.run.ages.MOST_PRICES", 100)
    with pytest.raises(UsageError, match=r"episode\.steps: 2 sensors and 8 steps, .* prices, more"):
        du.find_bounds(farm(), seeds=1, episodes=1)


def test_sensors_whose_data_stay_aloft_are_refused():
    """They are named if others have theirs carried to the ground."""
    plain = farm().model_dump(mode="json", exclude_unset=True)
    reading = plain["services"]["reading"]
    services = {"reading": reading, "live": reading | {"delivered": "drone"}}
    groups = [
        {"name": name, "count": 1, "mobility": {"kind": "static"}}
        | {"demand": {"kind": "sensing", "service": name}}
        for name in services
    ]
    del plain["demand"]
    with pytest.raises(ScenarioError, match=r"services\.live\.delivered: drone: the mean age"):
        du.find_bounds(plain | {"services": services, "users": groups}, seeds=1, episodes=1)
