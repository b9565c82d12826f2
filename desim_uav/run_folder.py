"""Run folders, which are written completely or not at all, and read back."""

from __future__ import annotations

import errno
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
from itertools import islice, takewhile
from pathlib import Path
from typing import IO, TYPE_CHECKING, Any

from desim_uav.checksums import SUMS, of_files, verify
from desim_uav.errors import (
    DesimError,
    PolicyError,
    ScenarioError,
    UsageError,
    did_you_mean,
    in_short,
)
from desim_uav.records import TABLES, Columns, arrow_schema, misfit
from desim_uav.rowcode.regular_file import lock_file, new_file

if TYPE_CHECKING:
    import pandas as pd
    import pyarrow as pa
    import pyarrow.parquet as pq

    from desim_uav.scenario.schema import Scenario
    from desim_uav.world import World

LONGEST_NAME = 200
HOLDER = "process"
"""The first word in each of our lock files, by which they are told from other files."""

fcntl: Any = None
with suppress(ImportError):
    import fcntl


class Draft:
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
                    writers[name] = files.enter_context(_writer(file, rows.schema))
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

    def write_json(self, name: str, content: Any) -> None:
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
            _sync(file)

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
    """Lock a folder, which need not exist yet; the lock ends with its process.

    Raises UsageError, which names the process, if another process holds the lock.
    """
    if fcntl is None:  # a system without such locks
        yield
        return
    file = folder.absolute().parent / f".{folder.absolute().name}.lock"
    with _locked(file, folder) as own:
        try:
            own.truncate(0)
            who = f"{HOLDER} {os.getpid()}, since {datetime.now():%H:%M:%S}"
            with suppress(OSError):  # the disk is full: it holds all the same, without a name
                own.write(who.encode())
            yield
        finally:
            file.unlink(missing_ok=True)


