"""The work of ``desim-uav replay``: makes one page from one or two run folders.

A run that kept no events is played again with the settings in its folder, and the result is
compared with the tables in the folder.
"""

from __future__ import annotations

from collections.abc import Callable, Generator, Sequence
from contextlib import ExitStack, closing
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pandas as pd
import pyarrow as pa

from desim_uav.engine.base import EpisodeLog
from desim_uav.errors import DesimError, NoEventsError, PolicyError
from desim_uav.experiment import tables
from desim_uav.experiment.progress import progress
from desim_uav.experiment.run import play
from desim_uav.experiment.side_by_side import common_episodes
from desim_uav.policies import Policy, load_policy
from desim_uav.report.replay.data import Encoder
from desim_uav.report.replay.page import page
from desim_uav.report.run import IN_TIME, KEPT, Again, Run, Tables
from desim_uav.run_folder import file_place, world_content, write_at
from desim_uav.sample_path import SamplePath
from desim_uav.world import World, build_world

MOST_BYTES = 25 * 2**20
"""The default limit on the size of a page."""

BASE64 = 4 / 3


@dataclass(frozen=True)
class Source:
    """A run to be shown: its folder, and the policy that plays it again if it kept no events.

    Without ``policy``, the one that the run's manifest names is loaded.
    """

    folder: Path
    policy: Policy | None = None


@dataclass(frozen=True)
class Made:
    """The page of one run or two, its episodes, and those left out because of its size limit."""

    content: bytes
    episodes: list[int]
    left_out: list[int]
    played_again: bool


@dataclass
class Written:
    """The file of a page, its episodes, and those left out because of its size limit."""

    file: Path
    size: int
    episodes: list[int]
    left_out: list[int]
    played_again: bool

    def summary(self) -> dict[str, Any]:
        """Return the result as plain data, for JSON."""
        return {
            "html": str(self.file),
            "bytes": self.size,
            "episodes": self.episodes,
            "left_out": self.left_out,
            "played_again": self.played_again,
        }


def write_replay(
    run_dir: Path,
    html: Path | None = None,
    episodes: str | None = None,
    show_progress: bool = True,
    most_bytes: int | None = None,
    beside: Path | None = None,
) -> Written:
    """Write the page of a run, or of two in step, into the first run's folder or to ``html``.

    The file is ``replay.html``, or ``replay-NAME.html`` beside a second run in a folder NAME.
    Raises as ``make_replay`` does, and UsageError if the page cannot be written.
    """
    name = f"replay-{beside.resolve().name}.html" if beside else "replay.html"
    file = run_dir / name if html is None else html
    place = file_place(file, "" if html is None else "--html")
    sources = [Source(folder) for folder in (run_dir, beside) if folder is not None]
    made = make_replay(sources, episodes, show_progress, most_bytes)
    write_at(place, made.content)
    return Written(file, len(made.content), made.episodes, made.left_out, made.played_again)


def make_replay(
    sources: Sequence[Source],
    episodes: str | None = None,
    show_progress: bool = True,
    most_bytes: int | None = None,
) -> Made:
    """Make the page of a run, or of two that are played in step.

    ``episodes`` is a text such as ``0-9``; by default as many of the counted episodes as fit.
    Raises PolicyError if a folder is unreadable or contradicts itself, or if two runs are not on
    common seeds, and NoEventsError if a run cannot be played again.
    """
    runs = [Run(source.folder) for source in sources]
    wanted = runs[0].chosen(episodes)
    for second in runs[1:]:
        wanted = common_episodes(runs[0], second, episodes)
    encoders = [Encoder(run) for run in runs]
    blocks: list[tuple[bytes, ...]] = []
    size, limit = 0.0, MOST_BYTES if most_bytes is None else most_bytes
    total = sum(_to_play(run, wanted) for run in runs)
    compiled = "batch" if any(run.settings.engine == "batch" for run in runs) else "des"
    with progress(show_progress, total, engine=compiled) as advance, ExitStack() as open_until:
        tables_of = [
            open_until.enter_context(closing(_tables(run, wanted, advance, source.policy)))
            for run, source in zip(runs, sources, strict=True)
        ]
        for each in zip(*tables_of, strict=True):
            made = tuple(
                encoder.episode(number, tables)
                for encoder, (number, tables) in zip(encoders, each, strict=True)
            )
            size += sum(map(len, made)) * BASE64
            if episodes is None and blocks and size > limit:
                break
            blocks.append(made)
    encoded = wanted[: len(blocks)]
    columns = zip(encoders, zip(*blocks, strict=True), strict=True)
    content = page(*((encoder.common(encoded), column) for encoder, column in columns))
    again = not all(run.keeps_events for run in runs)
    return Made(content, encoded, wanted[len(blocks) :], again)


