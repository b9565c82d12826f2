"""The leaderboard of submissions: its tables as data and in Markdown, and its figure."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from desim_uav.disk import file_place, write_at
from desim_uav.experiment.bench import profile
from desim_uav.experiment.bench.board import board, markdown, plain
from desim_uav.experiment.bench.receipts import NO_CHECKS
from desim_uav.experiment.bench.submission import Submission
from desim_uav.typed import typed

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@dataclass(frozen=True)
class Leaderboard:
    """The tables of a leaderboard: one for each task and track, and one of several tasks."""

    tables: Sequence[dict[str, Any]]

    @classmethod
    def of(
        cls, submissions: Sequence[Submission], checks: Mapping[str, str] = NO_CHECKS
    ) -> Leaderboard:
        """Return the leaderboard of submissions.

        ``checks`` says of the digest of a submission how it was verified (``receipts``). Raises
        PolicyError if two in a task and track have the same name.
        """
        return cls(board(submissions, checks))

    def content(self) -> list[dict[str, Any]]:
        """Return the tables as plain data."""
        return plain(self.tables)

    def markdown(self) -> str:
        """Return the tables in Markdown."""
        return markdown(self.tables)

    def figure(self) -> Figure:
        """Draw the performance profiles. Raises PolicyError if no policy has a score."""
        return profile.figure(self.tables)

    @typed
    def save(self, page: str | Path | None, figure: str | Path | None) -> None:
        """Write the tables in Markdown and the figure to files, where these are given.

        Raises UsageError, before anything is written, if one cannot be, or if its name has another
        ending.
        """
        from desim_uav.report.figures.style import ENDINGS, to_bytes

        files = []
        if page is not None:
            files.append((file_place(Path(page), "--out", [".md"]), self.markdown().encode()))
        if figure is not None:
            figure = Path(figure)
            place = file_place(figure, "--figure", ENDINGS)
            files.append((place, to_bytes(self.figure(), figure.suffix.lower())))
        for place, content in files:
            write_at(place, content)

    def _repr_markdown_(self) -> str:
        return self.markdown()
