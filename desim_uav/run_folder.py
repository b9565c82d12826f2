"""Run folders, which are written completely or not at all, and read back."""

from __future__ import annotations

import hashlib
import json
import os
import re
import shutil
import uuid
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager, nullcontext, suppress
from itertools import takewhile
from pathlib import Path
from typing import IO, TYPE_CHECKING, Any

from desim_uav.checksums import SUMS, of_files, verify
from desim_uav.disk import followed, sync, sync_folder
from desim_uav.errors import (
    DesimError,
    PolicyError,
    ScenarioError,
    UsageError,
)
from desim_uav.lock import held
from desim_uav.parquet_file import as_arrow, parquet_writer
from desim_uav.rowcode.regular_file import new_file

if TYPE_CHECKING:
    import pandas as pd
    import pyarrow.parquet as pq

    from desim_uav.scenario.schema import Scenario
    from desim_uav.world import World


LONGEST_NAME = 200
UNSAFE = re.compile(r"[^A-Za-z0-9._=-]+")
"""Characters that are replaced in a folder's name."""

MOST_OVERRIDES = 60
"""The characters of overrides in a folder's name; longer ones end with a digest of all."""

IN_NAME = {"name", "seed", "learning.algorithm", "learning.episodes"}
"""Keys that a folder's name says already, or that a continued training changes."""


def folder_name(scenario: Scenario, of: str, overrides: Sequence[str] = ()) -> str:
    """Return the name of a folder in ``runs``: scenario, policy or algorithm, seed, and overrides.

    The last override of a key counts, and keys are sorted, so the same settings have one name.
    """
    values = dict(one.split("=", 1) for one in overrides)
    said = sorted(f"{key}={value}" for key, value in values.items() if key not in IN_NAME)
    words = "-".join(UNSAFE.sub("-", one).strip("-") for one in said)
    if len(words) > MOST_OVERRIDES:
        digest = hashlib.sha256("\n".join(said).encode()).hexdigest()[:8]
        words = f"{words[: MOST_OVERRIDES - 9].rstrip('-.')}-{digest}"
    return "-".join(filter(None, [scenario.name, of, f"s{scenario.seed}", words]))


class RunDraft:
    """A run folder that is being written, hidden beside its place until it is published."""

    def __init__(self, path: Path) -> None:
        self.path = path

    @contextmanager
    def tables(self) -> Iterator[Callable[[str, pd.DataFrame], None]]:
        """Yield a function that appends rows to one of ``TABLES``; rows do not stay in memory."""
        with ExitStack() as files:
            writers: dict[str, pq.ParquetWriter] = {}

            def write(name: str, frame: pd.DataFrame) -> None:
                rows = as_arrow(name, frame)
                if name not in writers:
                    file = files.enter_context(self._new_file(f"{name}.parquet"))
                    writers[name] = files.enter_context(parquet_writer(file, rows.schema))
                with self._complaining(f"{name}.parquet"):
                    writers[name].write_table(rows)

            yield write

    def write_text(self, name: str, text: str) -> None:
        """Write a text file."""
        self.write_bytes(name, text.encode())

    def write_bytes(self, name: str, content: bytes) -> None:
        """Write a file."""
        with self._new_file(name) as file:
            file.write(content)

    def write_json(self, name: str, content: object) -> None:
        """Write a JSON file."""
        self.write_text(name, json.dumps(content, indent=1, allow_nan=False) + "\n")

    def seal(self) -> None:
        """Write the checksums of all files that were written."""
        with self._complaining(SUMS):
            text = of_files(file for file in self.path.iterdir() if file.is_file())
        self.write_text(SUMS, text)

    @contextmanager
    def _new_file(self, name: str) -> Iterator[IO[bytes]]:
        with self._complaining(name), new_file(self.path / name) as file:
            yield file
            sync(file)

    @contextmanager
    def _complaining(self, name: str) -> Iterator[None]:
        try:
            yield
        except OSError as error:
            raise DesimError(
                f"cannot write {name} to {self.path.parent}: {error.strerror or error}"
            ) from error


