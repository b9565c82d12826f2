"""Indices of components of one's own: both engines refuse the same ones, in the same words."""

from __future__ import annotations

import os
import pickle
from typing import Any

import numpy as np
import pytest

from desim_uav.engine.base import RunSettings
from desim_uav.engine.compiled import BatchSimulation
from desim_uav.engine.des import Simulation
from desim_uav.env import UavVectorEnv
from desim_uav.errors import ScenarioError, SimulationError
from desim_uav.learning.training import Training
from desim_uav.model.demand import asking
from desim_uav.model.mobility import walking
from desim_uav.rowcode import rows
from desim_uav.rowcode.bounds import CHECKED, OutsideError
from desim_uav.sample_path import draw
from desim_uav.scenario.load import load
from desim_uav.shipped import scenario_path
from desim_uav.world import World, build_world
from tests import faulty

HUGE = 10**9
KEYS = {
    "Scanning": "drones.admission",
    "Seeing": "observation",
    "Draining": "drones.battery",
    "Charging": "stations.charging",
    "Sharing": "drones.radio.sharing",
    "Losing": "drones.radio.path_loss",
    "Walking": "users.mobility",
    "Asking": "demand",
    "AskingForMore": "demand",
}


def world_with(name: str, *others: str, case: str = "case8", **values: Any) -> World:
    values = {"full_charge_min": 600.0, **values} if name == "Charging" else values
    text = "".join(f", {key}: {value}" for key, value in values.items())
    own = f"{KEYS.get(name, 'reward')}={{kind: 'tests.faulty:{name}'{text}}}"
    return build_world(load(scenario_path(case), [own, *others]), 0)


def fault_of(world: World, engine: Any) -> str:
    """The message of the error in which an episode ends."""
    one = engine(world, RunSettings((True,) * len(world.starts), False))
    with pytest.raises(SimulationError) as caught:
        one.reset(draw(world, 0, 0))
        for command in (0, 0, 4, *[len(world.actions) - 2] * 9):  # and then to a station
            one.features()
            one.step([command] * len(world.starts))
    return str(caught.value)


def words_of(name: str, index: int, size: int, of: str = "a table") -> str:
    """What the message of a fault must be."""
    place = faulty.place_of(getattr(faulty, name))
    what = f"IndexError: index {index} is out of bounds for {of} with size {size}"
    return f"component 'tests.faulty:{name}' failed: {what} {place}"


@pytest.mark.parametrize("engine", [Simulation, BatchSimulation])
@pytest.mark.parametrize("index", [-1, 3, HUGE, -HUGE])
def test_a_reward_looks_at_drones_that_exist(engine: Any, index: int):
    world = world_with("Previous", at=index)
    assert fault_of(world, engine) == words_of("Previous", index, 3)


@pytest.mark.parametrize("engine", [Simulation, BatchSimulation])
def test_it_writes_no_term_too_many(engine: Any):
    assert fault_of(world_with("TermTooMany"), engine) == words_of("TermTooMany", 1, 1)


@pytest.mark.parametrize("engine", [Simulation, BatchSimulation])
def test_functions_that_it_calls_are_checked(engine: Any):
    said = fault_of(world_with("Helped"), engine)
    what = f"IndexError: index {HUGE} is out of bounds for a table with size 48"
    place = faulty.place_of(faulty.helped)
    assert said == f"component 'tests.faulty:Helped' failed: {what} {place}"


@pytest.mark.parametrize("engine", [Simulation, BatchSimulation])
@pytest.mark.parametrize("index", [3, HUGE, -4])
def test_arrays_of_its_module_are_checked(engine: Any, index: int):
    said = fault_of(world_with("FromArray", at=index), engine)
    assert said == words_of("FromArray", index, 3, "axis 0")


@pytest.mark.parametrize("engine", [Simulation, BatchSimulation])
@pytest.mark.parametrize(
    ("name", "index", "size"), [("Popping", -1, 0), ("Removing", 1, 1), ("Inserting", 2, 1)]
)
def test_queues_have_no_more_than_was_put_in(engine: Any, name: str, index: int, size: int):
    assert fault_of(world_with(name), engine) == words_of(name, index, size, "a queue")


@pytest.mark.thorough
@pytest.mark.parametrize("engine", [Simulation, BatchSimulation])
@pytest.mark.parametrize("index", [-1, 1000, HUGE])
@pytest.mark.parametrize(
    ("name", "size", "others"),
    [
        ("Scanning", 48, ()),
        ("Seeing", 1, ()),
        ("Draining", 1, ()),
        ("Charging", 2, ("drones.battery={kind: endurance, return_below: 1.0}",)),
        ("Walking", 2, ()),
        ("Asking", 2, ()),
    ],
)
def test_so_are_the_others(engine: Any, name: str, size: int, index: int, others: tuple[str, ...]):
    assert fault_of(world_with(name, *others, at=index), engine) == words_of(name, index, size)


