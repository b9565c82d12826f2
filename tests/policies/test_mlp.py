"""Files of networks: what is in them, which are refused, and what drones do with them."""

import zipfile
from collections.abc import Callable
from contextlib import suppress
from dataclasses import fields
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

import desim_uav as du
from desim_uav import array_file
from desim_uav.errors import PolicyError
from desim_uav.experiment.bench.tasks import find_task
from desim_uav.model.random.streams import Purpose, Streams
from desim_uav.policies import load_policy
from desim_uav.policies.base import parts
from desim_uav.policies.mlp import Mlp, MlpFile, component_of, description_of, scaling_of
from desim_uav.registry import names, resolve
from desim_uav.scenario.load import from_mapping, load, loads, to_plain
from desim_uav.scenario.schema import Scenario
from desim_uav.shipped import find_table, trained_names
from desim_uav.world import World, build_world
from tests.command_line import runner

SMALL: dict[str, Any] = {
    "name": "small",
    "map": {"size_m": [960, 960], "cells": [4, 4], "dimensions": 2},
    "drones": {
        "count": 2,
        "footprint_radius_m": 200,
        "battery": {"autonomy_min": 7, "return_below": 0.6, "respawn_after_min": 1},
    },
    "stations": {"count": 1, "radius_m": 0, "full_charge_min": 3},
    "users": {"count": 6, "clusters": {"count": 2, "radius_m": [100, 200]}},
    "episode": {"steps": 12, "carry_over": True},
}
RADAR = {"kind": "radar", "cells_x": 3, "cells_y": 3, "scales": 1}


def small(**changes: Any) -> Scenario:
    return from_mapping({**SMALL, **changes})


def network(own: bool = False, seed: int = 0, **changes: Any) -> Mlp:
    """A network with weights that were drawn, for what drones see in the small scenario."""
    return network_in(build_world(small(**{"observation": RADAR, **changes}), 0), own, seed)


def network_in(world: World, own: bool = False, seed: int = 0) -> Mlp:
    """A network with weights that were drawn, for what drones see in a world."""
    about = description_of(world, own) | {"training": {}}
    rng = np.random.default_rng(seed)
    sizes = [len(about["features"]), 5, 4, len(about["actions"])]
    layers = [
        (rng.normal(size=(m, n)).astype(np.float32), rng.normal(size=n).astype(np.float32))
        for m, n in pairwise(sizes)
    ]
    return Mlp(*scaling_of(world), tuple(layers), about)


@pytest.fixture
def file(tmp_path: Path) -> Path:
    (tmp_path / "net.npz").write_bytes(network().to_bytes())
    return tmp_path / "net.npz"


