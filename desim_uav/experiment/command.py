"""A run with everything around it: the policy's world, the tables, the folder and the summary."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pandas as pd

from desim_uav import qoe
from desim_uav.engine.choose import check_engine
from desim_uav.errors import PolicyError
from desim_uav.experiment import run
from desim_uav.experiment.interrupt import asked_to_stop, at_once, interruptible
from desim_uav.experiment.provenance import clock, versions
from desim_uav.experiment.resume import Begun, Rest
from desim_uav.measures.tally import MEASURED, Tally
from desim_uav.parquet_file import read_parts
from desim_uav.policies import Policy, load_policy
from desim_uav.policies.base import PolicyLike, as_seen, file_of, parts, policy_name
from desim_uav.records import EPISODES, REQUESTS, SENSORS
from desim_uav.report.manifest import read_manifest
from desim_uav.run_folder import RunDraft, RunPlace, folder_name, world_content
from desim_uav.scenario.load import files_of, scenario_hash
from desim_uav.scenario.schema import Scenario
from desim_uav.world import World, build_world

NAMED = ("name", "scenario", "policy", "seed", "world_seed")
"""The entries of a manifest that a summary repeats, if it has them."""

ALWAYS_CALLED = ("policy.npz", "desim_uav.npz")
"""File names of policies that are the same in every folder; the folder's name tells more."""


Write = Callable[[str, pd.DataFrame], None]
"""Writes rows of a table; called with the table's name (see ``records.TABLES``) and the rows."""


@dataclass(frozen=True)
class How:
    """The options of a run that depend on neither the scenario nor the seed."""

    episodes: int = 1
    warmup: int = 0
    keep_events: bool = False
    engine: str = "des"
    command: Sequence[str] = ()
    overrides: Sequence[str] = ()
    name: str | None = None


@dataclass(frozen=True)
class Prepared:
    """A policy and the world in which it will be run."""

    scenario: Scenario
    world: World
    policy: Policy
    name: str

    @property
    def notice(self) -> str:
        """The policy's warning about this world, or "" if it has none."""
        text: str = getattr(self.policy, "notice", lambda world: "")(self.world)
        learned = getattr(self.policy, "world_seed", None)
        if not text or learned in (None, self.world.seed):
            return text
        return (
            f"{text}; it is run in world {self.world.seed}: set the world seed to {learned} to run "
            "it in its own world"
        )


@dataclass(frozen=True)
class Recorded:
    """A run that has ended or was interrupted, without its tables.

    ``summary`` covers all counted requests and episodes, ``by_service`` the requests per service.
    """

    prepared: Prepared
    manifest: dict[str, Any]
    summary: dict[str, Any]
    by_service: list[dict[str, Any]]

    @property
    def interrupted(self) -> bool:
        """Whether Ctrl-C ended the run before its last episode."""
        return bool(self.manifest["interrupted"])

    def write(self, draft: RunDraft) -> None:
        """Write everything except the tables into a run folder."""
        for name, content in files_of(self.prepared.scenario).items():
            draft.write_bytes(name, content)
        draft.write_json("world.json", world_content(self.prepared.world))
        draft.write_json("manifest.json", self.manifest)


@dataclass
class Done:
    """A finished run: its summary, which includes its folder, and the summary by service."""

    summary: dict[str, Any]
    by_service: list[dict[str, Any]]
    interrupted: bool


def prepare(
    scenario: Scenario, policy: PolicyLike, engine: str = "des", keep_events: bool = False
) -> Prepared:
    """Load a policy and build the world in which it is run on the scenario's seed.

    The world is that of the scenario's ``world_seed``, or else of its seed, for every policy. A
    network is run with the observation that it needs.
    ``keep_events`` says that episodes keep their event logs, which takes memory. Raises PolicyError
    if the policy cannot be loaded, and ScenarioError if the engine cannot run the scenario.
    """
    loaded = load_policy(policy)
    scenario = as_seen(scenario, loaded)
    world = at_once(build_world, scenario, scenario.effective_world_seed)
    check_engine(engine, world, keep_events)
    return Prepared(scenario, world, loaded, policy_name(policy))


