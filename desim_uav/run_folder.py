"""The folder of a run: written whole or not at all, and read back."""

from __future__ import annotations

import json
import os
import re
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

from desim_uav.errors import PolicyError, UsageError

if TYPE_CHECKING:
    import pandas as pd

    from desim_uav.world import World

TABLES = ("requests", "steps", "episodes", "users", "events")


class Draft:
    """A run folder in the making, beside its place: nothing is seen of it until it is published."""

    def __init__(self, path: Path) -> None:
        self.path = path

    def write_table(self, name: str, frame: pd.DataFrame) -> None:
        """Write a Parquet table."""
        import pyarrow as pa
        import pyarrow.parquet as pq

        with (self.path / f"{name}.parquet").open("wb") as file:
            pq.write_table(pa.Table.from_pandas(frame, preserve_index=False), file)
            _sync(file)

    def write_text(self, name: str, text: str) -> None:
        """Write a text file."""
        with (self.path / name).open("w", encoding="utf-8") as file:
            file.write(text)
            _sync(file)

    def write_json(self, name: str, content: Any) -> None:
        """Write a JSON file."""
        self.write_text(name, json.dumps(content, indent=1, allow_nan=False) + "\n")


class Place:
    """Where a run will stand: ``--out``, or the first free ``runs/NAME``, ``runs/NAME-2`` …."""

    def __init__(self, out: Path | None, name: str) -> None:
        """Raises UsageError where ``out`` is not empty, not a folder, or cannot be written."""
        self.out = out
        self.parent = Path("runs") if out is None else out.parent
        self.name = re.sub(r"[^A-Za-z0-9._=-]+", "-", name).strip("-.") or "run"
        if out is not None and out.exists():
            if not out.is_dir():
                raise UsageError(f"--out {out}: exists and is not a folder")
            if any(out.iterdir()):
                raise UsageError(f"--out {out}: the folder is not empty")

    @contextmanager
    def draft(self) -> Iterator[Draft]:
        """A draft beside the place; it is removed again unless it gets published."""
        try:
            self.parent.mkdir(parents=True, exist_ok=True)
            path = Path(tempfile.mkdtemp(prefix=".unfinished-", dir=self.parent))
        except OSError as error:
            raise UsageError(f"cannot write to {self.parent}: {error.strerror}") from error
        try:
            yield Draft(path)
        finally:
            shutil.rmtree(path, ignore_errors=True)

    def publish(self, draft: Draft) -> Path:
        """Move a draft to its place in one step; the place. Never overwrites."""
        draft.path.chmod(0o755)
        for candidate in self._candidates():
            try:
                draft.path.rename(candidate)
            except OSError as error:
                if self.out is not None:
                    raise UsageError(f"--out {candidate}: {error.strerror}") from error
                if not candidate.exists():
                    raise
                continue
            _sync_folder(self.parent)
            return candidate
        raise AssertionError("there is always a free number")

    def _candidates(self) -> Iterator[Path]:
        if self.out is not None:
            yield self.out
            return
        yield self.parent / self.name
        number = 2
        while True:
            yield self.parent / f"{self.name}-{number}"
            number += 1


def read_table(folder: Path, name: str, columns: dict[str, str]) -> pd.DataFrame:
    """A table of a finished run.

    Raises PolicyError, naming the file, where it is missing, unreadable or lacks a column.
    """
    import pyarrow as pa
    import pyarrow.parquet as pq

    if not folder.is_dir():
        raise PolicyError(f"{folder}: no such run folder")
    file = folder / f"{name}.parquet"
    if not file.is_file():
        raise PolicyError(f"{file}: no such table; is {folder} a run folder?")
    try:
        frame: pd.DataFrame = pq.ParquetFile(file).read().to_pandas()
    except (pa.ArrowException, OSError, ValueError) as error:
        raise PolicyError(f"{file}: not a readable Parquet file: {error}") from error
    missing = [column for column in columns if column not in frame.columns]
    if missing:
        raise PolicyError(f"{file}: no column {missing[0]!r}")
    return frame


def world_content(world: World) -> dict[str, Any]:
    """What ``world.json`` says of a world."""
    width, depth = world.area
    return {
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


def _sync(file: Any) -> None:
    file.flush()
    os.fsync(file.fileno())


def _sync_folder(folder: Path) -> None:
    descriptor = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)
