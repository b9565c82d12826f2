"""A saved state leads to the same rest of the episode in both engines, and in another process."""

from __future__ import annotations

import copy
import gc
import os
import pickle
import subprocess
import sys
from collections import namedtuple
from collections.abc import Callable, Iterator
from dataclasses import replace
from operator import itemgetter
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, Phase, given, settings
from hypothesis import strategies as st

from desim_uav.engine.base import RunSettings
from desim_uav.engine.choose import ENGINES, make_engine
from desim_uav.engine.compiled import calls
from desim_uav.engine.compiled.forks import Forks
from desim_uav.engine.compiled.pack import lacking
from desim_uav.engine.compiled.scratch import HEADERS
from desim_uav.engine.des.clock import Clock
from desim_uav.engine.episode import Engine
from desim_uav.engine.saved import SavedState
from desim_uav.engine.state import Buffers
from desim_uav.errors import ScenarioError, SimulationError, StateError
from desim_uav.rules.rows import State
from desim_uav.sample_path import draw
from desim_uav.scenario.load import from_mapping
from desim_uav.sky.rows import Sky
from desim_uav.world import World, build_world
from tests.engine import random_radio, random_tasks
from tests.engine.helpers import scenarios, some_command
from tests.engine.test_engine_copies import EVENTFUL, everything, stepped, world_of
from tests.selection import by_default

FAST = "users.mobility={kind: random_walk, speed_mps: 190.0, leg_s: 2.0}"
"""A walk on which the compiled engine runs out of memory in a step, and plays again."""


def new(name: str, world: World, **changes: Any) -> Any:
    ceilings = (True,) * world.scenario.drone_count
    settings = RunSettings(ceilings, world.scenario.episode.carry_over, keep_events=True)
    return make_engine(name, world, settings._replace(**changes))


def kinds_for(world: World, seed: int = 0) -> tuple[str, str]:
    """The engine to save in and the one to restore in; both are SimPy if only it runs a world."""
    if lacking(world):
        return "des", "des"
    return ENGINES[seed % 2], ENGINES[1 - seed % 2]


def rest(engine: Any, seed: int) -> list[Any]:
    """The rest of an episode under random commands, and all of the next one.

    The two engines may add the events of an instant to the log in another order, until it ends.
    """
    told = [engine.latest, in_order(engine), *to_the_end(engine, seed), in_order(engine)]
    told += [engine.carried(), engine.reset(draw(engine.world, 5, 9))]
    return [*told, *to_the_end(engine, seed), in_order(engine)]


def to_the_end(engine: Any, seed: int) -> Iterator[Any]:
    """Step by random commands, and yield at each epoch."""
    rng = np.random.default_rng(seed)
    while not (engine.terminated or engine.truncated):
        masks = engine.latest.masks
        yield engine.step([some_command(engine.world, mask, rng) for mask in masks])


def in_order(engine: Any) -> tuple[Any, str]:
    """The snapshot and all else that can be asked of any engine, with its events in order."""
    log = engine.log
    if log.events is not None:
        engine.log = replace(log, events=sorted(log.events, key=itemgetter(0, 1, 3, 4)))
    told = everything(engine)
    engine.log = log
    return engine.latest, told


def somewhere(name: str, world: World, seed: int) -> Any:
    """An engine at a random epoch of its second episode, which may be its end."""
    engine, rng = new(name, world), np.random.default_rng(seed)
    engine.reset(draw(world, seed, 0))
    stepped(engine, seed, most=int(rng.integers(0, world.scenario.episode.steps + 1)))
    engine.reset(draw(world, seed, 1))
    for _ in range(int(rng.integers(0, world.scenario.episode.steps + 1))):
        if not (engine.terminated or engine.truncated):
            engine.step([some_command(world, mask, rng) for mask in engine.latest.masks])
    return engine


def check(world: World, seed: int) -> tuple[SavedState, list[Any]]:
    """Save in one engine, and restore in both of them; return the state and what comes after."""
    first, second = kinds_for(world, seed)
    engine = somewhere(first, world, seed)
    saved = engine.save()
    fresh = new(first, world)
    fresh.carry(saved.before)
    fresh.reset(saved.path)
    for commands in world.commands.played(saved.commands, saved.numbers):
        fresh.step(commands)
    assert saved.digest() == fresh.save().digest()
    used = new(second, world)
    used.reset(draw(world, 8, 0))
    stepped(used, seed, most=2)
    twins = [new(first, world), used]
    for twin in twins:
        assert twin.restore(saved) == engine.latest
        assert twin.save().digest() == saved.digest()
    went_on = rest(engine, seed)
    assert [rest(twin, seed) == went_on for twin in twins] == [True, True]
    assert twins[0].restore(saved) == went_on[0]
    assert in_order(twins[0]) == went_on[1]
    return saved, went_on