def place_of(
    scenario: Scenario, policy: PolicyLike, out: Path | None, overrides: Sequence[str] = ()
) -> RunPlace:
    """Return the folder of a run: ``out``, or one in ``runs`` with the name of ``folder_name``."""
    return RunPlace(out, folder_name(scenario, label_of(policy_name(policy)), overrides))


def write_run(
    prepared: Prepared,
    how: How,
    place: RunPlace,
    advance: Callable[[], None] = lambda: None,
    continuation: Begun | None = None,
) -> Done:
    """Run a policy and write the tables into the run folder while it runs.

    ``continuation``: the run of which this is the continuation (see ``resume``). Raises
    KeyboardInterrupt, and writes nothing, if Ctrl-C is pressed before the first counted episode has
    ended.
    """
    with place.draft() as draft:
        with draft.tables() as write:
            recorded = record(prepared, how, write, advance, continuation)
        recorded.write(draft)
        run_dir = place.publish(draft)
    return Done(
        recorded.summary | {"run_dir": str(run_dir)}, recorded.by_service, recorded.interrupted
    )


def record(
    prepared: Prepared,
    how: How,
    write: Write,
    advance: Callable[[], None] = lambda: None,
    continuation: Begun | None = None,
) -> Recorded:
    """Run a policy; ``write`` is called with the tables of episodes when they have ended.

    Raises KeyboardInterrupt if Ctrl-C is pressed before the first counted episode has ended.
    """
    episodes = run.play(
        prepared.world,
        prepared.policy,
        prepared.name,
        prepared.scenario.seed,
        how.episodes,
        how.warmup,
        how.keep_events,
        how.engine,
        None if continuation is None else continuation.first,
    )
    if continuation is None:
        return record_episodes(prepared, how, episodes, write, advance)
    for _ in range(-how.warmup, continuation.first):
        advance()
    missing = continuation.missing(prepared, episodes, how.keep_events, advance)
    recorded = record_episodes(prepared, how, missing, write, advance, continuation)
    recorded.manifest["resumed_at"] = continuation.done
    return recorded


def record_episodes(
    prepared: Prepared,
    how: How,
    episodes: Iterable[run.Played],
    write: Write,
    advance: Callable[[], None] = lambda: None,
    continuation: Begun | None = None,
) -> Recorded:
    """Record the episodes of a policy as ``record`` does, whoever plays them.

    ``continuation``: the run that these episodes continue.
    """
    world, policy, seed = prepared.world, prepared.policy, prepared.scenario.seed
    now = clock()
    started = now()
    played_by: Counter[str] = Counter({} if continuation is None else continuation.played_by())

    def noted() -> Iterator[run.Played]:
        for log, path in episodes:
            played_by[log.engine] += log.episode >= 0
            yield log, path

    tally = _write_tables(world, noted(), how.keep_events, write, advance, continuation)
    if not tally.episodes:
        raise KeyboardInterrupt
    settings = run.run_settings(world, policy, how.keep_events)
    manifest = {
        "scenario": prepared.scenario.name,
        "scenario_hash": scenario_hash(prepared.scenario),
        "policy": prepared.name,
        "seed": seed,
        "world_seed": prepared.scenario.effective_world_seed,
        "engine": how.engine,
        "played_by": dict(played_by),
        "ceilings": ["tallest" if c else "none" for c in settings.ceilings],
        "carry_over": settings.carry_over,
        "warmup": how.warmup,
        "episodes": tally.episodes,
        "episodes_asked": how.episodes,
        "interrupted": tally.episodes < how.episodes,
        "command": list(how.command),
        "overrides": list(how.overrides),
        "started": started,
        "finished": now(),
        "versions": versions(),
    }
    if world.attribution:
        manifest["attribution"] = world.attribution
    manifest |= {"name": how.name} if how.name else {}
    entries = {key: manifest[key] for key in NAMED if key in manifest}
    return Recorded(prepared, manifest, entries | tally.headline(), tally.groups())


