"""The references and bounds of the benchmark's runs, which no submission can change.

``references.csv`` has what the reference policy reaches in each run, where scores are 0, and
``bounds.csv`` the proven bounds, where they are 1. They are beside the tasks, and the registry has
their hashes, or in the folder of a sealed set that was revealed.
"""

from __future__ import annotations

import csv
import hashlib
import io
import json
import math
import sys
from collections.abc import Mapping, Sequence
from contextlib import closing
from functools import cache
from pathlib import Path
from typing import Any

from desim_uav.disk import write_at
from desim_uav.errors import PolicyError, ScenarioError, in_short
from desim_uav.experiment.bench import bounds
from desim_uav.experiment.bench.measure import measure
from desim_uav.experiment.bench.score import measures_of
from desim_uav.experiment.bench.tasks import REGISTRY, TRACKS, BenchTrack, Task, tasks
from desim_uav.experiment.processes import run_each
from desim_uav.rowcode.regular_file import content_of, utf8
from desim_uav.shipped import bench_folder

REFERENCES, BOUNDS = "references.csv", "bounds.csv"
MOST_BYTES = 2**24
COLUMNS = ("task", "track", "seed", "measure", "value")
REFERENCE = "baseline"
"""The policy with the score 0."""

FILES, NEXT = "files", "next_files"
"""What the registry has of these files: their hashes and, while they are written, the next ones."""

Key = tuple[str, str, int, str]
"""A task, a track, a seed and a measure."""


def reference_of(task: Task, track: BenchTrack, seed: int) -> dict[str, float]:
    """Return what the reference reaches in a run, by measure; empty if none is kept."""
    return _of_run(REFERENCES, task, track, seed)


def bound_of(task: Task, track: BenchTrack, seed: int) -> dict[str, float]:
    """Return the proven bounds of a run, by measure; empty if none is kept."""
    return _of_run(BOUNDS, task, track, seed)


def kept(name: str, folder: Path) -> Mapping[Key, float]:
    """Return all values of a file.

    Raises ScenarioError if it is not the one of the registry, and PolicyError, which says what is
    wrong, if it cannot be read: a revealed set comes from somebody.
    """
    registry = _registry(folder)
    digests = {of[name] for of in (registry[FILES], registry.get(NEXT, {})) if name in of}
    if name not in registry[FILES] and not (folder / name).exists():
        return {}  # an interruption came before it was written for the first time
    return _read(folder / name, frozenset(digests))


def complete(
    chosen: Sequence[Task],
    tracks: Sequence[BenchTrack],
    jobs: int,
    *,
    anew: bool = False,
    seeds: int | None = None,
) -> None:
    """Compute the references and bounds that are not kept, or all ``anew``, and write them.

    Of each track only the first ``seeds`` are computed. What was computed before an interruption is
    written.
    """
    folder = folder_of(tracks[0])
    values = {name: dict(kept(name, folder)) for name in (REFERENCES, BOUNDS)}
    there = {name: {key[:3] for key in of} for name, of in values.items()}

    def lacks(task: Task, track: BenchTrack, seed: int) -> bool:
        run = task.name, track.name, seed
        proven = run in there[BOUNDS] or not bounds.has_bound(task, track)
        return run not in there[REFERENCES] or not proven

    work = [
        (task, track, seed)
        for task in chosen
        for track in tracks
        for seed in track.seeds[:seeds]
        if anew or lacks(task, track, seed)
    ]
    left = len(work)
    try:
        with closing(run_each(computed, work, jobs)) as ended:
            for number, parts in ended:
                task, track, seed = work[number]
                for name, part in parts.items():
                    run = (task.name, track.name, seed)
                    values[name] |= {(*run, measure): value for measure, value in part.items()}
                left -= 1
                if left % 16 == 0:
                    print(f"{left} runs are left", file=sys.stderr)
    finally:
        if left < len(work):
            write(folder, values)


