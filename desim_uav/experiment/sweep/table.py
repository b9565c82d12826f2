"""The result of a sweep: its rows, and the table of means over seeds."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pandas as pd

from desim_uav import escaped
from desim_uav.experiment.replay.again import Source
from desim_uav.experiment.statistics import LEVEL, Estimate, estimate
from desim_uav.experiment.sweep.folder import FAILED
from desim_uav.experiment.sweep.grid import Axis
from desim_uav.experiment.sweep.job import Failure, Job, JobRow, measured
from desim_uav.experiment.sweep.plan import Arm
from desim_uav.measures.known import looks
from desim_uav.report import notebook
from desim_uav.report.intervals import mean_words, sentence
from desim_uav.typed import typed

if TYPE_CHECKING:
    from matplotlib.figure import Figure

SHOWN_FAILURES = 10
SHOWN = (
    *("qoe1_percent", "qoe2_iterations", "qoe3_percent"),
    *("crashes_per_drone_episode", "reward_mean", "j_per_mbit"),
    *("completion_s", "deadlines_met_percent", "age_s", "updates_lost"),
)
"""The measures in the table at the end of a sweep, as far as its scenarios have them, unless others
are asked for."""


@dataclass(frozen=True)
class Done:
    """A sweep that has ended or was interrupted."""

    out: Path
    axes: Sequence[Axis]
    jobs: Sequence[Job]
    rows: Sequence[JobRow]
    failures: Sequence[Failure]
    interrupted: bool
    chosen: Sequence[str] = ()
    """The measures that were asked for; none if the usual ones are shown."""

    def content(self) -> dict[str, Any]:
        """Return all as plain data: rows, estimates by combination and policy, and failures."""
        first = self.jobs[0]
        return {
            "scenario": first.arm.scenario.name,
            "out": str(self.out),
            "episodes": first.episodes,
            "warmup": first.warmup,
            "confidence": LEVEL,
            "interrupted": self.interrupted,
            "rows": list(self.rows),
            "estimates": [
                arm.combination.cells | {"policy": arm.policy, "measures": _plain(estimates)}
                for arm, estimates in self._estimates()
            ],
            "failed": [failure.content() for failure in self.failures],
        }

    @property
    def frame(self) -> pd.DataFrame:
        """One row per job that has ended: the values of the keys, the policy and its measures."""
        return pd.DataFrame(list(self.rows))

    @contextmanager
    def sources(self) -> Iterator[list[Source]]:
        """Have the sweep in a folder, which it is in, while something is made of it."""
        yield [Source(self.out)]

    @typed
    def plot(
        self,
        out: str | Path | None = None,
        *,
        measure: str | Sequence[str] | None = None,
        key: str | Sequence[str] | None = None,
    ) -> Figure:
        """Draw measures over one or two keys; a notebook shows the figure.

        Args:
            out: A file that ends in .png, .pdf or .svg, if the figure is to be written.
            measure: One measure or several. Default: QoE1 to QoE3.
            key: Keys to show, the first along the axis, or ``"KEY=VALUE"`` to hold one.

        Raises UsageError for an unknown measure or key, and for the file.
        """
        from desim_uav.experiment.plot import Target, draw

        target = None if out is None else Target(Path(out), "out")
        figure = draw("sweep", [Source(self.out)], {"measure": measure, "key": key})
        if target is not None:
            target.write(figure)
        return figure

    def __repr__(self) -> str:
        ended = f"{len(self.rows)} of {len(self.jobs)} jobs have ended"
        return f"<Sweep in {self.out}: {ended}, {len(self.failures)} have failed>"

    def _repr_html_(self) -> str:
        words = range(self.headings().index("policy") + 1)
        return notebook.heading(repr(self)[1:-1]) + notebook.table(
            self.headings(), self.lines(), words
        )

    @property
    def _columns(self) -> dict[str, tuple[str, str]]:
        """Headings and formats of the measures that are shown."""
        names = self.chosen or [name for name in SHOWN if name in self._measures]
        return looks(names, short=True)

    @cached_property
    def _measures(self) -> tuple[str, ...]:
        return measured(self.jobs, self.chosen)

    def headings(self) -> list[str]:
        """Return the table's headings: the keys that vary, the policy, and the measures."""
        return [
            *self._varied(),
            "policy",
            "seeds",
            *(heading for heading, _ in self._columns.values()),
        ]

    def lines(self) -> list[list[str]]:
        """Return a line of means and half-widths for each combination and policy."""
        return [
            [
                *("null" if (v := arm.combination.cells[k]) is None else f"{v}" for k in varied),
                arm.policy,
                str(estimates["reward_mean"].n),
                *(format(estimates[name], form) for name, (_, form) in self._columns.items()),
            ]
            for varied in [self._varied()]
            for arm, estimates in self._estimates()
        ]

    def markdown(self, command: Sequence[str]) -> str:
        """Return the table as Markdown, with the command that made it."""
        first = self.jobs[0]
        columns = self.headings().index("policy") + 1
        heading, *lines = (
            [*map(escaped.markdown, line[:columns]), *line[columns:]]
            for line in (self.headings(), *self.lines())
        )
        rule = ["---" for _ in heading]
        table = ["| " + " | ".join(row) + " |" for row in (heading, rule, *lines)]
        rows = [{"measures": _plain(estimates)} for _, estimates in self._estimates()]
        words = sentence(mean_words(rows)).removesuffix(".")
        about = f"{words}, of {first.episodes} episode(s) after {first.warmup} of warm-up per seed."
        return "\n".join([escaped.markdown_code(" ".join(command)), "", about, "", *table]) + "\n"

    def complaint(self) -> str:
        """Return the first failures, and the file that lists all of them."""
        lines = [f"{f.job.arm.name}, seed {f.job.seed}: {f.reason}" for f in self.failures]
        more = len(lines) - SHOWN_FAILURES
        rest = [f"and {more} more"] if more > 0 else []
        rest += [f"{len(lines)} of {len(self.jobs)} jobs failed, see {self.out / FAILED}"]
        return "\n".join(lines[:SHOWN_FAILURES] + rest)

    def _varied(self) -> list[str]:
        return [axis.key for axis in self.axes if len(axis.values) > 1]

    def _estimates(self) -> list[tuple[Arm, dict[str, Estimate]]]:
        """Return for each arm the estimates of its measures over the seeds that have ended."""
        row_of = {row["job"]: row for row in self.rows}
        of_arm: dict[int, tuple[Arm, list[JobRow]]] = {}
        for job in self.jobs:
            _, rows = of_arm.setdefault(id(job.arm), (job.arm, []))
            rows += [row_of[job.id]] if job.id in row_of else []
        return [
            (arm, {name: estimate(row[name] for row in rows) for name in self._measures})
            for arm, rows in of_arm.values()
        ]


def _plain(estimates: dict[str, Estimate]) -> dict[str, dict[str, Any]]:
    return {name: asdict(of) for name, of in estimates.items()}