@pytest.mark.thorough
@pytest.mark.parametrize("engine", [Simulation, BatchSimulation])
@pytest.mark.parametrize("index", [-1, HUGE])
def test_so_is_sharing(engine: Any, index: int):
    said = fault_of(world_with("Sharing", case="urban_downlink", at=index), engine)
    assert said == words_of("Sharing", index, 22, "a queue")


@pytest.mark.parametrize("index", [-1, 2])
def test_so_is_a_path_loss_when_a_scenario_is_loaded(index: int):
    with pytest.raises(ScenarioError) as caught:
        world_with("Losing", case="urban_downlink", at=index)
    assert str(caught.value).endswith(f": {words_of('Losing', index, 2)}")


@pytest.mark.parametrize("name", ["Walking", "Asking"])
def test_so_are_those_that_python_draws(name: str, monkeypatch: pytest.MonkeyPatch):
    for module in (walking, asking):
        monkeypatch.setattr(module, "compiled_or_none", lambda *_: None)
    assert fault_of(world_with(name), Simulation) == words_of(name, -1, 2)


ALGORITHMS = {
    "NextState": (None, "the states"),
    "LastAction": (-1, "the actions"),
    "Allowed": (9, "a table"),
}


@pytest.mark.parametrize("engine", ["des", "batch"])
@pytest.mark.parametrize("name", ALGORITHMS)
def test_an_algorithm_has_the_values_that_exist(engine: str, name: str):
    changes = [f"learning.algorithm='tests.faulty:{name}'"]
    training = Training(build_world(load(scenario_path("case8"), changes), 0), 0, engine)
    _, _, states, actions = training.q.shape
    index, of = ALGORITHMS[name]
    before = training.q.copy()
    with pytest.raises(OutsideError) as caught:
        training.play(3)
    index, size = states if index is None else index, {"the states": states}.get(of, actions)
    assert str(caught.value) == words_of(name, index, size, of)
    assert (training.q != before).sum() <= 1  # nothing but what it wrote before


def test_training_with_a_reward_ends_in_its_fault():
    world = world_with("Previous", "users.mobility={kind: random_walk}")
    for engine in ("des", "batch"):
        with pytest.raises(SimulationError) as caught:
            Training(world, 0, engine).play(2)
        assert str(caught.value) == words_of("Previous", -1, 3)


@pytest.mark.parametrize("threads", [1, 3])
def test_one_of_many_environments_is_named(threads: int):
    changes = {"reward": {"kind": "tests.faulty:Crowded"}}
    count = 24
    env = UavVectorEnv("case8", count, changes, "Disabled", threads, None, range(count))
    env.reset(seed=0)
    for session in env.sessions:
        session.engine.state.faults = 0
    with pytest.raises(SimulationError) as caught:
        for _ in range(5):
            env.step(np.full((count, 3), 4))
    number, _, said = str(caught.value).removeprefix("environment ").partition(": ")
    assert said == words_of("Crowded", 1, 1)
    stopped = [k for k, one in enumerate(env.sessions) if one.engine.state.faults]
    assert int(number) in stopped
    assert all(env.sessions[k].engine.state.observations[0].attached_users > 20 for k in stopped)
    assert len(stopped) < count
    with pytest.raises(SimulationError):
        env.step(np.full((count, 3), 4))
    env.reset(seed=100)
    assert not any(one.engine.state.faults for one in env.sessions)
    env.close()


def test_an_engine_goes_on_in_the_next_episode_only():
    world = world_with("Crowded", at=1000)
    one = BatchSimulation(world, RunSettings((True,) * 3, False))
    one.reset(draw(world, 0, 0))
    world = world_with("Previous")
    one = BatchSimulation(world, RunSettings((True,) * 3, False))
    one.reset(draw(world, 0, 0))
    with pytest.raises(OutsideError):
        one.step([4, 4, 4])
    with pytest.raises(SimulationError, match="call reset first"):
        one.step([4, 4, 4])
    one.reset(draw(world, 0, 1))


def test_a_fault_can_be_pickled():
    fault = OutsideError("module:Own", "a table", ("own.py", 3, "Own.pay"), (0, 0))
    assert str(fault) == (
        "component 'module:Own' failed: IndexError: index 0 is out of bounds for a table with "
        "size 0 (own.py:3, in Own.pay)"
    )
    assert str(pickle.loads(pickle.dumps(fault))) == str(fault)


def test_built_in_rules_are_checked_only_on_demand():
    assert CHECKED is (os.environ.get("DESIM_UAV_CHECK", "0") == "1")


def test_a_table_is_filled_by_values_that_can_be_read_once(monkeypatch: pytest.MonkeyPatch):
    for checked in (False, True):
        monkeypatch.setattr(rows, "CHECKED", checked)
        table = rows.Table(2 * k for k in range(3))
        assert table == [0, 2, 4] and (type(table) is rows.BoundedTable) is checked
