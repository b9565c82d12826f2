"""Scratch memory: each thread has its own, and no environment pays for it."""

from __future__ import annotations

import pickle
from concurrent.futures import ThreadPoolExecutor
from copy import deepcopy
from functools import partial
from typing import Any

import numpy as np
import pytest

from desim_uav import UavParallelVectorEnv
from desim_uav.engine.base import RunSettings
from desim_uav.engine.compiled import BatchSimulation
from desim_uav.engine.compiled.scratch import scratch
from desim_uav.rowcode.packing import headers_of, packed, packed_apart
from desim_uav.rowcode.rows import Row, Table, blank, row
from desim_uav.sample_path import draw
from desim_uav.scenario.load import load
from desim_uav.shipped import scenario_path
from desim_uav.world import World, build_world

BYTES = 24_496
"""What the state of an environment of case 8 takes: a field more in its rows has to be worth it."""


@row
class Inner(Row):
    scratch = ("notes",)
    kept: Table[int]
    notes: Table[float]


@row
class Outer(Row):
    scratch = ("marks",)
    marks: Table[int]
    inner: Inner


def test_scratch_is_laid_out_apart_from_a_row():
    outer: Any = blank(Outer)
    outer.marks, outer.inner.kept, outer.inner.notes = Table([7] * 5), Table([1, 2]), Table([0.5])
    block, words = packed_apart(outer)
    assert words == 5 + 1
    assert len(block) == len(packed(outer)) - words
    assert headers_of(Outer) == (0, 3)
    # As if scratch began where the block does; the position of notes is that from the inner row.
    assert block[[0, 1]].tolist() == [0, 5]
    assert block[[3, 4]].tolist() == [8 * (5 - 2), 1]


def world_of(name: str) -> World:
    return build_world(load(scenario_path(name)), 0)


def engine_of(world: World) -> BatchSimulation:
    engine = BatchSimulation(world, RunSettings((True,) * world.scenario.drone_count, True))
    engine.reset(draw(world, 1, 0))
    return engine


def flown(engine: BatchSimulation, steps: int = 8) -> list[Any]:
    """What an engine shows and logs in its next steps, by commands that depend on it alone."""
    rng, shown = np.random.default_rng(5), []
    for _ in range(steps):
        commands = [rng.choice(np.flatnonzero(mask)) for mask in engine.snapshot().masks]
        shown.append(engine.step([int(one) for one in commands]))
    return [shown, engine.log.requests]


def test_a_state_of_case_8_takes_little_memory():
    with_env = UavParallelVectorEnv("case8", 2, world_seed=0)
    with_env.reset(seed=0)
    assert all(own.engine.memory.nbytes <= BYTES for own in with_env.sessions)
    with_env.close()


def test_each_thread_has_scratch_of_its_own():
    with ThreadPoolExecutor(1) as pool:
        assert pool.submit(scratch).result() != scratch()


@pytest.mark.parametrize("name", ["case1", "case8"])
def test_threads_play_as_one_thread_does(name: str):
    world = world_of(name)
    expected = flown(engine_of(world))
    engines = [engine_of(world) for _ in range(4)]
    with ThreadPoolExecutor(2) as pool:
        assert all(each == expected for each in pool.map(flown, engines))


def test_environments_of_other_sizes_may_use_the_same_scratch_between_steps():
    one, other = engine_of(world_of("case8")), engine_of(world_of("case1"))
    alone = [flown(deepcopy(one)), flown(deepcopy(other))]
    rng = [np.random.default_rng(5) for _ in range(2)]
    shown: list[Any] = [[], []]
    for _ in range(8):
        for k, engine in enumerate((one, other)):
            commands = [rng[k].choice(np.flatnonzero(mask)) for mask in engine.snapshot().masks]
            shown[k].append(engine.step([int(each) for each in commands]))
    assert [[shown[0], one.log.requests], [shown[1], other.log.requests]] == alone


@pytest.mark.parametrize(
    "copied", [deepcopy, lambda engine: pickle.loads(pickle.dumps(engine))], ids=["copy", "pickle"]
)
def test_a_copy_goes_on_in_another_thread(copied: Any):
    engine = engine_of(world_of("case8"))
    flown(engine, 2)
    other = copied(engine)
    with ThreadPoolExecutor(1) as pool:
        elsewhere = pool.submit(partial(flown, other)).result()
    assert elsewhere == flown(engine)
