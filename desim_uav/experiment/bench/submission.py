"""Submissions: the folder with the rows and the commands of a policy in a task of the benchmark.

The policies of several trainings may be in one submission. Its manifest lists them, and each row
has the number of its training.
"""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, Field

from desim_uav.array_file import Stored, pack
from desim_uav.checksums import verify
from desim_uav.errors import PolicyError, UsageError
from desim_uav.experiment.bench import commands as kept
from desim_uav.experiment.bench.commands import ARRAYS, Commands
from desim_uav.experiment.bench.measure import Measured, replayed
from desim_uav.experiment.bench.score import CRASHES, measures_of
from desim_uav.experiment.bench.tasks import (
    BENCHMARK,
    TRACKS,
    BenchTrack,
    Task,
    find_task,
    find_track,
)
from desim_uav.report.json_file import Form, read_json
from desim_uav.rowcode.regular_file import text_of
from desim_uav.run_folder import RunPlace
from desim_uav.scenario.epochs import most_epochs

FORMAT = 2

MOST_BYTES = 2**24
ROWS, COMMANDS, MANIFEST = "rows.csv", "commands.npz", "manifest.json"
TRAINING = "training"
WHOLE, WORDS = ("seed", "world_seed"), ("digest",)
LAST = ("decision_ms",)


def blank(name: str) -> bool:
    """Return whether nothing of a name can be seen."""
    return not any(letter.isprintable() and not letter.isspace() for letter in name)


def _seen(name: str) -> str:
    """Return a name. Raises ValueError if nothing of it can be seen."""
    if blank(name):
        raise ValueError("it must not be blank")
    return name


SubmissionText = Annotated[str, Field(max_length=10_000)]
Seed = Annotated[int, Field(ge=0, lt=2**63)]


class OfTraining(Form):
    """The policy of a training, with the digests of its file and of what it decided."""

    policy: SubmissionText
    policy_sha256: SubmissionText | None
    decisions_sha256: SubmissionText


class About(Form):
    """What a submission says of itself, without its versions and times."""

    format: Literal[2]
    benchmark: Literal["uav-v1"]
    task: SubmissionText
    track: SubmissionText
    seal: SubmissionText | None
    scenario_hash: SubmissionText
    trainings: Annotated[list[OfTraining], Field(min_length=1, max_length=100)]
    training_steps: Seed | None = None
    name: Annotated[SubmissionText, AfterValidator(_seen)]
    information: SubmissionText
    knows_future: bool
    ceiling: bool
    engine: SubmissionText
    episodes: Seed
    warmup: Seed
    seeds: Annotated[list[Seed], Field(min_length=1, max_length=1000)]
    interrupted: bool

    @property
    def is_trained(self) -> bool:
        """Whether its policies come from files, or it states how long they were trained."""
        return self.training_steps is not None or any(one.policy_sha256 for one in self.trainings)

    @property
    def runs(self) -> list[tuple[int, int]]:
        """The training and the seed of each row, in their order."""
        return [(number, seed) for number in range(len(self.trainings)) for seed in self.seeds]


@dataclass(frozen=True)
class Submission:
    """A submission that was read: what it says of itself, its rows, and the commands of each row.

    Each row has the number of its training.
    """

    folder: Path
    about: About
    task: Task
    track: BenchTrack
    rows: Sequence[Mapping[str, Any]]
    commands: Sequence[Commands]


def write(place: RunPlace, manifest: dict[str, Any], measured: Sequence[Measured]) -> Path:
    """Write the folder of a submission completely or not at all, and return its place."""
    commands = kept.joined([one.commands for one in measured])
    form = {"format": FORMAT, "seeds": manifest["seeds"]}
    with place.draft() as draft:
        draft.write_json(MANIFEST, manifest)
        rows = [one.row for one in measured]
        columns = columns_of(find_task(manifest["task"]))
        draft.write_text(ROWS, as_csv(rows, columns))
        draft.write_bytes(COMMANDS, pack(form, **commands))
        return place.publish(draft)


def columns_of(task: Task) -> tuple[str, ...]:
    """Return the columns of ``rows.csv`` in a task; an empty cell has no value."""
    return (TRAINING, *WHOLE, *replayed(task.scenario(TRACKS["one"])), *WORDS, *LAST)


