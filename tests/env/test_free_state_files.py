"""Files of saved states of drones that fly freely, alone and beside drones by cells."""

from __future__ import annotations

import copy
import json
import math
import os
import pickle
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from desim_uav import array_file
from desim_uav.engine.base import Carried, RunSettings
from desim_uav.engine.choose import make_engine
from desim_uav.env import UavEnv, UavParallelEnv, UavVectorEnv
from desim_uav.env.carried_drones import checked, plain
from desim_uav.errors import ScenarioError, StateError
from desim_uav.model.rules import Action, Mode
from desim_uav.sample_path import draw
from desim_uav.scenario.load import from_mapping
from desim_uav.world import World, build_world
from tests.engine import random_free, random_mixed
from tests.engine.helpers import some_command
from tests.env import test_free_envs, test_mixed_envs

OTHER = {"des": "batch", "batch": "des"}
CARRIED = {"episode": {"steps": 6, "carry_over": True}}
BY_EVENT = {**CARRIED, "decisions": {"kind": "event", "patience_s": 20}}
QUICK = {"timing": "minimum_time"}


def mixed(dimensions: int, **changes: Any) -> dict[str, Any]:
    made = test_mixed_envs.scenario(dimensions, **changes)
    for each in made["drones"]:
        each.setdefault("motion", QUICK)
    return made


KINDS: dict[str, dict[str, Any]] = {
    "2D": {**test_free_envs.scenario(), **CARRIED},
    "3D": {**test_free_envs.choosing(3), **CARRIED},
    "unlimited": {**test_free_envs.scenario(3, limited=False), **CARRIED},
    "2D by event": {**test_free_envs.choosing(), **BY_EVENT},
    "3D by event": {**test_free_envs.scenario(3), **BY_EVENT},
    "mixed": mixed(2, **CARRIED),
    "mixed by event": mixed(3, **BY_EVENT),
}


def env_of(kind: str, engine: str = "des") -> Any:
    return UavParallelEnv(KINDS[kind], engine=engine)


def turn(env: Any, rng: np.random.Generator) -> Any:
    """Begin an episode where one is due, else step; everything that is shown after that."""
    if env.session.episode < 0 or not env.agents:
        return env.reset(seed=7 if env.session.episode < 0 else None)
    return env.step({agent: command(env, agent, rng) for agent in env.agents})


def command(env: Any, agent: str, rng: np.random.Generator) -> Any:
    """Numbers that are eager to charge, or the index of an action."""
    space = env.action_space(agent)
    if space.shape == ():
        return int(rng.integers(space.n))
    numbers = rng.uniform(-1.0, 1.0, space.shape)
    numbers[-1] = rng.choice([-1.0, -0.0, 1.0])
    return numbers


def turns(env: Any, count: int, seed: int) -> list[Any]:
    rng = np.random.default_rng(seed)
    return [turn(env, rng) for _ in range(count)]


def whole_turns(env: Any, count: int, seed: int) -> list[Any]:
    """Turns, and where the drones are after each."""
    rng = np.random.default_rng(seed)
    return [(of_any(turn(env, rng)), env.session.engine.positions_m()) for _ in range(count)]


def of_any(shown: Any) -> Any:
    """What is shown, without what says which engine played it."""
    *others, infos = shown
    return *others, [{k: v for k, v in infos[one].items() if k != "compiled"} for one in infos]


@pytest.mark.parametrize(
    ("kind", "first", "second"),
    [
        *(("3D", "des", "des"), ("mixed by event", "des", "des")),
        *(
            pytest.param(kind, *pair, marks=pytest.mark.thorough)
            for kind in KINDS
            for pair in OTHER.items()
        ),
    ],
)
def test_the_rest_of_the_run_is_the_same(kind: str, first: str, second: str, tmp_path: Path):
    env, other, file = env_of(kind, first), env_of(kind, second), tmp_path / "state.npz"
    turns(env, 3, 1)
    for seed in range(5):
        turns(env, 11, seed)
        env.save().write(file)
        before = env.session.engine.save()
        shown = other.restore(file)
        assert other.save().saved.digest() == before.digest()
        assert other.session.engine.save().numbers.tolist() == before.numbers.tolist()
        np.testing.assert_equal(of_any(shown), of_any(env._present()))
        other.save().write(tmp_path / "again.npz")
        assert (tmp_path / "again.npz").read_bytes() == file.read_bytes()
        twin = env.fork(1)[0]
        np.testing.assert_equal(whole_turns(other, 9, seed), whole_turns(twin, 9, seed))


