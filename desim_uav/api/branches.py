"""Two branches of a run, from a step on."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from desim_uav.api.replay import Replay
from desim_uav.api.run_result import RunResult
from desim_uav.experiment.replay.again import Source
from desim_uav.typed import typed


class Counterfactual:
    """Two branches of a run, which have everything before a decision epoch in common.

    ``original`` is the run of the first policy. In ``other``, another policy goes on from the epoch
    ``at``, with the same walks, requests and other draws.
    """

    def __init__(
        self, original: RunResult, other: RunResult, about: dict[str, Any], folder: Path | None
    ) -> None:
        self.original, self.other = original, other
        self.folder = folder
        """The folder with both branches, if they were written."""
        self._about = about

    @property
    def at(self) -> tuple[int, int]:
        """The episode and the step from which the other policy goes on."""
        return self._about["episode"], self._about["step"]

    def summary(self) -> dict[str, Any]:
        """Return the measures of both branches since the fork's episode, and their difference."""
        return self._about | ({} if self.folder is None else {"run_dir": str(self.folder)})

    def difference(self) -> dict[str, Any]:
        """Return by how much the other branch's measures exceed the original's."""
        return dict(self._about["difference"])

    @property
    def shown(self) -> str:
        """The episodes that both branches are played in: from that of the fork on."""
        return f"{self.at[0]}-{int(self._about['episodes']) - 1}"

    @contextmanager
    def sources(self) -> Iterator[list[Source]]:
        """Have both branches in folders while something is made of them."""
        with self.original.sources() as original, self.other.sources() as other:
            yield [*original, *other]

    @typed
    def replay(self, file: str | Path | None = None, *, progress: bool = True) -> Replay:
        """Make the page that plays both branches side by side, from the fork's episode on.

        Raises UsageError if ``file`` cannot be written.
        """
        return self.original.replay(file, beside=self.other, episodes=self.shown, progress=progress)

    def __repr__(self) -> str:
        about = self._about
        change = ", ".join(
            f"{name[:4].upper().replace('QOE', 'QoE')} {about['difference'][name]:+.2f}"
            for name in ("qoe1_percent", "qoe2_iterations", "qoe3_percent")
            if about["difference"][name] is not None
        )
        return (
            f"<{about['scenario']}, seed {about['seed']}: {about['to']} instead of "
            f"{about['policy']} from {about['episode']}:{about['step']} on: {change}>"
        )
