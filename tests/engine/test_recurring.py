"""What is remembered of legs over users who stand: nothing may differ."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from desim_uav.engine import leg_memory as of_threads
from desim_uav.engine.base import RunSettings
from desim_uav.engine.choose import make_engine
from desim_uav.engine.compiled import simulation
from desim_uav.engine.des import Simulation, skies
from desim_uav.model.mobility.mobility import Walks
from desim_uav.sample_path import draw
from desim_uav.scenario.load import from_mapping
from desim_uav.sky.leg_memory import LEGS_AT
from desim_uav.world import World, build_world
from tests.engine import random_radio
from tests.engine.helpers import merged, some_command
from tests.engine.random_parts import accepted
from tests.engine.test_cities import ITU, mapping
from tests.engine.test_steady import WORLDS, by_radio, standing
from tests.engine.towns import told

pytestmark = pytest.mark.thorough
"""Both engines compile the kernels of lines of sight, which takes long."""

LEVELS = {"min_altitude_m": 30, "step_m": 20}
MORE: Mapping[str, Mapping[str, Any]] = {
    **WORLDS,
    "a3 over levels": standing(map={"levels": LEVELS}, association={"kind": "a3"}),
    "by event": standing(decisions={"kind": "event", "patience_s": 20}),
    "free": standing(drones={"motion": {"kind": "bang_coast_bang", "space": "free"}}),
    "shadowing": by_radio(shadowing={"los_db": 2, "nlos_db": 6}),
}
FORGOTTEN = ("drawn", "interference", "walking", "shadowing")
"""The worlds in which nothing is remembered."""


def world_of(name: str, seed: int = 0) -> World:
    keys = merged(mapping(**ITU), MORE[name])
    if name != "shadowing":
        keys["drones"]["radio"] = {**keys["drones"]["radio"], "shadowing": None}
    return build_world(from_mapping(keys), seed)


def settings_of(world: World) -> RunSettings:
    """Settings with events, in which an episode may begin in the middle of legs."""
    return told(world)._replace(carry_over=True)


def batch(world: World) -> Any:
    return make_engine("batch", world, settings_of(world))


def forgetful(world: World) -> Any:
    """An engine that recalls nothing."""
    engine = Simulation(world, settings_of(world))
    engine.constants.recall_leg = lambda *of_leg: -1
    engine.constants.remember_leg = lambda *of_leg: None
    return engine


def counted(engine: Any) -> list[int]:
    """A list to which a SimPy engine adds what it recalls: numbers of changes, or -1."""
    counts: list[int] = []
    recall = engine.constants.recall_leg

    def recall_and_count(*of_leg: int) -> int:
        counts.append(recall(*of_leg))
        return counts[-1]

    engine.constants.recall_leg = recall_and_count
    return counts


def step(engine: Any, rng: np.random.Generator) -> None:
    """Make a step by some actions."""
    engine.step([some_command(engine.world, mask, rng) for mask in engine.latest.masks])


def is_over(engine: Any) -> bool:
    return bool(engine.latest.terminated or engine.latest.truncated)


def flight(engine: Any, between: Callable[[Any], None] = lambda engine: None) -> Iterator[Any]:
    """The digests of all states in two episodes with the same actions, and the events of each."""
    for episode in range(2):
        rng = np.random.default_rng(3)
        engine.reset(draw(engine.world, 0, episode))
        while not is_over(engine):
            between(engine)
            yield engine.save().digest()
            step(engine, rng)
        yield [tuple(event) for event in engine.log.events or ()]


def flown(engine: Any) -> list[Any]:
    return list(flight(engine))


@pytest.mark.parametrize("name", MORE)
def test_legs_that_are_recalled_are_as_if_they_were_foreseen_anew(name: str) -> None:
    for seed in range(2):
        world = world_of(name, seed)
        expected, engine = flown(forgetful(world)), Simulation(world, settings_of(world))
        counts = counted(engine)
        assert flown(engine) == expected
        assert (counts == []) == (name in FORGOTTEN)
        assert sum(count >= 0 for count in counts) > 5 or name in (*FORGOTTEN, "free")
        for _ in range(2):  # the second one recalls what the first one has found
            assert flown(batch(world)) == expected


@pytest.mark.parametrize("name", ["a3 over levels", "charging"])
def test_a_state_is_restored_over_legs_that_are_recalled(name: str) -> None:
    world = world_of(name)
    expected = flown(forgetful(world))

    def come_back(engine: Any) -> None:
        """Go on by other actions, and then from the same state."""
        saved, rng = engine.save(), np.random.default_rng(engine.state.step)
        for _ in range(2):
            if not is_over(engine):
                step(engine, rng)
        engine.restore(saved)

    for engine in (Simulation(world, settings_of(world)), batch(world), batch(world)):
        assert list(flight(engine, come_back)) == expected


def ends(engine: Any) -> list[Any]:
    """Fly an episode on to its end by the same actions, and return its events."""
    rng = np.random.default_rng(7)
    while not is_over(engine):
        step(engine, rng)
    return [tuple(event) for event in engine.log.events or ()]


def test_forks_go_on_in_other_threads() -> None:
    world = world_of("a3 over levels")
    engines = forgetful(world), batch(world)
    for engine in engines:
        flown(engine)
        rng = np.random.default_rng(3)
        engine.reset(draw(world, 0, 0))
        for _ in range(4):
            step(engine, rng)
    forks = engines[1].fork(4)
    with ThreadPoolExecutor(2) as pool:
        later = list(pool.map(ends, forks))
    assert later == [ends(engines[0])] * 4 == [ends(engines[1])] * 4


def test_nothing_is_recalled_of_users_at_other_places() -> None:
    """Users stand elsewhere in a sample path of one's own, some of them with the same classes."""
    world = world_of("levels")
    paths = [draw(world, 0, 0)] * 3
    legs = paths[1].walks.legs.copy()
    legs["x_m"] = np.clip(legs["x_m"] + 3.0, 0.0, 499.0)
    paths[1] = replace(paths[1], walking=Walks(legs, paths[1].walks.offsets))
    first = forgetful(world)
    others = Simulation(world, settings_of(world)), batch(world), batch(world)
    counts = counted(others[0])
    expected, recalled = [], []
    for path in paths:
        first.carry(None)
        first.reset(path)
        expected.append(ends(first))
        for engine in others:
            engine.carry(None)
            engine.reset(path)
            assert ends(engine) == expected[-1]
        recalled.append(sum(count >= 0 for count in counts))
    assert expected[0] == expected[2] != expected[1]
    assert recalled[0] == recalled[1] and recalled[2] - recalled[1] == len(counts) // 2