@pytest.mark.thorough
@pytest.mark.parametrize("kind", ["3D", "mixed by event"])
def test_another_process_goes_on_in_the_other_engine(kind: str, tmp_path: Path):
    for first, second in OTHER.items():
        env, file, told = env_of(kind, first), tmp_path / "state.npz", tmp_path / "told"
        turns(env, 44, 1)
        env.save().write(file)
        script = (
            "import pickle, sys; from tests.env.test_free_state_files import env_of, whole_turns\n"
            f"env = env_of({kind!r}, {second!r})\n"
            "env.restore(sys.argv[1])\n"
            "pickle.dump(whole_turns(env, 12, 2), open(sys.argv[2], 'wb'))\n"
        )
        root = Path(__file__).parents[2]
        path = os.pathsep.join([str(root), os.environ.get("PYTHONPATH", "")])
        subprocess.run(
            [sys.executable, "-c", script, str(file), str(told)],
            check=True,
            env={**os.environ, "PYTHONPATH": path},
        )
        np.testing.assert_equal(pickle.loads(told.read_bytes()), whole_turns(env, 12, 2))


@pytest.mark.thorough
def test_environments_with_one_array_of_actions(tmp_path: Path):
    """A drone of the unlimited type has a number for a wish to charge, which the file keeps."""
    made = KINDS["2D"]
    types = [{"name": "a", **made["drones"]}, {"name": "b", **made["drones"], "battery": None}]
    made = {**made, "drones": [{**one, "count": 1, "start_cells": [[1, 1]]} for one in types]}
    vector = UavVectorEnv(made, 2, {"world_seed": 1})
    rng = np.random.default_rng(0)
    vector.reset(seed=3)
    for _ in range(8):
        vector.step(rng.uniform(-1.0, 1.0, vector.action_space.shape).astype(np.float32))
    vector.save(1).write(tmp_path / "state.npz")
    alone = UavEnv(made, {"world_seed": 1})
    alone.restore(tmp_path / "state.npz")
    vector.restore(tmp_path / "state.npz", 0)
    for _ in range(9):
        action = rng.uniform(-1.0, 1.0, alone.action_space.shape).astype(np.float32)
        many = vector.step(np.array([action, action]))
        if alone.session.snapshot.truncated:
            seen, _ = alone.reset()
        else:
            seen, *_ = alone.step(action)
        assert (many[0] == seen).all()


# ---- drones that are carried over


def world_of(make: Callable[[int], dict[str, Any]], seed: int) -> World:
    """The world of the next random scenario that is none of radio, with drones carried over."""
    while True:
        made = make(seed)
        made["episode"]["carry_over"] = True
        try:
            world = build_world(from_mapping(made), 0)
        except ScenarioError:
            seed += 1000
            continue
        if world.free:
            return world
        seed += 1000


def carried_over(world: World, seed: int, episodes: int) -> list[Carried]:
    """The states of drones after each of some episodes under random commands."""
    ceilings = (True,) * world.scenario.drone_count
    engine, rng = (
        make_engine("des", world, RunSettings(ceilings, True)),
        np.random.default_rng(seed),
    )
    found = []
    for episode in range(episodes):
        shown = engine.reset(draw(world, seed, episode))
        while not (shown.terminated or shown.truncated):
            shown = engine.step([some_command(world, mask, rng) for mask in shown.masks])
        found.append(engine.carried())
    return [one for one in found if one is not None]


MAKE = {
    "free": random_free.scenario,
    "choosing": random_free._choosing,
    "mixed": random_mixed.scenario,
}


@pytest.mark.thorough
@pytest.mark.parametrize("seed", range(12))
@pytest.mark.parametrize("kind", MAKE)
def test_every_state_of_random_scenarios_is_read_again(kind: str, seed: int):
    world = world_of(MAKE[kind], seed)
    ceilings = (True,) * world.scenario.drone_count
    for drones in carried_over(world, seed, 6):
        data = json.loads(json.dumps(plain(drones), allow_nan=False))
        assert json.loads(json.dumps(plain(checked(data, world, ceilings)))) == data


