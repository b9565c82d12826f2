"""Copies and pickles of engines: they share the world with the original, and nothing else."""

from __future__ import annotations

import copy
import pickle
from collections.abc import Callable
from dataclasses import fields
from typing import Any

import numpy as np
import pytest

from desim_uav.engine.base import RunSettings
from desim_uav.engine.choose import ENGINES, make_engine
from desim_uav.engine.episode import Engine
from desim_uav.errors import SimulationError
from desim_uav.sample_path import SamplePath, draw
from desim_uav.scenario.load import load
from desim_uav.shipped import scenario_path
from desim_uav.world import World, build_world
from tests.engine.helpers import some_command

WAYS: dict[str, Callable[[Any], Any]] = {
    "copy": copy.copy,
    "deepcopy": copy.deepcopy,
    "pickle": lambda engine: pickle.loads(pickle.dumps(engine)),
}
BUSY = (
    "drones.battery.autonomy_min=6",
    "drones.battery.return_below=0.7",
    "drones.battery.respawn_after_min=2",
    "episode.steps=6",
)
EVENTFUL = RunSettings((True,) * 3, carry_over=True, keep_events=True, keep_steps=True)


def world_of(*overrides: str) -> World:
    return build_world(load(scenario_path("case8"), [*BUSY, *overrides]), 2)


def everything(engine: Engine) -> str:
    """All that can be asked of an engine whose episode is under way or over."""
    log = {part.name: getattr(engine.log, part.name) for part in fields(engine.log) if part.compare}
    log["requests"] = [
        [getattr(request, name) for name in REQUEST] for request in engine.log.requests
    ]
    places = [place.tolist() for place in engine.positions_m()]
    asked = (engine.measures(), engine.carried(), engine.terminated, engine.truncated)
    return repr((log, places, engine.user_states(), asked))


REQUEST = (
    *("request_id", "user", "service", "bandwidth_bps", "required", "done", "served_us"),
    *("attached_us", "t_request_us", "t_first_us", "t_end_us", "interruptions", "drones"),
    "outcome",
)


def played(engine: Engine, path: SamplePath, seed: int) -> list[Any]:
    return [*_begun(engine, path), *stepped(engine, seed)]


def _begun(engine: Engine, path: SamplePath) -> list[Any]:
    return [engine.reset(path), everything(engine)]


def stepped(engine: Engine, seed: int, most: int = 99) -> list[Any]:
    """What random commands lead to, up to the episode's end."""
    rng, told = np.random.default_rng(seed), []
    while not (engine.terminated or engine.truncated) and len(told) < 2 * most:
        shown = engine.latest  # type: ignore[attr-defined]
        commands = [some_command(engine.world, mask, rng) for mask in shown.masks]
        told += [engine.step(commands), everything(engine)]
    return told


@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize("name", ENGINES)
def test_a_copy_in_an_episode_goes_on_with_its_log_and_its_drones(name: str, way: str):
    world = world_of()
    engine, twin = (make_engine(name, world, EVENTFUL) for _ in range(2))
    paths = [draw(world, 3, episode) for episode in range(3)]
    for each in (engine, twin):
        played(each, paths[0], seed=0)
        _begun(each, paths[1])
        stepped(each, 1, most=3)
    other, disturbed = WAYS[way](engine), WAYS[way](engine)
    assert everything(other) == everything(engine)
    stepped(disturbed, 9)
    played(disturbed, paths[0], seed=9)
    ways_on = [
        [*stepped(each, 2), *played(each, paths[2], seed=3)] for each in (engine, other, twin)
    ]
    assert ways_on[0] == ways_on[2]
    assert ways_on[1] == ways_on[2]


@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize("name", ENGINES)
def test_copies_between_episodes(name: str, way: str):
    world = world_of()
    engine = make_engine(name, world, EVENTFUL)
    new = WAYS[way](engine)
    assert new.carried() is None
    first = [played(each, draw(world, 1, 0), seed=0) for each in (new, engine)]
    assert first[0] == first[1]
    carried = engine.carried()
    ended = WAYS[way](engine)
    assert everything(ended) == everything(engine) and ended.carried() == carried
    engine.carry(None)
    afresh = WAYS[way](engine)
    assert afresh.carried() is None
    engine.carry(carried)
    given = WAYS[way](engine)
    with pytest.raises(SimulationError, match="call reset first"):
        given.step([0, 0, 0])
    path = draw(world, 1, 1)
    goes_on, starts_afresh = played(ended, path, 1), played(afresh, path, 1)
    assert goes_on == played(given, path, 1) == played(engine, path, 1)
    assert goes_on != starts_afresh
    assert starts_afresh == played(make_engine(name, world, EVENTFUL), path, 1)


@pytest.mark.parametrize("name", ENGINES)
def test_a_copy_shares_the_world(name: str):
    engine = make_engine(name, world_of(), EVENTFUL)
    assert copy.deepcopy(engine).world is engine.world
    assert copy.copy(engine).world is engine.world


def test_a_copy_finds_more_room_for_what_does_not_fit():
    """The compiled engine plays an episode again with more room, in a copy as in the original."""
    walk = "users.mobility={kind: random_walk, speed_mps: 190.0, leg_s: 2.0}"
    world = world_of(walk)
    engine, twin = (make_engine("batch", world, EVENTFUL) for _ in range(2))
    for each in (engine, twin):
        _begun(each, draw(world, 0, 0))
    other: Any = pickle.loads(pickle.dumps(engine))
    room = other.buffers
    went_on = stepped(twin, 2)
    assert stepped(other, 2) == went_on
    assert other.buffers > room
    assert stepped(engine, 2) == went_on


def test_a_pickle_of_another_version_is_refused(monkeypatch: pytest.MonkeyPatch):
    pickled = pickle.dumps(make_engine("batch", world_of(), EVENTFUL))
    monkeypatch.setattr("desim_uav.engine.compiled.simulation.kernels_digest", lambda: "other")
    with pytest.raises(pickle.UnpicklingError, match="another version of desim-uav"):
        pickle.loads(pickled)


def test_a_copy_of_an_engine_that_has_failed_waits_for_the_next_episode():
    world = world_of()
    engine: Any = make_engine("des", world, EVENTFUL)
    engine.reset(draw(world, 0, 0))

    def fail(*_: Any) -> None:
        raise SimulationError("no reward")

    engine.constants.pay = fail
    with pytest.raises(SimulationError, match="no reward"):
        engine.step([0, 0, 0])
    other = copy.deepcopy(engine)
    with pytest.raises(SimulationError, match="call reset first"):
        other.step([0, 0, 0])
    assert other.carried() is None
    fresh = make_engine("des", world, EVENTFUL)
    assert played(other, draw(world, 0, 1), 1) == played(fresh, draw(world, 0, 1), 1)
