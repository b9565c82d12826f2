"""Keys of tasks: what is refused by its whole message, warned of, and written and read again."""

from __future__ import annotations

import pytest

from desim_uav.scenario.doubts import deadlines_can_be_met
from desim_uav.scenario.load import dump, loads, scenario_hash
from tests.scenario.refused import blocks_of, check_block

BLOCKS = blocks_of("task_keys.txt")

TASKS = """
drones: {radio: {kind: link_classes, sharing: equal}, processor: {cores: 2, ghz: 2}}
users: {processor: {ghz: 0.5}}
services:
  vision:
    {kind: compute, input_mbit: [1], cycles_per_bit: [1000], output_mbit: [0.5], deadline_s: 9}
offloading: shortest
demand: {kind: dynamic, mix: {vision: 1}}
reward: {kind: coverage_battery}
"""


@pytest.mark.parametrize("block", BLOCKS, ids=range(len(BLOCKS)))
def test_messages(block: str) -> None:
    check_block(block)


def test_it_can_be_written_and_read_again() -> None:
    for text in (TASKS, TASKS.replace("shortest", "always"), "name: mine"):
        scenario = loads(text)
        assert loads(dump(scenario)) == scenario
        assert scenario_hash(loads(dump(scenario))) == scenario_hash(scenario)


def test_a_deadline_that_none_can_meet_is_a_warning() -> None:
    """The best link has 5.5547 bit/s/Hz over 5 MHz: 27.7735 Mbit/s.

    Sending 1.5 Mbit takes 54 ms and computing 0.5 s; the user alone needs 2 s. If both compute a
    part, it takes at least 0.433834 s.
    """
    assert not list(deadlines_can_be_met(loads(TASKS)))
    (warning,) = deadlines_can_be_met(loads(TASKS, overrides=["services.vision.deadline_s=0.4"]))
    assert warning == (
        "services.vision: each request is late: its deadline is 0.4 s, and the least that it can "
        "take is 0.433834 s"
    )
    never = ["services.vision.deadline_s=0.54", "offloading=always"]
    (warning,) = deadlines_can_be_met(loads(TASKS, overrides=never))
    assert warning.endswith("is 0.554008 s")
