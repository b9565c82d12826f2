"""Submissions: the folder with the rows and the commands of a policy in a task of the benchmark."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field

from desim_uav.array_file import Stored, pack
from desim_uav.checksums import verify
from desim_uav.errors import PolicyError, UsageError
from desim_uav.experiment.bench.measure import NONE, REPLAYED, Commands, Measured
from desim_uav.experiment.bench.tasks import BENCHMARK, Task, Track, find_task, find_track
from desim_uav.regular_file import text_of
from desim_uav.report.json_file import Form, read_json
from desim_uav.run_folder import Place

FORMAT = 1
MOST_BYTES = 2**24
ROWS, COMMANDS, MANIFEST = "rows.csv", "commands.npz", "manifest.json"
WHOLE, WORDS = ("seed", "world_seed"), ("digest",)
COLUMNS = (*WHOLE, *REPLAYED, *WORDS, "qoe3_at_most_percent", "decision_ms")
"""The columns of ``rows.csv``; an empty cell has no value."""

Text = Annotated[str, Field(max_length=10_000)]
Seed = Annotated[int, Field(ge=0, lt=2**63)]


class About(Form):
    """What a submission says of itself, without its versions and times."""

    format: Literal[1]
    benchmark: Literal["uav-v1"]
    task: Text
    track: Text
    scenario_hash: Text
    policy: Text
    policy_sha256: Text | None
    name: Text
    information: Text
    knows_future: bool
    ceiling: bool
    engine: Text
    episodes: Seed
    warmup: Seed
    seeds: Annotated[list[Seed], Field(min_length=1, max_length=1000)]
    interrupted: bool


@dataclass(frozen=True)
class Submission:
    """A submission that was read: what it says of itself, its rows and its commands by seed."""

    folder: Path
    about: About
    task: Task
    track: Track
    rows: Sequence[Mapping[str, Any]]
    commands: Mapping[int, Commands]


def write(place: Place, manifest: dict[str, Any], measured: Sequence[Measured]) -> Path:
    """Write the folder of a submission completely or not at all, and return its place."""
    seeds = [one.row["seed"] for one in measured]
    commands = np.stack([one.commands for one in measured])
    with place.draft() as draft:
        draft.write_json(MANIFEST, manifest)
        draft.write_text(ROWS, as_csv([one.row for one in measured]))
        (draft.path / COMMANDS).write_bytes(
            pack({"format": FORMAT, "seeds": seeds}, commands=commands)
        )
        return place.publish(draft)


def as_csv(rows: Sequence[Mapping[str, Any]]) -> str:
    """Return rows as CSV, with all digits of each number."""
    text = io.StringIO()
    writer = csv.DictWriter(text, COLUMNS, lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
    return text.getvalue()


def read(folder: Path) -> Submission:
    """Read a submission.

    Raises PolicyError, which names the file, if it is unreadable, has changed since it was written,
    is of another version of the task, or if its files do not fit together.
    """
    if not folder.is_dir():
        raise PolicyError(f"{folder}: no such folder of a submission")
    about = About.model_validate(read_json(folder / MANIFEST, About, "a submission's manifest"))
    try:
        task, track = find_task(about.task), find_track(about.track)
    except UsageError as error:
        raise PolicyError(f"{folder / MANIFEST}: {error}") from error
    if about.scenario_hash != task.scenario_hash:
        raise PolicyError(
            f"{folder / MANIFEST}: scenario_hash: it is of another version of {task.name}, whose "
            f"hash is {task.scenario_hash}"
        )
    rows = _read_rows(folder / ROWS)
    if [row["seed"] for row in rows] != about.seeds:
        raise PolicyError(f"{folder / ROWS}: its seeds are not those of {MANIFEST}")
    return Submission(folder, about, task, track, rows, _read_commands(folder, about, task))


def read_all(folders: Sequence[Path]) -> list[Submission]:
    """Read submissions; a folder of submissions stands for all in it. Raises as ``read`` does."""
    return [read(each) for folder in folders for each in _submissions(folder)]


def _submissions(folder: Path) -> list[Path]:
    """Return the folders of submissions in a folder, or the folder itself if there are none."""
    if (folder / MANIFEST).exists() or not folder.is_dir():
        return [folder]
    return sorted(each.parent for each in folder.glob(f"*/{MANIFEST}")) or [folder]


def _read_rows(file: Path) -> list[dict[str, Any]]:
    try:
        verify(file)
        reader = csv.DictReader(io.StringIO(text_of(file, MOST_BYTES)), strict=True)
        if tuple(reader.fieldnames or ()) != COLUMNS:
            raise ValueError(f"its columns must be {', '.join(COLUMNS)}")
        return [_values(row) for row in reader]
    except (OSError, ValueError, csv.Error) as error:
        reason = getattr(error, "strerror", None) or error
        raise PolicyError(f"{file}: not readable rows of a submission: {reason}") from error


def _values(row: Mapping[str, str | None]) -> dict[str, Any]:
    if len(row) != len(COLUMNS):
        raise ValueError("a row is too long")
    values = {name: _value(name, row[name]) for name in COLUMNS}
    if values["qoe3_percent"] is None:
        raise ValueError("qoe3_percent: there is no value")
    return values


def _value(name: str, text: str | None) -> Any:
    if text is None:
        raise ValueError(f"{name}: a row is too short")
    if name in WORDS:
        return text
    try:
        value = int(text) if name in WHOLE else float(text) if text else None
    except ValueError:
        raise ValueError(f"{name}: {text[:40]!r} is not a number") from None
    if value is not None and not math.isfinite(value):
        raise ValueError(f"{name}: {text[:40]!r} is not finite")
    return value


def _read_commands(folder: Path, about: About, task: Task) -> dict[int, Commands]:
    file = folder / COMMANDS
    verify(file)
    stored = Stored(file, "file of commands", ["commands"], FORMAT)
    scenario = task.scenario(find_track(about.track))
    episodes, steps = about.warmup + about.episodes, scenario.episode.steps
    expected = (len(about.seeds), episodes, steps, scenario.drones.count)
    form = stored.forms["commands"]
    if form.dtype != np.int8 or form.shape != expected:
        raise PolicyError(
            f"{file}: commands must be int8 of shape {expected} (seeds, episodes, steps, drones), "
            f"not {form.dtype} of shape {form.shape}"
        )
    if stored.about.get("seeds") != about.seeds:
        raise PolicyError(f"{file}: its seeds are not those of {MANIFEST}")
    commands = stored.arrays()["commands"]
    if commands.min() < NONE:
        raise PolicyError(f"{file}: a command is less than {NONE}")
    return dict(zip(about.seeds, commands, strict=True))


def place_of(task: Task, track: Track, name: str, out: Path | None) -> Place:
    """Return the folder of a submission: ``out``, or one in ``runs``."""
    return Place(out, f"{BENCHMARK}-{task.family}-{task.size}-{track.name}-{name}")