def as_csv(rows: Sequence[Mapping[str, Any]], columns: Sequence[str]) -> str:
    """Return these columns of rows as CSV, with all digits of each number."""
    text = io.StringIO()
    writer = csv.DictWriter(text, columns, extrasaction="ignore", lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
    return text.getvalue()


def read(folder: Path, tracks: Mapping[str, BenchTrack] = TRACKS) -> Submission:
    """Read a submission on the tracks of the public set, or of one that was sealed.

    Raises PolicyError, which names the file, if it is unreadable, has changed since it was written,
    is of another version of the task, or if its files do not fit together.
    """
    if not folder.is_dir():
        raise PolicyError(f"{folder}: no such folder of a submission")
    about = About.model_validate(read_json(folder / MANIFEST, About, "a submission's manifest"))
    try:
        task, track = find_task(about.task), find_track(about.track, tracks)
    except UsageError as error:
        raise PolicyError(f"{folder / MANIFEST}: {error}") from error
    if about.scenario_hash != task.scenario_hash:
        raise PolicyError(
            f"{folder / MANIFEST}: scenario_hash: it is of another version of {task.name}, whose "
            f"hash is {task.scenario_hash}"
        )
    if about.seal != track.seal:
        raise PolicyError(
            f"{folder / MANIFEST}: seal: it is {about.seal or 'of the public set'}, but the set "
            f"that is used is {track.seal or 'the public one'}; see --revealed"
        )
    rows = _read_rows(folder / ROWS, task)
    if [(row[TRAINING], row["seed"]) for row in rows] != about.runs:
        raise PolicyError(
            f"{folder / ROWS}: its seeds are not those of {MANIFEST}, for each training in turn"
        )
    return Submission(folder, about, task, track, rows, _read_commands(folder, about, task))


def read_all(
    folders: Sequence[Path], tracks: Mapping[str, BenchTrack] = TRACKS
) -> list[Submission]:
    """Read submissions; a folder of submissions stands for all in it. Raises as ``read`` does."""
    return [read(each, tracks) for folder in folders for each in _submissions(folder)]


def _submissions(folder: Path) -> list[Path]:
    """Return the folders of submissions in a folder, or the folder itself if there are none."""
    if (folder / MANIFEST).exists() or not folder.is_dir():
        return [folder]
    return sorted(each.parent for each in folder.glob(f"*/{MANIFEST}")) or [folder]


def _read_rows(file: Path, task: Task) -> list[dict[str, Any]]:
    columns, needed = columns_of(task), [CRASHES, *(one.name for one in measures_of(task))]
    try:
        verify(file)
        reader = csv.DictReader(io.StringIO(text_of(file, MOST_BYTES)), strict=True)
        if tuple(reader.fieldnames or ()) != columns:
            raise ValueError(f"its columns must be {', '.join(columns)}")
        return [_values(row, columns, needed) for row in reader]
    except (OSError, ValueError, csv.Error) as error:
        reason = getattr(error, "strerror", None) or error
        raise PolicyError(f"{file}: not readable rows of a submission: {reason}") from error


def _values(
    row: Mapping[str, str | None], columns: Sequence[str], needed: Sequence[str]
) -> dict[str, Any]:
    if len(row) != len(columns):
        raise ValueError("a row is too long")
    values = {name: _value(name, row[name]) for name in columns}
    for name in needed:
        if values[name] is None:
            raise ValueError(f"{name}: there is no value")
    return values


def _value(name: str, text: str | None) -> Any:
    if text is None:
        raise ValueError(f"{name}: a row is too short")
    if name in WORDS:
        return text
    try:
        value = int(text) if name in (TRAINING, *WHOLE) else float(text) if text else None
    except ValueError:
        raise ValueError(f"{name}: {text[:40]!r} is not a number") from None
    if value is not None and not math.isfinite(value):
        raise ValueError(f"{name}: {text[:40]!r} is not finite")
    if value is not None and name in LAST and value < 0:
        raise ValueError(f"{name}: {text[:40]!r} is negative")
    return value


def _read_commands(folder: Path, about: About, task: Task) -> list[Commands]:
    file = folder / COMMANDS
    verify(file)
    stored = Stored(file, "file of commands", list(ARRAYS), FORMAT)
    scenario = task.scenario(TRACKS[about.track])
    shape = (len(about.runs), about.warmup + about.episodes)
    try:
        kept.require_forms(stored.forms, shape, most_epochs(scenario) + 1, scenario.drone_count)
        commands = kept.parted(stored.arrays())
    except ValueError as error:
        raise PolicyError(f"{file}: {error}") from error
    if stored.about.get("seeds") != about.seeds:
        raise PolicyError(f"{file}: its seeds are not those of {MANIFEST}")
    return commands


def place_of(task: Task, track: BenchTrack, name: str, out: Path | None) -> RunPlace:
    """Return the folder of a submission: ``out``, or one in ``runs``."""
    return RunPlace(out, f"{BENCHMARK}-{task.family}-{task.size}-{track.name}-{name}")
