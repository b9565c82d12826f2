"""What surrounds a run: the world of the policy, the tables, the folder and the summary."""

from __future__ import annotations

import platform
import time
from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from importlib.metadata import version
from pathlib import Path
from typing import Any

import pandas as pd

from desim_uav import __version__, qoe
from desim_uav.engine.choose import check_engine
from desim_uav.errors import PolicyError
from desim_uav.experiment.interrupt import asked_to_stop, interruptible
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
from desim_uav.policies.base import PolicyLike, file_of, parts, policy_name
from desim_uav.records import EPISODES, REQUESTS, to_frame
from desim_uav.report.manifest import read_manifest
from desim_uav.run_folder import Draft, Place, read_parts, world_content
from desim_uav.scenario.load import dump, scenario_hash
from desim_uav.scenario.schema import Scenario
from desim_uav.world import World, build_world

PACKAGES = ("numba", "numpy", "pandas", "pyarrow", "pydantic", "simpy")

NAMED = ("scenario", "policy", "seed")
"""What a summary says of a run beside its measures, as its manifest does."""

ALWAYS_CALLED = ("policy.npz", "desim_uav.npz")
"""What a policy's file is called in whatever folder: the folder's name says more."""


Write = Callable[[str, pd.DataFrame], None]
"""Takes rows of one of ``run_folder.TABLES``, by its name."""


@dataclass(frozen=True)
class How:
    """How a policy is run, whatever the scenario and the seed."""

    episodes: int = 1
    warmup: int = 0
    keep_events: bool = False
    engine: str = "des"
    command: Sequence[str] = ()


@dataclass(frozen=True)
class Prepared:
    """A policy in the world in which it is going to be run."""

    scenario: Scenario
    world: World
    policy: Policy
    name: str

    @property
    def notice(self) -> str:
        """What to warn of before the policy acts in this world, or nothing."""
        found: str = getattr(self.policy, "notice", lambda world: "")(self.world)
        return found


@dataclass(frozen=True)
class Recorded:
    """A run that has ended, or was interrupted: what it says of itself, beside its tables.

    ``summary`` is of all counted requests and episodes, ``by_service`` of the requests alone.
    """

    prepared: Prepared
    manifest: dict[str, Any]
    summary: dict[str, Any]
    by_service: list[dict[str, Any]]

    @property
    def interrupted(self) -> bool:
        """Has Ctrl-C ended it before its last episode?"""
        return bool(self.manifest["interrupted"])

    def write(self, draft: Draft) -> None:
        """Write everything but the tables into a run folder."""
        draft.write_text("scenario.yaml", dump(self.prepared.scenario))
        draft.write_json("world.json", world_content(self.prepared.world))
        draft.write_json("manifest.json", self.manifest)


@dataclass
class Done:
    """A finished run: where it stands and what it says of itself."""

    summary: dict[str, Any]
    by_service: list[dict[str, Any]]
    interrupted: bool


def prepare(
    scenario: Scenario, policy: PolicyLike, engine: str = "des", keep_events: bool = False
) -> Prepared:
    """Load a policy, and build the world in which it is run on the scenario's seed.

    A policy that was trained in a world of its own is run there, unless the scenario names a world.
    ``keep_events``: its episodes keep their event logs, which takes memory. Raises PolicyError for
    a policy that cannot be loaded, and ScenarioError if the engine cannot run the scenario.
    """
    loaded = load_policy(policy)
    scenario = _where_it_learned(scenario, loaded)
    world = build_world(scenario, scenario.effective_world_seed)
    check_engine(engine, world, keep_events)
    return Prepared(scenario, world, loaded, policy_name(policy))


def place_of(scenario: Scenario, policy: PolicyLike, out: Path | None) -> Place:
    """Return where a run stands: ``out``, or ``runs/<scenario>-<policy>-s<seed>``."""
    return Place(out, f"{scenario.name}-{_label(policy_name(policy))}-s{scenario.seed}")