BATTERY = {"autonomy_min": 12, "return_below": 1.0, "respawn_after_min": 60}
ROOM: dict[str, Any] = {
    "map": {
        "size_m": [1000, 1000],
        "cells": [5, 5],
        "dimensions": 2,
        "no_fly": [{"polygon_m": [[200, 600], [400, 600], [400, 750], [200, 750]]}],
    },
    "drones": {
        "count": 4,
        "start_cells": [[0, 4], [2, 2], [0, 0], [4, 4]],
        "motion": {"space": "free", "max_speed_mps": 10, "cruise": [2, 10], "margin_m": 10},
        "battery": BATTERY,
    },
    "stations": {"count": 1, "radius_m": 0, "full_charge_min": 60},
    "users": {"count": 3},
    "episode": {"steps": 1, "step_s": 30, "carry_over": True},
    "decisions": {"kind": "event", "patience_s": 20},
}
RETURNS, CHARGES, HOVERS, FLIES = range(4)
LEG = 9
"""The place of its leg in the data of a drone."""


@pytest.fixture(scope="module")
def held() -> tuple[World, Any]:
    """A world, and four drones in it after 30 s, as a file has them.

    The first one is on its way home around the zone, and the others charge, hover and fly.
    """
    world = build_world(from_mapping(ROOM), 0)
    engine = make_engine("des", world, RunSettings((True,) * 4, True))
    shown = engine.reset(draw(world, 0, 0))
    home, west = [0.0, 0.0, 1.0, 1.0], [-0.6, 0.0, -1.0, -1.0]
    while not shown.truncated:
        shown = engine.step([home, home, 1, west if shown.step else [0.0, -0.1, 1.0, 0.0]])
    return world, json.loads(json.dumps(plain(engine.carried()), allow_nan=False))


def test_states_that_drones_can_be_in(held: tuple[World, Any]):
    world, data = held
    modes = [Mode(drone[0]) for drone in data]
    assert modes == [Mode.RETURNING, Mode.CHARGING, Mode.FLYING, Mode.FLYING]
    assert data[RETURNS][LEG] == [100.0, 900.0, 20.0, 410.0, 760.0, 20.0, None, 0, 0, 0]
    assert data[FLIES][LEG][:6] == [900.0, 872.5, 20.0, 735.0, 872.5, 20.0]
    read = checked(data, world, (True,) * 4)
    assert json.loads(json.dumps(plain(read))) == data


