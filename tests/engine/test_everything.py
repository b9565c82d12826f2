"""Everything at once, at random: both engines against each other, and the audit after each event.

``random_all`` draws fleets, batteries of all kinds, charging, free flight or cells or both, cruise
speeds, wind, separation, decisions by clock and by event, episodes that drones carry over or begin
afresh, mobility, demand, services, radio and access points.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import suppress
from typing import Any

import numpy as np
import pytest

from desim_uav.errors import ScenarioError
from desim_uav.registry import names
from desim_uav.scenario.load import from_mapping
from desim_uav.scenario.schema import Scenario
from desim_uav.world import World
from tests.engine import random_all
from tests.engine.random_all import world_of
from tests.engine.random_radio import audited
from tests.verification.engines import differences, engines

MANY = 400
OF_SENSORS = {"sensing", "age"}
"""The kinds of demand and reward that ``random_sensors`` draws."""

AUDITED_IN = 4
"""In how many scenarios one is audited, which takes many times longer."""


def unlike(seed: int, make: Callable[[int], World] = world_of) -> list[str]:
    """In what two episodes of both engines differ, some of whose drones have no ceiling."""
    world, rng = make(seed), np.random.default_rng(seed)
    ceilings = tuple((rng.random(world.scenario.drone_count) < 0.5).tolist())
    one, other = engines(world, ceilings)
    return [name for episode in range(2) for name in differences(one, other, seed, episode)]


def differing(seeds: range, make: Callable[[int], World]) -> dict[int, list[str]]:
    """The seeds of which both engines differ, and in what."""
    return {seed: names for seed in seeds if (names := unlike(seed, make))}


def check(seeds: range) -> None:
    """Compare the engines, and audit a part of the scenarios; all are tried."""
    found: dict[int, Any] = {}
    for seed in seeds:
        try:
            if names := unlike(seed):
                found[seed] = names
            elif seed % AUDITED_IN == 0:
                audited(world_of(seed))
        except AssertionError as broken:
            found[seed] = str(broken).partition("\n")[0]
    assert found == {}


@pytest.mark.thorough
@pytest.mark.parametrize("first", range(0, 30, 10))
def test_engines_are_equal_and_no_event_breaks_a_rule(first: int):
    check(range(first, first + 10))


@pytest.mark.slow
@pytest.mark.parametrize("first", range(30, MANY, 10))
def test_many_are_equal_and_no_event_breaks_a_rule(first: int):
    check(range(first, first + 10))


@pytest.mark.thorough
def test_everything_is_drawn_and_much_is_accepted():
    drawn: Counter[tuple[str, Any]] = Counter()
    for seed in range(150):
        made = random_all.one_of_all(seed)
        with suppress(ScenarioError):
            scenario = from_mapping(made)
            drawn.update(set(_kinds(made, scenario)))
    assert drawn["accepted", True] >= 75
    for slot in ("mobility", "demand", "battery", "charging", "observation", "reward", "sharing"):
        known = set(names(slot)) - {"trace", "coverage"} - OF_SENSORS
        assert known <= {kind for name, kind in drawn if name == slot}, slot
    pairs = {
        (one, other)
        for one in ("free", "mixed", "chooses", "event", "carried", "carried by event", "windy")
        for other in (True, False)
    }
    assert pairs <= set(drawn)
    assert all(count >= 2 for count in drawn.values())


def _kinds(made: dict[str, Any], scenario: Scenario) -> Iterator[tuple[str, Any]]:
    """What is in an accepted scenario."""
    yield "accepted", True
    yield "free", scenario.free
    chosen = [getattr(drones.motion, "cruise", None) for drones in scenario.fleet]
    yield "chooses", scenario.free and any(chosen)
    yield "mixed", scenario.mixed
    yield "event", scenario.decisions.by_event
    yield "carried", scenario.episode.carry_over
    yield "carried by event", scenario.episode.carry_over and scenario.decisions.by_event
    yield "windy", any(scenario.wind_mps)
    yield "on_conflict", scenario.separation_m and scenario.on_conflict
    yield "mobility", made["users"]["mobility"]["kind"]
    yield "charging", made["stations"].get("charging", {}).get("kind", "constant")
    for slot in ("demand", "observation", "reward"):
        yield slot, made[slot]["kind"]
    for each in made["drones"]:
        yield "battery", (each["battery"] or {}).get("kind")
        yield "sharing", each.get("radio", {}).get("sharing")
        yield "interference", str(each.get("radio", {}).get("interference"))
