"""Keys of sensors: what is refused by its whole message, and written and read again."""

from __future__ import annotations

import pytest

from desim_uav.scenario.doubts import updates_fit_in_stores
from desim_uav.scenario.load import dump, loads, scenario_hash
from tests.scenario.refused import blocks_of, check_block

BLOCKS = blocks_of("sensor_keys.txt")

SENSORS = """
drones: {radio: {kind: link_classes, sharing: equal}}
users:
- {name: phones, count: 5}
- {name: meters, count: 7, demand: {kind: sensing, service: reading}}
services:
  voice: {kind: transfer, volume_mbit: [3]}
  reading:
    {kind: collect, updates: {kind: periodic, every_s: 60}, size_mbit: [1], keeps: last, buffer: 3}
demand: {kind: dynamic, mix: {voice: 1}}
reward: {kind: coverage_battery}
"""


@pytest.mark.parametrize("block", BLOCKS, ids=range(len(BLOCKS)))
def test_messages(block: str) -> None:
    check_block(block)


def test_updates_that_fit_in_no_store_are_a_warning() -> None:
    ground = SENSORS.replace("keeps: last", "delivered: ground")
    keys = "drones.store_mbit=2", "services.reading.size_mbit=[1, 2.5]"
    (warning,) = updates_fit_in_stores(loads(ground, overrides=keys))
    assert warning == (
        "services.reading: updates of 2.5 Mbit are never sent, because no drone can store more "
        "than 2 Mbit (store_mbit)"
    )
    for changes in (("drones.store_mbit=2.5", keys[1]), keys[1:], keys[:1]):
        assert not list(updates_fit_in_stores(loads(ground, overrides=changes)))


def test_it_can_be_written_and_read_again() -> None:
    for text in (SENSORS, SENSORS.replace("every_s: 60", "every_s: 60, offset: 0")):
        scenario = loads(text)
        assert loads(dump(scenario)) == scenario
        assert scenario_hash(loads(dump(scenario))) == scenario_hash(scenario)