def run_to_folder(
    scenario: Scenario,
    policy: PolicyLike,
    *,
    episodes: int,
    warmup: int,
    keep_events: bool,
    out: Path | None,
    command: Sequence[str],
    engine: str = "des",
    say: Callable[[str], None] = lambda notice: None,
    advance: Callable[[], None] = lambda: None,
) -> Done:
    """Run and write the run folder. Raises the errors of its parts before anything is written.

    ``engine``: des or batch. Ctrl-C ends it after the episode under way, a second one at once; what
    has ended is kept. Where no counted episode has, nothing is, and a KeyboardInterrupt is raised.
    """
    prepared = prepare(scenario, policy, engine, keep_events)
    place = place_of(scenario, policy, out)
    if prepared.notice:
        say(prepared.notice)
    how = How(episodes, warmup, keep_events, engine, command)
    return write_run(prepared, how, place, advance)


def write_run(
    prepared: Prepared, how: How, place: Place, advance: Callable[[], None] = lambda: None
) -> Done:
    """Run, and write the tables into the run folder as they come.

    Raises KeyboardInterrupt if Ctrl-C comes before the first counted episode has ended; then
    nothing is written.
    """
    with place.draft() as draft:
        with draft.tables() as write:
            recorded = record(prepared, how, write, advance)
        recorded.write(draft)
        run_dir = place.publish(draft)
    return Done(
        recorded.summary | {"run_dir": str(run_dir)}, recorded.by_service, recorded.interrupted
    )


def record(
    prepared: Prepared, how: How, write: Write, advance: Callable[[], None] = lambda: None
) -> Recorded:
    """Run a policy; ``write`` is given the tables of episodes as they end.

    Raises KeyboardInterrupt if Ctrl-C comes before the first counted episode has ended.
    """
    world, policy, seed = prepared.world, prepared.policy, prepared.scenario.seed
    now = clock()
    started = now()
    episodes = play(
        world,
        policy,
        prepared.name,
        seed,
        how.episodes,
        how.warmup,
        how.keep_events,
        how.engine,
    )
    tally, by_service = _write_tables(world, episodes, how.keep_events, write, advance)
    if not tally.episodes:
        raise KeyboardInterrupt
    settings = run_settings(world, policy, how.keep_events)
    manifest = {
        "scenario": prepared.scenario.name,
        "scenario_hash": scenario_hash(prepared.scenario),
        "policy": prepared.name,
        "seed": seed,
        "world_seed": prepared.scenario.effective_world_seed,
        "engine": how.engine,
        "ceilings": ["tallest" if c else "none" for c in settings.ceilings],
        "carry_over": settings.carry_over,
        "warmup": how.warmup,
        "episodes": tally.episodes,
        "episodes_asked": how.episodes,
        "interrupted": tally.episodes < how.episodes,
        "command": list(how.command),
        "started": started,
        "finished": now(),
        "versions": versions(),
    }
    named = {key: manifest[key] for key in NAMED}
    return Recorded(prepared, manifest, named | tally.headline(), by_service.summaries())


def _write_tables(
    world: World,
    episodes: Iterable[Played],
    keep_events: bool,
    write: Write,
    advance: Callable[[], None],
) -> tuple[Tally, qoe.Groups]:
    """Write the tables of episodes as they end: of all that happened, one batch is in memory.

    What is said of the counted ones, and of their requests by service. It ends when it is asked to.
    """
    tally, by_service = Tally(), qoe.Groups("service")
    played: list[Played] = []
    with asked_to_stop("this episode") as stop:

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
            for episode in interruptible(episodes):
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
    named = {key: manifest[key] for key in NAMED}
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


def _label(name: str) -> str:
    """A policy's part of a folder's name: a file without its path, or the folder it stands in."""
    file = file_of(name)
    if file is None:
        return name
    named = file.absolute().parent.name if file.name in ALWAYS_CALLED else file.stem
    return f"{parts(name)[0]}-{named}"


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
