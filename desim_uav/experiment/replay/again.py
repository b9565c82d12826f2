"""Plays a run that kept no events again, with the settings in its folder.

The result is compared with the tables in the folder.
"""

from __future__ import annotations

from collections.abc import Callable, Generator, Sequence
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pandas as pd
import pyarrow as pa

from desim_uav.columns import arrow_schema
from desim_uav.errors import DesimError, NoEventsError, PolicyError
from desim_uav.experiment.progress import progress
from desim_uav.experiment.run import Played, play, tabulate
from desim_uav.policies import Policy, load_policy
from desim_uav.records import TABLES
from desim_uav.report.run import IN_TIME, KEPT, Again, Run, Tables
from desim_uav.run_folder import world_content
from desim_uav.world import World, build_world


@dataclass(frozen=True)
class Source:
    """A run to be shown: its folder, and the policy that plays it again if it kept no events.

    Without ``policy``, the one that the run's manifest names is loaded. ``passing``: the folder is
    there only while the run is shown.
    """

    folder: Path
    policy: Policy | None = None
    passing: bool = False

    @classmethod
    def of(cls, run: Path | Source) -> Source:
        """Return a run to be shown, which its folder stands for."""
        return run if isinstance(run, Source) else cls(run)


def playable(run: Path | Source, show_progress: bool = True) -> Run:
    """Return a run with events and legs; if it kept none, it is played again on demand."""
    source = Source.of(run)
    return Run(source.folder, playing_again(show_progress, source.policy))


def playing_again(show_progress: bool = True, policy: Policy | None = None) -> Again:
    """Return a function that makes the events and legs that a run did not keep.

    The function raises NoEventsError if the run cannot be played again.
    """

    def again(run: Run, numbers: Sequence[int]) -> Tables:
        total = max(numbers) - run.episodes[0] + 1
        try:
            engine = run.settings.engine
        except PolicyError as error:
            raise NoEventsError(f"{run.folder}: the run kept no events, and {error}") from error
        with progress(show_progress, total, engine=engine) as advance:
            episodes = [tables for _, tables in played_again(run, numbers, advance, policy)]
        return {
            name: pd.concat([of[name] for of in episodes], ignore_index=True) for name in IN_TIME
        }

    return again


def played_again(
    run: Run,
    numbers: Sequence[int],
    advance: Callable[[], None] = lambda: None,
    policy: Policy | None = None,
) -> Generator[tuple[int, Tables]]:
    """Play a run again and yield the tables of these episodes, including events and legs.

    Raises NoEventsError if the result differs from the tables in the folder.
    """
    world, episodes = _begin(run, policy)
    rest = set(numbers)
    with closing(episodes):
        while rest:
            try:
                played = next(episodes)
            except DesimError as error:
                raise _not_again(run, str(error)) from error
            number = played[0].episode
            if number in rest:
                rest.remove(number)
                yield number, _checked(run, world, played)
            advance()


def _begin(run: Run, policy: Policy | None) -> tuple[World, Generator[Played]]:
    """Return the world of a run and an iterator over its episodes.

    Raises NoEventsError if the run cannot be played again.
    """
    settings = run.settings
    name = settings.policy
    try:
        policy = load_policy(name) if policy is None else policy
        world = build_world(run.scenario, settings.world_seed)
    except DesimError as error:
        raise _not_again(run, str(error)) from error
    if world_content(world) != run.map:
        raise _not_again(run, "world.json differs from the world of scenario.yaml on this seed")
    if {*settings.ceilings} != {"tallest" if policy.ceiling else "none"}:
        raise _not_again(run, f"the ceiling of policy {name!r} has changed since the run")
    counted, warmup = run.episodes[-1] + 1, settings.warmup
    return world, play(world, policy, name, settings.seed, counted, warmup, True, settings.engine)


def _checked(run: Run, world: World, played: Played) -> Tables:
    """Return the tables of an episode that was played again, if they are those of the folder."""
    replayed: Tables = vars(tabulate(world, [played], keep_events=True))
    episode = played[0].episode
    stored = run.of_episode(episode)
    for name in KEPT:
        if not _arrow(name, replayed[name]).equals(_arrow(name, stored[name])):
            raise _not_again(
                run, f"episode {episode}: {name}.parquet differs from what is computed now"
            )
    return replayed


def _arrow(name: str, frame: Any) -> pa.Table:
    schema = arrow_schema(TABLES[name].among(frame.columns))
    return pa.Table.from_pandas(frame, schema, preserve_index=False)


def _not_again(run: Run, reason: str) -> NoEventsError:
    policy = run.settings.policy
    return NoEventsError(
        f"{run.folder}: the run kept no events, and it cannot be played again: {reason} (policy "
        f"{policy!r}; try again in the folder where the run was made, or run it again with "
        "--events)"
    )
