"""Random scenarios with tasks at processors: both engines are equal, and no event breaks a rule."""

from __future__ import annotations

from collections import Counter

import pytest

from desim_uav.engine.base import EpisodeLog
from tests.engine.random_radio import audited
from tests.engine.random_tasks import migrating_world_of, relaying_world_of, world_of
from tests.engine.test_everything import differing
from tests.selection import by_default

MANY = 400


@pytest.mark.parametrize("first", by_default([], range(0, MANY, 20), at_most=1))
def test_engines_are_equal(first: int) -> None:
    assert differing(range(first, first + 20), world_of) == {}


@pytest.mark.parametrize("seed", by_default([], range(1000, 1000 + MANY // 4), at_most=2))
def test_no_event_breaks_a_rule(seed: int) -> None:
    audited(world_of(seed))


@pytest.mark.parametrize("first", by_default([], range(0, MANY // 4, 20), at_most=1))
def test_engines_are_equal_if_results_are_relayed(first: int) -> None:
    assert differing(range(first, first + 20), relaying_world_of) == {}


@pytest.mark.parametrize("seed", by_default([], range(1000, 1000 + MANY // 4), at_most=2))
def test_no_relayed_result_breaks_a_rule(seed: int) -> None:
    audited(relaying_world_of(seed))


@pytest.mark.parametrize("first", by_default([], range(0, MANY // 4, 20), at_most=1))
def test_engines_are_equal_if_tasks_migrate(first: int) -> None:
    assert differing(range(first, first + 20), migrating_world_of) == {}


@pytest.mark.parametrize("seed", by_default([], range(1000, 1000 + MANY // 4), at_most=4))
def test_no_task_that_migrates_breaks_a_rule(seed: int) -> None:
    audited(migrating_world_of(seed))


@pytest.mark.thorough
def test_tasks_migrate() -> None:
    """A check of the checks: tasks move, turn to another drone, and arrive."""
    counted: Counter[str] = Counter()
    for seed in (1003, 1004, 1008):
        for log in audited(migrating_world_of(seed)):
            moving: dict[int, int] = {}
            for _, _, kind, drone, _, request, *_ in log.events or ():
                if kind == "move":
                    counted["turns"] += request in moving
                    moving[request] = drone
                elif kind == "stage":
                    counted["arrives"] += moving.pop(request, None) == drone
                counted[kind] += 1
    assert counted["move"] > counted["arrives"] > 15 and counted["turns"] > 0, counted


@pytest.mark.thorough
def test_results_are_relayed() -> None:
    """A check of the checks. Seeds 2 and 7 have rates that are held, and seed 5 has not."""
    for seed in (2, 5, 7):
        assert sum(map(relayed, audited(relaying_world_of(seed)))) > 0, seed


def relayed(log: EpisodeLog) -> int:
    """How often a drone begins to send a result that another one has computed."""
    sites: dict[int, int] = {}
    count = 0
    for _, _, kind, drone, _, request, *_, stage in log.events or ():
        if kind == "stage" and stage == 2:
            sites[request] = drone
        count += kind == "serve" and sites.get(request, drone) != drone
    return count


@pytest.mark.thorough
def test_much_happens_to_tasks() -> None:
    counted: Counter[str] = Counter()
    worlds = [world_of(seed) for seed in range(2000, 2005)]
    for world in (*worlds, relaying_world_of(2), relaying_world_of(7)):
        for log in audited(world):
            counted.update(event[2] for event in log.events or ())
            counted["restarts"] += sum(one.restarts for one in log.requests)
            counted["computed"] += sum(one.computing_us > 0 for one in log.requests)
    kinds = ("late", "handover", "crash", "complete", "restarts", "computed")
    assert all(counted[kind] >= 5 for kind in kinds), counted