def _to_play(run: Run, wanted: Sequence[int]) -> int:
    """Return how many episodes must be read or played to obtain those that are wanted."""
    return len(wanted) if run.keeps_events else wanted[-1] - run.episodes[0] + 1


def _tables(
    run: Run, wanted: list[int], advance: Callable[[], None], policy: Policy | None
) -> Generator[tuple[int, Tables]]:
    """Return the tables of these episodes, by playing the run again if it kept no events."""
    if run.keeps_events:
        return _stored(run, wanted, advance)
    return played_again(run, wanted, advance, policy)


def _stored(
    run: Run, wanted: list[int], advance: Callable[[], None]
) -> Generator[tuple[int, Tables]]:
    for number in wanted:
        yield number, run.of_episode(number)
        advance()


def playable(run_dir: Path, show_progress: bool = True) -> Run:
    """Return a run with events and legs; if it kept none, it is played again on demand."""
    return Run(run_dir, playing_again(show_progress))


def playing_again(show_progress: bool = True) -> Again:
    """Return a function that makes the events and legs that a run did not keep.

    The function raises NoEventsError if the run cannot be played again.
    """

    def again(run: Run, wanted: Sequence[int]) -> Tables:
        total = max(wanted) - run.episodes[0] + 1
        try:
            engine = run.settings.engine
        except PolicyError as error:
            raise NoEventsError(f"{run.folder}: the run kept no events, and {error}") from error
        with progress(show_progress, total, engine=engine) as advance:
            made = [tables for _, tables in played_again(run, wanted, advance)]
        return {name: pd.concat([of[name] for of in made], ignore_index=True) for name in IN_TIME}

    return again


def played_again(
    run: Run,
    wanted: Sequence[int],
    advance: Callable[[], None] = lambda: None,
    policy: Policy | None = None,
) -> Generator[tuple[int, Tables]]:
    """Play a run again and yield the tables of these episodes, including events and legs.

    Raises NoEventsError if the result differs from the tables in the folder.
    """
    world, logs = _begin(run, policy)
    rest = set(wanted)
    with closing(logs):
        while rest:
            try:
                log, path = next(logs)
            except DesimError as error:
                raise _not_again(run, str(error)) from error
            if log.episode in rest:
                rest.remove(log.episode)
                yield log.episode, _checked(run, world, log, path)
            advance()


def _begin(run: Run, policy: Policy | None = None) -> tuple[World, Any]:
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


def _checked(run: Run, world: World, log: EpisodeLog, path: SamplePath) -> Tables:
    """Return the tables of an episode that was played again, if they are those of the folder."""
    requests = tables.requests_table([log], world)
    made = {
        "requests": requests,
        "steps": tables.steps_table([log]),
        "users": tables.users_table([path], world),
        "episodes": tables.episodes_table([log], world, requests),
        "events": tables.events_table([log]),
        "legs": tables.legs_table([log]),
    }
    stored = run.of_episode(log.episode)
    for name in KEPT:
        if not _arrow(name, made[name]).equals(_arrow(name, stored[name])):
            raise _not_again(
                run, f"episode {log.episode}: {name}.parquet differs from what is computed now"
            )
    return made


def _arrow(name: str, frame: Any) -> pa.Table:
    from desim_uav.records import TABLES, arrow_schema

    return pa.Table.from_pandas(frame, arrow_schema(TABLES[name]), preserve_index=False)


def _not_again(run: Run, reason: str) -> NoEventsError:
    policy = run.settings.policy
    return NoEventsError(
        f"{run.folder}: the run kept no events, and it cannot be played again: {reason} (policy "
        f"{policy!r}; try again in the folder where the run was made, or run it again with "
        "--events)"
    )
