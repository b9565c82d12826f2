"""Random scenarios of radio: both engines are equal, nothing breaks a rule, and all of them end."""

from __future__ import annotations

from collections import Counter
from itertools import pairwise
from typing import Any

import numpy as np
import pytest

from desim_uav.engine.base import RunSettings
from desim_uav.engine.compiled import BatchSimulation
from desim_uav.sample_path import draw
from desim_uav.world import World
from tests.engine.helpers import some_command
from tests.engine.random_radio import audited, world_of
from tests.engine.replay import check_log
from tests.selection import by_default
from tests.verification.engines import differences, engines

SEEDS, AUDITED, TOGETHER = range(400), range(400, 480), range(1000, 1500)
"""The seeds of scenarios for each of the tests below."""
TOLD = RunSettings((), carry_over=False, keep_events=True)


def flown(world: World, seed: int) -> list[str]:
    """In what two episodes of both engines differ."""
    one, other = engines(world, (True,) * world.scenario.drones.count)
    return [name for episode in range(2) for name in differences(one, other, seed, episode)]


@pytest.mark.parametrize("first", by_default([0], range(0, len(SEEDS), 16)))
def test_both_engines_are_equal(first: int) -> None:
    unlike = {seed: flown(world_of(seed), seed) for seed in SEEDS[first : first + 16]}
    assert {seed: found for seed, found in unlike.items() if found} == {}


def parts(seeds: range, brief: int, size: int) -> list[Any]:
    """All seeds in parts of this size, of which the first is brief and runs by default."""
    begins = [seeds.start, *range(seeds.start + brief, seeds.stop, size)]
    spans = [range(*span) for span in pairwise([*begins, seeds.stop])]
    assert [seed for span in spans for seed in span] == list(seeds)
    return by_default(spans[:1], spans, at_most=2)


@pytest.mark.parametrize("seeds", parts(AUDITED, 6, 8))
def test_no_event_breaks_a_rule(seeds: range) -> None:
    """The audit after each event, and the log read by rules of its own."""
    for seed in seeds:
        world = world_of(seed)
        for log in audited(world):
            check_log(world, log)


def most_at_once(world: World) -> float:
    """The largest number of events in an instant, for each link of a drone and a user."""
    scenario = world.scenario
    links = (scenario.drones.count + len(scenario.access_points) + 1) * (len(world.homes) + 1)
    engine = BatchSimulation(world, TOLD._replace(ceilings=(True,) * scenario.drones.count))
    rng, shown = np.random.default_rng(0), engine.reset(draw(world, 1, 0))
    while not (shown.terminated or shown.truncated):
        shown = engine.step([some_command(world, mask, rng) for mask in shown.masks])
    return max(Counter(event[0] for event in engine.log.events or ()).values()) / links


@pytest.mark.parametrize("seeds", parts(TOGETHER, 6, 26))
def test_instants_end_where_drones_interfere(seeds: range) -> None:
    """Interference ends and begins with the drones that it makes others take, but not for ever."""
    for seed in seeds:
        assert most_at_once(world_of(seed, "co_channel")) < 4
