"""Keys of backhauls: what is refused by its message, warned of, and written and read again."""

from __future__ import annotations

import pytest

from desim_uav.scenario.doubts import deadlines_can_be_met, services_fit_the_bandwidth
from desim_uav.scenario.load import dump, loads, scenario_hash
from tests.scenario.refused import blocks_of, check_block

BLOCKS = blocks_of("backhaul_keys.txt")

NARROW = "drones: {backhaul: {kind: capacity, kbps: 2000}}"


@pytest.mark.parametrize("block", BLOCKS, ids=range(len(BLOCKS)))
def test_messages(block: str) -> None:
    check_block(block)


def test_it_can_be_written_and_read_again() -> None:
    for text in (NARROW, "drones: {backhaul: null}"):
        scenario = loads(text)
        assert loads(dump(scenario)) == scenario
        assert scenario_hash(loads(dump(scenario))) == scenario_hash(scenario)
    assert scenario_hash(loads("drones: {backhaul: null}")) == scenario_hash(
        loads("name: scenario")
    )


def test_a_rate_above_every_backhaul_is_a_warning() -> None:
    (warning,) = services_fit_the_bandwidth(loads(NARROW))
    assert warning == (
        "services.throughput: requests for 2500 kbit/s are never served, because no drone has more "
        "than 2000 kbit/s (its bandwidth and its backhaul)"
    )
    assert not list(services_fit_the_bandwidth(loads(NARROW.replace("2000", "2500"))))


def test_deadlines_know_the_backhaul() -> None:
    """1.5 Mbit take 0.75 s at 2 Mbit/s, and 1e9 cycles 0.5 s."""
    text = """
drones:
  radio: {kind: link_classes, sharing: equal}
  processor: {ghz: 2}
  backhaul: {kbps: 2000}
services:
  vision:
    {kind: compute, input_mbit: [1], cycles_per_bit: [1000], output_mbit: [0.5], deadline_s: 1}
demand: {kind: dynamic, mix: {vision: 1}}
reward: {kind: coverage_battery}
"""
    (warning,) = deadlines_can_be_met(loads(text))
    assert warning.endswith("its deadline is 1 s, and the least that it can take is 1.25 s")
    assert not list(deadlines_can_be_met(loads(text.replace("2000", "4000"))))
