"""Random scenarios with sensors: both engines are equal, and no event breaks a rule."""

from __future__ import annotations

from collections import Counter
from functools import partial
from typing import Any

import pytest

from tests.engine import random_sensors, test_saved
from tests.engine.random_parts import accepted
from tests.engine.random_radio import audited
from tests.engine.random_sensors import world_of
from tests.engine.test_everything import differing
from tests.selection import by_default

MANY = 400


@pytest.mark.parametrize("first", by_default([], range(0, MANY, 20), at_most=1))
def test_engines_are_equal(first: int) -> None:
    assert differing(range(first, first + 20), world_of) == {}


def shown_all(seed: int) -> dict[str, Any]:
    """A random scenario with sensors whose drones are told and paid for ages."""
    made = random_sensors.scenario(seed)
    ground = any(each.get("delivered") == "ground" for each in made["services"].values())
    load = {"load_mbit": 2.5} if ground else {}
    kind = "radar" if seed % 2 else "local"
    made["observation"] = {"kind": kind, **load, **({"age_s": 40} if kind == "radar" else {})}
    made["reward"] = {"kind": "qoe", "age": 0.7}
    return made


@pytest.mark.parametrize("first", by_default([], range(5000, 5020, 10), at_most=1))
def test_engines_show_and_pay_the_same(first: int) -> None:
    assert differing(range(first, first + 10), partial(accepted, shown_all)) == {}


@pytest.mark.parametrize("seed", by_default([], range(1000, 1000 + MANY // 4), at_most=2))
def test_no_event_breaks_a_rule(seed: int) -> None:
    audited(world_of(seed))


@pytest.mark.parametrize("seed", by_default([], [3003, 3004, 3005, 3006]))
def test_a_saved_state_leads_to_the_same_rest(seed: int) -> None:
    test_saved.check(world_of(seed), seed)


@pytest.mark.thorough
def test_much_happens_to_updates() -> None:
    counted: Counter[str] = Counter()
    for seed in range(2000, 2004):
        for log in audited(world_of(seed)):
            counted.update(event[2] for event in log.events or ())
    assert all(counted[kind] >= 5 for kind in ("generate", "drop", "deliver")), counted