def test_worlds_take_turns_in_a_thread() -> None:
    worlds = [world_of("a3 over levels", seed) for seed in range(2)]
    expected = [flown(forgetful(world)) for world in worlds]
    for _ in range(2):
        flights = [flight(batch(world)) for world in worlds]
        assert list(zip(*flights, strict=True)) == list(zip(*expected, strict=True))


def test_threads_remember_on_their_own() -> None:
    world = world_of("a3 over levels")
    expected = flown(forgetful(world))
    engines = [batch(world) for _ in range(4)]
    with ThreadPoolExecutor(2) as pool:
        assert list(pool.map(flown, engines)) == [expected] * 4


@pytest.mark.parametrize("engine_of", [lambda world: Simulation(world, settings_of(world)), batch])
def test_a_small_memory_forgets(engine_of: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(of_threads, "WORDS", LEGS_AT + 300)
    world = world_of("a3 over levels")

    def flown_here() -> tuple[list[Any], int]:
        return flown(engine_of(world)), of_threads.known_legs()

    with ThreadPoolExecutor(1) as pool:
        shown, known = pool.submit(flown_here).result()
    assert shown == flown(forgetful(world)) and 0 < known < 20


def test_too_little_room_for_what_is_recalled_is_made_larger(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    world = world_of("a3 over levels")
    expected, first = flown(forgetful(world)), Simulation(world, settings_of(world))
    assert flown(first) == flown(batch(world)) == expected
    monkeypatch.setattr(skies, "CHANGES", 1)
    second = Simulation(world, settings_of(world))
    second.constants.scene.number = first.constants.scene.number
    counts = counted(second)
    assert flown(second) == expected
    assert min(counts) >= 0 and max(counts) > 1
    monkeypatch.setattr(simulation, "_most_crossings", lambda world: 1)
    narrow = batch(world)
    assert narrow.buffers.crossings == 1
    assert flown(narrow) == expected
    assert narrow.buffers.crossings > 1


def still(seed: int) -> dict[str, Any]:
    """A random scenario in which users stand, and buildings may block lines of sight."""
    keys = random_radio.scenario(seed, "none")
    keys["users"]["mobility"] = {"kind": "static"}
    keys["drones"]["radio"] |= {"shadowing": None, "line_of_sight": "buildings"}
    return keys


@pytest.mark.parametrize("first", range(0, 40, 10))
def test_random_scenarios_are_as_if_nothing_was_recalled(first: int) -> None:
    recalled = 0
    for seed in range(first, first + 10):
        world = accepted(still, seed)
        expected, engine = flown(forgetful(world)), Simulation(world, settings_of(world))
        counts = counted(engine)
        assert flown(engine) == flown(batch(world)) == flown(batch(world)) == expected
        recalled += sum(count >= 0 for count in counts)
    assert recalled > 20
