"""``drones`` as a list of types: what is read from it, and what is refused by its whole message."""

from __future__ import annotations

from typing import Any

import pytest

from desim_uav.errors import ScenarioError
from desim_uav.scenario.drones import Drones, NamedDrones
from desim_uav.scenario.layout import start_cells
from desim_uav.scenario.load import dump, from_mapping, json_schema, loads, scenario_hash, to_plain
from desim_uav.scenario.schema import Scenario
from desim_uav.world import build_world
from tests.scenario.refused import blocks_of, check_block

BLOCKS = blocks_of("fleet_keys.txt")

TWO = """
drones:
- {name: scout, count: 2, footprint_radius_m: 300, battery: {autonomy_min: 9}}
- {name: relay, count: 1, radio: {kind: link_classes}, battery: null}
"""


@pytest.mark.parametrize("block", BLOCKS, ids=lambda block: block.splitlines()[-1][3:60])
def test_messages(block: str) -> None:
    check_block(block)


def test_the_types_and_their_drones() -> None:
    scenario = loads(TWO)
    scout, relay = scenario.fleet
    assert isinstance(scout, NamedDrones) and isinstance(relay, NamedDrones)
    assert scenario.type_names == ("scout", "relay")
    assert scenario.drone_count == 3
    assert scenario.type_numbers == (0, 0, 1)
    assert scenario.limited_battery
    assert scenario.differing == ("footprint_radius_m", "radio", "battery")
    assert scout.bandwidth_kbps == Drones().bandwidth_kbps  # a key that is left out has its default


def test_one_block_is_a_fleet_of_one_type() -> None:
    scenario = Scenario()
    assert scenario.fleet == (scenario.drones,)
    assert scenario.type_numbers == (0, 0, 0)
    assert scenario.type_names == ("drones",)
    assert scenario.differing == ()
    assert scenario.require_one_type("this") is scenario.drones


def test_a_list_is_written_and_read_back() -> None:
    scenario = loads(TWO)
    assert loads(dump(scenario)) == scenario
    assert scenario_hash(loads(dump(scenario))) == scenario_hash(scenario)
    first, second = to_plain(scenario)["drones"]
    assert next(iter(first)) == "name"
    assert "footprint_radius_m" in first and "footprint_radius_m" not in second


def test_a_name_is_part_of_the_hash_and_nothing_is_added_to_one_block() -> None:
    assert scenario_hash(loads(TWO)) != scenario_hash(loads(TWO.replace("scout", "other")))
    assert list(to_plain(Scenario())["drones"]) == [*Drones.model_fields]


@pytest.mark.parametrize(
    ("override", "counts"),
    [("drones.0.count=5", (5, 1)), ("drones.1.count=4", (2, 4)), ("drones=[{name: a}]", (3,))],
)
def test_overrides(override: str, counts: tuple[int, ...]) -> None:
    assert tuple(each.count for each in loads(TWO, overrides=[override]).fleet) == counts


@pytest.mark.parametrize(
    ("override", "message"),
    [
        ("drones.count=5", "'count' is not an index of this list, which has 2 items"),
        ("drones.2.count=5", "'2' is not an index of this list, which has 2 items"),
        ("drones.0.count=0", "drones.0.count=0: must be at least 1"),
        ("drones.0.name=relay", "drones.1.name"),
    ],
)
def test_overrides_that_are_refused(override: str, message: str) -> None:
    with pytest.raises(ScenarioError, match="drones") as caught:
        loads(TWO, overrides=[override])
    assert message in str(caught.value)


def test_the_preset_is_beneath_each_type() -> None:
    types = loads("preset: paper\n" + TWO.replace("battery: null", "battery: {}")).fleet
    assert [each.battery.respawn_after_min for each in types if each.battery] == [0.0, 0.0]


def test_start_cells_of_one_type() -> None:
    scenario = from_mapping(
        {
            "drones": [
                {"name": "a", "count": 1},
                {"name": "b", "count": 2, "start_cells": [[0, 0], [1, 2]]},
                {"name": "c", "count": 1},
            ]
        }
    )
    alike = start_cells(from_mapping({"drones": {"count": 4}}))
    assert start_cells(scenario) == [alike[0], (0, 0), (1, 2), alike[3]]


def test_what_needs_one_type_says_which_keys_differ() -> None:
    world = build_world(loads(TWO), 0)
    message = "types scout, relay differ in footprint_radius_m, radio, battery; greedy needs"
    with pytest.raises(ScenarioError, match=message):
        world.require_one_type("greedy")
    with pytest.raises(ScenarioError, match="needs drones of one type"):
        _ = world.only_type.capacity
    alike = build_world(loads("drones: [{name: a}, {name: b, count: 1}]"), 0)
    assert alike.only_type.capacity == build_world(Scenario(), 0).only_type.capacity


@pytest.mark.thorough
def test_the_schema_for_editors_has_both_forms() -> None:
    drones: dict[str, Any] = json_schema()["properties"]["drones"]
    one, several = drones["anyOf"]
    assert one["$ref"].endswith("Drones")
    assert several["type"] == "array" and several["minItems"] == 1
    assert json_schema()["$defs"]["NamedDrones"]["required"] == ["name"]
