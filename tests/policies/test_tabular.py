"""Learned tables: their files, and what a drone does with them."""

import json
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from desim_uav import array_file, compare
from desim_uav.engine.base import RunSettings
from desim_uav.engine.des import Simulation
from desim_uav.errors import PolicyError
from desim_uav.experiment.train.course import train
from desim_uav.model.random.streams import Purpose, Streams
from desim_uav.model.rules import Mode
from desim_uav.policies import load_policy
from desim_uav.policies.base import decide
from desim_uav.policies.tabular import Greedy, QTable, read_table
from desim_uav.sample_path import draw
from desim_uav.scenario.load import from_mapping
from desim_uav.scenario.schema import Scenario
from desim_uav.shipped import find_table, trained_names
from desim_uav.world import World, build_world

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
    "learning": {"episodes": 40},
}


def small(**changes: Any) -> Scenario:
    return from_mapping({**SMALL, **changes})


@pytest.fixture(scope="module")
def table() -> QTable:
    return train(small())[0]


@pytest.fixture
def file(table: QTable, tmp_path: Path) -> Path:
    (tmp_path / "policy.npz").write_bytes(table.to_bytes())
    return tmp_path / "policy.npz"


def flights(world: World, policy: Any, episodes: int = 3) -> list[Any]:
    """What it was shown and what it told, decision by decision."""
    engine = Simulation(world, RunSettings((True,) * 2, carry_over=True))
    seen = []
    for episode in range(episodes):
        policy.begin(world, Streams(0, Purpose.LEARNER, episode))
        shown = engine.reset(draw(world, 0, episode))
        while not shown.truncated:
            commands = decide(policy, shown, world)
            seen += zip(shown.observations, shown.masks, commands, strict=True)
            shown = engine.step(commands)
    return seen


def test_a_file_gives_its_table_back(table: QTable, file: Path):
    found = read_table(file)
    assert (found.q == table.q).all() and found.q.dtype == np.float32
    assert found.about == table.about | {"format": 1}
    assert found.to_bytes() == table.to_bytes()
    assert found.about["scenario"] == "small" and found.about["episodes"] == 40
    assert "name: small" in found.about["scenario_yaml"]


def test_it_does_what_is_best_of_what_is_allowed(table: QTable, file: Path):
    world = build_world(small(), 0)
    modes = set()
    for seen, mask, command in flights(world, load_policy(str(file)), episodes=6):
        modes.add(seen.mode)
        assert mask[command]
        if seen.mode in (Mode.FLYING, Mode.CHARGED):
            x, y = seen.cell
            state = (x * 4 + y) * 8 + int(seen.battery_s // 60)
            values = table.q[seen.drone, state]
            allowed = [a for a, legal in enumerate(mask) if legal]
            best = max(values[a] for a in allowed)
            assert command == min(a for a in allowed if values[a] == best)
    assert len(modes) > 2, "it was forced, too"


def test_it_knows_its_world(file: Path):
    policy = load_policy(str(file))
    assert policy.world_seed == 0
    assert policy.notice(build_world(small(), 0)) == ""
    assert "small, world seed 0" in policy.notice(build_world(small(), 1))


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"drones": {**SMALL["drones"], "count": 3}}, "drones 2; the scenario has 3"),
        ({"drones": {**SMALL["drones"], "battery": None}}, "the scenario has"),
        ({"map": {**SMALL["map"], "cells": [5, 4]}}, "states"),
        ({"map": {**SMALL["map"], "dimensions": 3}}, "actions"),
        ({"observation": {"kind": "local"}}, "states"),
    ],
)
def test_a_table_that_does_not_fit(changes: dict[str, Any], message: str, file: Path):
    policy = load_policy(str(file))
    with pytest.raises(PolicyError, match=message) as problem:
        policy.begin(build_world(small(**changes), 0), Streams(0, Purpose.LEARNER))
    assert str(file) in str(problem.value)


def about_without(key: str) -> Callable[[QTable], bytes]:
    def made(table: QTable) -> bytes:
        about = {name: value for name, value in table.about.items() if name != key}
        return array_file.pack(about | {"format": 1}, q=table.q)

    return made


def with_q(change: Callable[[np.ndarray], np.ndarray]) -> Callable[[QTable], bytes]:
    return lambda table: array_file.pack(table.about | {"format": 1}, q=change(table.q))


def with_member(table: QTable, path: Path, name: str, content: bytes) -> bytes:
    path.write_bytes(table.to_bytes())
    with zipfile.ZipFile(path, "a") as archive:
        archive.writestr(name, content)
    return path.read_bytes()


