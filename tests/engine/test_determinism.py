"""One seed, one run: in another process, under another policy, whatever the order of insertion."""

from __future__ import annotations

import os
import random
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from pandas.testing import assert_frame_equal

from desim_uav.engine.base import EpisodeLog, Event, RunSettings
from desim_uav.engine.des import Simulation
from desim_uav.engine.des.agenda import Agenda
from desim_uav.errors import ScenarioError
from desim_uav.experiment.run import Results, run
from desim_uav.policies import load_policy
from desim_uav.sample_path import draw
from desim_uav.scenario.load import from_mapping, load
from desim_uav.shipped import scenario_path
from desim_uav.world import build_world
from tests.engine.helpers import Flight, path_of, scenarios, some_command, strip

TABLES = ("requests", "steps", "episodes", "users", "events")


def results_of(case: str, policy: str, seed: int = 11) -> Results:
    world = build_world(load(scenario_path(case)), seed)
    return run(world, load_policy(policy), policy, seed, episodes=3, warmup=1, keep_events=True)


def assert_same(first: dict[str, pd.DataFrame], second: dict[str, pd.DataFrame]) -> None:
    for name in TABLES:
        assert len(first[name]) > 0
        assert_frame_equal(first[name], second[name], check_exact=True)


def tables(results: Results) -> dict[str, pd.DataFrame]:
    return {name: getattr(results, name) for name in TABLES}


@pytest.mark.parametrize("case", ["case8", "case9"])
def test_the_same_seed_gives_the_same_tables(case: str):
    assert_same(tables(results_of(case, "random")), tables(results_of(case, "random")))


def test_another_seed_gives_other_tables():
    one, other = results_of("case8", "baseline", 1), results_of("case8", "baseline", 2)
    assert not one.requests.equals(other.requests)
    assert not one.users.equals(other.users)


IN_ANOTHER_PROCESS = """
import pickle, sys
from tests.engine.test_determinism import results_of, tables
out = {case: tables(results_of(case, "random")) for case in ("case8", "case9")}
with open(sys.argv[1], "wb") as file:
    pickle.dump((hash("drone"), out), file)
"""


def test_another_process_gives_the_same_tables(tmp_path: Path):
    root = Path(__file__).resolve().parents[2]
    running = {}
    for hash_seed in ("1", "20"):
        file = tmp_path / f"{hash_seed}.pickle"
        paths = os.pathsep.join([str(root), os.environ.get("PYTHONPATH", "")])
        command = [sys.executable, "-c", IN_ANOTHER_PROCESS, str(file)]
        environment = os.environ | {"PYTHONHASHSEED": hash_seed, "PYTHONPATH": paths}
        running[file] = subprocess.Popen(command, cwd=root, env=environment)
    own = {case: tables(results_of(case, "random")) for case in ("case8", "case9")}
    hashes = set()
    for file, process in running.items():
        assert process.wait(timeout=120) == 0
        hashed, told = pd.read_pickle(file)
        hashes.add(hashed)
        for case, frames in own.items():
            assert_same(frames, told[case])
    assert len(hashes) == 2, "the processes do differ in what hashes are"


def test_another_policy_meets_the_same_users():
    # The k-th request of a user is the same; when it comes depends on the service before.
    one, other = results_of("case8", "baseline"), results_of("case8", "hover")
    assert_frame_equal(one.users, other.users, check_exact=True)
    attributes = ["service", "requested_s", "bandwidth_kbps"]
    keys = ["episode", "user", "k"]
    kept = []
    for results in (one, other):
        frame = results.requests.sort_values("request_id", kind="stable")
        frame["k"] = frame.groupby(["episode", "user"]).cumcount()
        kept.append(frame.set_index(keys).sort_index())
    shared = kept[0].index.intersection(kept[1].index)
    assert len(shared) > 48 * 4, "not only first requests"
    assert_frame_equal(
        kept[0].loc[shared, attributes], kept[1].loc[shared, attributes], check_exact=True
    )
    assert len(kept[0]) != len(kept[1])
    late = shared[shared.get_level_values("k") > 0]
    moved = kept[0].loc[late, "t_request_s"] != kept[1].loc[late, "t_request_s"]
    assert moved.any()


