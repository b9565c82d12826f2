"""Continuing a run folder: the result is that of a run that was never interrupted."""

from __future__ import annotations

from collections.abc import Callable, Generator, Iterable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pandas as pd

from desim_uav.errors import PolicyError, UsageError
from desim_uav.experiment import run
from desim_uav.experiment.provenance import versions
from desim_uav.parquet_file import as_arrow, as_written, read_parts, read_table
from desim_uav.policies.base import file_of
from desim_uav.records import EPISODES, TABLES
from desim_uav.registry import names
from desim_uav.report.manifest import read_manifest, read_played_by
from desim_uav.run_folder import RunPlace
from desim_uav.sample_path import draw
from desim_uav.scenario.load import scenario_hash

if TYPE_CHECKING:
    from desim_uav.experiment.command import How, Prepared


@dataclass
class Rest:
    """The rows of a batch of episodes that is not complete, by table; it is joined once.

    ``size``: how many episodes, and rows, are in it.
    """

    frames: dict[str, pd.DataFrame] = field(default_factory=dict)
    size: tuple[int, int] = (0, 0)

    def join(self, results: run.Results) -> None:
        """Put these rows before those of later episodes."""
        for name, frame in self.frames.items():
            later = as_written(name, getattr(results, name))
            setattr(results, name, pd.concat([frame, later], ignore_index=True))
        self.frames, self.size = {}, (0, 0)


@dataclass(frozen=True)
class Begun:
    """A run folder that holds fewer episodes than are asked for.

    ``done`` is the number of the first missing episode. The simulation begins with ``first``, which
    is earlier: what is simulated again must agree with what is in the folder. The last batch begins
    with the episode ``open_from``, and later episodes belong to it as well; ``size`` is how large
    it is. If the batch is complete, ``open_from`` is ``done``.
    """

    folder: Path
    first: int
    done: int
    open_from: int
    size: tuple[int, int]

    def parts(self) -> Iterator[tuple[str, pd.DataFrame]]:
        """Yield the tables in the folder, in parts, without the rows of an incomplete batch."""
        for name in _there(self.folder):
            for part in read_parts(self.folder, name, TABLES[name]):
                whole = part[part["episode"] < self.open_from]
                if len(whole) or not len(part):
                    yield name, whole

    def rest(self) -> Rest:
        """Return the rows of the incomplete batch.

        An uninterrupted run would put them into its tables and sums together with later ones.
        """
        if self.open_from == self.done:
            return Rest()
        there = _there(self.folder)
        return Rest({name: _rows(self.folder, name, self.open_from) for name in there}, self.size)

    def played_by(self) -> dict[str, int]:
        """Return how many of its episodes each engine has played, as far as it says so."""
        return read_played_by(read_manifest(self.folder))

    def missing(
        self,
        prepared: Prepared,
        episodes: Iterable[run.Played],
        keep_events: bool,
        advance: Callable[[], None],
    ) -> Generator[run.Played]:
        """Yield the episodes that the folder lacks, after a check of the last ones that it has.

        Raises PolicyError if an episode differs from what is in the folder.
        """
        checked = max(self.first, min(self.open_from, self.done - 1))
        stored = {name: _rows(self.folder, name, checked) for name in _there(self.folder)}
        for played in episodes:
            number = played[0].episode
            if number >= self.done:
                stored.clear()
                yield played
                continue
            if number < checked:
                advance()
                continue
            tables = vars(run.tabulate(prepared.world, [played], keep_events))
            for name, frame in stored.items():
                was, now = frame[frame["episode"] == number], tables[name]
                if not as_arrow(name, now).equals(as_arrow(name, was)):
                    raise PolicyError(
                        f"{self.folder}: it cannot be continued: episode {number} in "
                        f"{name}.parquet differs from what is computed now (policy "
                        f"{prepared.name!r})"
                    )
            advance()


def begun(prepared: Prepared, how: How, folder: Path) -> Begun:
    """Return what is to be continued in a folder.

    Raises PolicyError if the folder's run is of another scenario, policy or seed, or was made with
    other options or versions, or if it has more episodes.
    """
    manifest = read_manifest(folder)
    settings = run.run_settings(prepared.world, prepared.policy, how.keep_events)
    now: dict[str, Any] = {
        "scenario": prepared.scenario.name,
        "policy": prepared.name,
        "seed": prepared.scenario.seed,
        "world_seed": prepared.scenario.effective_world_seed,
        "engine": how.engine,
        "ceilings": ["tallest" if c else "none" for c in settings.ceilings],
        "warmup": how.warmup,
        "events": how.keep_events,
        "scenario_hash": scenario_hash(prepared.scenario),
    }
    record = {**manifest, "events": (folder / "events.parquet").exists()}
    for name, version in versions().items():
        if name != "platform":  # another machine computes the same
            now[f"version of {name}"] = version
            record[f"version of {name}"] = dict(manifest.get("versions") or {}).get(name)
    for what, value in now.items():
        if record.get(what) != value:
            raise PolicyError(
                f"{folder}: it holds another run: {what} {record.get(what)!r}, not {value!r}"
            )
    numbers = read_table(folder, "episodes", EPISODES)["episode"].tolist()
    episodes = len(numbers) - how.warmup
    if numbers != list(range(-how.warmup, episodes)) or not 0 < episodes <= how.episodes:
        raise PolicyError(
            f"{folder}: it holds {episodes} episode(s), and {how.episodes} are asked for"
        )
    starts_afresh = not settings.carry_over and _forgets(prepared.name)
    first = episodes - 1 if starts_afresh else -how.warmup
    return Begun(folder, first, episodes, *_last_batch(prepared, folder, episodes))


def _last_batch(prepared: Prepared, folder: Path, episodes: int) -> tuple[int, tuple[int, int]]:
    """Return the first episode of the last batch and its size, or ``episodes`` if it is whole."""
    *_, last = read_parts(folder, "episodes", EPISODES)
    numbers = last["episode"].tolist()
    logged = {"requests", "events"} & {*_there(folder)}
    rows = sum(len(_rows(folder, name, numbers[0])) for name in logged)
    paths = (draw(prepared.world, prepared.scenario.seed, number) for number in numbers)
    rows += sum(len(path.walks.legs) for path in paths)
    is_complete = len(numbers) >= run.BATCH or rows >= run.ROWS
    return (episodes, (0, 0)) if is_complete else (numbers[0], (len(numbers), rows))


def _forgets(policy: str) -> bool:
    """Return whether a policy is known to keep nothing between episodes."""
    return policy in names("policy") or file_of(policy) is not None


def unfinished(place: RunPlace) -> Path:
    """Return the folder of the last interrupted run among the possible places of a new one.

    Raises UsageError if there is none.
    """
    for folder in reversed(place.taken()):
        try:
            if read_manifest(folder).get("interrupted"):
                return folder
        except PolicyError:
            continue
    raise UsageError(
        f"--resume: there is no interrupted run {place.parent / place.name}; name its folder with "
        "--out"
    )


def _there(folder: Path) -> list[str]:
    return [name for name in TABLES if (folder / f"{name}.parquet").exists()]


def _rows(folder: Path, name: str, first: int) -> pd.DataFrame:
    """Return the rows of a table from an episode on."""
    parts = read_parts(folder, name, TABLES[name])
    return pd.concat([part[part["episode"] >= first] for part in parts], ignore_index=True)