def random_worlds(count: int) -> list[tuple[World, int]]:
    """Worlds of random scenarios, the same every time."""
    found: list[tuple[World, int]] = []

    @settings(
        max_examples=count,
        deadline=None,
        derandomize=True,
        database=None,
        phases=[Phase.generate],
        suppress_health_check=list(HealthCheck),
    )
    @given(scenarios(), st.integers(0, 2**31))
    def collect(scenario: dict[str, Any], seed: int) -> None:
        try:
            found.append((build_world(from_mapping(scenario), seed), len(found)))
        except ScenarioError:
            return

    collect()
    return found


def test_in_both_engines():
    for world, seed in random_worlds(5):
        check(world, seed)


@pytest.mark.thorough
def test_in_both_engines_with_radio():
    for seed in range(2):
        check(random_radio.world_of(seed), seed)


@pytest.mark.thorough
@pytest.mark.parametrize("seed", [4003])
def test_in_both_engines_with_tasks(seed: int):
    check(random_tasks.world_of(seed), seed)


@pytest.mark.thorough
@pytest.mark.parametrize("seed", [4005])
def test_results_that_are_relayed(seed: int):
    check(random_tasks.relaying_world_of(seed), seed)


@pytest.mark.thorough
@pytest.mark.parametrize("seed", [1004])
def test_tasks_that_migrate(seed: int):
    check(random_tasks.migrating_world_of(seed), seed)


@pytest.mark.parametrize("count", by_default([], [10, 100], at_most=1))
@pytest.mark.parametrize("kind", ["plain", "radio"])
def test_random_scenarios_in_this_and_another_process(kind: str, count: int, tmp_path: Path):
    """So many of each kind; another process goes on in the same engine or in the other one."""
    if kind == "plain":
        worlds = random_worlds(count + 20)[:count]
    else:
        worlds = [(random_radio.world_of(seed), seed) for seed in range(count)]
    assert len(worlds) == count
    kept = [(seed, *check(world, seed)) for world, seed in worlds]
    assert elsewhere(kept, tmp_path) == []


@pytest.mark.thorough
def test_in_another_process(tmp_path: Path):
    kept = [(seed, *check(world, seed)) for world, seed in random_worlds(2)]
    assert elsewhere(kept, tmp_path) == []


def elsewhere(kept: list[tuple[int, SavedState, list[Any]]], folder: Path) -> list[tuple[int, str]]:
    """The seeds and engines of which another process finds another rest of the episode."""
    script = (
        "import pickle, sys; from tests.engine.test_saved import kinds_for, new, rest\n"
        "unlike = []\n"
        "for seed, saved, went_on in pickle.load(open(sys.argv[1], 'rb')):\n"
        "    name = kinds_for(saved.world, seed // 2)[0]\n"
        "    engine = new(name, saved.world)\n"
        "    engine.restore(saved)\n"
        "    if rest(engine, seed) != went_on:\n"
        "        unlike.append((seed, name))\n"
        "pickle.dump(unlike, open(sys.argv[2], 'wb'))\n"
    )
    files = [str(folder / name) for name in ("kept", "unlike")]
    Path(files[0]).write_bytes(pickle.dumps(kept))
    root = Path(__file__).parents[2]
    path = os.pathsep.join([str(root), os.environ.get("PYTHONPATH", "")])
    subprocess.run(
        [sys.executable, "-c", script, *files], check=True, env={**os.environ, "PYTHONPATH": path}
    )
    unlike: list[tuple[int, str]] = pickle.loads(Path(files[1]).read_bytes())
    return unlike


# ---- what a saved state is


@pytest.mark.parametrize("name", ENGINES)
def test_it_does_not_change(name: str):
    world = world_of()
    engine = somewhere(name, world, 3)
    saved = engine.save()
    digest, log = saved.digest(), everything(engine)
    other = new(name, world)
    for each in (engine, other):
        each.restore(saved)
        stepped(each, 1)
    assert engine.save().digest() != digest
    restored = new(name, world)
    restored.restore(saved)
    assert (saved.digest(), everything(restored)) == (digest, log)
    assert pickle.loads(pickle.dumps(saved)).digest() == digest
    assert copy.deepcopy(saved) is saved


