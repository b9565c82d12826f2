"""Reads the folder of a finished run; each part is checked when it is read."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import pandas as pd

from desim_uav.checksums import verify
from desim_uav.errors import NoEventsError, PolicyError, UsageError, in_short
from desim_uav.model.rules import US
from desim_uav.parquet_file import read_table
from desim_uav.records import TABLES
from desim_uav.report.manifest import Settings, read_manifest, read_settings
from desim_uav.report.world import read_world, stored_world
from desim_uav.run_folder import read_scenario
from desim_uav.scenario.schema import Scenario
from desim_uav.world import World

Tables = dict[str, pd.DataFrame]
"""Tables by name."""

KEPT = ("requests", "steps", "users", "episodes")
IN_TIME = ("events", "legs")
"""The tables that a run keeps only with ``--events``."""


@dataclass(frozen=True)
class Run:
    """A run folder, whose parts are read when they are needed.

    ``again`` makes the events and legs of some episodes if the folder has none. Reading a part
    raises PolicyError, with the file, if it is missing, unreadable or not that of a run.
    """

    folder: Path
    again: Again | None = None

    # ---- what happened

    def table(self, name: str) -> pd.DataFrame:
        """Return one of ``records.TABLES`` as it was written."""
        if name not in self._read:
            self._read[name] = read_table(self.folder, name, TABLES[name])
        return self._read[name]

    def of(self, name: str, episode: int) -> pd.DataFrame:
        """Return the rows of an episode."""
        if name in IN_TIME and not self.keeps_events:
            self.need([episode])
            frame = self._again[name]
        else:
            frame = self.table(name)
        return frame[frame["episode"] == episode]

    def of_episode(self, episode: int) -> Tables:
        """Return all tables of an episode that are in the folder."""
        names = KEPT + IN_TIME if self.keeps_events else KEPT
        return {name: self.of(name, episode) for name in names}

    def counted(self, name: str) -> pd.DataFrame:
        """Return the rows of all episodes except warm-up."""
        frame = self.table(name)
        return frame[frame["episode"] >= 0]

    def need(self, episodes: Sequence[int]) -> None:
        """Make sure that the events and legs of these episodes can be read.

        Raises NoEventsError if the run kept none and cannot be played again.
        """
        if self.keeps_events or self._again_of >= set(episodes):
            return
        self.table("requests")  # a folder that is not a run's gives a better message here
        if self.again is None:
            raise NoEventsError(f"{self.folder}: the run kept no events")
        self._again.update(self.again(self, episodes))
        self._again_of.clear()
        self._again_of.update(episodes)

    @cached_property
    def keeps_events(self) -> bool:
        """Whether the run has kept its events and legs."""
        return all((self.folder / f"{name}.parquet").is_file() for name in IN_TIME)

    @cached_property
    def _read(self) -> Tables:
        return {}

    @cached_property
    def _again(self) -> Tables:
        return {}

    @cached_property
    def _again_of(self) -> set[int]:
        return set()

    # ---- the run itself

    @cached_property
    def manifest(self) -> dict[str, Any]:
        """The run's manifest; scenario, policy and seed are checked, other entries are not."""
        return read_manifest(self.folder)

    @cached_property
    def settings(self) -> Settings:
        """The settings of the run. Raises PolicyError if there is not one ceiling per drone."""
        settings = read_settings(self.folder)
        if len(settings.ceilings) != self.scenario.drone_count:
            raise PolicyError(
                f"{self.folder / 'manifest.json'}: ceilings: {len(settings.ceilings)}, but "
                f"scenario.yaml has {self.scenario.drone_count} drones"
            )
        return settings

    @cached_property
    def scenario(self) -> Scenario:
        """The scenario of the run."""
        return read_scenario(self.folder)

    @cached_property
    def yaml(self) -> str:
        """The text of the scenario's file."""
        verify(self.folder / "scenario.yaml")
        return (self.folder / "scenario.yaml").read_text(encoding="utf-8")

    @cached_property
    def map(self) -> dict[str, Any]:
        """The content of ``world.json``; pictures show this world, even if drawing has changed."""
        world, cells = read_world(self.folder), list(self.scenario.map.cells)
        if world["cells"] != cells:
            raise PolicyError(
                f"{self.folder / 'world.json'}: cells: {world['cells']}, "
                f"but scenario.yaml has {cells}"
            )
        return world

    @cached_property
    def world(self) -> World:
        """The world of ``world.json``."""
        return stored_world(self.map, self.scenario)

    @property
    def name(self) -> str:
        """The name of the run in the headings of figures."""
        return "{scenario}, {policy}, seed {seed}".format(**self.manifest)

    def drone_name(self, drone: int) -> str:
        """Return the name of a drone in figures, with that of its type if there are several."""
        names = self.scenario.type_names
        name = names[self.scenario.type_numbers[drone]]
        return f"drone {drone} ({name})" if len(names) > 1 else f"drone {drone}"

    # ---- its episodes

    @cached_property
    def episodes(self) -> list[int]:
        """The numbers of all episodes, including warm-up. Raises PolicyError if there are none."""
        numbers = sorted({int(number) for number in self.table("episodes")["episode"]})
        if not numbers:
            raise PolicyError(f"{self.folder / 'episodes.parquet'}: it has no episodes")
        return numbers

    @property
    def counted_episodes(self) -> list[int]:
        """The numbers of the episodes without warm-up. Raises PolicyError if there are none."""
        numbers = [number for number in self.episodes if number >= 0]
        if not numbers:
            raise PolicyError(f"{self.folder}: the run has no counted episode")
        return numbers

    def episode(self, episode: int | None) -> int:
        """Return the requested episode, by default the first counted one.

        Raises UsageError if the run has no such episode.
        """
        there = self.episodes
        if episode is None:
            return next((number for number in there if number >= 0), there[0])
        if episode not in there:
            raise UsageError(
                f"episode: {episode}: {self.name} has the episodes {there[0]} to {there[-1]}"
            )
        return episode

    def chosen(self, text: str | None) -> list[int]:
        """Return the episodes of a text such as ``0-9,12``, by default the counted ones.

        Raises UsageError if the text is malformed or the run has no such episode.
        """
        there = self.episodes
        if text is None:
            return [number for number in there if number >= 0] or there
        numbers = sorted({number for part in text.split(",") for number in _numbers(text, part)})
        missing = sorted(set(numbers) - set(there))
        if missing:
            raise UsageError(
                f"episodes: {text}: there is no episode {missing[0]}; "
                f"there are {there[0]} to {there[-1]}"
            )
        return numbers

    def duration_s(self, episode: int) -> float:
        """Return the duration of an episode."""
        return float(self.of("episodes", episode)["duration_s"].iloc[0])

    def instant_us(self, episode: int, minute: float) -> int:
        """Return a minute of an episode in microseconds. Raises UsageError if it is not in it."""
        at_us, duration_s = round(float(minute) * 60 * US, 0), self.duration_s(episode)
        if not 0 <= at_us <= round(duration_s * US):
            raise UsageError(
                f"minute: {minute:g}: episode {episode} is from minute 0 to {duration_s / 60:g}"
            )
        return int(at_us)


Again = Callable[[Run, Sequence[int]], Tables]


def opened(run: Run | Path) -> Run:
    """Return a run, which may be given by its folder."""
    return run if isinstance(run, Run) else Run(run)


def _numbers(text: str, part: str) -> range:
    sign, part = (-1, part.strip()[1:]) if part.strip().startswith("-") else (1, part.strip())
    first, dash, last = part.partition("-")
    try:
        begin = sign * int(first)
        end = int(last) if dash else begin
    except ValueError:
        raise UsageError(f"episodes: {in_short(repr(text))}: write 0-9, or 0,4,8") from None
    if end < begin or end - begin > 10**6:
        raise UsageError(f"episodes: {in_short(repr(text))}: write 0-9, or 0,4,8")
    return range(begin, end + 1)
