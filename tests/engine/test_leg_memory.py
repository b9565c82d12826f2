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
from desim_uav.rowcode.rows import Table, address, blank, place
from desim_uav.rowcode.views import in_memory, zeros
from desim_uav.sample_path import draw
from desim_uav.scenario.load import from_mapping
from desim_uav.sky.leg_memory import (
    COUNT,
    DRAFT,
    END,
    LEGS_AT,
    SLOTS,
    new_memory,
    recall_leg,
    remember_leg,
)
from desim_uav.sky.rows import Change, LegRow, Propagation, Scene, Sky
from desim_uav.world import World, build_world
from tests.engine import random_radio
from tests.engine.helpers import merged, some_command
from tests.engine.random_parts import accepted
from tests.engine.test_cities import ITU, mapping
from tests.engine.test_steady import WORLDS, by_radio, standing
from tests.engine.towns import told

USERS, ROOM = 9, 4
"""One user more than a word has classes, and the room for changes of the kernels' tests."""


# ---- the kernels


class Asked:
    """A sky of two senders with one radio, whose legs are asked for."""

    def __init__(self, words: int = LEGS_AT + 200) -> None:
        scene, sky = blank(Scene), blank(Sky)
        scene.number, scene.groups = 7, Table([0] * USERS)
        scene.radios = Table(blank(Propagation) for _ in range(2))
        for radio in scene.radios:
            radio.classes = 15
        sky.legs, sky.held = Table(blank(LegRow) for _ in range(2)), Table([3] * 2 * USERS)
        self.scene, self.sky = in_memory(scene), in_memory(sky)
        self.memory = new_memory(words)
        self.sky.leg_memory = place(self.memory)
        self.rows = zeros(Change, ROOM)

    def recall(
        self, sender: int = 0, start_us: int = 0, until_us: int = 60, room: int = ROOM
    ) -> int:
        """Ask for a leg."""
        places = address(self.scene), address(self.sky), place(self.rows), room
        return recall_leg(*places, sender, start_us, until_us)

    def remember(self, changes: list[tuple[int, int, int]], start_us: int = 0) -> None:
        """Keep the changes on the leg that was asked for."""
        self.rows[: len(changes)] = changes
        remember_leg(address(self.sky), place(self.rows), len(changes), start_us)


CHANGES = [(50, 8, -14), (50, 0, 15), (7, 2**20 - 1, 0), (0, 3, 1)]


def test_a_leg_is_recalled_at_any_time_for_any_drone() -> None:
    asked = Asked()
    assert asked.recall() == -1
    asked.remember(CHANGES)
    asked.rows[:] = 0
    now_us = 10**15
    asked.sky.legs[1].since_us = now_us
    assert asked.recall(1, now_us, now_us + 60) == len(CHANGES)
    assert asked.rows.tolist() == [(now_us + t, user, change) for t, user, change in CHANGES]


def test_only_as_many_changes_are_written_as_there_is_room_for() -> None:
    asked = Asked()
    asked.recall()
    asked.remember(CHANGES)
    asked.rows[:] = 0
    assert asked.recall(room=1) == len(CHANGES)
    assert asked.rows.tolist() == [CHANGES[0], *[(0, 0, 0)] * 3]


FIELDS = (
    *("x0_m", "y0_m", "z0_m", "x1_m", "y1_m", "z1_m", "since_us", "transit", "level", "to_level"),
    *("radio", "serving"),
)


@pytest.mark.parametrize("name", FIELDS)
def test_a_leg_that_differs_is_another_one(name: str) -> None:
    asked = Asked()
    asked.recall()
    asked.remember(CHANGES)
    leg = asked.sky.legs[0]
    setattr(leg, name, 1)
    assert asked.recall() == -1
    setattr(leg, name, 0)
    assert asked.recall() == len(CHANGES)


@pytest.mark.parametrize("user", range(USERS))
def test_classes_that_differ_make_another_leg(user: int) -> None:
    asked = Asked()
    asked.recall()
    asked.remember(CHANGES)
    asked.sky.held[user] = 4
    assert asked.recall() == -1
    assert asked.recall(1) == len(CHANGES)


