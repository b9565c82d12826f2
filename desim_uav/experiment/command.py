"""What ``desim-uav run`` does around a run: the folder, the progress, the summary."""

from __future__ import annotations

import platform
import time
from collections import Counter
from collections.abc import Callable, Iterable
from contextlib import suppress
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from importlib.metadata import version
from pathlib import Path
from typing import Any

from desim_uav import __version__, qoe
from desim_uav.engine.choose import check_engine
from desim_uav.errors import PolicyError
from desim_uav.experiment.interrupt import asked_to_stop
from desim_uav.experiment.progress import progress
from desim_uav.experiment.run import (
    Played,
    Tally,
    counted,
    is_batch,
    play,
    run_settings,
    tabulate,
)
from desim_uav.policies import Policy, load_policy
from desim_uav.policies.base import file_of, parts
from desim_uav.records import EPISODES, REQUESTS, to_frame
from desim_uav.report.manifest import read_manifest
from desim_uav.run_folder import Draft, Place, read_parts, world_content
from desim_uav.scenario.load import dump, scenario_hash
from desim_uav.scenario.schema import Scenario
from desim_uav.world import World, build_world

PACKAGES = ("numba", "numpy", "pandas", "pyarrow", "pydantic", "simpy")

ALWAYS_CALLED = ("policy.npz", "desim_uav.npz")
"""What a policy's file is called in whatever folder: the folder's name says more."""


@dataclass
class Done:
    """A finished run: where it stands and what it says of itself."""

    summary: dict[str, Any]
    by_service: list[dict[str, Any]]
    interrupted: bool


def run_to_folder(
    scenario: Scenario,
    policy_name: str,
    *,
    episodes: int,
    warmup: int,
    keep_events: bool,
    out: Path | None,
    command: list[str],
    show_progress: bool,
    engine: str = "des",
    say: Callable[[str], None] = lambda notice: None,
) -> Done:
    """Run and write the run folder. Raises the errors of its parts before anything is written.

    ``engine``: des or batch. Ctrl-C ends it after the episode under way, a second one at once; what
    has ended is kept. Where no counted episode has, nothing is, and a KeyboardInterrupt is raised.
    """
    seed = scenario.seed
    policy = load_policy(policy_name)
    place = Place(out, f"{scenario.name}-{_label(policy_name)}-s{seed}")
    scenario = _where_it_learned(scenario, policy)
    world = build_world(scenario, scenario.effective_world_seed)
    check_engine(engine, world)
    notice = getattr(policy, "notice", lambda world: "")(world)
    if notice:
        say(notice)
    now = clock()
    started = now()
    with place.draft() as draft:
        with progress(show_progress, warmup + episodes, engine=engine) as advance:
            episodes_played = play(
                world, policy, policy_name, seed, episodes, warmup, keep_events, engine
            )
            tally, by_service = _record(world, episodes_played, keep_events, draft, advance)
        if not tally.episodes:
            raise KeyboardInterrupt
        interrupted = tally.episodes < episodes
        settings = run_settings(world, policy, keep_events)
        draft.write_text("scenario.yaml", dump(scenario))
        draft.write_json("world.json", world_content(world))
        draft.write_json(
            "manifest.json",
            {
                "scenario": scenario.name,
                "scenario_hash": scenario_hash(scenario),
                "policy": policy_name,
                "seed": seed,
                "world_seed": scenario.effective_world_seed,
                "engine": engine,
                "ceilings": ["tallest" if c else "none" for c in settings.ceilings],
                "carry_over": settings.carry_over,
                "warmup": warmup,
                "episodes": tally.episodes,
                "episodes_asked": episodes,
                "interrupted": interrupted,
                "command": command,
                "started": started,
                "finished": now(),
                "versions": versions(),
            },
        )
        run_dir = place.publish(draft)
    named = {"scenario": scenario.name, "policy": policy_name, "seed": seed}
    return Done(
        named | tally.headline() | {"run_dir": str(run_dir)},
        by_service.summaries(),
        interrupted,
    )


