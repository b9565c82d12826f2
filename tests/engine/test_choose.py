"""Engines by name."""

import pytest

from desim_uav.engine.base import RunSettings
from desim_uav.engine.choose import ENGINES, check_engine, engine_for, make_engine
from desim_uav.engine.compiled import BatchSimulation
from desim_uav.engine.des import Simulation
from desim_uav.errors import ScenarioError, UsageError
from desim_uav.scenario.load import from_mapping
from desim_uav.world import World, build_world

SETTINGS = RunSettings((True,) * 3, False)


def world_of(**changes: object) -> World:
    return build_world(from_mapping(changes), 0)


def test_each_name_is_an_engine():
    engines = [make_engine(name, world_of(), SETTINGS) for name in ENGINES]
    assert [type(engine) for engine in engines] == [Simulation, BatchSimulation]
    assert engine_for(world_of()) == "batch"


def test_what_has_no_kernel():
    loss = {"kind": "tests.engine.helpers:Loss"}
    world = world_of(drones={"admission": loss}, reward={"kind": "tests.engine.test_batch:Flat"})
    said: list[str] = []
    assert engine_for(world, said.append) == "des"
    assert said == [
        "the SimPy engine (des) is used, which is slower: "
        "drones.admission: 'Loss' is not compiled: it does not work on rows; "
        "reward: 'Flat' is not compiled: it does not work on rows"
    ]
    assert type(make_engine("des", world, SETTINGS)) is Simulation
    with pytest.raises(ScenarioError) as told:
        make_engine("batch", world, SETTINGS)
    assert [problem.partition(":")[0] for problem in told.value.problems] == [
        "drones.admission",
        "reward",
    ]


@pytest.mark.parametrize("autonomy_min", [30, 36, 60, 43_200])
def test_a_battery_of_any_length_has_a_kernel(autonomy_min: float, capsys):
    battery = {"kind": "endurance", "autonomy_min": autonomy_min}
    stations = {"full_charge_min": autonomy_min}
    world = world_of(drones={"battery": battery}, stations=stations)
    assert engine_for(world) == "batch"
    check_engine("batch", world)
    assert capsys.readouterr().err == ""


def test_no_such_engine():
    with pytest.raises(UsageError, match="--engine simpy: allowed: auto, des, batch"):
        check_engine("simpy", world_of())