def test_a_leg_of_another_world_or_of_another_length_is_another_one() -> None:
    asked = Asked()
    asked.recall()
    asked.remember(CHANGES)
    assert asked.recall(until_us=61) == -1
    asked.scene.number += 1
    assert asked.recall() == -1


def test_many_legs_share_slots() -> None:
    asked = Asked(2**17)
    legs = range(2000)
    for _ in range(2):
        known = []
        for number in legs:
            asked.sky.legs[0].x0_m = 0.1 * number
            known.append(asked.recall())
            if known[-1] < 0:
                asked.remember([(number % 60, number % 9, 2)])
            else:
                assert asked.rows[0].tolist() == (number % 60, number % 9, 2)
    assert known == [1] * len(legs) and asked.memory[COUNT] == len(legs)
    slots = np.flatnonzero(asked.memory[LEGS_AT - SLOTS : LEGS_AT])
    hashes = asked.memory[asked.memory[LEGS_AT - SLOTS + slots]] & (SLOTS - 1)
    assert (hashes != slots).any()  # some are not in the first slot that they asked for


def test_a_memory_without_room_forgets_all_and_begins_anew() -> None:
    asked = Asked(LEGS_AT + 100)
    leg = asked.sky.legs[0]
    known = []
    for number in [*range(6), 5, 0]:
        leg.x0_m = float(number)
        known.append(asked.recall())
        if known[-1] < 0:
            asked.remember(CHANGES)
        assert asked.memory[END] <= len(asked.memory)
    assert known == [-1] * 6 + [4, -1]
    asked.memory[COUNT] = SLOTS // 2
    leg.x0_m = 9.0
    assert asked.recall() == -1
    asked.remember(CHANGES)
    assert asked.memory[COUNT] == 0 and not asked.memory[LEGS_AT - SLOTS : LEGS_AT].any()


def test_what_does_not_fit_is_neither_recalled_nor_kept() -> None:
    for words, classes, until_us in ((LEGS_AT + 10, 15, 60), (2**17, 128, 60), (2**17, 15, 2**35)):
        asked = Asked(words)
        asked.scene.radios[0].classes = classes
        for _ in range(2):
            assert asked.recall(until_us=until_us) == -1
            assert asked.memory[DRAFT] == 0
            asked.remember(CHANGES)
    asked = Asked(LEGS_AT + 20)
    asked.recall()
    asked.remember(CHANGES)
    assert asked.memory[COUNT] == 0


# ---- the engines

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


@pytest.mark.thorough
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


@pytest.mark.thorough
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
    """What an episode under way leads to."""
    rng = np.random.default_rng(7)
    while not is_over(engine):
        step(engine, rng)
    return [tuple(event) for event in engine.log.events or ()]


@pytest.mark.thorough
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


@pytest.mark.thorough
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


@pytest.mark.thorough
def test_worlds_take_turns_in_a_thread() -> None:
    worlds = [world_of("a3 over levels", seed) for seed in range(2)]
    expected = [flown(forgetful(world)) for world in worlds]
    for _ in range(2):
        flights = [flight(batch(world)) for world in worlds]
        assert list(zip(*flights, strict=True)) == list(zip(*expected, strict=True))


@pytest.mark.thorough
def test_threads_remember_on_their_own() -> None:
    world = world_of("a3 over levels")
    expected = flown(forgetful(world))
    engines = [batch(world) for _ in range(4)]
    with ThreadPoolExecutor(2) as pool:
        assert list(pool.map(flown, engines)) == [expected] * 4


@pytest.mark.thorough
@pytest.mark.parametrize("engine_of", [lambda world: Simulation(world, settings_of(world)), batch])
def test_a_small_memory_forgets(engine_of: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(of_threads, "WORDS", LEGS_AT + 300)
    world = world_of("a3 over levels")

    def flown_here() -> tuple[list[Any], int]:
        return flown(engine_of(world)), of_threads.known_legs()

    with ThreadPoolExecutor(1) as pool:
        shown, known = pool.submit(flown_here).result()
    assert shown == flown(forgetful(world)) and 0 < known < 20


@pytest.mark.thorough
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


@pytest.mark.thorough
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