def _record(
    world: World,
    episodes: Iterable[Played],
    keep_events: bool,
    draft: Draft,
    advance: Callable[[], None],
) -> tuple[Tally, qoe.Groups]:
    """Write the tables of episodes as they end: of all that happened, one batch is in memory.

    What is said of the counted ones, and of their requests by service. It ends when it is asked to.
    """
    tally, by_service = Tally(), qoe.Groups("service")
    played: list[Played] = []
    with asked_to_stop("this episode") as stop, draft.tables() as write:

        def put_down() -> None:
            with stop.undisturbed():
                results = tabulate(world, played, keep_events)
                for name, frame in vars(results).items():
                    if frame is not None:
                        write(name, frame)
                tally.add(results.requests, results.episodes)
                by_service.add(counted(results.requests))
                played.clear()

        with suppress(KeyboardInterrupt):
            for episode in episodes:
                played.append(episode)
                advance()
                if is_batch(played):
                    put_down()
                if stop():
                    break
        with suppress(KeyboardInterrupt):  # one more: it comes once all is put down
            if played:
                put_down()
    return tally, by_service


def read_summary(
    folder: Path, by: str | None = None
) -> tuple[dict[str, Any], list[dict[str, Any]] | None]:
    """The summary of a finished run, and of its requests in groups.

    One row group is in memory at a time. Raises PolicyError for tables that are unreadable, or that
    no run has written so.
    """
    tally, groups = Tally(), None if by is None else qoe.Groups(by)
    no_episodes = to_frame(EPISODES, [])
    asked: Counter[int] = Counter()
    for requests in read_parts(folder, "requests", REQUESTS):
        problem = qoe.inconsistency(requests)
        if problem:
            raise PolicyError(f"{folder / 'requests.parquet'}: {problem}")
        asked.update(requests["episode"].tolist())
        tally.add(requests, no_episodes)
        if groups is not None:
            groups.add(counted(requests))
    for episodes in read_parts(folder, "episodes", EPISODES):
        tally.add(to_frame(REQUESTS, []), episodes)
        for episode, requests in zip(episodes["episode"], episodes["requests"], strict=True):
            if asked.pop(episode, 0) != requests:
                raise _of_two_runs(folder, episode)
    for episode in asked:
        raise _of_two_runs(folder, episode)
    manifest = read_manifest(folder)
    named = {key: manifest[key] for key in ("scenario", "policy", "seed")}
    told = None if groups is None else groups.summaries()
    return named | tally.headline() | {"run_dir": str(folder)}, told


def _of_two_runs(folder: Path, episode: int) -> PolicyError:
    return PolicyError(
        f"{folder}: requests.parquet and episodes.parquet are not of one run: they differ in "
        f"episode {episode}"
    )


def _where_it_learned(scenario: Scenario, policy: Policy) -> Scenario:
    """The scenario in the world a policy was trained in, unless it asks for one itself."""
    world_seed = getattr(policy, "world_seed", None)
    if scenario.world_seed is not None or world_seed is None:
        return scenario
    return scenario.model_copy(update={"world_seed": world_seed})


def _label(policy_name: str) -> str:
    """A policy's part of a folder's name: a file without its path, or the folder it stands in."""
    file = file_of(policy_name)
    if file is None:
        return policy_name
    named = file.absolute().parent.name if file.name in ALWAYS_CALLED else file.stem
    return f"{parts(policy_name)[0]}-{named}"


def clock() -> Callable[[], str]:
    """What tells the time from now on; if the clock is set back, the time does not go back."""
    last, since_s = datetime.now(UTC), time.monotonic()

    def now() -> str:
        nonlocal last, since_s
        before_s, since_s = since_s, time.monotonic()
        last = max(last + timedelta(seconds=since_s - before_s), datetime.now(UTC))
        return last.isoformat()

    return now


def versions() -> dict[str, str]:
    """Of Python, this package and those its figures hang on."""
    found = {"desim-uav": __version__, "python": platform.python_version()}
    return found | {name: version(name) for name in PACKAGES} | {"platform": platform.platform()}
