"""The work of ``desim-uav replay``: makes one page from one or two run folders."""

from __future__ import annotations

from collections.abc import Callable, Generator, Sequence
from contextlib import ExitStack, closing
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from desim_uav.disk import file_place, write_at
from desim_uav.experiment.progress import progress
from desim_uav.experiment.replay.again import Source, played_again
from desim_uav.experiment.replay.forked import shown_of
from desim_uav.experiment.replay.side_by_side import common_episodes
from desim_uav.policies import Policy
from desim_uav.report.replay.data import Encoder
from desim_uav.report.replay.page import page
from desim_uav.report.run import Run, Tables

MOST_BYTES = 25 * 2**20
"""The default limit on the size of a page."""

BASE64 = 4 / 3


@dataclass(frozen=True)
class ReplayPage:
    """The page of one run or two, its episodes, and those left out because of its size limit."""

    content: bytes
    episodes: list[int]
    left_out: list[int]
    played_again: bool

    @property
    def size(self) -> int:
        """The number of bytes of the page."""
        return len(self.content)

    def summary(self) -> dict[str, Any]:
        """Return the result as plain data, for JSON."""
        return {
            "bytes": self.size,
            "episodes": self.episodes,
            "left_out": self.left_out,
            "played_again": self.played_again,
        }


@dataclass(frozen=True)
class Written(ReplayPage):
    """A page in a file."""

    file: Path

    def summary(self) -> dict[str, Any]:
        """Return the result as plain data, for JSON."""
        return {"html": str(self.file)} | super().summary()


def write_replay(
    run_dir: Path | Source,
    html: Path | None = None,
    episodes: str | None = None,
    show_progress: bool = True,
    most_bytes: int | None = None,
    beside: Path | Source | None = None,
) -> Written:
    """Write the page of a run, or of two in step, into the first run's folder or to ``html``.

    The file is ``replay.html``, or ``replay-NAME.html`` beside a second run in a folder NAME. Of
    the folder of a counterfactual, both branches are shown.
    Raises as ``make_replay`` does, and UsageError if the page cannot be written.
    """
    sources = [Source.of(run) for run in (run_dir, beside) if run is not None]
    first, second = sources[0].folder, sources[1].folder if len(sources) > 1 else None
    name = f"replay-{second.resolve().name}.html" if second else "replay.html"
    file = first / name if html is None else html
    place = file_place(file, "" if html is None else "--html", [".html"])
    choice = shown_of(first, second, episodes)
    if choice.folders != [source.folder for source in sources]:
        sources = [Source(folder) for folder in choice.folders]
    page = make_replay(sources, choice.episodes, show_progress, most_bytes)
    write_at(place, page.content)
    return Written(**vars(page), file=file)


def make_replay(
    sources: Sequence[Source],
    episodes: str | None = None,
    show_progress: bool = True,
    most_bytes: int | None = None,
) -> ReplayPage:
    """Make the page of a run, or of two that are played in step.

    ``episodes`` is a text such as ``0-9``; by default as many of the counted episodes as fit.
    Raises PolicyError if a folder is unreadable or contradicts itself, or if two runs are not on
    common seeds, and NoEventsError if a run cannot be played again.
    """
    runs = [Run(source.folder) for source in sources]
    numbers = runs[0].chosen(episodes)
    for second in runs[1:]:
        numbers = common_episodes(runs[0], second, episodes)
    encoders = [Encoder(run) for run in runs]
    blocks: list[tuple[bytes, ...]] = []
    size, limit = 0.0, MOST_BYTES if most_bytes is None else most_bytes
    total = sum(_to_play(run, numbers) for run in runs)
    compiled = "batch" if any(run.settings.engine == "batch" for run in runs) else "des"
    with progress(show_progress, total, engine=compiled) as advance, ExitStack() as open_until:
        tables_of = [
            open_until.enter_context(closing(_tables(run, numbers, advance, source.policy)))
            for run, source in zip(runs, sources, strict=True)
        ]
        for each in zip(*tables_of, strict=True):
            episode = tuple(
                encoder.episode(number, tables)
                for encoder, (number, tables) in zip(encoders, each, strict=True)
            )
            size += sum(map(len, episode)) * BASE64
            if episodes is None and blocks and size > limit:
                break
            blocks.append(episode)
    encoded = numbers[: len(blocks)]
    columns = zip(encoders, zip(*blocks, strict=True), strict=True)
    content = page(*((encoder.common(encoded), column) for encoder, column in columns))
    again = not all(run.keeps_events for run in runs)
    return ReplayPage(content, encoded, numbers[len(blocks) :], again)


def _to_play(run: Run, numbers: Sequence[int]) -> int:
    """Return how many episodes must be read or played to obtain those that are wanted."""
    return len(numbers) if run.keeps_events else numbers[-1] - run.episodes[0] + 1


def _tables(
    run: Run, numbers: list[int], advance: Callable[[], None], policy: Policy | None
) -> Generator[tuple[int, Tables]]:
    """Return the tables of these episodes, by playing the run again if it kept no events."""
    if run.keeps_events:
        return _stored(run, numbers, advance)
    return played_again(run, numbers, advance, policy)


def _stored(
    run: Run, numbers: list[int], advance: Callable[[], None]
) -> Generator[tuple[int, Tables]]:
    for number in numbers:
        yield number, run.of_episode(number)
        advance()
