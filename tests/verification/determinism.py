"""Determinism: the same seed gives the same run in any process, hash seed and insertion order."""

from __future__ import annotations

import os
import random
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from desim_uav import compare
from desim_uav.engine.base import EpisodeLog, Event
from desim_uav.engine.des.clock import Clock
from desim_uav.experiment.run import Results, run
from desim_uav.policies import load_policy
from desim_uav.scenario.load import load
from desim_uav.shipped import scenario_path
from desim_uav.world import build_world
from tests.engine.helpers import Flight, path_of, strip
from tests.verification.figure import Exact, Figure

CASES = ("case8", "case9")
HASH_SEEDS = ("1", "20")
Frames = dict[str, dict[str, pd.DataFrame]]
TABLES = ("requests", "steps", "episodes", "users", "events")


def figures(quick: bool = False) -> Iterator[Figure]:
    """Tables, rows and logs, to the last bit."""
    yield from in_other_processes(HASH_SEEDS[: 1 if quick else 2])
    if not quick:
        yield from in_two_workers()
    yield from in_any_order(quick)


# ---- processes


def in_other_processes(hash_seeds: Sequence[str] = HASH_SEEDS) -> Iterator[Figure]:
    """Three episodes of a random policy here, again, and in processes of other hash seeds."""
    with tempfile.TemporaryDirectory() as folder:
        running = {seed: _start(Path(folder) / seed, seed) for seed in hash_seeds}
        own, again = ({case: tables(results_of(case, "random")) for case in CASES} for _ in "12")
        cases = len(CASES) * len(TABLES)
        yield Exact("run twice: tables that differ", _unlike(own, again), 0, cases=cases)
        hashes, unlike = {hash("drone")}, 0
        for seed, process in running.items():
            assert process.wait(timeout=300) == 0
            hashed, told = pd.read_pickle(Path(folder) / seed)
            hashes.add(hashed)
            unlike += _unlike(own, told)
    assert len(hashes) > len(hash_seeds), "the processes do differ in what hashes are"
    cases *= len(hash_seeds)
    yield Exact("processes with other hash seeds: tables that differ", unlike, 0, cases=cases)


def in_two_workers() -> Iterator[Figure]:
    """A comparison on three seeds, by one worker and by two."""
    one, two = (
        compare(
            "tiny",
            policies=["baseline", "random"],
            seeds=3,
            episodes=2,
            warmup=0,
            jobs=jobs,
            progress=False,
        ).rows()
        for jobs in (1, 2)
    )
    unlike = sum(a != b for a, b in zip(one, two, strict=True))
    yield Exact("two worker processes: replications that differ", unlike, 0, cases=len(one))


def results_of(case: str, policy: str, seed: int = 11) -> Results:
    world = build_world(load(scenario_path(case)), seed)
    return run(world, load_policy(policy), policy, seed, episodes=3, warmup=1, keep_events=True)


def tables(results: Results) -> dict[str, pd.DataFrame]:
    return {name: getattr(results, name) for name in TABLES}


IN_ANOTHER_PROCESS = """
import pickle, sys
from tests.verification.determinism import results_of, tables
out = {case: tables(results_of(case, "random")) for case in ("case8", "case9")}
with open(sys.argv[1], "wb") as file:
    pickle.dump((hash("drone"), out), file)
"""


def _start(file: Path, hash_seed: str) -> subprocess.Popen[bytes]:
    root = Path(__file__).resolve().parents[2]
    paths = os.pathsep.join([str(root), os.environ.get("PYTHONPATH", "")])
    environment = os.environ | {"PYTHONHASHSEED": hash_seed, "PYTHONPATH": paths}
    command = [sys.executable, "-c", IN_ANOTHER_PROCESS, str(file)]
    return subprocess.Popen(command, cwd=root, env=environment)


def _unlike(one: Frames, other: Frames) -> int:
    assert all(len(frame) > 0 for frames in one.values() for frame in frames.values())
    return sum(not one[case][name].equals(other[case][name]) for case in CASES for name in TABLES)


# ---- ties


def in_any_order(quick: bool = False) -> Iterator[Figure]:
    """Episodes full of ties, with what has one key on the agenda in random orders."""
    unlike = episodes = 0
    for seed in range(1 if quick else 3):
        expected = [content(log) for log in in_lockstep(seed)]
        for shuffle in range(4):
            with shuffled(10 * seed + shuffle):
                found = [content(log) for log in in_lockstep(seed)]
            unlike += sum(one != other for one, other in zip(expected, found, strict=True))
            episodes += len(expected)
    yield Exact("ties inserted in random order: logs that differ", unlike, 0, cases=episodes)


def in_lockstep(seed: int) -> list[EpisodeLog]:
    """Six drones, two on each of three cells, told the same; users on a lattice, asking at once.

    They cross footprints, land, queue, charge, run empty and come back in the same microseconds;
    requests of the same length end together, and everybody thinks for as long.
    """
    lattice = [(x, y) for x in range(60, 1440, 240) for y in range(60, 1440, 240)]
    world = strip(
        [(1, 1), (4, 1), (2, 4)] * 2,
        lattice,
        cells=(6, 6),
        steps=12,
        radius_m=300,
        battery={"autonomy_min": 7, "return_below": 0.8, "respawn_after_min": 1.0},
        stations={"count": 1, "pads": 2, "full_charge_min": 2},
        bandwidth_kbps=500,
    )
    asks = {user: [(0, 90, 100), *[(30, 60, 100)] * 9] for user in range(len(lattice))}
    rng = np.random.default_rng(seed)
    flight = Flight(world, carry_over=True, check=None)
    logs = []
    for episode in range(3):
        words = ["forward", "backward", "right", "left", "hover", "goto", "charge"]
        told = " ".join(rng.choice(words, 12, p=[0.18, 0.18, 0.18, 0.18, 0.1, 0.09, 0.09]))
        path = path_of(world, asks, thinking=True, respawn=[[0] * 13] * 6, episode=episode)
        logs.append(flight.episode(path, *[told] * 6))
    return logs


def content(log: EpisodeLog) -> tuple[list[Event] | None, list[Any], list[dict[str, Any]]]:
    kept = ("user", "t_request_us", "served_us", "attached_us", "t_end_us", "drones", "outcome")
    requests = [{name: getattr(request, name) for name in kept} for request in log.requests]
    return log.events, log.steps, requests


@contextmanager
def shuffled(seed: int) -> Iterator[None]:
    """Let what has one key in the event queue come in random order, not in that of insertion."""

    def numbers() -> Iterator[int]:
        rng, given = random.Random(seed), set[int]()
        while True:
            number = rng.getrandbits(48)
            if number not in given:
                given.add(number)
                yield number

    def init(clock: Clock, *given: Any) -> None:
        plain(clock, *given)
        clock._eid = numbers()

    plain = Clock.__init__
    Clock.__init__ = init  # type: ignore[method-assign]
    try:
        yield
    finally:
        Clock.__init__ = plain  # type: ignore[method-assign]