def test_a_file_gives_its_network_back(file: Path):
    found, made = MlpFile(file).network(), network()
    assert found.about == made.about | {"format": 1, "hidden": [5, 4]}
    assert found.to_bytes() == made.to_bytes() == file.read_bytes()
    features = np.random.default_rng(1).normal(size=len(made.low)).astype(np.float32)
    features[::3] = 0.0
    values = (features.astype(np.float64) - made.low) * made.scale
    for k, (weights, biases) in enumerate(made.layers):
        values = np.maximum(values, 0.0) if k else values
        values = values @ weights.astype(np.float64) + biases
    assert np.allclose(found.scores(features.tolist()), values, rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize("units", [2, 5, 9, 128])
def test_sums_are_added_in_the_order_of_the_inputs(units: int):
    """So they are the same on every machine, bit for bit."""
    rng = np.random.default_rng(units)
    weights = rng.normal(size=(600, units)).astype(np.float32)
    values = rng.normal(size=600).astype(np.float32)
    values[100:300] = 0.0
    ones = np.ones(600, np.float32)
    layer = weights, rng.normal(size=units).astype(np.float32)
    sums = [0.0] * units
    for value, row in zip(values.tolist(), weights.tolist(), strict=True):
        sums = [total + value * weight for total, weight in zip(sums, row, strict=True)]
    expected = [total + bias for total, bias in zip(sums, layer[1].tolist(), strict=True)]
    assert Mlp(0 * ones, ones, (layer,), {}).scores(values.tolist()).tolist() == expected


def test_whole_numbers_are_scaled_by_their_bounds():
    world = build_world(small(observation={"kind": "position"}), 0)
    low, scale = scaling_of(world)
    assert description_of(world)["features"] == ["cell_x", "cell_y", "battery_min"]
    assert low.tolist() == [0, 0, 0] and np.allclose(scale, [1 / 3, 1 / 3, 1 / 7])
    low, scale = scaling_of(build_world(small(observation=RADAR), 0))
    assert set(low) == {0.0} and set(scale) == {0.0, 1.0}
    features = description_of(build_world(small(observation=RADAR), 0))["features"]
    assert [features[k] for k in np.flatnonzero(scale == 0)] == ["time_left"]
    once = small(observation=RADAR, episode={"carry_over": False})
    assert set(scaling_of(build_world(once, 0))[1]) == {1.0}


class Checked:
    """A network that is looked at while it flies."""

    ceiling = True

    def __init__(self, policy: Any) -> None:
        self.policy, self.choices = policy, []

    def begin(self, *arguments: Any) -> None:
        self.policy.begin(*arguments)

    def act(self, observation: Any, mask: Any) -> int:
        command = self.policy.act(observation, mask)
        scores = self.policy._network.scores(observation.features)
        allowed = [a for a, legal in enumerate(mask) if legal]
        best = max(scores[a] for a in allowed)
        assert command == min(a for a in allowed if scores[a] == best)
        self.choices.append(len(allowed))
        return command


def test_it_does_what_is_best_of_what_is_allowed(file: Path):
    checked = Checked(load_policy(file))
    du.run(small(observation=RADAR), policy=checked, episodes=2, progress=False)
    assert min(checked.choices) == 1 < max(checked.choices), "some were forced, and some were not"


FREELY = {**SMALL["drones"], "motion": {"space": "free"}}
ENGINES = ["des", pytest.param("batch", marks=pytest.mark.thorough)]


@pytest.mark.parametrize("engine", ENGINES)
def test_in_free_flight_its_numbers_are_the_command(tmp_path: Path, engine: str):
    made = network(drones=FREELY)
    assert made.about["actions"] == ["aim_x", "aim_y", "aim_charge"]
    (tmp_path / "net.npz").write_bytes(made.to_bytes())
    policy: Any = load_policy(tmp_path / "net.npz")
    commands: list[tuple[int, Any, bool]] = []

    class Watched:
        ceiling, observation, begin = True, policy.observation, policy.begin

        def act(self, observation: Any, mask: Any) -> Any:
            command = policy.act(observation, mask)
            if np.ndim(command):
                commands.append((observation.drone, command, mask[0]))
                scores = made.scores(observation.features)
                assert command == np.minimum(np.maximum(scores, -1.0), 1.0).tolist()
            else:
                assert sum(mask) == 1 and mask[command], "a drone that is not asked"
            return command

    run = du.run(small(drones=FREELY), policy=Watched(), engine=engine, progress=False)
    told = run.steps[run.steps["action"] == "fly"].sort_values(["step", "drone"])
    assert len(told) == len(commands) > 10
    flown = [command[:2] for _, command, _ in commands]
    np.testing.assert_allclose(told[["aim_x", "aim_y"]].to_numpy(), flown, rtol=1e-6)
    with pytest.raises(PolicyError, match="trained with actions"):
        policy.begin(build_world(small(observation=RADAR), 0), Streams(0, Purpose.LEARNER))


def test_both_engines_give_the_same_tables(file: Path):
    """Also where the scenario has another observation: the policy brings its own."""
    runs = [
        du.run(small(), policy=file, episodes=3, warmup=1, seed=5, engine=engine, progress=False)
        for engine in ("des", "batch")
    ]
    for name in ("requests", "steps", "episodes"):
        pd.testing.assert_frame_equal(*(getattr(run, name) for run in runs))
    assert runs[0].scenario.observation == from_mapping({"observation": RADAR}).observation


def test_it_flies_in_worlds_it_has_not_seen_and_knows_its_own(tmp_path: Path):
    for own in (False, True):
        (tmp_path / "net.npz").write_bytes(network(own).to_bytes())
        policy: Any = load_policy(tmp_path / "net.npz")
        here, there = (build_world(small(observation=RADAR), seed) for seed in (0, 1))
        assert policy.world_seed == (0 if own else None)
        assert policy.notice(here) == ""
        assert ("small, world seed 0" in policy.notice(there)) == own


def test_comparisons_and_the_command_line_take_it(
    file: Path, tmp_path: Path, capsys: Any, monkeypatch: Any
):
    found = du.compare(
        small(), policies=["hover", str(file)], seeds=2, episodes=1, warmup=0, progress=False
    )
    assert found.policies == ["hover", str(file)]
    (tmp_path / "small.yaml").write_text(
        "name: small\nepisode: {steps: 2}\nmap: {dimensions: 2}\ndrones: {battery: null}\n"
    )
    out = str(tmp_path / "run")
    run = runner(capsys, monkeypatch)
    run("run", tmp_path / "small.yaml", "--policy", file, "--out", out).failed(4, "with features")


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"map": {**SMALL["map"], "dimensions": 3}}, "features"),
        ({"drones": {**SMALL["drones"], "battery": None}}, "features"),
        ({"observation": {**RADAR, "full": 4}}, "observation"),
    ],
)
def test_a_network_that_does_not_fit(changes: dict[str, Any], message: str, file: Path):
    policy = load_policy(file)
    world = build_world(small(**{"observation": RADAR, **changes}), 0)
    with pytest.raises(PolicyError, match=f"trained with {message}") as problem:
        policy.begin(world, Streams(0, Purpose.LEARNER))
    assert str(file) in str(problem.value) and "\n" not in str(problem.value)