NAN, LARGE = float("nan"), 10**400
FORGED: dict[str, tuple[int, dict[int, Any], dict[int, Any], str]] = {
    "no list": (HOVERS, {LEG: "x"}, {}, "is no list of 10"),
    "no leg": (HOVERS, {LEG: None}, {}, "has none"),
    "a short leg": (HOVERS, {LEG: [0.0] * 9}, {}, "is no list of 10"),
    "no number": (HOVERS, {}, {0: "x"}, "is not a number"),
    "not finite": (HOVERS, {}, {0: NAN}, "is not a number"),
    "infinite": (HOVERS, {}, {0: -math.inf}, "is not a number"),
    "large": (HOVERS, {}, {3: LARGE}, "is not a number"),
    "true": (HOVERS, {}, {3: True}, "is not a number"),
    "in another cell": (HOVERS, {1: [1, 0, 0]}, {}, "is not in the cell"),
    "off the map": (FLIES, {}, {3: -10.0}, "cannot be at"),
    "too high": (FLIES, {}, {5: 21.0}, "cannot be at"),
    "in an obstacle": (FLIES, {}, {3: 300.0, 4: 700.0}, "cannot be in an obstacle"),
    "through an obstacle": (FLIES, {}, {3: 150.0, 4: 620.0}, "is not free"),
    "a limit of zero": (FLIES, {}, {6: 0.0}, "takes more than a step"),
    "a limit below zero": (FLIES, {}, {6: -5.0}, "takes more than a step"),
    "a limit close to zero": (FLIES, {}, {6: 5e-324}, "takes more than a step"),
    "slower": (FLIES, {}, {6: 5.0}, "takes more than a step"),
    "faster": (FLIES, {}, {6: 9.5}, "as long as it says"),
    "too far": (FLIES, {}, {3: 400.0}, "takes more than a step"),
    "no rest of a leg": (FLIES, {10: 0}, {}, "is over before"),
    "more of a leg": (FLIES, {10: 20_000_001}, {}, "as long as it says"),
    "an old leg": (FLIES, {3: 30_000_000, 10: 5}, {}, "is over before"),
    "a leg of a hover": (FLIES, {11: 1}, {}, "HOVER has no leg"),
    "no action": (FLIES, {11: 4}, {}, "from 0 to 3"),
    "a way home of no return": (FLIES, {}, {8: 1}, "has a station ahead"),
    "a hop of no return": (FLIES, {4: [-1, 0, 0]}, {}, "is on a hop"),
    "a longer hover": (HOVERS, {10: 10_000_001}, {}, "as long as it says"),
    "a limit at rest": (HOVERS, {}, {6: 5.0}, "has no limit"),
    "no station": (RETURNS, {}, {7: 1}, "no way home"),
    "a station below": (RETURNS, {}, {7: -1}, "no way home"),
    "no level": (RETURNS, {}, {9: 1}, "no way home"),
    "a level below": (RETURNS, {}, {9: -1}, "no way home"),
    "no node": (RETURNS, {}, {8: 5}, "no node"),
    "a large node": (RETURNS, {}, {8: 2**60}, "whole number"),
    "a node below": (RETURNS, {}, {8: -2}, "whole number"),
    "a node of no kind": (RETURNS, {}, {8: 0.0}, "whole number"),
    "no node ahead": (RETURNS, {}, {8: -1}, "without a station"),
    "a node behind": (RETURNS, {}, {8: 2}, "is not free"),
    "on no hop": (RETURNS, {4: None}, {}, "is on a hop"),
    "on another hop": (RETURNS, {4: [2, 0, 0]}, {}, "is not by"),
    "a limit of a return": (RETURNS, {}, {6: 5.0}, "only a commanded leg"),
    "an old hop": (RETURNS, {3: 2**40}, {}, "is over before"),
    "a command of a return": (RETURNS, {10: 5}, {}, "follows no command"),
    "beside the station": (CHARGES, {}, {0: 501.0, 3: 501.0}, "has landed"),
    "above the station": (CHARGES, {}, {2: 20.5, 5: 20.5}, "cannot be at"),
    "fallen elsewhere": (HOVERS, {0: 5, 8: [100.0, 101.0], 10: 0}, {}, "lies elsewhere"),
    "fallen in the air": (HOVERS, {0: 5, 8: [100.0, 100.0], 10: 0}, {}, "lies elsewhere"),
    "not fallen": (HOVERS, {0: 5, 10: 0}, {}, "has fallen"),
}


@pytest.mark.parametrize("name", FORGED)
def test_states_that_no_drone_can_be_in_are_refused(name: str, held: tuple[World, Any]):
    world, data = held
    drone, changes, of_leg, problem = FORGED[name]
    forged = copy.deepcopy(data)
    for place, value in of_leg.items():
        forged[drone][LEG][place] = value
    for place, value in changes.items():
        forged[drone][place] = value
    with pytest.raises(ValueError, match=problem):
        checked(forged, world, (True,) * 4)


@pytest.mark.parametrize("value", [5, [5], [[]], [None] * 4, [[0] * 12] * 4, {}, "x"])
def test_what_is_no_list_of_drones_is_refused(value: Any, held: tuple[World, Any]):
    with pytest.raises(ValueError, match=r"\w"):
        checked(value, held[0], (True,) * 4)


def test_a_leg_of_free_flight_is_for_drones_that_fly_freely():
    world = build_world(from_mapping({"seed": 0, **KINDS["mixed"]}), 0)
    ceilings = (True,) * 4
    engine = make_engine("des", world, RunSettings(ceilings, True))
    shown = engine.reset(draw(world, 0, 0))
    while not shown.truncated:
        shown = engine.step([4, world.actions.index(Action.HOVER), 4, 4])
    data = json.loads(json.dumps(plain(engine.carried()), allow_nan=False))
    assert json.loads(json.dumps(plain(checked(data, world, ceilings)))) == data
    for one, other in ((0, 1), (1, 0)):
        forged = copy.deepcopy(data)
        forged[one][LEG] = data[other][LEG]
        with pytest.raises(ValueError, match="has a leg of free flight, or"):
            checked(forged, world, ceilings)


# ---- files that were altered


