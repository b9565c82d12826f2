"""Users in groups: each with its own homes, walks and requests, in both engines."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from pandas.testing import assert_frame_equal

import desim_uav as du
from desim_uav.errors import SimulationError, UsageError
from desim_uav.experiment.run import run
from desim_uav.policies.random import Random
from desim_uav.sample_path import SamplePath, draw, draw_all
from desim_uav.scenario.load import from_mapping
from desim_uav.world import World, build_world
from tests.engine import random_groups, test_saved
from tests.engine.helpers import ALL_DEMANDS, ALL_WALKS
from tests.engine.random_radio import audited
from tests.selection import by_default
from tests.verification.engines import differences, engines

RADIO = {
    "kind": "link_classes",
    "line_of_sight": "drawn",
    "shadowing": {"los_db": 2, "nlos_db": 6},
}
SMALL = {
    "map": {"size_m": [1200, 1200], "cells": [5, 5], "dimensions": 2},
    "drones": {"count": 2, "battery": None},
    "stations": {"count": 1, "radius_m": 0},
    "episode": {"steps": 4},
}
FIRST = {"name": "first", "count": 9}
STILL = {
    "name": "still",
    "count": 4,
    "mobility": {"kind": "static"},
    "demand": {"kind": "poisson", "rate_per_hour": 60},
}
AWAY = {"name": "away", "count": 3, "mobility": {"kind": "gauss_markov"}, "max_height_m": 3}


def world_of(users: Any, **changes: Any) -> World:
    """The world of a small scenario with these users."""
    return build_world(from_mapping({**SMALL, "users": users, **changes}), 3)


def of_user(path: SamplePath, user: int) -> list[Any]:
    """The walk and the requests of a user."""
    walks, requests = path.walks, path.requests
    return [
        walks.legs[walks.offsets[user] : walks.offsets[user + 1]].tolist(),
        requests.rows[requests.offsets[user] : requests.offsets[user + 1]].tolist(),
        bool(requests.follows[user]),
    ]


# ---- what is drawn


@pytest.mark.parametrize("engine", ["des", "batch"])
def test_a_list_of_one_group_plays_as_the_mapping(engine: Any):
    alone, listed = (
        run(world_of(users), Random(), "random", 3, 2, engine=engine)
        for users in ({"count": 9}, [FIRST])
    )
    assert set(listed.requests["group"]) == set(listed.users["group"]) == {"first"}
    assert_frame_equal(alone.requests, listed.requests.drop(columns="group"))
    assert_frame_equal(alone.users, listed.users.drop(columns="group"))
    assert_frame_equal(alone.steps, listed.steps)
    assert_frame_equal(alone.episodes, listed.episodes)


def test_another_group_changes_nobody_elses_draws():
    one, two = world_of([FIRST, AWAY]), world_of([FIRST, AWAY, STILL])
    assert (two.homes[:12] == one.homes).all()
    assert (two.stream_numbers[:12] == one.stream_numbers).all()
    for episode in (-1, 0, 5):
        path, other = draw(one, 8, episode), draw(two, 8, episode)
        assert [of_user(path, user) for user in range(12)] == [
            of_user(other, user) for user in range(12)
        ]


def test_the_size_of_a_group_changes_nobody_elses_draws():
    one, two = world_of([FIRST, AWAY]), world_of([{**FIRST, "count": 30}, AWAY])
    assert (one.homes[9:] == two.homes[30:]).all()
    assert (one.stream_numbers[9:] == two.stream_numbers[30:]).all()
    path, other = draw(one, 8, 0), draw(two, 8, 0)
    assert [of_user(path, 9 + k) for k in range(3)] == [of_user(other, 30 + k) for k in range(3)]


def test_groups_alike_are_drawn_independently():
    world = world_of([FIRST, {**FIRST, "name": "second"}])
    path = draw(world, 8, 0)
    assert not (world.homes[:9] == world.homes[9:]).all(axis=1).any()
    assert of_user(path, 0) != of_user(path, 9)


def test_each_group_asks_by_its_own_mix():
    mixes = [{"throughput": 1}, {"edge_computing": 1}]
    users = [
        {"name": f"g{k}", "count": 20, "demand": {"kind": "static", "mix": mix}}
        for k, mix in enumerate(mixes)
    ]
    requests = draw(world_of(users), 0, 0).requests
    assert requests.rows[:, 1].tolist() == 20 * [0] + 20 * [1]


def test_paths_drawn_together_are_those_drawn_alone():
    world = world_of([FIRST, STILL, AWAY])
    together = draw_all(world, 4, range(3))
    for episode in range(3):
        alone = draw(world, 4, episode)
        assert [of_user(together[episode], u) for u in range(16)] == [
            of_user(alone, u) for u in range(16)
        ]


@pytest.mark.parametrize(
    ("mobility", "together"),
    [({"kind": "random_walk"}, True), ({"kind": "random_waypoint"}, False)],
)
def test_groups_of_one_mobility_walk_step_by_step_if_users_do_not_begin_together(
    mobility: Any, together: bool
):
    groups = [{"name": f"g{k}", "count": 3, "mobility": mobility} for k in range(2)]
    assert (world_of(groups).row_mobility is not None) is together


def test_leaders_are_those_of_the_group():
    group = {"kind": "group", "groups": 2, "radius_m": 40, "step_s": 25}
    lone = world_of([FIRST, {"name": "walkers", "count": 6, "mobility": group}])
    more = world_of([{**FIRST, "count": 4}, {"name": "walkers", "count": 6, "mobility": group}])
    path, other = draw(lone, 1, 0), draw(more, 1, 0)
    assert [of_user(path, 9 + k) for k in range(6)] == [of_user(other, 4 + k) for k in range(6)]


# ---- what happens


def check(seed: int) -> None:
    """Compare two episodes of both engines in a random scenario."""
    world, rng = random_groups.world_of(seed), np.random.default_rng(seed)
    ceilings = tuple((rng.random(world.scenario.drone_count) < 0.5).tolist())
    one, other = engines(world, ceilings)
    assert [differences(one, other, seed, episode) for episode in range(2)] == [[], []]


@pytest.mark.thorough
@pytest.mark.parametrize("seed", by_default([], range(200), at_most=4))
def test_engines_are_equal(seed: int):
    check(seed)


@pytest.mark.thorough
@pytest.mark.parametrize("seed", range(3))
def test_no_event_breaks_a_rule(seed: int):
    audited(random_groups.world_of(seed))


def test_random_scenarios_have_groups_of_all_kinds():
    worlds = [random_groups.scenario(seed)["users"] for seed in range(200)]
    walks = {each["mobility"]["kind"] for users in worlds for each in users}
    asked = {each["demand"]["kind"] for users in worlds for each in users if "demand" in each}
    assert walks >= {each["kind"] for each in ALL_WALKS} | {"static", "random_walk"}
    assert asked >= {each["kind"] for each in ALL_DEMANDS} | {"static", "dynamic", "poisson"}
    assert {len(users) for users in worlds} == {1, 2, 3, 4}


def test_links_of_a_group_do_not_depend_on_the_size_of_another():
    drones = {**SMALL["drones"], "radio": RADIO}  # type: ignore[dict-item]
    demand = {"kind": "continuous"}
    states = []
    for count in (1, 5):
        users = [
            {**FIRST, "count": count, "mobility": {"kind": "static"}},
            {**STILL, "demand": demand},
        ]
        world = world_of(users, drones=drones, demand=demand)
        events = run(world, Random(), "random", 3, keep_events=True).events
        own = events[(events["user"] >= count) & events["link_class"].notna()]
        states.append(own.assign(user=own["user"] - count).reset_index(drop=True))
    columns = ["t_us", "drone", "user", "link_class"]
    assert_frame_equal(states[0][columns], states[1][columns])
    assert len(states[0]) > 0


# ---- what is told


def test_measures_by_group():
    result = du.run(world_of([FIRST, STILL]).scenario, episodes=2, engine="des")
    by_group = result.qoe(by="group")
    assert list(by_group.index) == ["first", "still"]
    requests = result.requests
    assert by_group.loc["still", "requests"] == (requests["user"] >= 9).sum()
    assert (requests["group"] == np.where(requests["user"] < 9, "first", "still")).all()


def test_measures_by_group_need_groups():
    result = du.run(world_of({"count": 3}).scenario, engine="des")
    with pytest.raises(UsageError, match=r"by: group: the users of this run are not a list"):
        result.qoe(by="group")


def test_errors_of_draws_name_the_group():
    lost = {"name": "lost", "count": 2, "mobility": {"kind": "tests.plug_ins:Stuck"}}
    with pytest.raises(SimulationError, match=r"^group 'lost': users\.mobility: "):
        draw(world_of([FIRST, lost]), 0, 0).walks  # noqa: B018


@pytest.mark.parametrize("seed", by_default([], range(6)))
def test_a_saved_state_leads_to_the_same_rest(seed: int):
    test_saved.check(world_of([FIRST, STILL, AWAY]), seed)
