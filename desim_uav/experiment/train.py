"""The work of ``desim-uav train`` around a training: the folder, checkpoints and the policy."""

from __future__ import annotations

import json
import platform
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from desim_uav import __version__
from desim_uav.checksums import SUMS, of_contents
from desim_uav.engine.choose import engine_for
from desim_uav.errors import PolicyError, SimulationError, UsageError
from desim_uav.experiment.command import clock, versions
from desim_uav.experiment.interrupt import asked_to_stop, at_once
from desim_uav.learning import checkpoint
from desim_uav.learning.checkpoint import Checkpoint
from desim_uav.learning.training import Progress, Training
from desim_uav.policies.tabular import QTable, described
from desim_uav.records import TRAINING, to_frame
from desim_uav.run_folder import Place, held, parquet, world_content, world_hash, write_whole
from desim_uav.scenario.load import dump, scenario_hash
from desim_uav.scenario.schema import Scenario
from desim_uav.world import World, build_world

CHECKPOINT, BEFORE = "checkpoint.npz", "checkpoint-before.npz"
POLICY, MANIFEST = "policy.npz", "manifest.json"
PROVENANCE = ("scenario", "scenario_hash", "algorithm", "seed", "world_seed", "episodes")
LAST = 100
"""The number of last episodes over whose means a training is summarized."""

OnEpisode = Callable[[list[Progress]], None]


@dataclass
class Course:
    """A training and its rows so far, one per drone and episode.

    ``first`` is the episode at which it was resumed. ``stopped`` says that a callback has ended it
    before its last episode; it then counts as finished.
    """

    training: Training
    rows: list[Progress] = field(default_factory=list)
    first: int = 0
    started: str = ""
    finished: str = ""
    command: Sequence[str] = ()
    stopped: bool = False

    @property
    def interrupted(self) -> bool:
        """Whether Ctrl-C ended the training before its last episode."""
        return not self.stopped and self.training.episode < self.training.settings.episodes

    def summary(self, folder: Path | None = None) -> dict[str, Any]:
        """Return the means of the last episodes."""
        return _summary(self.training, self.rows, folder)


@dataclass(frozen=True)
class Pause:
    """An action after every ``every`` episodes; if it returns False, the training stops.

    With ``at_end`` it is also done after the last episode, whatever its number.
    """

    every: int
    act: Callable[[Course], bool]
    at_end: bool = False

    def after(self, episode: int) -> int:
        """Return the next episode after which the action is due."""
        return episode + self.every - episode % self.every

    def is_due(self, episode: int, last: int) -> bool:
        """Return whether the action is due after ``episode`` of ``last`` episodes."""
        return episode % self.every == 0 or (self.at_end and episode == last)


@dataclass
class Trained:
    """A training that has ended or was interrupted, with its summary and folder."""

    summary: dict[str, Any]
    interrupted: bool
    course: Course
    folder: Path


def begin(scenario: Scenario, engine: str | None = None) -> Course:
    """Begin a training; ``engine`` is des or batch, by default that of ``engine_for``."""
    world = build_world(scenario, scenario.effective_world_seed)
    return Course(Training(world, scenario.seed, engine or engine_for(world)))


def train(
    scenario: Scenario,
    world: World,
    on_episode: OnEpisode = lambda rows: None,
    engine: str | None = None,
) -> tuple[QTable, list[Progress]]:
    """Train from beginning to end; return the learned table, and a row per drone and episode.

    ``engine`` is des or batch, by default that of ``engine_for``. Raises SimulationError if values
    are learned that are not finite.
    """
    course = Course(Training(world, scenario.seed, engine or engine_for(world)))
    learn(course, (), on_episode)
    return _learned(course.training), course.rows


def learn(
    course: Course,
    pauses: Sequence[Pause],
    on_episode: OnEpisode = lambda rows: None,
    stop: Callable[[], bool] = lambda: False,
) -> None:
    """Learn until the last episode, until ``stop()`` is true, or until a pause returns False.

    Compiled code learns several episodes at once. Pauses come exactly after the episodes at which
    they are due, and do not change the result.
    """
    training, last = course.training, course.training.settings.episodes
    while training.episode < last and not stop() and not course.stopped:
        following = min([last, *(pause.after(training.episode) for pause in pauses)])
        course.rows += _play_to(training, following, on_episode)
        for pause in pauses:
            if pause.is_due(training.episode, last) and not pause.act(course):
                course.stopped = training.episode < last


def _play_to(training: Training, episode: int, on_episode: OnEpisode) -> list[Progress]:
    """Learn some of the episodes up to this one, and call ``on_episode`` for each."""
    rows = at_once(training.play, episode - training.episode)
    drones = len(training.learners)
    for first in range(0, len(rows), drones):
        on_episode(rows[first : first + drones])
    return rows