class RunPlace:
    """The place of a new run folder: ``--out``, or the first free ``runs/NAME``, ``NAME-2`` …."""

    def __init__(self, out: Path | None, name: str) -> None:
        """Raise UsageError if no run folder can be made at ``out``."""
        self.out = out
        self.target = None if out is None else _vacant(out)
        self.parent = Path("runs") if self.target is None else self.target.parent
        self.name = UNSAFE.sub("-", name[:LONGEST_NAME]).strip("-.") or "run"

    @contextmanager
    def draft(self) -> Iterator[RunDraft]:
        """Yield a draft beside the place; it is removed afterwards unless it was published.

        Raises UsageError if nothing can be written there, or if another process writes to ``out``.
        """
        path, new = self.parent / f".unfinished-{uuid.uuid4().hex}", not self.parent.exists()
        try:
            self.parent.mkdir(parents=True, exist_ok=True)
            path.mkdir()
        except FileExistsError as error:
            raise UsageError(f"cannot write to {self.parent}: it is not a folder") from error
        except OSError as error:
            raise UsageError(f"cannot write to {self.parent}: {error.strerror}") from error
        try:
            with nullcontext() if self.target is None else held(self.target):
                yield RunDraft(path)
        finally:
            shutil.rmtree(path, ignore_errors=True)
            if new:
                with suppress(OSError):  # it is not empty where the run stands there
                    self.parent.rmdir()

    def vacant(self) -> Path:
        """Return a folder that does not exist yet, or is empty."""
        if self.out is not None:
            return self.out
        return next(candidate for candidate in self._candidates() if not candidate.exists())

    def taken(self) -> list[Path]:
        """Return the existing folders at the possible places: the first, the second, …."""
        return list(takewhile(Path.exists, self._candidates()))

    def publish(self, draft: RunDraft) -> Path:
        """Seal a draft, move it to its place, and return the place. Never overwrites."""
        draft.seal()
        candidates = self._candidates()
        while not self._moved(draft, candidate := next(candidates)):
            pass
        sync_folder(self.parent)
        return self.out or candidate

    def _moved(self, draft: RunDraft, candidate: Path) -> bool:
        """Move a draft to a place; return False if it is taken and there are others."""
        try:
            draft.path.rename(candidate)
        except OSError as error:
            if self.target is None and (candidate.exists() or candidate.is_symlink()):
                return False
            raise UsageError(f"cannot write to {candidate}: {error.strerror}") from error
        return True

    def _candidates(self) -> Iterator[Path]:
        if self.target is not None:
            yield self.target
        else:
            yield self.parent / self.name
            number = 2
            while True:
                yield self.parent / f"{self.name}-{number}"
                number += 1


class Replaced(RunPlace):
    """The place of a run folder that its continuation replaces; other files in it are kept."""

    def __init__(self, folder: Path) -> None:
        """Raise UsageError if the folder cannot be replaced."""
        try:
            self.target = followed(folder)
            if self.target == Path.cwd() or self.target.is_mount():
                raise UsageError(f"{folder}: this folder cannot be replaced")
        except OSError as error:
            raise UsageError(f"{folder}: {error.strerror or error}") from error
        self.out, self.parent, self.name = folder, self.target.parent, self.target.name

    def _moved(self, draft: RunDraft, candidate: Path) -> bool:
        """Put a draft in the place of the old folder, which stays if that fails."""
        old = self.parent / f".replaced-{uuid.uuid4().hex}"
        try:
            candidate.rename(old)
            try:
                draft.path.rename(candidate)
            except OSError:
                old.rename(candidate)
                raise
            for other in old.iterdir():
                if not os.path.lexists(candidate / other.name):
                    other.rename(candidate / other.name)
        except OSError as error:
            raise UsageError(f"cannot write to {candidate}: {error.strerror}") from error
        shutil.rmtree(old, ignore_errors=True)
        return True


def read_scenario(folder: Path) -> Scenario:
    """Read the scenario of a run. Raises PolicyError, which names the file, if it cannot."""
    from desim_uav.scenario.load import load

    file = folder / "scenario.yaml"
    verify(file)
    try:
        return load(file)
    except ScenarioError as error:
        raise PolicyError(error.problems[0]) from error


def world_content(world: World) -> dict[str, Any]:
    """Return the content of ``world.json`` for a world."""
    width, depth = world.area
    city = world.grid.city
    own: dict[str, Any] = {}
    if len(city):
        own["city"] = {
            "attribution": city.attribution,
            "roofs_m": city.roofs_m.tolist(),
            "pieces_m": [piece.tolist() for piece in city.pieces_m],
        }
    return own | {
        "size_m": [width, depth],
        "cells": list(world.grid.cells),
        "cell_height_m": world.grid.height_m.tolist(),
        "levels_m": list(world.grid.levels_m[: world.grid.levels_under_ceiling]),
        "open_levels_m": list(world.grid.levels_m),
        "stations": [list(cell) for cell in world.stations],
        "clusters": [
            {"x_m": x, "y_m": y, "radius_m": radius} for x, y, radius in world.clusters.tolist()
        ],
        "start_cells": [list(cell) for cell in world.starts],
        "users": world.homes.tolist(),
    }


def world_hash(world: World) -> str:
    """Return the SHA-256 of everything that was drawn for a world."""
    text = json.dumps(world_content(world), sort_keys=True, allow_nan=False)
    return hashlib.sha256(text.encode()).hexdigest()


def _vacant(out: Path) -> Path:
    """Return the target of ``--out``, with links followed. Raises UsageError if it is taken."""
    try:
        target = followed(out)
        if target.exists():
            if not target.is_dir():
                raise UsageError(f"--out {out}: exists and is not a folder")
            if any(target.iterdir()):
                raise UsageError(
                    f"--out {out}: the folder is not empty; name another one, or delete it first"
                )
            if target == Path.cwd() or target.is_mount():
                raise UsageError(
                    f"--out {out}: this folder cannot be replaced; name a folder in it"
                )
    except OSError as error:
        raise UsageError(f"--out {out}: {error.strerror or error}") from error
    return target
