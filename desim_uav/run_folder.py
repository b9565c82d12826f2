"""The folder of a run: written whole or not at all, and read back."""

from __future__ import annotations

import hashlib
import json
import os
import re
import shutil
import tempfile
import uuid
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, nullcontext, suppress
from datetime import datetime
from itertools import takewhile
from pathlib import Path
from typing import IO, TYPE_CHECKING, Any

from desim_uav.checksums import SUMS, of_files, verify
from desim_uav.errors import DesimError, PolicyError, ScenarioError, UsageError
from desim_uav.records import TABLES, arrow_schema, misfit

if TYPE_CHECKING:
    import pandas as pd
    import pyarrow as pa
    import pyarrow.parquet as pq

    from desim_uav.scenario.schema import Scenario
    from desim_uav.world import World

LONGEST_NAME = 200

fcntl: Any = None
with suppress(ImportError):
    import fcntl


class Draft:
    """A run folder in the making, beside its place: nothing is seen of it until it is published."""

    def __init__(self, path: Path) -> None:
        self.path = path

    @contextmanager
    def tables(self) -> Iterator[Callable[[str, pd.DataFrame], None]]:
        """Write rows of ``TABLES`` as they come, by name; none is in memory after that."""
        with ExitStack() as files:
            writers: dict[str, pq.ParquetWriter] = {}

            def write(name: str, frame: pd.DataFrame) -> None:
                rows = _table(name, frame)
                if name not in writers:
                    file = files.enter_context(self._new_file(f"{name}.parquet"))
                    writers[name] = files.enter_context(_writer(file, rows.schema))
                with self._complaining(f"{name}.parquet"):
                    writers[name].write_table(rows)

            yield write

    def write_text(self, name: str, text: str) -> None:
        """Write a text file."""
        with self._new_file(name) as file:
            file.write(text.encode())

    def write_json(self, name: str, content: Any) -> None:
        """Write a JSON file."""
        self.write_text(name, json.dumps(content, indent=1, allow_nan=False) + "\n")

    def seal(self) -> None:
        """Write the checksums of all that was written."""
        with self._complaining(SUMS):
            text = of_files(self.path.iterdir())
        self.write_text(SUMS, text)

    @contextmanager
    def _new_file(self, name: str) -> Iterator[IO[bytes]]:
        with self._complaining(name), (self.path / name).open("wb") as file:
            yield file
            file.flush()
            os.fsync(file.fileno())

    @contextmanager
    def _complaining(self, name: str) -> Iterator[None]:
        try:
            yield
        except OSError as error:
            raise DesimError(
                f"cannot write {name} to {self.path.parent}: {error.strerror or error}"
            ) from error


@contextmanager
def held(folder: Path) -> Iterator[None]:
    """Nobody else writes to a folder meanwhile, there or to come; the hold ends with its process.

    Raises UsageError, naming who does.
    """
    if fcntl is None:  # a system without such locks
        yield
        return
    file = folder.absolute().parent / f".{folder.absolute().name}.lock"
    with _locked(file, folder) as own:
        try:
            own.truncate(0)
            who = f"process {os.getpid()}, since {datetime.now():%H:%M:%S}"
            with suppress(OSError):  # the disk is full: it holds all the same, without a name
                os.write(own.fileno(), who.encode())
            yield
        finally:
            file.unlink(missing_ok=True)


