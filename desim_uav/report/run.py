"""The folder of a finished run as its readers take it: each part is checked as it is read."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import pandas as pd

from desim_uav.checksums import verify
from desim_uav.errors import NoEventsError, PolicyError, UsageError
from desim_uav.records import TABLES
from desim_uav.report.manifest import Settings, read_manifest, read_settings
from desim_uav.report.world import read_world, stored_world
from desim_uav.run_folder import read_scenario, read_table
from desim_uav.scenario.schema import Scenario
from desim_uav.world import World

Tables = dict[str, pd.DataFrame]
"""By name."""

KEPT = ("requests", "steps", "users", "episodes")
IN_TIME = ("events", "legs")
"""What a run keeps only with ``--events``."""


@dataclass(frozen=True)
class Run:
    """A run folder. Each part is read when needed.

    ``again`` is asked for the events and legs of some episodes where the folder has none. Raises
    PolicyError, naming the file, for a part that is missing, unreadable, or not of a run.
    """

    folder: Path
    again: Again | None = None

    # ---- what happened

    def table(self, name: str) -> pd.DataFrame:
        """One of ``run_folder.TABLES``, as it was written."""
        if name not in self._read:
            self._read[name] = read_table(self.folder, name, TABLES[name])
        return self._read[name]

    def of(self, name: str, episode: int) -> pd.DataFrame:
        """The rows of an episode."""
        if name in IN_TIME and not self.keeps_events:
            self.need([episode])
            frame = self._made[name]
        else:
            frame = self.table(name)
        return frame[frame["episode"] == episode]

    def of_episode(self, episode: int) -> Tables:
        """All tables of an episode that the folder holds."""
        names = KEPT + IN_TIME if self.keeps_events else KEPT
        return {name: self.of(name, episode) for name in names}

    def counted(self, name: str) -> pd.DataFrame:
        """The rows of all episodes but those of warm-up."""
        frame = self.table(name)
        return frame[frame["episode"] >= 0]

    def need(self, episodes: Sequence[int]) -> None:
        """Have events and legs of these episodes at hand, however they are come by.

        Raises NoEventsError where there are none.
        """
        if self.keeps_events or self._made_of >= set(episodes):
            return
        self.table("requests")  # of what is no run folder at all, more is wrong
        if self.again is None:
            raise NoEventsError(f"{self.folder}: the run kept no events")
        self._made.update(self.again(self, episodes))
        self._made_of.clear()
        self._made_of.update(episodes)

    @cached_property
    def keeps_events(self) -> bool:
        """Has the run kept what happened when?"""
        return all((self.folder / f"{name}.parquet").is_file() for name in IN_TIME)

    @cached_property
    def _read(self) -> Tables:
        return {}

    @cached_property
    def _made(self) -> Tables:
        return {}

    @cached_property
    def _made_of(self) -> set[int]:
        return set()

    # ---- what it was

    @cached_property
    def manifest(self) -> dict[str, Any]:
        """What the run says of itself: scenario, policy, seed; and more, if it is no one else's."""
        return read_manifest(self.folder)

    @cached_property
    def settings(self) -> Settings:
        """How it was made. Raises PolicyError where ceilings are not those of its drones."""
        settings = read_settings(self.folder)
        if len(settings.ceilings) != self.scenario.drones.count:
            raise PolicyError(
                f"{self.folder / 'manifest.json'}: ceilings: {len(settings.ceilings)}, but "
                f"scenario.yaml has {self.scenario.drones.count} drones"
            )
        return settings

    @cached_property
    def scenario(self) -> Scenario:
        """The scenario as it was run."""
        return read_scenario(self.folder)

    @cached_property
    def yaml(self) -> str:
        """The text of the scenario's file."""
        verify(self.folder / "scenario.yaml")
        return (self.folder / "scenario.yaml").read_text(encoding="utf-8")

    @cached_property
    def map(self) -> dict[str, Any]:
        """What ``world.json`` says: a picture shows this world, whatever would be drawn today."""
        world, cells = read_world(self.folder), list(self.scenario.map.cells)
        if world["cells"] != cells:
            raise PolicyError(
                f"{self.folder / 'world.json'}: cells: {world['cells']}, "
                f"but scenario.yaml has {cells}"
            )
        return world

    @cached_property
    def world(self) -> World:
        """The same as a world."""
        return stored_world(self.map, self.scenario)

    @property
    def name(self) -> str:
        """What a figure of the run is headed with."""
        return "{scenario}, {policy}, seed {seed}".format(**self.manifest)

    # ---- its episodes

    @cached_property
    def episodes(self) -> list[int]:
        """Their numbers, warm-up among them. Raises PolicyError where there are none."""
        found = sorted({int(number) for number in self.table("episodes")["episode"]})
        if not found:
            raise PolicyError(f"{self.folder / 'episodes.parquet'}: it has no episodes")
        return found

    @property
    def counted_episodes(self) -> list[int]:
        """Without warm-up. Raises PolicyError where none is left."""
        found = [number for number in self.episodes if number >= 0]
        if not found:
            raise PolicyError(f"{self.folder}: no episode was counted")
        return found

    def episode(self, asked: int | None) -> int:
        """The episode asked for, else the first counted one. Raises UsageError."""
        there = self.episodes
        if asked is None:
            return next((number for number in there if number >= 0), there[0])
        if asked not in there:
            raise UsageError(
                f"--episode {asked}: {self.folder} has the episodes {there[0]} to {there[-1]}"
            )
        return asked

    def chosen(self, text: str | None) -> list[int]:
        """The episodes of a text such as ``0-9,12``; without one, the counted ones.

        Raises UsageError for one that is not there.
        """
        there = self.episodes
        if text is None:
            return [number for number in there if number >= 0] or there
        wanted = sorted({number for part in text.split(",") for number in _numbers(text, part)})
        missing = sorted(set(wanted) - set(there))
        if missing:
            raise UsageError(
                f"--episodes {text}: there is no episode {missing[0]}; "
                f"there are {there[0]} to {there[-1]}"
            )
        return wanted

    def duration_s(self, episode: int) -> float:
        """How long an episode lasted."""
        return float(self.of("episodes", episode)["duration_s"].iloc[0])


Again = Callable[[Run, Sequence[int]], Tables]


def opened(run: Run | Path) -> Run:
    """A run, from its folder too."""
    return run if isinstance(run, Run) else Run(run)


def _numbers(text: str, part: str) -> range:
    sign, part = (-1, part.strip()[1:]) if part.strip().startswith("-") else (1, part.strip())
    first, dash, last = part.partition("-")
    try:
        begin = sign * int(first)
        end = int(last) if dash else begin
    except ValueError:
        raise UsageError(f"--episodes {text}: write 0-9, or 0,4,8") from None
    if end < begin or end - begin > 10**6:
        raise UsageError(f"--episodes {text}: write 0-9, or 0,4,8")
    return range(begin, end + 1)
