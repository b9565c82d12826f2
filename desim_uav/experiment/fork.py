"""Counterfactuals: another policy goes on from a decision epoch of a run, on its sample paths."""

from __future__ import annotations

import re
from collections.abc import Callable, Generator, Iterable
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, NamedTuple

import pandas as pd

from desim_uav.engine.choose import faster, make_engine
from desim_uav.engine.episode import Engine
from desim_uav.engine.saved import SavedState
from desim_uav.errors import UsageError
from desim_uav.experiment import run
from desim_uav.experiment.command import (
    How,
    Prepared,
    Recorded,
    Write,
    label_of,
    record_episodes,
)
from desim_uav.experiment.evaluate import replicated
from desim_uav.experiment.run import Played
from desim_uav.measures.known import compared_in
from desim_uav.measures.tally import MEASURED, Tally
from desim_uav.policies.base import Policy
from desim_uav.registry import naming_plug_ins
from desim_uav.run_folder import RunDraft, RunPlace, folder_name
from desim_uav.sample_path import draw
from desim_uav.scenario.schema import Scenario

FORM = re.compile(r"(\d{1,9}):(\d{1,9})")
BRANCHES = ("original", "other")
"""The folders of the two branches in the folder of a counterfactual."""

FORK_FILE = "fork.json"


class At(NamedTuple):
    """A decision epoch: the number of an episode, and of the step that begins there, from 0."""

    episode: int
    step: int

    @classmethod
    def of(cls, text: str) -> At:
        """Return the epoch that a text such as ``0:12`` names. Raises UsageError."""
        match = FORM.fullmatch(text)
        if match is None:
            raise UsageError(
                f"--fork {text}: must be EPISODE:STEP, two numbers from 0 on, such as 0:12"
            )
        return cls(int(match[1]), int(match[2]))

    def __str__(self) -> str:
        return f"{self.episode}:{self.step}"


@dataclass
class Branches:
    """The two branches of a run: the original, and that in which another policy goes on.

    The latter has no ceiling if one of both policies has none: drones may already be above it, or
    its policy may send them there.
    """

    prepared: Prepared
    other: Policy
    other_name: str
    at: At
    how: How
    past: list[Played] = field(default_factory=list)
    """The episodes before the fork, which both branches have in common."""
    saved: SavedState | None = None
    at_us: int = 0
    """The time of the fork."""

    def original(self) -> Generator[Played]:
        """Yield the episodes of the first policy, and save the state at the fork."""
        prepared, how = self.prepared, self.how
        settings = run.run_settings(prepared.world, prepared.policy, how.keep_events)
        engine = make_engine(how.engine, prepared.world, settings)
        policy, name = prepared.policy, prepared.name
        for episode in range(-how.warmup, how.episodes):
            engine = faster(how.engine, engine)
            yield self._played(engine, policy, name, episode)
            if episode < self.at.episode:
                self.past.append((engine.log, engine.drawn))

    def continued(self) -> Generator[Played]:
        """Yield the episodes before the fork, and then those of the other policy."""
        yield from self.past
        assert self.saved is not None, "the original has been played"
        prepared, seed, saved = self.prepared, self.prepared.scenario.seed, self.saved
        ceiling = prepared.policy.ceiling and self.other.ceiling
        settings = saved.settings._replace(ceilings=(ceiling,) * len(saved.settings.ceilings))
        kind = self.how.engine if settings == saved.settings else "des"  # it takes up any way back
        engine, policy, name = (
            make_engine(kind, prepared.world, settings),
            self.other,
            self.other_name,
        )
        with naming_plug_ins():
            snapshot = engine.restore(saved)
            run.begin(policy, name, prepared.world, seed, self.at.episode, False)
            run.fly(engine, policy, name, snapshot)
        yield engine.log, engine.drawn
        for episode in range(self.at.episode + 1, self.how.episodes):
            yield self._played(engine, policy, name, episode)

    def _played(self, engine: Engine, policy: Policy, name: str, episode: int) -> Played:
        """Play an episode; the first time that it is the one of the fork, save the state there."""
        world, seed = self.prepared.world, self.prepared.scenario.seed
        with naming_plug_ins():
            carried = engine.settings.carry_over and engine.truncated and not engine.terminated
            run.begin(policy, name, world, seed, episode, carried)
            snapshot = engine.reset(draw(world, seed, episode))
            if episode == self.at.episode:
                snapshot = run.fly(engine, policy, name, snapshot, until=self.at.step)
                if snapshot.terminated or snapshot.truncated:
                    raise UsageError(
                        f"--fork {self.at}: episode {episode} is over after {snapshot.step} "
                        f"step(s); the last one that can be forked is {snapshot.step - 1}"
                    )
                self.saved, self.at_us = engine.save(), snapshot.t_us
            run.fly(engine, policy, name, snapshot)
        return engine.log, engine.drawn