@pytest.mark.parametrize(
    ("damaged", "message"),
    [
        (lambda table: b"", "not a readable policy file"),
        (lambda table: b"PK\x03\x04 nothing", "not a readable policy file"),
        (lambda table: table.to_bytes()[:-40], "not a readable policy file"),
        (lambda table: array_file.pack(table.about | {"format": 2}, q=table.q), "its format is 2"),
        (
            lambda table: array_file.pack({"format": 1}, q=table.q),
            "its description has no valid 'features'",
        ),
        (lambda table: array_file.pack({"format": 1}, p=table.q), "it must hold exactly"),
        (about_without("world_hash"), "its description has no valid 'world_hash'"),
        (with_q(lambda q: q.astype(np.float64)), "not float64"),
        (with_q(lambda q: q[0]), "not float32 of shape"),
        (with_q(lambda q: q[:, :-1]), "127 states and 7 actions, but its description has 128"),
        (with_q(lambda q: np.full_like(q, np.nan)), "not finite"),
    ],
)
def test_a_file_that_is_no_table(damaged, message: str, table: QTable, tmp_path: Path):
    path = tmp_path / "bad.npz"
    path.write_bytes(damaged(table))
    with pytest.raises(PolicyError, match=message) as problem:
        read_table(path)
    assert str(path) in str(problem.value)


def test_more_than_a_table_is_refused(table: QTable, tmp_path: Path):
    path = tmp_path / "more.npz"
    for name in ("../escape.npy", "code.pkl"):
        with_member(table, path, name, b"x")
        with pytest.raises(PolicyError, match="it must hold exactly"):
            read_table(path)


def test_an_array_of_objects_is_not_unpickled(table: QTable, tmp_path: Path):
    class Trap:
        def __reduce__(self) -> Any:
            return (tmp_path / "sprung").touch, ()

    path = tmp_path / "trap.npz"
    text = np.frombuffer(json.dumps(table.about | {"format": 1}).encode(), np.uint8)
    np.savez(path, about=text, q=np.array([Trap()], object))
    with pytest.raises(PolicyError, match="allow_pickle"):
        read_table(path)
    assert not (tmp_path / "sprung").exists()


def test_a_file_there_is_not(tmp_path: Path):
    with pytest.raises(PolicyError, match="No such file"):
        load_policy(str(tmp_path / "none.npz"))
    with pytest.raises(PolicyError, match="needs its file"):
        load_policy("table")


def test_shipped_tables_are_found_by_name(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.chdir(tmp_path)
    assert find_table("case8.npz").is_file()
    Path("case8.npz").write_text("mine")
    assert find_table("case8.npz") == Path("case8.npz"), "a file of one's own comes first"
    assert find_table("./none.npz") == Path("none.npz")


OTHERS = ("ppo_", "mappo_", "expert_", "planner_", "dispatch.")
TABLES = [name for name in trained_names() if not name.startswith(OTHERS)]

VARIANTS = {f"edge_{kind}.npz": ("edge", [f"offloading={kind}"]) for kind in ("always", "shortest")}
"""The scenarios, and what is overridden in them, of tables that do not have a scenario's name."""


@pytest.mark.parametrize("name", TABLES)
def test_shipped_tables_fit_their_scenarios(name: str):
    from desim_uav.scenario.load import load, scenario_hash
    from desim_uav.shipped import scenario_path

    policy = Greedy(name)
    about = policy.about
    assert (about["seed"], about["world_seed"], about["algorithm"]) == (0, 0, "q_learning")
    of, overrides = VARIANTS.get(name, (name.removesuffix(".npz"), []))
    scenario = load(scenario_path(of), overrides)
    assert about["scenario_hash"] == scenario_hash(scenario), "train it again"
    world = build_world(scenario, 0)
    assert policy.notice(world) == ""
    policy.begin(world, Streams(0, Purpose.LEARNER))


@pytest.mark.thorough
def test_the_shipped_table_does_what_the_readme_says():
    pair = ["baseline", "case8.npz"]
    compared = compare(
        "case8",
        policies=pair,
        world_seed=0,
        first_seed=9000,
        seeds=20,
        engine="batch",
        progress=False,
    )
    (better,) = compared.content()["differences"]
    measures = better["measures"]
    readme = " ".join((Path(__file__).parents[2] / "README.md").read_text(encoding="utf-8").split())
    qoe1, qoe3 = (measures[name] for name in ("qoe1_percent", "qoe3_percent"))
    told = [f"{own['mean']:.2f} ± {own['half_width']:.2f}" for own in (qoe1, qoe3)]
    assert f"by {told[0]} points in QoE1 and {told[1]} in QoE3" in readme