def computed(task: Task, track: BenchTrack, seed: int) -> dict[str, dict[str, float]]:
    """Return the references and bounds of a run, by file and measure."""
    row = measure(task, track, REFERENCE, seed).row
    reference = {one.name: row[one.name] for one in measures_of(task)}
    return {REFERENCES: reference, BOUNDS: bounds.compute(task, track, seed)}


def write(folder: Path, values: Mapping[str, Mapping[Key, float]]) -> None:
    """Write the files in the order of tasks, tracks and seeds, and their hashes.

    The registry allows the old and the new files while they are written, so that an interruption
    leaves a set that can be read.
    """
    registry = _registry(folder)
    contents = {name: _content(those) for name, those in values.items()}
    digests = {name: hashlib.sha256(content).hexdigest() for name, content in contents.items()}
    _write_registry(folder, registry | {NEXT: digests})
    for name, content in contents.items():
        write_at(folder / name, content)
    registry.pop(NEXT, None)
    _write_registry(folder, registry | {FILES: registry[FILES] | digests})
    _read.cache_clear()


def _content(those: Mapping[Key, float]) -> bytes:
    """Return the values of a file as CSV."""
    order, text = list(tasks()), io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(COLUMNS)
    for key in sorted(those, key=lambda key: (order.index(key[0]), *key[1:])):
        writer.writerow([*key, repr(those[key])])
    return text.getvalue().encode()


def _write_registry(folder: Path, registry: Mapping[str, Any]) -> None:
    write_at(folder / REGISTRY, (json.dumps(registry, indent=1) + "\n").encode())


def folder_of(track: BenchTrack) -> Path:
    """Return the folder with the references and bounds of a track."""
    return track.folder or bench_folder()


def _registry(folder: Path) -> dict[str, Any]:
    registry: dict[str, Any] = json.loads((folder / REGISTRY).read_text(encoding="utf-8"))
    return registry


def _of_run(name: str, task: Task, track: BenchTrack, seed: int) -> dict[str, float]:
    values, run = kept(name, folder_of(track)), (task.name, track.name, seed)
    those = ((one.name, values.get((*run, one.name))) for one in measures_of(task))
    return {measure: value for measure, value in those if value is not None}


@cache
def _read(file: Path, digests: frozenset[str]) -> dict[Key, float]:
    if not digests:
        return {}
    try:
        content = content_of(file, MOST_BYTES)
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or error
        raise PolicyError(f"{file}: cannot be read: {reason}") from error
    if hashlib.sha256(content).hexdigest() not in digests:
        raise ScenarioError(
            f"{file}: it is frozen and has been changed: its hash is not that in {REGISTRY}"
        )
    values: dict[Key, float] = {}
    try:
        rows = csv.reader(io.StringIO(utf8(content)), strict=True)
        if tuple(next(rows, ())) != COLUMNS:
            raise ValueError(f"its columns must be {', '.join(COLUMNS)}")
        for row in rows:
            key, value = _entry(row)
            if key in values:
                raise ValueError(f"{in_short(row)} is the second value of this measure in this run")
            values[key] = value
    except (ValueError, csv.Error) as error:
        raise PolicyError(f"{file}: {error}") from error
    return values


def _entry(row: Sequence[str]) -> tuple[Key, float]:
    """Return the key and the value in a row. Raises ValueError, which says what is wrong."""
    try:
        task, track, seed, measure, value = row
        key, number = (task, track, int(seed), measure), float(value)
    except ValueError:
        raise ValueError(f"{in_short(row)} must be {', '.join(COLUMNS)}") from None
    if task not in tasks() or track not in TRACKS:
        raise ValueError(f"{in_short(row)} has an unknown task or track")
    if measure not in {one.name for one in measures_of(tasks()[task])}:
        raise ValueError(f"{in_short(row)} has a measure that does not count in this task")
    if not math.isfinite(number):
        raise ValueError(f"{in_short(row)} has a value that is not finite")
    return key, number