def table_of(training: Training) -> QTable:
    """Return the policy that a training has learned so far: the mean of each drone's Q-tables."""
    world, scenario = training.world, training.world.scenario
    about = {
        "features": described(training.features),
        "actions": [action.name.lower() for action in world.actions],
        "scenario": scenario.name,
        "scenario_hash": scenario_hash(scenario),
        "scenario_yaml": dump(scenario),
        "world_seed": world.seed,
        "world_hash": world_hash(world),
        "seed": training.seed,
        "algorithm": training.settings.algorithm,
        "episodes": training.episode,
        "versions": {
            "desim-uav": __version__,
            "python": platform.python_version(),
            "numpy": np.__version__,
        },
    }
    return QTable(training.q.mean(axis=1, dtype=np.float32), about)


def _learned(training: Training) -> QTable:
    """Return the policy of a finished training. Raises SimulationError if it is not of numbers."""
    if not np.isfinite(training.q).all():
        raise SimulationError(
            f"learning.algorithm: {training.settings.algorithm!r} has learned values that are not "
            "finite"
        )
    return table_of(training)


def train_to_folder(
    scenario: Scenario,
    *,
    out: Path | None,
    resume: bool,
    checkpoint_every: int,
    command: Sequence[str],
    engine: str | None = None,
    pauses: Sequence[Pause] = (),
    on_start: Callable[[int], None] = lambda episode: None,
    on_episode: OnEpisode = lambda rows: None,
) -> Trained:
    """Train and write the folder, with a checkpoint after every ``checkpoint_every`` episodes.

    ``engine`` is des or batch, by default that of ``engine_for``. Ctrl-C ends the training after
    the current episode (with compiled code, after a few) and writes a checkpoint. Raises UsageError
    if the folder cannot be used, and PolicyError if its checkpoint cannot.
    """
    now = clock()
    course = begin(scenario, engine)
    course.started, course.command = now(), command
    folder = _resumable(scenario, out) if resume else _not_begun(scenario, out)

    def save(course: Course) -> bool:
        _save(course, folder)
        return True

    with held(folder), asked_to_stop("these episodes") as stop:
        course.rows = _resumed(course.training, folder / CHECKPOINT)
        course.first = course.training.episode
        if not (folder / CHECKPOINT).exists():
            _save(course, folder)  # first of all, as only a folder with a checkpoint is resumed
        if not (folder / MANIFEST).exists():  # a finished training stays intact until the end
            write_whole(folder / "scenario.yaml", dump(scenario).encode())
        on_start(course.first)
        learn(course, [Pause(checkpoint_every, save), *pauses], on_episode, stop)
        _save(course, folder)
        course.finished = now()
        if not course.interrupted:
            _finish(course, folder)
    return Trained(course.summary(folder), course.interrupted, course, folder)


def train_in_memory(
    scenario: Scenario,
    *,
    command: Sequence[str],
    engine: str | None = None,
    pauses: Sequence[Pause] = (),
    on_episode: OnEpisode = lambda rows: None,
) -> Course:
    """Train and write nothing. Ctrl-C ends the training after the current episodes."""
    now = clock()
    course = begin(scenario, engine)
    course.started, course.command = now(), command
    with asked_to_stop("these episodes") as stop:
        learn(course, pauses, on_episode, stop)
    course.finished = now()
    return course


def save_training(course: Course, out: Path | None) -> Path:
    """Write the folder of a training that is in memory. Raises UsageError if it cannot."""
    folder = _new(course.training.world.scenario, out)
    with held(folder):
        _save(course, folder)
        _finish(course, folder)
    return folder


def _place(scenario: Scenario, out: Path | None) -> Place:
    return Place(out, f"{scenario.name}-{scenario.learning.algorithm}-s{scenario.seed}")


def _new(scenario: Scenario, out: Path | None) -> Path:
    """Return a new folder, or ``out`` if it is empty. Raises UsageError if it cannot be made."""
    folder = _place(scenario, out).vacant()
    try:
        folder.mkdir(parents=True, exist_ok=out is not None)
    except OSError as error:
        raise UsageError(f"cannot write to {folder}: {error.strerror}") from error
    return folder


def _not_begun(scenario: Scenario, out: Path | None) -> Path:
    """Return a new folder. Raises UsageError, with a hint at ``--resume`` for a training."""
    with suppress(OSError):  # of what cannot be read, ``_new`` says more
        if out is not None and _is_begun(out):
            raise UsageError(
                f"--out {out}: the folder is not empty: it holds a training; continue it with "
                "--resume, or name another folder"
            )
    return _new(scenario, out)


def _resumable(scenario: Scenario, out: Path | None) -> Path:
    """Return the folder of this training, or a new one if there is none.

    Without ``out`` it is the last folder of its name that holds this training; unfinished
    trainings come before finished ones. Raises UsageError if ``out`` holds something else.
    """
    if out is not None:
        return out if _is_begun(out) else _new(scenario, out)
    mine = [folder for folder in _place(scenario, None).taken() if _is_of(scenario, folder)]
    mine.sort(key=lambda folder: not (folder / MANIFEST).exists())
    return mine[-1] if mine else _new(scenario, None)


