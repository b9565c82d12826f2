"""A run folder as its readers take it: tables, the world, and the episodes one may ask for."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import pandas as pd

from desim_uav.errors import PolicyError, ScenarioError, UsageError
from desim_uav.run_folder import TABLES, read_table, world_content
from desim_uav.scenario.load import load
from desim_uav.scenario.schema import Scenario
from desim_uav.world import World, build_world

Tables = Callable[[Path, str], pd.DataFrame]

MANIFEST = {"scenario": str, "policy": str, "seed": int}


def tables_of(folder: Path, name: str) -> pd.DataFrame:
    """A table of a run, as it was written.

    Raises PolicyError where it cannot be read, and where a run kept no events.
    """
    a_run = (folder / "requests.parquet").exists()
    if a_run and name in ("events", "legs") and not (folder / f"{name}.parquet").exists():
        raise PolicyError(f"{folder}: the run kept no events; run it again with --events")
    return read_table(folder, name, TABLES[name])


@dataclass(frozen=True)
class Run:
    """A run folder; ``tables`` is where its tables come from. Each part is read when needed.

    Raises PolicyError, naming the file, for a part that is missing or unreadable.
    """

    folder: Path
    tables: Tables = tables_of

    def table(self, name: str) -> pd.DataFrame:
        """One of ``run_folder.TABLES``."""
        if name not in self._read:
            self._read[name] = self.tables(self.folder, name)
        return self._read[name]

    def of(self, name: str, episode: int) -> pd.DataFrame:
        """The rows of an episode."""
        frame = self.table(name)
        return frame[frame["episode"] == episode]

    @cached_property
    def _read(self) -> dict[str, pd.DataFrame]:
        return {}

    @cached_property
    def manifest(self) -> dict[str, Any]:
        """What the run says of itself: scenario, policy, seed."""
        manifest = read_json(self.folder / "manifest.json")
        for key, of_type in MANIFEST.items():
            if not isinstance(manifest.get(key), of_type):
                raise PolicyError(f"{self.folder / 'manifest.json'}: not of a run: no {key}")
        return manifest

    @cached_property
    def scenario(self) -> Scenario:
        """The scenario as it was run."""
        try:
            return load(self.folder / "scenario.yaml")
        except ScenarioError as error:
            raise PolicyError(str(error)) from error

    @cached_property
    def world(self) -> World:
        """The world of the run. Raises PolicyError where ``world.json`` has another."""
        scenario = self.scenario
        try:
            world = build_world(scenario, scenario.effective_world_seed)
        except ScenarioError as error:
            raise PolicyError(f"{self.folder / 'scenario.yaml'}: {error}") from error
        if json.loads(json.dumps(world_content(world))) != read_json(self.folder / "world.json"):
            raise PolicyError(f"{self.folder / 'world.json'}: not the world of its scenario.yaml")
        return world

    @property
    def map(self) -> dict[str, Any]:
        """What ``world.json`` says of the world."""
        return world_content(self.world)

    @property
    def name(self) -> str:
        """What a figure of the run is headed with."""
        manifest = self.manifest
        return f"{manifest['scenario']}, {manifest['policy']}, seed {manifest['seed']}"

    def episode(self, asked: int | None) -> int:
        """The episode asked for, else the first counted one. Raises UsageError."""
        there = [int(number) for number in self.table("episodes")["episode"]]
        if not there:
            raise PolicyError(f"{self.folder}: no episode has ended")
        if asked is None:
            return max(there[0], 0) if max(there[0], 0) in there else there[0]
        if asked not in there:
            raise UsageError(
                f"--episode {asked}: {self.folder} has the episodes {there[0]} to {there[-1]}"
            )
        return asked

    def duration_s(self, episode: int) -> float:
        """How long an episode lasted."""
        return float(self.of("episodes", episode)["duration_s"].iloc[0])


def read_json(file: Path) -> dict[str, Any]:
    """A JSON object of a folder. Raises PolicyError, naming the file."""
    try:
        content = json.loads(file.read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError) as error:
        reason = getattr(error, "strerror", None) or error
        raise PolicyError(f"{file}: not readable: {reason}") from error
    if not isinstance(content, Mapping):
        raise PolicyError(f"{file}: not a JSON object")
    return dict(content)
