"""The run of one seed: in memory, or in its folder."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import pandas as pd

from desim_uav.checksums import verify
from desim_uav.errors import DesimError, NoEventsError, UsageError
from desim_uav.experiment.command import Done, Recorded, place_of, read_summary
from desim_uav.experiment.replay.again import Source
from desim_uav.measures.tally import MEASURED, Tally
from desim_uav.parquet_file import read_parts, read_table
from desim_uav.records import REQUESTS, TABLES
from desim_uav.report.manifest import read_manifest
from desim_uav.report.run import IN_TIME
from desim_uav.run_folder import RunPlace, read_scenario
from desim_uav.scenario.schema import Scenario

FILES = (*(f"{name}.parquet" for name in TABLES), "scenario.yaml", "world.json", "manifest.json")
"""What a run folder holds, beside its checksums."""


OPTIONAL = {
    **dict.fromkeys(IN_TIME, ""),
    "access_points": "the scenario has no access points",
    "updates": "no users of the scenario are sensors",
    "sensors": "no users of the scenario are sensors",
}
"""The tables that not all runs have, and why; those of events have to be asked for."""


def lacking(name: str, where: str = "") -> DesimError:
    """Return the error that a run does not have one of the OPTIONAL tables."""
    if name in IN_TIME:
        return NoEventsError(f"{where}the run kept no {name}; events=True keeps them")
    return UsageError(f"{where}{OPTIONAL[name]}")


class Tables:
    """The tables of a run in memory, in the row groups that a run folder has them in."""

    def __init__(self) -> None:
        self._parts: dict[str, list[pd.DataFrame]] = {}

    def write(self, name: str, frame: pd.DataFrame) -> None:
        """Take rows of a table."""
        self._parts.setdefault(name, []).append(frame)

    def __contains__(self, name: str) -> bool:
        return name in self._parts

    def parts(self) -> Sequence[tuple[str, pd.DataFrame]]:
        """Return all that was written, table by table."""
        return [(name, frame) for name, frames in self._parts.items() for frame in frames]

    def table(self, name: str) -> pd.DataFrame:
        """Return a table of its own, which may be changed."""
        if name not in self._parts:
            raise lacking(name)
        parts = self._parts[name]
        return pd.concat([part for part in parts if len(part)] or parts[:1], ignore_index=True)


@dataclass
class InMemory:
    """A run whose tables are in memory."""

    recorded: Recorded
    tables: Tables
    folder: Path | None = field(default=None, init=False)

    @property
    def manifest(self) -> dict[str, Any]:
        """The contents of manifest.json."""
        return self.recorded.manifest

    @property
    def scenario(self) -> Scenario:
        """The scenario as it was run."""
        return self.recorded.prepared.scenario

    @property
    def summary(self) -> dict[str, Any]:
        """The measures over all counted episodes, and what was run."""
        return self.recorded.summary

    def groups(self, by: str) -> list[dict[str, Any]]:
        """Return the measures of each group of counted requests."""
        if by == "service":
            return self.recorded.by_service
        there = [name for name in MEASURED if name in self.tables]
        return Tally(by).add(**{name: self.table(name) for name in there}).groups()

    def table(self, name: str) -> pd.DataFrame:
        """Return a table. Raises NoEventsError where the run has not kept it."""
        return self.tables.table(name)

    def save(self, place: RunPlace) -> Path:
        """Write the run folder."""
        with place.draft() as draft:
            with draft.tables() as write:
                for name, frame in self.tables.parts():
                    write(name, frame)
            self.recorded.write(draft)
            return place.publish(draft)

    @contextmanager
    def source(self) -> Iterator[Source]:
        """Have the run in a folder while a page that plays it is made."""
        with TemporaryDirectory(prefix="desim-uav-") as scratch:
            folder = self.save(RunPlace(Path(scratch) / default_place(self, None).name, ""))
            yield Source(folder, self.recorded.prepared.policy, passing=True)


class InFolder:
    """A run whose tables are in its folder, and are read when they are asked for."""

    def __init__(self, folder: Path, done: Done | None = None) -> None:
        """Look at the folder; ``done`` is what has just been written there, if it has.

        Raises PolicyError for a folder that is not a run's.
        """
        if done is None:
            next(read_parts(folder, "requests", REQUESTS))
        self.folder: Path | None = folder
        self._folder = folder
        self.manifest: dict[str, Any] = read_manifest(folder)
        self._done = done
        self._summary = None if done is None else done.summary

    @cached_property
    def scenario(self) -> Scenario:
        """See ``InMemory``."""
        return read_scenario(self._folder)

    @property
    def summary(self) -> dict[str, Any]:
        """See ``InMemory``."""
        if self._summary is None:
            self._summary, _ = read_summary(self._folder)
        return self._summary

    def groups(self, by: str) -> list[dict[str, Any]]:
        """See ``InMemory``."""
        if self._done is not None and by == "service":
            return self._done.by_service
        self._summary, groups = read_summary(self._folder, by)
        return groups or []

    def table(self, name: str) -> pd.DataFrame:
        """See ``InMemory``."""
        if name in OPTIONAL and not (self._folder / f"{name}.parquet").exists():
            raise lacking(name, f"{self._folder}: ")
        frame = read_table(self._folder, name, TABLES[name])
        if name == "requests":  # as in memory, where an array would be the exception
            frame["drones"] = [list(map(int, drones)) for drones in frame["drones"]]
        return frame

    def save(self, place: RunPlace) -> Path:
        """See ``InMemory``."""
        with place.draft() as draft:
            for file in (self._folder / name for name in FILES):
                verify(file)
                if file.exists():
                    draft.write_bytes(file.name, _content(file))
            return place.publish(draft)

    @contextmanager
    def source(self) -> Iterator[Source]:
        """See ``InMemory``."""
        yield Source(self._folder)


Kept = InMemory | InFolder
"""A run of one seed, wherever its tables are."""


def default_place(run: Kept, out: Path | None) -> RunPlace:
    """Return where a run stands that is saved: ``out``, or where the command line would put it."""
    overrides = run.manifest.get("overrides", ())
    return place_of(run.scenario, run.manifest["policy"], out, overrides)


def _content(file: Path) -> bytes:
    try:
        return file.read_bytes()
    except OSError as error:
        raise DesimError(f"cannot copy {file}: {error.strerror or error}") from error