def _is_begun(folder: Path) -> bool:
    """Return whether there is a checkpoint, or only the remains of one after a kill."""
    if (folder / CHECKPOINT).is_file():
        return True
    left = list(folder.iterdir()) if folder.is_dir() else []
    return bool(left) and all(path.name.startswith(f".{CHECKPOINT}-") for path in left)


def _is_of(scenario: Scenario, folder: Path) -> bool:
    """Return whether this folder may hold this training; an unreadable checkpoint counts, too."""
    if not (folder / CHECKPOINT).is_file():
        return False
    try:
        return checkpoint.identity(folder / CHECKPOINT) == _identity(scenario)
    except PolicyError:
        return True


def _resumed(training: Training, file: Path) -> list[Progress]:
    """Continue from a checkpoint, if there is one, and return its rows.

    Raises PolicyError if the checkpoint is damaged or belongs to another training.
    """
    if not file.exists():
        return []
    try:
        if checkpoint.identity(file) != _identity(training.world.scenario):
            raise PolicyError(
                f"{file}: the checkpoint of another training: its scenario, seeds or learning "
                "parameters differ"
            )
        found = checkpoint.read(file, training.q.shape)
    except PolicyError as error:
        raise PolicyError(f"{error}{_older(training, file)}") from error
    if found.memory.episode > training.settings.episodes:
        raise PolicyError(
            f"{file}: it has learned for {found.memory.episode} episodes already, more than "
            f"{training.settings.episodes}"
        )
    try:
        training.recall(found.memory)
    except PolicyError as error:
        raise PolicyError(f"{file}: {error}") from error
    return found.rows


def _older(training: Training, damaged: Path) -> str:
    """Return a hint at the checkpoint before a damaged one, if it is intact, or ""."""
    before = damaged.with_name(BEFORE)
    try:
        if checkpoint.identity(before) != _identity(training.world.scenario):
            return ""
        episode = checkpoint.read(before, training.q.shape).memory.episode
    except PolicyError:
        return ""
    return f"; the one before it, of episode {episode}, is intact: mv {before} {damaged}"


def _identity(scenario: Scenario) -> str:
    """Return the text by which a training recognizes its checkpoint, without its length."""
    learning = scenario.learning.model_copy(update={"episodes": 1})
    return f"{__version__}/{scenario_hash(scenario.model_copy(update={'learning': learning}))}"


def _save(course: Course, folder: Path) -> None:
    training = course.training
    found = Checkpoint(_identity(training.world.scenario), training.remember(), course.rows)
    content = checkpoint.to_bytes(found)
    with suppress(OSError):
        write_whole(folder / BEFORE, (folder / CHECKPOINT).read_bytes())
    write_whole(folder / CHECKPOINT, content)


def _finish(course: Course, folder: Path) -> None:
    """Write the files of a finished training; the manifest comes last."""
    training = course.training
    table = _learned(training)
    manifest = {key: table.about[key] for key in PROVENANCE} | {
        "kind": "training",
        "resumed_at": course.first,
        "command": list(course.command),
        "started": course.started,
        "finished": course.finished,
        "versions": versions(),
    }
    if course.stopped:
        manifest["stopped"] = True
    files = {
        "scenario.yaml": dump(training.world.scenario).encode(),
        "world.json": json.dumps(world_content(training.world)).encode(),
        "training.parquet": parquet("training", to_frame(TRAINING, course.rows)),
        POLICY: table.to_bytes(),
        MANIFEST: (json.dumps(manifest, indent=1) + "\n").encode(),
    }
    files = {SUMS: of_contents(files).encode()} | files
    for name, content in files.items():
        write_whole(folder / name, content)
    (folder / BEFORE).unlink(missing_ok=True)


def _summary(training: Training, rows: list[Progress], folder: Path | None) -> dict[str, Any]:
    """Return the means of the last episodes, and the folder and policy file if there is one."""
    last = to_frame(TRAINING, rows)
    last = last[last["episode"] >= training.episode - LAST]
    scenario = training.world.scenario
    where = {} if folder is None else {"folder": str(folder), "policy": str(folder / POLICY)}
    return {
        "scenario": scenario.name,
        "algorithm": training.settings.algorithm,
        "seed": training.seed,
        "world_seed": training.world.seed,
        "episodes": training.episode,
        "over_last": min(LAST, training.episode),
        "reward_mean": _mean(last["reward"]),
        "qoe1_percent": _mean(last["qoe1_percent"]),
        "qoe2_iterations": _mean(last["qoe2_iterations"]),
        "qoe3_percent": _mean(last["qoe3_percent"]),
        "crashes_per_drone_episode": _mean(last["crashes"]),
        **where,
    }


def _mean(column: pd.Series) -> float | None:
    there = column.dropna()
    return float(there.mean()) if len(there) else None