@contextmanager
def _locked(file: Path, folder: Path) -> Iterator[IO[bytes]]:
    while True:
        with ExitStack() as opened:
            try:
                own = opened.enter_context(lock_file(file, HOLDER.encode()))
            except (OSError, ValueError) as error:
                raise _no_lock(file, folder, error) from error
            try:
                fcntl.flock(own, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError:
                who = own.read(200).decode(errors="replace") or "another process"
                raise UsageError(f"{folder}: {in_short(who)} is writing to it") from None
            except OSError:  # a file system without locks
                yield own
                return
            if _is_still(file, own):
                yield own
                return


def _no_lock(file: Path, folder: Path, error: OSError | ValueError) -> UsageError:
    """Return what to say of a lock file that cannot be used."""
    if not os.path.lexists(file):
        return UsageError(f"cannot write to {folder.parent}: {getattr(error, 'strerror', error)}")
    reason = "it is a link" if file.is_symlink() else getattr(error, "strerror", None) or error
    return UsageError(f"{folder} cannot be locked with {file}: {reason}; remove or rename it")


def _is_still(file: Path, own: IO[bytes]) -> bool:
    """Return whether the lock file is still the one that was opened, and not removed since."""
    try:
        return file.stat().st_ino == os.fstat(own.fileno()).st_ino
    except FileNotFoundError:
        return False


class Place:
    """The place of a new run folder: ``--out``, or the first free ``runs/NAME``, ``NAME-2`` …."""

    def __init__(self, out: Path | None, name: str) -> None:
        """Raise UsageError if no run folder can be made at ``out``."""
        self.out = out
        self.target = None if out is None else _vacant(out)
        self.parent = Path("runs") if self.target is None else self.target.parent
        self.name = re.sub(r"[^A-Za-z0-9._=-]+", "-", name[:LONGEST_NAME]).strip("-.") or "run"

    @contextmanager
    def draft(self) -> Iterator[Draft]:
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
                yield Draft(path)
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

    def publish(self, draft: Draft) -> Path:
        """Seal a draft, move it to its place, and return the place. Never overwrites."""
        draft.seal()
        candidates = self._candidates()
        while not self._moved(draft, candidate := next(candidates)):
            pass
        _sync_folder(self.parent)
        return self.out or candidate

    def _moved(self, draft: Draft, candidate: Path) -> bool:
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


class Replaced(Place):
    """The place of a run folder that its continuation replaces; other files in it are kept."""

    def __init__(self, folder: Path) -> None:
        """Raise UsageError if the folder cannot be replaced."""
        try:
            self.target = _followed(folder)
            if self.target == Path.cwd() or self.target.is_mount():
                raise UsageError(f"{folder}: this folder cannot be replaced")
        except OSError as error:
            raise UsageError(f"{folder}: {error.strerror or error}") from error
        self.out, self.parent, self.name = folder, self.target.parent, self.target.name

    def _moved(self, draft: Draft, candidate: Path) -> bool:
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


def parquet(name: str, frame: pd.DataFrame) -> bytes:
    """Return one of ``TABLES`` as the bytes of a Parquet file."""
    import pyarrow as pa

    file = pa.BufferOutputStream()
    rows = as_arrow(name, frame)
    with _writer(file, rows.schema) as writer:
        writer.write_table(rows)
    return bytes(file.getvalue())


def _writer(file: Any, schema: pa.Schema) -> pq.ParquetWriter:
    """Return a writer with page checksums, so that later damage is noticed."""
    import pyarrow.parquet as pq

    return pq.ParquetWriter(file, schema, write_page_checksum=True)


def as_arrow(name: str, frame: pd.DataFrame) -> pa.Table:
    """Return a frame as an Arrow table, with the metadata that pandas needs."""
    import pyarrow as pa

    schema = arrow_schema(TABLES[name].among(frame.columns))
    return pa.Table.from_pandas(frame, schema, preserve_index=False)


def write_whole(path: Path, content: bytes) -> None:
    """Write a file completely, or leave the old one: a new file replaces it in one step.

    Raises DesimError if the file cannot be written.
    """
    beside = path.with_name(f".{path.name}-{uuid.uuid4().hex}")
    try:
        with new_file(beside) as file:
            file.write(content)
            _sync(file)
        beside.replace(path)
    except OSError as error:
        raise DesimError(f"cannot write {path}: {error.strerror or error}") from error
    finally:
        with suppress(OSError):
            beside.unlink()
    _sync_folder(path.parent)


def no_such(folder: Path, what: str) -> PolicyError:
    """Return the error that a folder is not there, with the nearest name beside it."""
    with suppress(OSError):
        beside = [path.name for path in islice(folder.parent.iterdir(), 10_000) if path.is_dir()]
        return PolicyError(f"{folder}: no such {what}{did_you_mean(folder.name, beside)}")
    return PolicyError(f"{folder}: no such {what}")


def read_table(folder: Path, name: str, columns: dict[str, str]) -> pd.DataFrame:
    """Read a table of a finished run.

    Raises PolicyError, which names the file, if it is missing or unreadable, has changed since it
    was written, or if a column is missing or has another type.
    """
    import pandas as pd

    return pd.concat(read_parts(folder, name, columns), ignore_index=True)


def read_parts(folder: Path, name: str, columns: dict[str, str]) -> Iterator[pd.DataFrame]:
    """Yield a table of a finished run by row groups, at least one. Raises as ``read_table``."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    file = folder / f"{name}.parquet"
    try:
        if not folder.is_dir():
            raise no_such(folder, "run folder")
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
                yield as_frame(table, columns)
    except (pa.ArrowException, OSError, ValueError) as error:
        reason = str(error).partition("\n")[0]
        raise PolicyError(f"{file}: not a readable Parquet file: {reason}") from error


def as_written(name: str, frame: pd.DataFrame) -> pd.DataFrame:
    """Return a frame of one of ``TABLES`` as it is after it was written and read."""
    return as_frame(as_arrow(name, frame), TABLES[name])


def as_frame(table: pa.Table, columns: dict[str, str]) -> pd.DataFrame:
    """Return a frame; the file's own metadata for pandas, which has no checksum, is ignored."""
    import pandas as pd

    frame = table.to_pandas(ignore_metadata=True)
    if isinstance(columns, Columns):
        columns = columns.among(table.column_names)
    for name in (name for name, dtype in columns.items() if dtype == "Int64"):
        frame[name] = table[name].to_pandas(types_mapper=lambda _: pd.Int64Dtype())
    return frame


def read_scenario(folder: Path) -> Scenario:
    """Read the scenario of a run. Raises PolicyError, which names the file, if it cannot."""
    from desim_uav.scenario.load import load

    file = folder / "scenario.yaml"
    verify(file)
    try:
        return load(file)
    except ScenarioError as error:
        raise PolicyError(error.problems[0]) from error


def file_place(out: Path, option: str = "") -> Path:
    """Return the place of a file to be written, with links followed. Nothing is made yet.

    ``option`` names the option in messages. Raises UsageError if no file can be written there.
    """
    named = f"{option} {out}".strip()
    try:
        place = _followed(out)
        if place.exists() and not place.is_file():
            raise UsageError(f"{named}: exists and is not a file")
        try_writing(next(folder for folder in place.parents if folder.exists()))
    except OSError as error:
        reason = error.strerror or error
        raise UsageError(f"{named}: the folder cannot be written to: {reason}") from error
    return place


def write_at(place: Path, content: bytes) -> None:
    """Write a file in its place, and make its folders if they do not exist.

    Raises DesimError if that fails; then new folders are removed again.
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
    """Raise OSError if no file can be made in a folder, independently of its permissions."""
    with tempfile.TemporaryFile(dir=folder):
        pass


def world_content(world: World) -> dict[str, Any]:
    """Return the content of ``world.json`` for a world."""
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
    """Return the SHA-256 of everything that was drawn for a world."""
    text = json.dumps(world_content(world), sort_keys=True, allow_nan=False)
    return hashlib.sha256(text.encode()).hexdigest()


def _vacant(out: Path) -> Path:
    """Return the target of ``--out``, with links followed. Raises UsageError if it is taken."""
    try:
        target = _followed(out)
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


def _followed(path: Path) -> Path:
    """Return a path with links followed. Raises OSError if they lead in a circle."""
    circle = OSError(errno.ELOOP, os.strerror(errno.ELOOP), str(path))
    try:
        target = path.resolve()
    except RuntimeError as error:  # Python up to 3.12
        raise circle from error
    if target.is_symlink():  # later versions leave the circle as it is
        raise circle
    return target


def _sync(file: IO[bytes]) -> None:
    """Have the system write a file to the disk."""
    file.flush()
    os.fsync(file.fileno())


def _sync_folder(folder: Path) -> None:
    """Make the new name durable, if the system can."""
    with suppress(OSError):
        descriptor = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(descriptor)
        finally:
            os.close(descriptor)
