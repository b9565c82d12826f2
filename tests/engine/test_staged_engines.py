"""Random scenarios of radio whose services have several stages: both engines, audit and replay."""

from __future__ import annotations

import pytest

from desim_uav.sample_path import draw
from desim_uav.world import World
from tests.engine.random_parts import Dice, accepted
from tests.engine.random_radio import audited, scenario
from tests.engine.random_tasks import with_uplinks
from tests.engine.replay import check_log
from tests.engine.test_radio_engines import flown
from tests.selection import by_default
from tests.staged import staged


def world_of(seed: int) -> World:
    """The world of a random scenario in which uploads and images have several stages."""

    def several(seed: int) -> dict[str, object]:
        mapping = scenario(seed)
        held = mapping["drones"]["radio"]["sharing"] == "held"
        own = {"upload": staged(held, seed), "image": staged(held, seed + 1)}
        offered = {name: own.get(name, one) for name, one in mapping["services"].items()}
        with_uplinks([mapping["drones"], *mapping["access_points"]], Dice(seed + 1_700_000))
        return mapping | {"services": offered}

    return accepted(several, seed)


@pytest.mark.parametrize("first", by_default([], range(0, 160, 16)))
def test_both_engines_are_equal(first: int) -> None:
    unlike = {seed: flown(world_of(seed), seed) for seed in range(first, first + 16)}
    assert {seed: found for seed, found in unlike.items() if found} == {}


@pytest.mark.parametrize("first", by_default([500], range(500, 580, 2), at_most=2))
def test_no_event_breaks_a_rule(first: int) -> None:
    for seed in range(first, first + 2):
        world = world_of(seed)
        for episode, log in enumerate(audited(world)):
            check_log(world, log, draw(world, 1, episode))