def test_think_times_are_the_same_whatever_the_policy():
    gaps = []
    for policy in ("baseline", "hover"):
        frame = results_of("case8", policy).requests.sort_values(["episode", "user", "request_id"])
        own = frame.groupby(["episode", "user"])
        frame["k"] = own.cumcount()
        frame["gap"] = (frame["t_request_s"] - own["t_end_s"].shift()).round(6)
        gaps.append(frame.set_index(["episode", "user", "k"])["gap"].dropna())
    shared = gaps[0].index.intersection(gaps[1].index)
    assert len(shared) > 50
    assert (gaps[0].loc[shared] == gaps[1].loc[shared]).all()


# ---- ties


def in_lockstep(seed: int) -> list[EpisodeLog]:
    """Six drones, two on each of three cells, told the same; users on a lattice, asking at once.

    They cross footprints, land, queue, charge, run empty and come back in the same microseconds;
    requests of the same length end together, and everybody thinks for as long.
    """
    lattice = [(x, y) for x in range(60, 1440, 240) for y in range(60, 1440, 240)]
    world = strip(
        [(1, 1), (4, 1), (2, 4)] * 2,
        lattice,
        cells=(6, 6),
        steps=12,
        radius_m=300,
        battery={"autonomy_min": 7, "return_below": 0.8, "respawn_after_min": 1.0},
        stations={"count": 1, "pads": 2, "full_charge_min": 2},
        bandwidth_kbps=500,
    )
    asks = {user: [(0, 90, 100), *[(30, 60, 100)] * 9] for user in range(len(lattice))}
    rng = np.random.default_rng(seed)
    flight = Flight(world, carry_over=True, check=None)
    logs = []
    for episode in range(3):
        words = ["forward", "backward", "right", "left", "hover", "goto", "charge"]
        told = " ".join(rng.choice(words, 12, p=[0.18, 0.18, 0.18, 0.18, 0.1, 0.09, 0.09]))
        path = path_of(world, asks, thinking=True, respawn=[[0] * 13] * 6, episode=episode)
        logs.append(flight.episode(path, *[told] * 6))
    return logs


def content(log: EpisodeLog) -> tuple[list[Event] | None, list[Any], list[dict[str, Any]]]:
    kept = ("user", "t_request_us", "served_us", "attached_us", "t_end_us", "drones", "outcome")
    requests = [{name: getattr(request, name) for name in kept} for request in log.requests]
    return log.events, log.steps, requests


def share_of_ties(log: EpisodeLog) -> float:
    """The part of the events beside another of their instant, phase and kind."""
    assert log.events is not None
    frame = pd.DataFrame([event[:3] for event in log.events])
    return float(frame.duplicated(keep=False).mean())


@contextmanager
def shuffled(seed: int) -> Iterator[None]:
    """Let all that has one key on the agenda come in a random order, not in that of insertion."""

    def numbers() -> Iterator[int]:
        rng, given = random.Random(seed), set[int]()
        while True:
            number = rng.getrandbits(48)
            if number not in given:
                given.add(number)
                yield number

    def init(agenda: Agenda) -> None:
        plain(agenda)
        agenda._eid = numbers()

    plain = Agenda.__init__
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Agenda, "__init__", init)
        yield


@pytest.mark.parametrize("seed", range(3))
def test_the_order_of_insertion_decides_nothing(seed: int):
    expected = [content(log) for log in in_lockstep(seed)]
    for shuffle in range(4):
        with shuffled(10 * seed + shuffle):
            assert [content(log) for log in in_lockstep(seed)] == expected


@settings(max_examples=60, deadline=None, derandomize=True)
@given(scenario=scenarios(), seed=st.integers(0, 10**6))
def test_it_decides_nothing_in_random_scenarios(scenario: dict[str, Any], seed: int):
    try:
        world = build_world(from_mapping(scenario), seed)
    except ScenarioError:
        assume(False)

    def told() -> list[Any]:
        rng = np.random.default_rng(seed)
        engine = Simulation(world, RunSettings((True,) * len(world.starts), True, True))
        logs = []
        for episode in range(2):
            shown = engine.reset(draw(world, seed, episode))
            while not (shown.terminated or shown.truncated):
                shown = engine.step([some_command(world, mask, rng) for mask in shown.masks])
            logs.append(content(engine.log))
        return logs

    expected = told()
    with shuffled(seed):
        assert told() == expected


def test_the_lockstep_is_full_of_ties():
    logs = [log for seed in range(3) for log in in_lockstep(seed)]
    assert all(share_of_ties(log) > 0.8 for log in logs)
    kinds = {event[2] for log in logs for event in log.events or []}
    assert {"crash", "respawn", "land", "charge", "charged", "blocked", "complete"} <= kinds
    assert sum(log.queueing_us for log in logs) > 0
