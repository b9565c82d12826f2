"""The dispatcher: its commands, its training, and the files and worlds that it takes."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

import desim_uav as du
from desim_uav import array_file
from desim_uav.errors import PolicyError
from desim_uav.experiment.bench.tasks import find_task
from desim_uav.policies import load_policy
from desim_uav.policies.base import parts
from desim_uav.policies.dispatcher import ARRAY, WEIGHTS, Dispatcher, problem_of
from desim_uav.policies.weights_file import FORMAT, to_bytes
from desim_uav.scenario.load import from_mapping, load
from desim_uav.shipped import find_table
from desim_uav.world import World, build_world

TASK = find_task("uav-v1/dispatch/small").path


def world(**changes: str) -> World:
    return build_world(load(TASK, [f"{key}={value}" for key, value in changes.items()]), 0)


def begun(of: World | None = None, **weights: float) -> Dispatcher:
    policy = Dispatcher(weights=WEIGHTS | weights)
    policy.begin(of or world(), None)  # type: ignore[arg-type]  # it draws nothing
    return policy


def test_the_best_place_covers_the_users_and_costs_battery() -> None:
    """Five users are worth more than none here; a drone that is nearly empty flies home."""
    policy, here_m = begun(slow=0.0, cost=0.0, stay=0.0), np.array([1000.0, 1000.0])
    five_m = np.array([[1500.0, 1500.0]]) + 50.0 * np.array(
        [[0, 0], [1, 0], [0, 1], [-1, 0], [0, -1]]
    )
    place_m = policy._place(here_m, five_m, np.ones(5), charge=1.0)
    assert np.hypot(*(place_m - [1500.0, 1500.0])) < 300.0
    assert policy._covers(place_m[None], five_m).tolist() == [[1.0] * 5]
    home_m = policy._place(here_m, five_m, np.ones(5), charge=0.02)
    assert home_m.tolist() in policy._stations.tolist()


def test_users_are_covered_as_far_as_the_links_reach() -> None:
    """With classes of links, the radius of the paper's disc means nothing."""
    content = yaml.safe_load(TASK.read_text(encoding="utf-8"))
    for key in ("footprint_radius_m", "bandwidth_kbps"):
        content["drones"].pop(key, None)
    content["drones"]["radio"] = {"kind": "link_classes", "power_dbm": 20}
    graded = build_world(from_mapping(content), 0)
    reach_m = graded.links[0].reach_m
    policy, here_m = begun(graded, margin=0.0, width=0.02), np.zeros((1, 2))
    users_m = np.array([[0.95 * reach_m, 0.0], [1.05 * reach_m, 0.0]])
    assert policy._covers(here_m, users_m).tolist() == [[1.0, 0.0]]
    assert reach_m != graded.scenario.fleet[0].footprint_radius_m


def test_what_a_place_takes_is_no_less_than_the_flight_and_the_hover_after_it() -> None:
    policy = begun()
    assert (np.diff(policy._takes) >= 0).all()
    hover_s = world().facts.capacity_s or 0.0
    assert policy._takes[0] == pytest.approx(30.0 / hover_s, rel=1e-3)


@pytest.mark.thorough
def test_no_drone_crashes_and_both_engines_fly_alike() -> None:
    """From 30 minutes on a battery of 28 minutes would be empty."""
    same: dict[str, Any] = {"policy": "dispatch.npz", "seeds": [7_000_001], "world_seed": 0}
    fast, readable = (du.run(TASK, **same, episodes=3, engine=one) for one in ("batch", "des"))
    assert fast.episodes["crashes"].sum() == 0
    assert fast.steps.equals(readable.steps) and fast.requests.equals(readable.requests)


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("drones.motion.reach", "step"),
        ("drones.battery.kind", "unlimited"),
        ("wind_mps", "[1, 0]"),
    ],
)
def test_worlds_it_cannot_fly_in_are_refused(key: str, value: str) -> None:
    changes = {key: value}
    if "battery" in key:
        changes = {"drones.battery": "null"}
    policy = Dispatcher(weights=WEIGHTS)
    other = world(**changes)
    assert problem_of(other)
    with pytest.raises(PolicyError, match="must"):
        policy.begin(other, None)  # type: ignore[arg-type]


def test_files_are_known_by_their_array_and_checked(tmp_path: Path) -> None:
    file = tmp_path / "own.npz"
    file.write_bytes(to_bytes(ARRAY, WEIGHTS, np.array([*WEIGHTS.values()]), {}))
    assert parts(str(file)) == ("dispatcher", str(file))
    assert load_policy(str(file)).weights == WEIGHTS  # type: ignore[attr-defined]
    bad = [np.full(len(WEIGHTS), np.nan), np.zeros(3), np.zeros(len(WEIGHTS), np.float32)]
    for array, words in zip(bad, ("not finite", "numbers", "float64"), strict=True):
        about = {"format": FORMAT, "weights": [*WEIGHTS]}
        file.write_bytes(array_file.pack(about, dispatch=array))
        with pytest.raises(PolicyError, match=words):
            load_policy(str(file))
    file.write_bytes(array_file.pack({"format": FORMAT, "weights": []}, dispatch=bad[1]))
    with pytest.raises(PolicyError, match="its weights must be wait, age"):
        load_policy(str(file))
    assert find_table("dispatch.npz").stat().st_size < 200_000