class Forked(NamedTuple):
    """What was recorded of both branches, and ``about``, the content of ``fork.json``."""

    original: Recorded
    other: Recorded
    about: dict[str, Any]


def record_branches(
    branches: Branches, writes: tuple[Write, Write], advance: Callable[[], None] = lambda: None
) -> Forked:
    """Play both branches; ``writes`` are called with their tables.

    Raises UsageError if the episode of the fork ends before its step, and KeyboardInterrupt if
    Ctrl-C is pressed.
    """
    prepared, at, how = branches.prepared, branches.at, branches.how
    _check(branches)
    tallies = Since(at, prepared.scenario), Since(at, prepared.scenario)
    then = replace(
        prepared, policy=branches.other, name=f"{prepared.name}, then {branches.other_name}"
    )
    original = _recorded(prepared, how, branches.original(), tallies[0].noting(writes[0]), advance)
    other = _recorded(then, how, branches.continued(), tallies[1].noting(writes[1]), advance)
    fork = {
        "episode": at.episode,
        "step": at.step,
        "t_us": branches.at_us,
        "policy": prepared.name,
        "to": branches.other_name,
    }
    for recorded in (original, other):
        recorded.manifest["fork"] = fork
    assert branches.saved is not None
    measures = [each.measures() for each in tallies]
    entries = {key: original.manifest[key] for key in ("scenario", "seed", "world_seed")}
    about = entries | fork | {"episodes": how.episodes, "state": branches.saved.digest()}
    about |= dict(zip(BRANCHES, measures, strict=True)) | {"difference": _difference(*measures)}
    return Forked(original, other, about)


def _recorded(
    prepared: Prepared,
    how: How,
    episodes: Iterable[Played],
    write: Write,
    advance: Callable[[], None],
) -> Recorded:
    recorded = record_episodes(prepared, how, episodes, write, advance)
    if recorded.interrupted:
        raise KeyboardInterrupt
    return recorded


def _check(branches: Branches) -> None:
    """Raise UsageError for a step that no episode has."""
    world, at = branches.prepared.world, branches.at
    most = world.most_epochs
    if at.step >= most:
        have = f"at most {most} steps" if world.by_event else f"the steps 0 to {most - 1}"
        raise UsageError(f"--fork {at}: an episode has {have}; step {at.step} is none")


class Since:
    """The measures of a branch over the episodes from that of the fork on."""

    def __init__(self, at: At, scenario: Scenario) -> None:
        self.first, self.scenario = at.episode, scenario
        self.tally = Tally()

    def noting(self, write: Write) -> Write:
        """Return a function that writes a table, and adds up what the measures need."""

        def both(name: str, frame: pd.DataFrame) -> None:
            write(name, frame)
            if name in MEASURED:
                self.tally.add(**{name: frame[frame["episode"] >= self.first]})

        return both

    def measures(self) -> dict[str, float | None]:
        """Return the number of requests, and the measures that comparisons have."""
        names = ("requests", *compared_in(self.scenario))
        return replicated(self.tally.headline(), self.scenario, names)


def _difference(
    one: dict[str, float | None], other: dict[str, float | None]
) -> dict[str, float | None]:
    """Return what the other branch has more than the original; None where one has no value."""
    pairs = {name: (value, other[name]) for name, value in one.items()}
    return {
        name: None if first is None or second is None else second - first
        for name, (first, second) in pairs.items()
    }


# ---- the folder


def place_of_fork(branches: Branches, out: Path | None) -> RunPlace:
    """Return the folder of a counterfactual: ``out``, or one in ``runs`` that names what it is."""
    prepared, at = branches.prepared, branches.at
    name = folder_name(prepared.scenario, label_of(prepared.name), branches.how.overrides)
    return RunPlace(out, f"{name}-fork-{at.episode}-{at.step}-{label_of(branches.other_name)}")


def write_branches(
    branches: Branches, place: RunPlace, advance: Callable[[], None] = lambda: None
) -> tuple[Path, Forked]:
    """Play both branches and write their run folders, with ``fork.json``, into one folder.

    Nothing is left if the command fails or is interrupted.
    """
    with place.draft() as draft:
        drafts = [RunDraft(draft.path / name) for name in BRANCHES]
        for each in drafts:
            each.path.mkdir()
        with drafts[0].tables() as first, drafts[1].tables() as second:
            forked = record_branches(branches, (first, second), advance)
        for each, recorded in zip(drafts, forked[:2], strict=True):
            recorded.write(each)
            each.seal()
        draft.write_json(FORK_FILE, forked.about)
        return place.publish(draft), forked
