"""Random scenarios with groups, tasks and sensors: equal engines, and no event breaks a rule."""

from __future__ import annotations

from collections import Counter

import pytest

from tests.engine import test_saved
from tests.engine.random_everything import scenario, world_of
from tests.engine.random_parts import accepted
from tests.selection import by_default
from tests.verification.everything import MANY, examine, examined, parts_of


@pytest.mark.parametrize("seed", by_default([], range(MANY), at_most=3))
def test_engines_are_equal_and_no_event_breaks_a_rule(seed: int) -> None:
    examine(world_of(seed), seed)


@pytest.mark.parametrize("seed", by_default([], range(500, 540), at_most=2))
def test_a_saved_state_leads_to_the_same_rest(seed: int) -> None:
    """In both engines, from either to the other; all drones fly from cell to cell."""
    world = accepted(scenario, seed, lambda made: not (made.free or made.mixed))
    test_saved.check(world, seed)


@pytest.mark.thorough
def test_a_failure_is_told_by_its_seed(monkeypatch: pytest.MonkeyPatch) -> None:
    def breaks(*_: object) -> None:
        raise AssertionError("a rule is broken\nand more")

    monkeypatch.setattr("tests.verification.everything.examine", breaks)
    assert list(examined([3])) == [(3, "a rule is broken")]


@pytest.mark.thorough
def test_everything_is_drawn() -> None:
    """A check of the checks: each part of the model is in some scenarios, and missing in others."""
    counted = Counter(name for seed in range(60) for name in parts_of(world_of(seed).scenario))
    always = {"groups", "sensors"}
    assert all(counted[name] > 30 for name in (*always, "tasks")), counted
    parts = ("backhauls", "access points", "several types", "free flight", "mixed fleet")
    parts += ("interference", "by event", "carried over", "commanded shares", "wind", "batteries")
    assert all(4 <= counted[name] < 60 for name in parts), counted