def with_about(**changes: Any) -> Callable[[Path], None]:
    def damage(path: Path) -> None:
        made = network()
        about = made.about | {"format": 1, "hidden": [5, 4]} | changes
        weights = np.concatenate([array.reshape(-1) for pair in made.layers for array in pair])
        path.write_bytes(array_file.pack(about, low=made.low, scale=made.scale, weights=weights))

    return damage


def with_arrays(**changes: Any) -> Callable[[Path], None]:
    def damage(path: Path) -> None:
        with np.load(path) as stored:
            arrays = {name: stored[name] for name in stored}
        np.savez(path, **(arrays | {k: change(arrays) for k, change in changes.items()}))

    return damage


def cut(path: Path) -> None:
    path.write_bytes(path.read_bytes()[:-40])


def more(path: Path) -> None:
    with zipfile.ZipFile(path, "a") as archive:
        archive.writestr("more.npy", b"")


@pytest.mark.parametrize(
    ("damage", "message"),
    [
        (cut, "not a readable policy file"),
        (more, "it must hold exactly"),
        (with_about(format=2), "its format is 2"),
        (with_about(actions=None), "no valid 'actions'"),
        (with_about(actions=[1, 2]), "actions must be a list of names"),
        (with_about(features=[]), "features must be a list of names"),
        (with_about(world_seed=True), "no valid 'world_seed'"),
        (with_about(world_seed=-1), "world_seed: -1"),
        (with_about(hidden=[5, -4]), "hidden must be a list"),
        (with_about(hidden=[4096] * 32), "more than 67,108,864 weights"),
        (with_about(hidden=[5, 5]), "weights must be float32 of shape"),
        (
            with_about(observation={"kind": "os:system"}),
            "its observation is os:system; must be one",
        ),
        (with_about(observation={"kind": []}), "its observation is"),
        (with_about(observation={"kind": "radar", "cells_x": 2}), "cells_x"),
        (with_arrays(low=lambda of: of["low"][1:]), "low must be float32 of shape"),
        (with_arrays(scale=lambda of: of["scale"].astype(float)), "not float64 of shape"),
        (with_arrays(weights=lambda of: of["weights"] * np.nan), "weights has values that are not"),
        (with_arrays(weights=lambda of: of["weights"].astype(object)), "objects"),
    ],
)
def test_what_is_refused(damage: Callable[[Path], None], message: str, file: Path):
    damage(file)
    with pytest.raises(PolicyError, match=message) as problem:
        policy = load_policy(f"mlp:{file}")
        policy.begin(build_world(small(observation=RADAR), 0), Streams(0, Purpose.LEARNER))
    assert str(file) in str(problem.value) and "\n" not in str(problem.value)