@pytest.mark.parametrize("name", ENGINES)
def test_there_is_none_before_an_episode_and_after_a_failure(name: str):
    world = world_of()
    engine = new(name, world)
    with pytest.raises(SimulationError, match="save: no episode"):
        engine.save()
    engine.restore(somewhere(name, world, 1).save())
    engine.carry(None)
    with pytest.raises(SimulationError, match="save: no episode"):
        engine.save()


@pytest.mark.parametrize("name", ENGINES)
def test_states_of_others_are_refused(name: str):
    world = world_of()
    saved = somewhere("des", world, 1).save()
    other = new(name, world_of("users.count=20"))
    for engine, problem in (
        (other, "another world"),
        (new(name, world, carry_over=False), "carry_over"),
        (new(name, world, ceilings=(False,) * 3), ""),
    ):
        if not problem:
            engine.restore(saved)
            above = engine.save()
            continue
        with pytest.raises(StateError, match=problem):
            engine.restore(saved)
    with pytest.raises(StateError, match="above the ceiling"):
        new(name, world).restore(above)
    bare = new(name, world, keep_events=False)
    bare.restore(saved)
    with pytest.raises(StateError, match="without events"):
        new(name, world).restore(bare.save())


def test_a_state_of_other_rows_is_refused(monkeypatch: pytest.MonkeyPatch):
    pickled = pickle.dumps(somewhere("des", world_of(), 1).save())
    other = namedtuple("other", "fields")  # type: ignore[misc]
    monkeypatch.setattr("desim_uav.engine.saved._values", lambda cls: other)
    with pytest.raises(pickle.UnpicklingError, match="use the version that wrote it"):
        pickle.loads(pickled)


@pytest.mark.thorough
def test_a_restored_engine_finds_more_room_for_what_does_not_fit():
    world = world_of(FAST)
    engine = make_engine("des", world, EVENTFUL)
    engine.reset(draw(world, 0, 0))
    other: Any = make_engine("batch", world, EVENTFUL)
    other.restore(engine.save())
    room = other.buffers
    assert stepped(other, 2) == stepped(engine, 2)
    assert other.buffers > room


def test_events_of_one_instant_keep_their_order():
    clock = Clock(3, now_us=7)
    for slot, t_us, key in ((0, 9, 5), (1, 9, 4), (2, 8, 6)):
        clock.due(slot, t_us, key)
    assert clock.scheduled() == ((2, 8, 6), (1, 9, 4), (0, 9, 5))
    clock.undo(1)
    clock.due(0, 10, 1)
    assert clock.scheduled() == ((2, 8, 6), (0, 10, 1))


# ---- memory


WAYS: tuple[Callable[[Any], Any], ...] = (
    copy.deepcopy,
    lambda engine: pickle.loads(pickle.dumps(engine)),
    lambda engine: engine.fork(2)[1],
)


def shuffled(operations: int, seed: int) -> None:
    """Copy, pickle, fork, save, restore, step and drop engines in a random order.

    Each engine has beside it the commands of its episode, by which a new one is at the same state.
    """
    world, rng = world_of("episode.steps=9"), np.random.default_rng(seed)
    path = draw(world, 1, 0)
    pool: list[tuple[Any, list[list[int]]]] = []
    states: list[tuple[Any, list[list[int]]]] = []
    for _ in range(operations):
        what = rng.integers(7)
        if what == 0 or not pool:
            engine = make_engine(ENGINES[rng.integers(2)], world, EVENTFUL)
            engine.reset(path)
            pool.append((engine, []))
            continue
        k = int(rng.integers(len(pool)))
        engine, told = pool[k]
        if what == 1:
            pool.append((WAYS[rng.integers(len(WAYS))](engine), list(told)))
        elif what == 2:
            states.append((engine.save(), list(told)))
        elif what == 3 and states:
            state, then = states[int(rng.integers(len(states)))]
            if rng.random() < 0.3:
                state = pickle.loads(pickle.dumps(state))
            engine.restore(state)
            pool[k] = engine, list(then)
        elif what == 4 and len(pool) > 2:
            del pool[k], engine
            gc.collect()
        elif not (engine.terminated or engine.truncated):
            commands = [some_command(world, mask, rng) for mask in engine.latest.masks]
            engine.step(commands)
            told.append(commands)
    for engine, told in pool:
        twin = make_engine("batch", world, EVENTFUL)
        twin.reset(path)
        for commands in told:
            twin.step(commands)
        assert everything(engine) == everything(twin)


