"""One seed, one run: in another process, under another policy, whatever the order of insertion."""

from __future__ import annotations

from typing import Any

import numpy as np
import pandas as pd
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from pandas.testing import assert_frame_equal

from desim_uav.engine.base import EpisodeLog, RunSettings
from desim_uav.engine.des import Simulation
from desim_uav.errors import ScenarioError
from desim_uav.sample_path import draw
from desim_uav.scenario.load import from_mapping
from desim_uav.world import build_world
from tests.engine.helpers import scenarios, some_command
from tests.verification.determinism import (
    TABLES,
    content,
    in_any_order,
    in_lockstep,
    in_other_processes,
    results_of,
    shuffled,
    tables,
)
from tests.verification.figure import check


def assert_same(first: dict[str, pd.DataFrame], second: dict[str, pd.DataFrame]) -> None:
    for name in TABLES:
        assert len(first[name]) > 0
        assert_frame_equal(first[name], second[name], check_exact=True)


@pytest.mark.parametrize("case", ["case8", "case9"])
def test_the_same_seed_gives_the_same_tables(case: str):
    assert_same(tables(results_of(case, "random")), tables(results_of(case, "random")))


@pytest.mark.thorough
def test_another_seed_gives_other_tables():
    one, other = results_of("case8", "baseline", 1), results_of("case8", "baseline", 2)
    assert not one.requests.equals(other.requests)
    assert not one.users.equals(other.users)


@pytest.mark.thorough
def test_another_process_gives_the_same_tables():
    check(in_other_processes())


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


def share_of_ties(log: EpisodeLog) -> float:
    """The part of the events beside another of their instant, phase and kind."""
    assert log.events is not None
    frame = pd.DataFrame([event[:3] for event in log.events])
    return float(frame.duplicated(keep=False).mean())


def test_the_order_of_insertion_decides_nothing():
    check(in_any_order(quick=False))


@pytest.mark.thorough
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