def _write_tables(
    world: World,
    episodes: Iterable[run.Played],
    keep_events: bool,
    write: Write,
    advance: Callable[[], None],
    continuation: Begun | None,
) -> Tally:
    """Write the tables of episodes when they have ended, with one batch in memory at a time.

    Return the measures of the counted episodes, also by service. A signal ends the run after the
    current episode.
    """
    tally = Tally("service")
    rest = Rest() if continuation is None else continuation.rest()
    for name, part in () if continuation is None else continuation.parts():
        write(name, part)
        if name in MEASURED:
            tally.add(**{name: part})
    played: list[run.Played] = []
    with asked_to_stop("this episode") as stop:

        def put_down() -> None:
            with stop.undisturbed():
                results = run.tabulate(world, played, keep_events)
                rest.join(results)
                for name, frame in vars(results).items():
                    if frame is not None:
                        write(name, frame)
                tally.add(**{name: getattr(results, name) for name in MEASURED})
                played.clear()

        with suppress(KeyboardInterrupt):
            for episode in interruptible(episodes):
                played.append(episode)
                advance()
                if run.is_batch(played, rest.size):
                    put_down()
                if stop():
                    break
        with suppress(KeyboardInterrupt):  # a further one is raised when everything is written
            if played or rest.frames:
                put_down()
    return tally


def read_summary(
    folder: Path, by: str | None = None
) -> tuple[dict[str, Any], list[dict[str, Any]] | None]:
    """Return the summary of a finished run, and those of its requests grouped by a column.

    One row group is in memory at a time. Raises PolicyError if the tables are unreadable or
    contradict each other.
    """
    tally = Tally(by)
    requests_of, numbers = Counter[int](), set[int]()
    for requests in read_parts(folder, "requests", REQUESTS):
        problem = qoe.inconsistency(requests)
        if problem:
            raise PolicyError(f"{folder / 'requests.parquet'}: {problem}")
        requests_of.update(requests["episode"].tolist())
        tally.add(requests)
    for episodes in read_parts(folder, "episodes", EPISODES):
        tally.add(episodes=episodes)
        numbers.update(episodes["episode"])
        for episode, requests in zip(episodes["episode"], episodes["requests"], strict=True):
            if requests_of.pop(episode, 0) != requests:
                raise _of_two_runs(folder, "requests", episode)
    for episode in requests_of:
        raise _of_two_runs(folder, "requests", episode)
    if (folder / "sensors.parquet").exists():
        for sensors in read_parts(folder, "sensors", SENSORS):
            for episode in sorted({*sensors["episode"]} - numbers):
                raise _of_two_runs(folder, "sensors", episode)
            tally.add(sensors=sensors)
    manifest = read_manifest(folder)
    entries = {key: manifest[key] for key in NAMED if key in manifest}
    by_group = None if by is None else tally.groups()
    return entries | tally.headline() | {"run_dir": str(folder)}, by_group


def _of_two_runs(folder: Path, table: str, episode: int) -> PolicyError:
    return PolicyError(
        f"{folder}: {table}.parquet and episodes.parquet are not of one run: they differ in "
        f"episode {episode}"
    )


def label_of(name: str) -> str:
    """Return a policy's part of a folder's name: the name of its file or of the file's folder."""
    file = file_of(name)
    if file is None:
        module, _, own = name.rpartition(":")
        return f"{Path(module).stem}:{own}" if module.endswith(".py") else name
    name_of_file = file.absolute().parent.name if file.name in ALWAYS_CALLED else file.stem
    kind, argument = parts(name)
    options = argument.partition(file.name)[2]  # of a planner
    return f"{kind}-{name_of_file}{options}"
