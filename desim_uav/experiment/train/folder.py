"""The folder of a training: a checkpoint while it goes on, and in the end what was learned."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from contextlib import suppress
from pathlib import Path

from desim_uav import __version__
from desim_uav.checksums import SUMS, of_contents
from desim_uav.columns import to_frame
from desim_uav.disk import write_whole
from desim_uav.errors import PolicyError, UsageError, notice
from desim_uav.experiment.interrupt import asked_to_stop
from desim_uav.experiment.provenance import versions
from desim_uav.experiment.train.course import (
    NOT_SAID,
    POLICY,
    Asked,
    OnEpisode,
    TrainingCourse,
    TrainingPause,
    begin,
    learn,
    learned,
)
from desim_uav.learning import checkpoint
from desim_uav.learning.training import Training
from desim_uav.lock import held
from desim_uav.parquet_file import parquet
from desim_uav.records import TRAINING
from desim_uav.run_folder import RunPlace, folder_name, world_content
from desim_uav.scenario.load import files_of, scenario_hash
from desim_uav.scenario.schema import Scenario

CHECKPOINT, BEFORE = "checkpoint.npz", "checkpoint-before.npz"
MANIFEST = "manifest.json"
PROVENANCE = ("scenario", "scenario_hash", "algorithm", "seed", "world_seed", "episodes")


def train_to_folder(
    scenario: Scenario,
    *,
    out: Path | None,
    resume: bool,
    checkpoint_every: int,
    asked: Asked = NOT_SAID,
    engine: str = "auto",
    pauses: Sequence[TrainingPause] = (),
    on_start: Callable[[int], None] = lambda episode: None,
    on_episode: OnEpisode = lambda rows: None,
) -> TrainingCourse:
    """Train and write the folder, with a checkpoint after every ``checkpoint_every`` episodes.

    ``engine`` is auto (that of ``engine_for``), des or batch. Ctrl-C ends the training after
    the current episode (with compiled code, after a few) and writes a checkpoint. Raises UsageError
    if the folder cannot be used, and PolicyError if its checkpoint cannot.
    """
    course = begin(scenario, engine, asked)
    name = _name(course)
    folder = _resumable(scenario, out, name) if resume else _not_begun(out, name)
    with held(folder), asked_to_stop("these episodes") as stop:
        _resume(course, folder / CHECKPOINT)
        if not (folder / CHECKPOINT).exists():
            _save(course, folder)  # first of all, as only a folder with a checkpoint is resumed
        if not (folder / MANIFEST).exists():  # a finished training stays intact until the end
            for name, content in files_of(scenario).items():
                write_whole(folder / name, content)
        on_start(course.first)
        saving = TrainingPause(checkpoint_every, lambda course: _save(course, folder))
        learn(course, [saving, *pauses], on_episode, stop)
        _save(course, folder)
        if not course.interrupted:
            _finish(course, folder)
    course.folder = folder
    return course


def save_training(course: TrainingCourse, out: Path | None) -> Path:
    """Write the folder of a training that is in memory. Raises UsageError if it cannot."""
    folder = _new(out, _name(course))
    with held(folder):
        _save(course, folder)
        _finish(course, folder)
    return folder


def _name(course: TrainingCourse) -> str:
    scenario = course.training.world.scenario
    return folder_name(scenario, scenario.learning.algorithm, course.asked.overrides)


def _new(out: Path | None, name: str) -> Path:
    """Return a new folder, or ``out`` if it is empty. Raises UsageError if it cannot be made."""
    folder = RunPlace(out, name).vacant()
    try:
        folder.mkdir(parents=True, exist_ok=out is not None)
    except OSError as error:
        raise UsageError(f"cannot write to {folder}: {error.strerror}") from error
    return folder


def _not_begun(out: Path | None, name: str) -> Path:
    """Return a new folder. Raises UsageError, with a hint at ``--resume`` for a training."""
    with suppress(OSError):  # of what cannot be read, ``_new`` says more
        if out is not None and _is_begun(out):
            raise UsageError(
                f"--out {out}: the folder is not empty: it holds a training; continue it with "
                "--resume, or name another folder"
            )
    return _new(out, name)


def _resumable(scenario: Scenario, out: Path | None, name: str) -> Path:
    """Return the folder of this training, or a new one if there is none.

    Without ``out`` it is the last folder of its name that holds this training; unfinished
    trainings come before finished ones. Raises UsageError if ``out`` holds something else.
    """
    if out is not None:
        if _is_begun(out):
            return out
        folder = _new(out, name)
        nothing = "holds no training, so there is nothing to resume: it begins anew"
        notice(f"--resume: {out} {nothing}")
        return folder
    mine = [folder for folder in RunPlace(None, name).taken() if _is_of(scenario, folder)]
    mine.sort(key=lambda folder: not (folder / MANIFEST).exists())
    return mine[-1] if mine else _new(None, name)


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


def _resume(course: TrainingCourse, file: Path) -> None:
    """Continue from a checkpoint, if there is one.

    Raises PolicyError if the checkpoint is damaged or belongs to another training.
    """
    training = course.training
    if not file.exists():
        return
    try:
        if checkpoint.identity(file) != _identity(training.world.scenario):
            raise PolicyError(
                f"{file}: the checkpoint of another training: its scenario, a file or component of "
                "it, seeds or learning parameters differ"
            )
        point = checkpoint.read(file, training.q.shape)
    except PolicyError as error:
        raise PolicyError(f"{error}{_older(training, file)}") from error
    if point.memory.episode > training.settings.episodes:
        raise PolicyError(
            f"{file}: it has learned for {point.memory.episode} episodes already, more than "
            f"{training.settings.episodes}"
        )
    try:
        training.recall(point.memory)
    except PolicyError as error:
        raise PolicyError(f"{file}: {error}") from error
    course.rows, course.first = point.rows, training.episode


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


def _save(course: TrainingCourse, folder: Path) -> None:
    training = course.training
    point = checkpoint.Checkpoint(
        _identity(training.world.scenario), training.remember(), course.rows
    )
    content = checkpoint.to_bytes(point)
    with suppress(OSError):
        write_whole(folder / BEFORE, (folder / CHECKPOINT).read_bytes())
    write_whole(folder / CHECKPOINT, content)


def _finish(course: TrainingCourse, folder: Path) -> None:
    """Write the files of a finished training; the manifest comes last."""
    training = course.training
    table = learned(training)
    manifest = {key: table.about[key] for key in PROVENANCE} | {
        "kind": "training",
        "resumed_at": course.first,
        "command": list(course.asked.command),
        "overrides": list(course.asked.overrides),
        "started": course.started,
        "finished": course.finished,
        "versions": versions(),
    }
    if course.asked.name:
        manifest["name"] = course.asked.name
    if course.stopped:
        manifest["stopped"] = True
    files = {
        **files_of(training.world.scenario),
        "world.json": json.dumps(world_content(training.world)).encode(),
        "training.parquet": parquet("training", to_frame(TRAINING, course.rows)),
        POLICY: table.to_bytes(),
        MANIFEST: (json.dumps(manifest, indent=1) + "\n").encode(),
    }
    files = {SUMS: of_contents(files).encode()} | files
    for name, content in files.items():
        write_whole(folder / name, content)
    (folder / BEFORE).unlink(missing_ok=True)
