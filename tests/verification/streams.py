"""Random streams against NumPy's own generators, and their independence of each other."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator
from itertools import pairwise
from typing import Any

import numpy as np

from desim_uav.model.random.streams import Purpose, Streams, uniforms
from desim_uav.sample_path import SamplePath, draw
from desim_uav.scenario.load import loads
from desim_uav.world import World, build_world
from tests.verification.figure import Exact, Figure

SEEDS = [0, 1, 42, 2**31, 2**32 - 1, 2**32, 2**32 + 1, 2**40 + 12345, 2**63 - 1]
EPISODES = [0, 6999, -1]
ENTITIES = 200


def figures(quick: bool = False) -> Iterator[Figure]:
    """Number for number, and hash for hash."""
    keys = [(s, p, e) for s in SEEDS for p in Purpose for e in EPISODES]
    unlike, numbers = 0, 50
    for seed, purpose, episode in keys:
        ours = uniforms(Streams(seed, purpose, episode).states(ENTITIES), numbers)
        last = numpys(seed, int(purpose), ENTITIES - 1, episode).random(numbers)
        unlike += int((ours[-1] != last).sum())
    of_all = len(keys) * numbers
    yield Exact("numbers that differ from NumPy's SFC64", unlike, 0, cases=of_all)
    states = Streams(7, Purpose.DEMAND, 3).states(5000)[-1:]
    far = int((uniforms(states, 2000)[0] != numpys(7, 3, 4999, 3).random(2000)).sum())
    yield Exact("numbers that differ late in a stream", far, 0, cases=2000)
    one = hashes(*drawn())
    entities = sum(map(len, one.values()))
    for what, change in (("user", {"users__count": 13}), ("drone", {"drones__count": 4})):
        others = len(changed(one, hashes(*drawn(**change))))
        yield Exact(
            f"one more {what}: other entities whose draws change", others, 0, cases=entities
        )


def numpys(seed: int, purpose: int, entity: int, episode: int) -> np.random.Generator:
    """What the model says a stream is."""
    key = (purpose, entity, episode % 2**32)
    return np.random.Generator(np.random.SFC64(np.random.SeedSequence(seed, spawn_key=key)))


def digest(*arrays: np.ndarray) -> str:
    """A hash of the bytes of arrays."""
    hashed = hashlib.sha256()
    for array in arrays:
        hashed.update(np.ascontiguousarray(array).tobytes())
    return hashed.hexdigest()


def each(rows: np.ndarray, offsets: np.ndarray) -> list[str]:
    """A hash for each entity."""
    return [digest(rows[a:b]) for a, b in pairwise(offsets)]


BASE = {
    "seed": 11,
    "users.count": 12,
    "users.clusters.count": 4,
    "drones.count": 3,
    "stations.count": 3,
    "position_noise.probability": 0.5,
}


def drawn(episode: int = 0, seed: int | None = None, **changes: Any) -> tuple[World, SamplePath]:
    """(world, sample path) of a small scenario in 3D with everything random in it."""
    settings_ = BASE | {key.replace("__", "."): value for key, value in changes.items()}
    overrides = [f"{key}={value}" for key, value in settings_.items()]
    scenario = loads("name: streams", overrides=overrides)
    world = build_world(scenario, scenario.effective_world_seed)
    return world, draw(world, scenario.seed if seed is None else seed, episode)


def hashes(world: World, path: SamplePath) -> dict[str, list[str]]:
    """The hash of everybody's draws, by purpose."""
    return {
        "buildings": [digest(world.grid.height_m)],
        "clusters": [digest(row) for row in world.clusters],
        "placement": [digest(row) for row in world.homes],
        "mobility": each(*path.walks),
        "demand": each(path.requests.rows, path.requests.offsets),
        "noise": [digest(row) for row in path.position_error],
        "respawn": [digest(row) for row in path.respawn],
    }


def changed(one: dict[str, list[str]], other: dict[str, list[str]]) -> list[tuple[str, int]]:
    """(Purpose, entity) of one whose draws another does not have."""
    return [
        (purpose, entity)
        for purpose, found in one.items()
        for entity, digested in enumerate(found)
        if other[purpose][entity] != digested
    ]
