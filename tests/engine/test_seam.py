"""The functions that each engine implements in its own way, and those called by address."""

from __future__ import annotations

import subprocess
import sys

import pytest

from desim_uav.engine.compiled import calls, simulation  # noqa: F401  (which import all engine code)
from desim_uav.engine.compiled.components import SLOTS
from desim_uav.rowcode.code_digest import STANDS_IN
from desim_uav.rules.rows import Constants

SEAM = {
    *("due.due", "due.undo", "due.nothing_before", "due.nothing_due", "due.run_until"),
    *("charging.hand_on_pads", "spots.find_users"),
}
"""The functions of the rules in whose place the compiled engine has others: seven (decision 1)."""

FORESEEN = {
    *("foresee", "foresee_in_air", "foresee_all", "recall_leg", "remember_leg", "better_us"),
    *("mark", "meet", "least_m"),
}
"""The kernels of the sky, which the SimPy engine calls with memory that grows (decision 21)."""


def test_the_seam_is_what_decision_1_lists():
    rules = [one for one in STANDS_IN if one.__module__.startswith("desim_uav.rules.")]
    names = {f"{one.__module__.rpartition('.')[2]}.{one.__qualname__}" for one in rules}
    assert names == SEAM and len(SEAM) <= 7


def test_all_other_functions_by_address_are_those_of_components():
    kinds = list(Constants.kinds)
    functions = {one.name for slot in SLOTS for one in slot.functions}
    assert set(kinds[kinds.index("foresee") :]) - functions == {*FORESEEN, "run"}


TRAIN = """
from desim_uav.learning.training import Training
from desim_uav.rowcode.compiled_apart import _CELLS
from desim_uav.scenario.load import load
from desim_uav.world import build_world

if __name__ == "__main__":
    Training(build_world(load("case8"), 0), 0, "batch").play(60)
    print(*(cell.name for cell in _CELLS.values() if cell.value.value))
"""


@pytest.mark.thorough
def test_case_8_is_trained_without_any_rule_that_is_compiled_apart():
    done = subprocess.run([sys.executable, "-c", TRAIN], capture_output=True, text=True, check=True)
    assert done.stdout.split() == []
