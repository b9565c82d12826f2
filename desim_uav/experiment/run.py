"""A run: one policy in a number of episodes of one scenario, on one seed."""

from __future__ import annotations

from collections.abc import Callable, Generator, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, fields
from typing import Any

import pandas as pd

from desim_uav.engine.base import EpisodeLog, RunSettings
from desim_uav.engine.choose import faster, make_engine
from desim_uav.engine.episode import Engine
from desim_uav.errors import DesimError, SimulationError
from desim_uav.experiment import tables
from desim_uav.model.random.streams import Purpose, Streams
from desim_uav.model.state import Snapshot
from desim_uav.policies.answers import NoCommandError
from desim_uav.policies.base import Policy, decide, show
from desim_uav.registry import FAULTS, naming_plug_ins, what_failed
from desim_uav.sample_path import SamplePath, draw
from desim_uav.world import World

BATCH, ROWS = 50, 200_000
"""The episodes, or before that the rows, after which a batch is put into tables."""


@dataclass
class Results:
    """The tables of a run (see ``records``); those that it does not keep are None."""

    requests: pd.DataFrame
    steps: pd.DataFrame
    episodes: pd.DataFrame
    users: pd.DataFrame
    events: pd.DataFrame | None
    legs: pd.DataFrame | None
    access_points: pd.DataFrame | None
    updates: pd.DataFrame | None
    sensors: pd.DataFrame | None


Played = tuple[EpisodeLog, SamplePath]
"""The log and the sample path of an episode that has ended."""


def run_settings(world: World, policy: Policy, keep_events: bool) -> RunSettings:
    """Return the engine's settings for a policy and the scenario of a world."""
    ceilings = (policy.ceiling,) * world.scenario.drone_count
    return RunSettings(ceilings, world.scenario.episode.carry_over, keep_events)


def run(
    world: World,
    policy: Policy,
    policy_name: str,
    seed: int,
    episodes: int = 1,
    warmup: int = 0,
    keep_events: bool = False,
    on_episode: Callable[[], None] = lambda: None,
    engine: str = "des",
) -> Results:
    """Run ``warmup`` + ``episodes`` episodes and return all tables in memory.

    Warm-up episodes have negative numbers. ``engine`` is one of ``engine.choose.CHOICES``.
    """
    parts: list[Results] = []
    played: list[Played] = []
    for episode in play(world, policy, policy_name, seed, episodes, warmup, keep_events, engine):
        played.append(episode)
        if is_batch(played):
            parts.append(tabulate(world, played, keep_events))
            played = []
        on_episode()
    if played or not parts:
        parts.append(tabulate(world, played, keep_events))
    return _joined(parts)


def play(
    world: World,
    policy: Policy,
    policy_name: str,
    seed: int,
    episodes: int = 1,
    warmup: int = 0,
    keep_events: bool = False,
    engine: str = "des",
    first: int | None = None,
) -> Generator[Played]:
    """Yield the log and the sample path of each episode of a run when it has ended.

    ``first`` is the number of the first episode, by default that of the first of ``warmup``.
    """
    settings = run_settings(world, policy, keep_events)
    simulation = make_engine(engine, world, settings)
    for episode in range(-warmup if first is None else first, episodes):
        with naming_plug_ins():
            path = draw(world, seed, episode)
            carried = settings.carry_over and simulation.truncated and not simulation.terminated
            simulation = faster(engine, simulation)
            begin(policy, policy_name, world, seed, episode, carried)
            fly(simulation, policy, policy_name, simulation.reset(path))
        yield simulation.log, path


def begin(
    policy: Policy, policy_name: str, world: World, seed: int, episode: int, carried: bool
) -> None:
    """Let a policy prepare for an episode. Raises SimulationError if it fails."""
    with _blame(policy_name, episode):
        policy.begin(world, Streams(seed, Purpose.LEARNER, episode), carried)


def fly(
    simulation: Engine,
    policy: Policy,
    policy_name: str,
    snapshot: Snapshot,
    until: int | None = None,
) -> Snapshot:
    """Let a policy command the drones until the end of the episode, or until a step of it.

    Returns the last snapshot. Raises SimulationError if the policy or the engine fails.
    """
    episode = simulation.log.episode
    with _blame(policy_name, episode, snapshot.step):
        show(policy, simulation)
    while not (snapshot.terminated or snapshot.truncated) and snapshot.step != until:
        with _blame(policy_name, episode, snapshot.step):
            commands = decide(policy, snapshot, simulation.world)
        snapshot = simulation.step(commands)
    return snapshot


@contextmanager
def _blame(policy_name: str, episode: int, step: int | None = None) -> Iterator[None]:
    """Turn an error in a policy into a SimulationError with the policy, episode and step."""
    try:
        yield
    except DesimError:
        raise
    except NoCommandError as problem:
        where = f"in episode {episode}, step {step}"
        raise SimulationError(f"policy {policy_name!r} {where}: {problem}") from None
    except FAULTS as error:
        where = f"episode {episode}" + ("" if step is None else f", step {step}")
        raise SimulationError(
            f"policy {policy_name!r} failed in {where}: {what_failed(error)}"
        ) from error


def is_batch(played: Sequence[Played], before: tuple[int, int] = (0, 0)) -> bool:
    """Return whether it is time to put these episodes into tables.

    ``before``: how many episodes, and rows, are already in the batch.
    """
    rows = before[1] + sum(
        len(log.requests) + len(log.events or ()) + len(path.walks.legs) for log, path in played
    )
    return before[0] + len(played) == BATCH or rows >= ROWS


def tabulate(world: World, played: Sequence[Played], keep_events: bool) -> Results:
    """Return the tables of some episodes."""
    logs = [log for log, _ in played]
    requests = tables.requests_table(logs, world)
    return Results(
        requests,
        tables.steps_table(logs, world),
        tables.episodes_table(logs, world, requests),
        tables.users_table([path for _, path in played], world),
        tables.events_table(logs, world) if keep_events else None,
        tables.legs_table(logs) if keep_events else None,
        tables.points_table(logs) if world.scenario.access_points else None,
        tables.updates_table(logs, world) if world.senses else None,
        tables.sensors_table(logs, world) if world.senses else None,
    )


def _joined(parts: list[Results]) -> Results:
    def joined(name: str) -> Any:
        frames: list[pd.DataFrame] = [getattr(part, name) for part in parts]
        if frames[0] is None:
            return None
        return pd.concat([f for f in frames if len(f)] or frames[:1], ignore_index=True)

    return Results(**{field.name: joined(field.name) for field in fields(Results)})