@pytest.fixture(scope="module")
def written(tmp_path_factory: pytest.TempPathFactory) -> Path:
    env = env_of("mixed by event")
    turns(env, 42, 3)
    assert env.session.episode > 0 and env.session.engine.state.step > 1
    file: Path = tmp_path_factory.mktemp("states") / "state.npz"
    env.save().write(file)
    return file


def altered(file: Path, to: Path, change: Callable[[Any, Any], Any]) -> Path:
    """A file whose description and arrays were changed."""
    stored = array_file.Stored(file, "saved state", ["commands", "numbers"], 1)
    about, arrays = dict(stored.about), stored.arrays()
    change(about, arrays)
    to.write_bytes(array_file.pack(about, **arrays))
    return to


def put(name: str, value: Callable[[Any], Any]) -> Callable[[Any, Any], Any]:
    """A change of an array."""
    return lambda about, arrays: arrays.update({name: value(arrays[name])})


def no_number(array: Any, value: float) -> Any:
    array[0, 1, 0] = value
    return array


CHANGES: dict[str, tuple[Callable[[Any, Any], Any], str]] = {
    "no numbers": (lambda about, arrays: arrays.pop("numbers"), "numbers .* are missing"),
    "NaN": (put("numbers", lambda n: no_number(n, NAN)), "numbers are not finite"),
    "infinite": (put("numbers", lambda n: no_number(n, -math.inf)), "numbers are not finite"),
    "other": (put("numbers", lambda n: no_number(n, 0.1234)), "lead to another state"),
    "float32": (put("numbers", lambda n: n.astype(np.float32)), "numbers are wrong"),
    "whole": (put("numbers", lambda n: n.astype(np.int64)), "numbers are wrong"),
    "flat": (put("numbers", lambda n: n[:, :, 0]), "numbers are wrong"),
    "fewer steps": (put("numbers", lambda n: n[1:]), "numbers are wrong"),
    "fewer drones": (put("numbers", lambda n: n[:, 1:]), "numbers are wrong"),
    "fewer numbers": (put("numbers", lambda n: n[:, :, 1:]), "do not fit"),
    "more numbers": (put("numbers", lambda n: np.repeat(n, 2, axis=2)), "numbers are wrong"),
    "no commands": (put("commands", lambda n: n * 0 - 1), "lead to another state"),
    "odd commands": (put("commands", lambda n: n * 0 + 2**62), "lead to another state"),
    "flight of all": (put("commands", lambda n: n * 0 + 9), "lead to another state"),
    "place": (lambda about, arrays: about["before"][1][LEG].__setitem__(0, -5.0), "cannot be pl"),
    "node": (lambda about, arrays: about["before"][1][LEG].__setitem__(8, 10**9), "cannot be pl"),
    "no drone": (lambda about, arrays: about.update(before=[[]] * 4), "cannot be played"),
    "afresh": (lambda about, arrays: about.update(before=None), "lead to another state"),
}


@pytest.mark.parametrize("engine", ["des", pytest.param("batch", marks=pytest.mark.thorough)])
@pytest.mark.parametrize("change", CHANGES)
def test_an_altered_file_is_refused_and_changes_nothing(
    change: str, engine: str, written: Path, tmp_path: Path
):
    env = env_of("mixed by event", engine)
    turns(env, 2, 1)
    before, how = env.save().saved.digest(), CHANGES[change]
    file = altered(written, tmp_path / "altered.npz", how[0])
    with pytest.raises(StateError, match=how[1]) as raised:
        env.restore(file)
    assert str(file) in str(raised.value) and raised.value.exit_code == 4
    assert env.save().saved.digest() == before


def test_numbers_need_drones_that_fly_freely(tmp_path: Path):
    made = {**KINDS["2D"], "drones": {"count": 2}}
    env = UavEnv(made)
    env.reset(seed=1)
    env.step([4, 4])
    env.save().write(tmp_path / "state.npz")
    stored = array_file.Stored(tmp_path / "state.npz", "saved state", ["commands"], 1)
    forged = array_file.pack(stored.about, **stored.arrays(), numbers=np.zeros((1, 2, 2)))
    (tmp_path / "forged.npz").write_bytes(forged)
    with pytest.raises(StateError, match="numbers of the shape"):
        env.restore(tmp_path / "forged.npz")