@pytest.mark.thorough
def test_any_order_of_copies_pickles_and_ends():
    shuffled(60, 0)


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(1, 4))
def test_many_orders_of_copies_pickles_and_ends(seed: int):
    shuffled(120, seed)


# ---- compiled forks


def forked(world: World, count: int) -> tuple[Any, Forks, list[Engine]]:
    settings = RunSettings((True,) * world.scenario.drone_count, True, keep_steps=False)
    engine: Any = make_engine("batch", world, settings)
    engine.reset(draw(world, 0, 0))
    engine.step([4] * len(engine.drones))
    forks = Forks(engine, count)
    forks.take()
    return engine, forks, engine.fork(count)


OF_SCRATCH = [*HEADERS, (State.byte_of["sky"] + Sky.byte_of["scratch_at"]) // 8]
"""The words of a state that depend on where it is in memory."""


def test_forks_are_what_copies_are():
    world = world_of()
    engine, forks, copies = forked(world, 4)
    before = engine.memory.copy()
    for seed in range(2):
        rng = np.random.default_rng(seed)
        for _ in range(4):
            commands = rng.integers(0, 7, (4, 3))
            assert forks.step(commands) == 0
            for each, block, own in zip(copies, forks.blocks, commands.tolist(), strict=True):
                shown = each.step(own)
                ours, theirs = (
                    np.delete(words, OF_SCRATCH)
                    for words in (block, each.memory)  # type: ignore[attr-defined]
                )
                assert np.array_equal(ours, theirs)
            seen = [feature for one in shown.observations for feature in one.features]
            assert forks.outputs.observations[3].tolist() == seen
        assert np.array_equal(engine.memory, before)
        forks.take()
        engine.fork_into(copies)
    with pytest.raises(ValueError, match="commands must be from 0 to"):
        forks.step(np.full((4, 3), 99))


def test_forks_without_room_are_taken_anew():
    engine, forks, _ = forked(world_of(FAST), 3)
    engine.buffers, engine.leg_buffer = Buffers(0, 8, 8), 16
    saved = engine.save()
    engine._make_room()
    engine._take_rows(saved.rows)
    due = np.array(saved.rows.due, np.int64)
    calls.resume(*engine.addresses(), due)
    forks.take()
    commands = np.full((3, 3), 4)
    assert forks.step(commands) == 3
    for _ in range(12):
        forks.more_room()
        forks.take()
        if forks.step(commands) == 0:
            break
    twin = new("batch", engine.world, keep_events=False, keep_steps=False)
    twin.restore(saved)
    twin.step([4, 4, 4])
    assert forks.outputs.numbers[0, 1:4].tolist() == list(twin.measures())


def test_forks_that_cannot_be_stepped_stay_as_they_are():
    world = world_of()
    engine, forks, _ = forked(world, 2)
    hover = np.full((2, 3), 4)
    for shape in ((3, 3), (2, 2), (6,)):
        with pytest.raises(ValueError, match="must have the shape"):
            forks.step(np.full(shape, 4))
    for _ in range(2 * world.scenario.episode.steps):
        forks.step(hover, np.array([True, False]))
    assert forks.outputs.over.tolist() == [[False, True, False], [False, False, False]]
    ended = forks.blocks.copy()
    forks.step(hover, np.array([True, False]))
    assert np.array_equal(forks.blocks, ended)
    for way in (copy.copy, copy.deepcopy, pickle.dumps):
        with pytest.raises(TypeError, match="forks cannot be copied"):
            way(forks)
    untaken = Forks(engine, 2)
    assert untaken.step(hover) == 0
    assert not untaken.blocks.any()
    engine.carry(None)
    with pytest.raises(SimulationError, match="take: no episode"):
        untaken.take()


def test_siblings_of_other_settings_are_refused():
    world = world_of()
    engine, _, _ = forked(world, 1)
    with pytest.raises(SimulationError, match="another world or has other settings"):
        engine.fork_into([new("batch", world)])
    fresh: Any = make_engine("batch", world, engine.settings)
    with pytest.raises(SimulationError, match="no episode has begun"):
        fresh.fork_into([engine])