SETTINGS = [
    (kind, one.name)
    for kind in names("observation")
    for one in fields(resolve("observation", kind))
]


@pytest.mark.parametrize(("kind", "setting"), SETTINGS)
def test_each_setting_of_an_observation_is_read_again(kind: str, setting: str, file: Path):
    """Also those that only some scenarios allow, such as loads of stores, which need sensors."""
    default = getattr(resolve("observation", kind)(), setting)
    for other in (not default,) if isinstance(default, bool) else (default + 1, default + 2):
        observation = {"kind": kind, setting: other}
        with_about(observation=observation)(file)
        with suppress(PolicyError):  # the next number may be allowed: fields of view are odd
            assert getattr(MlpFile(file).observation, setting) == other
            return
    pytest.fail(f"no other value of {setting} can be read")


def test_a_network_that_sees_its_store_flies(file: Path):
    task = load(find_task("uav-v1/harvest/small").path)
    seen = {"kind": "position", "load_mbit": 6}
    scenario = task.model_copy(update={"observation": component_of(seen)})
    file.write_bytes(network_in(build_world(scenario, 0)).to_bytes())
    assert to_plain(du.run(task, policy=file, episodes=1, progress=False).scenario)[
        "observation"
    ] == {**seen, "load_levels": 3}


def test_a_name_is_enough(file: Path, tmp_path: Path):
    assert parts(str(file)) == ("mlp", str(file))
    assert parts(f"mlp:{file}") == ("mlp", str(file))
    for other in ("none.npz", "case8.npz", "a\0b.npz", str(tmp_path)):
        assert parts(other)[0] == ("table" if other.endswith(".npz") else other)
    with pytest.raises(PolicyError, match="needs its file"):
        load_policy("mlp")
    with pytest.raises(PolicyError, match=r"none\.npz"):
        load_policy("mlp:none.npz")


SHIPPED = [
    pytest.param(name, marks=pytest.mark.thorough) if name == "ppo_festival.npz" else name
    for name in trained_names()
    if "ppo_" in name
]
"""The network for free flight needs kernels that no other test of this file compiles."""


@pytest.mark.parametrize("name", SHIPPED)
def test_shipped_networks_fly_and_tell_where_they_come_from(name: str):
    policy: Any = load_policy(name)
    training = policy.about["training"]
    assert training["command"][0].endswith("ppo.py") and training["steps_done"] > 0
    assert training["commit"] and training["processor"]
    trained_in = loads(training["scenario_yaml"])
    assert trained_in.observation == policy.observation
    run = du.run(policy.about["scenario"], policy=name, engine="batch", progress=False)
    baseline = du.run(policy.about["scenario"], seed=run.seeds[0], engine="batch", progress=False)
    mine, other = (of.summaries()[0]["qoe3_percent"] for of in (run, baseline))
    assert mine > other + 10
    assert find_table(name).stat().st_size < 2**20