@contextmanager
def _locked(file: Path, folder: Path) -> Iterator[IO[str]]:
    while True:
        try:
            own = file.open("a+", encoding="utf-8")
        except OSError as error:
            raise UsageError(f"cannot write to {folder.parent}: {error.strerror}") from error
        with own:
            try:
                fcntl.flock(own, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError:
                own.seek(0)
                who = own.read(200) or "another process"
                raise UsageError(f"{folder}: {who} is writing to it") from None
            except OSError:  # a file system without locks
                yield own
                return
            if _is_still(file, own):
                yield own
                return


def _is_still(file: Path, own: IO[str]) -> bool:
    """Is it the one that was opened? Whoever held it before may have removed it since."""
    try:
        return file.stat().st_ino == os.fstat(own.fileno()).st_ino
    except FileNotFoundError:
        return False


class Place:
    """Where a run will stand: ``--out``, or the first free ``runs/NAME``, ``runs/NAME-2`` …."""

    def __init__(self, out: Path | None, name: str) -> None:
        """Raises UsageError where no run can be put at ``out``."""
        self.out = out
        self.target = None if out is None else _vacant(out)
        self.parent = Path("runs") if self.target is None else self.target.parent
        self.name = re.sub(r"[^A-Za-z0-9._=-]+", "-", name[:LONGEST_NAME]).strip("-.") or "run"

    @contextmanager
    def draft(self) -> Iterator[Draft]:
        """A draft beside the place; it is removed again unless it gets published.

        Raises UsageError where nothing can be written, or somebody is writing to ``out``.
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
                yield Draft(path)
        finally:
            shutil.rmtree(path, ignore_errors=True)
            if new:
                with suppress(OSError):  # it is not empty where the run stands there
                    self.parent.rmdir()

    def vacant(self) -> Path:
        """A folder that is not there yet, or empty."""
        if self.out is not None:
            return self.out
        return next(candidate for candidate in self._candidates() if not candidate.exists())

    def taken(self) -> list[Path]:
        """The folders that stand where it could: the first, the second …."""
        return list(takewhile(Path.exists, self._candidates()))

    def publish(self, draft: Draft) -> Path:
        """Seal a draft and move it to its place in one step; the place. Never overwrites."""
        draft.seal()
        candidates = self._candidates()
        while not self._moved(draft, candidate := next(candidates)):
            pass
        _sync_folder(self.parent)
        return self.out or candidate

    def _moved(self, draft: Draft, candidate: Path) -> bool:
        """Move a draft to a place, unless it is taken and there are others."""
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


def parquet(name: str, frame: pd.DataFrame) -> bytes:
    """One of ``TABLES`` as a Parquet file."""
    import pyarrow as pa

    file = pa.BufferOutputStream()
    rows = _table(name, frame)
    with _writer(file, rows.schema) as writer:
        writer.write_table(rows)
    return bytes(file.getvalue())


def _writer(file: Any, schema: pa.Schema) -> pq.ParquetWriter:
    """A bit that flips later on is noticed when the file is read."""
    import pyarrow.parquet as pq

    return pq.ParquetWriter(file, schema, write_page_checksum=True)


def _table(name: str, frame: pd.DataFrame) -> pa.Table:
    """In Arrow's terms, with what pandas wants to know when it reads it."""
    import pyarrow as pa

    return pa.Table.from_pandas(frame, arrow_schema(TABLES[name]), preserve_index=False)


def write_whole(path: Path, content: bytes) -> None:
    """Write a file, or leave what was there: beside it first, then in its place in one step.

    Raises DesimError where that fails.
    """
    beside = path.with_name(f".{path.name}-{uuid.uuid4().hex}")
    try:
        with beside.open("wb") as file:
            file.write(content)
            file.flush()
            os.fsync(file.fileno())
        beside.replace(path)
    except OSError as error:
        raise DesimError(f"cannot write {path}: {error.strerror or error}") from error
    finally:
        with suppress(OSError):
            beside.unlink()
    _sync_folder(path.parent)


def read_table(folder: Path, name: str, columns: dict[str, str]) -> pd.DataFrame:
    """A table of a finished run.

    Raises PolicyError, naming the file, where it is missing or unreadable, has changed since it was
    written, or where a column is missing or of another type.
    """
    import pandas as pd

    return pd.concat(read_parts(folder, name, columns), ignore_index=True)


def read_parts(folder: Path, name: str, columns: dict[str, str]) -> Iterator[pd.DataFrame]:
    """The same, a row group at a time; at least one, if only of no rows."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    file = folder / f"{name}.parquet"
    try:
        if not folder.is_dir():
            raise PolicyError(f"{folder}: no such run folder")
        if not file.is_file():
            raise PolicyError(f"{file}: no such table; is {folder} a run folder?")
        verify(file)
        whole = file.absolute()  # "a:b/c" would be taken for a URI
        with pq.ParquetFile(whole, page_checksum_verification=True) as parquet_file:
            groups = range(parquet_file.num_row_groups)
            for rows in ([group] for group in groups) if groups else ([],):
                table = parquet_file.read_row_groups(rows)
                problem = misfit(columns, table)
                if problem is not None:
                    raise PolicyError(f"{file}: {problem}")
                yield _frame(table, columns)
    except (pa.ArrowException, OSError, ValueError) as error:
        reason = str(error).partition("\n")[0]
        raise PolicyError(f"{file}: not a readable Parquet file: {reason}") from error


def _frame(table: pa.Table, columns: dict[str, str]) -> pd.DataFrame:
    """For pandas, whatever the file says of it: that has no checksum, and adds nothing."""
    import pandas as pd

    frame = table.to_pandas(ignore_metadata=True)
    for name in (name for name, dtype in columns.items() if dtype == "Int64"):
        frame[name] = table[name].to_pandas(types_mapper=lambda _: pd.Int64Dtype())
    return frame


def read_scenario(folder: Path) -> Scenario:
    """The scenario as it was run. Raises PolicyError, naming the file, where it cannot be read."""
    from desim_uav.scenario.load import load

    file = folder / "scenario.yaml"
    verify(file)
    try:
        return load(file)
    except ScenarioError as error:
        raise PolicyError(error.problems[0]) from error


def file_place(out: Path, option: str = "") -> Path:
    """Where a file is to stand, links followed; ``option``: who says so. Nothing is made yet.

    Raises UsageError where no file can be written.
    """
    named = f"{option} {out}".strip()
    try:
        place = out.resolve()
        if place.exists() and not place.is_file():
            raise UsageError(f"{named}: exists and is not a file")
        try_writing(next(folder for folder in place.parents if folder.exists()))
    except (OSError, RuntimeError) as error:
        reason = getattr(error, "strerror", None) or error
        raise UsageError(f"{named}: the folder cannot be written to: {reason}") from error
    return place


def write_at(place: Path, content: bytes) -> None:
    """Write a file in its place, in new folders if need be; where that fails, none is left.

    Raises DesimError.
    """
    new = [folder for folder in place.parents if not folder.exists()]
    try:
        try:
            place.parent.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise DesimError(f"cannot write {place}: {error.strerror or error}") from error
        write_whole(place, content)
    except BaseException:
        for folder in new:
            with suppress(OSError):  # somebody else's file is in it
                folder.rmdir()
        raise


def try_writing(folder: Path) -> None:
    """Raises OSError where no file can be made in a folder, whatever its permissions say."""
    with tempfile.TemporaryFile(dir=folder):
        pass


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


def world_hash(world: World) -> str:
    """SHA-256 of all that was drawn of a world."""
    text = json.dumps(world_content(world), sort_keys=True, allow_nan=False)
    return hashlib.sha256(text.encode()).hexdigest()


def _vacant(out: Path) -> Path:
    """Where ``--out`` points, links followed. Raises UsageError where no run can be put there."""
    try:
        target = out.resolve()
        if target.exists():
            if not target.is_dir():
                raise UsageError(f"--out {out}: exists and is not a folder")
            if any(target.iterdir()):
                raise UsageError(f"--out {out}: the folder is not empty")
            if target == Path.cwd() or target.is_mount():
                raise UsageError(f"--out {out}: this folder must stay; name one in it")
    except (OSError, RuntimeError) as error:
        raise UsageError(f"--out {out}: {getattr(error, 'strerror', None) or error}") from error
    return target


def _sync_folder(folder: Path) -> None:
    """Make the new name last, where the system can."""
    with suppress(OSError):
        descriptor = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(descriptor)
        finally:
            os.close(descriptor)
