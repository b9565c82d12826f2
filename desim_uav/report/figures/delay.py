"""The delays of tasks: their parts, and their distributions, by service and by run."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes

from desim_uav.errors import PolicyError, UsageError
from desim_uav.records import TASKS
from desim_uav.report.figures.alike import MOST_SERIES, alike_in_all_but_seeds
from desim_uav.report.figures.style import NARROW, Figure, headed, look, short, styled
from desim_uav.report.figures.visits import counted_episodes
from desim_uav.report.run import Run, opened

PARTS: dict[str, dict[str, Any]] = {
    "waiting": {"facecolor": "#E3E3E3", "hatch": "xxxx", "edgecolor": "0.45"},
    "sending": {"facecolor": "#56B4E9", "hatch": "////", "edgecolor": "black"},
    "computing": {"facecolor": "#332288", "hatch": "", "edgecolor": "white"},
    "only the user computes": {"facecolor": "#F0E442", "hatch": "....", "edgecolor": "0.35"},
}
"""The parts of a delay, which add up to it: what a user computes while its task is also sent or
computed elsewhere is not counted again."""


@dataclass(frozen=True)
class Series:
    """The tasks of a service in some runs, which differ only in their seeds."""

    label: str
    tasks: pd.DataFrame

    @property
    def done(self) -> pd.DataFrame:
        """The tasks that were completed."""
        return self.tasks[self.tasks["outcome"] == "completed"]

    def parts(self) -> list[float]:
        """Return the mean seconds of each of ``PARTS`` over the completed tasks."""
        done = self.done
        columns = [done[f"{name}_s"] for name in list(PARTS)[:3]]
        alone = done["completion_s"] - sum(columns)
        return [float(part.mean()) if len(done) else 0.0 for part in (*columns, alone)]


@styled
def delay_figure(
    runs: Run | Path | Sequence[Run | Path], episode: int | None = None, width: float = 9.6
) -> Figure:
    """Draw the mean parts of the delay of tasks, and how many tasks were done within which time.

    There is a series for each service with tasks and each run; runs that differ only in their seeds
    are one series. The tasks are those of all counted episodes, or of one. The parts are means over
    completed tasks, and the distribution is a share of all tasks. A vertical line is a deadline.
    ``width`` is in inches; in a narrow figure the panels are below each other. Raises PolicyError
    if a folder is not that of a run, has no tasks or is given twice, and UsageError for an unknown
    episode or for too many series.
    """
    several = [opened(run) for run in (runs if isinstance(runs, Sequence) else [runs])]
    series = _all_series(several, episode)
    if len(series) > MOST_SERIES:
        raise UsageError(
            f"delay: {len(series)} services of runs, and a figure shows at most {MOST_SERIES}"
        )
    bars = 0.8 + 0.42 * len(series)
    if width > NARROW:
        figure = Figure(figsize=(width, max(3.4, 1.6 + bars)))
        parts, times = figure.subplots(1, 2, width_ratios=(1.15, 1))
    else:
        figure = Figure(figsize=(width, 1.4 + bars + 2.2))
        parts, times = figure.subplots(2, 1, height_ratios=(bars, 2.2))
    _draw_parts(parts, series)
    _draw_times(times, series)
    which = f"episode {episode}" if episode is not None else "all counted episodes"
    name = several[0].name if len(several) == 1 else f"{len(several)} runs"
    headed(figure, f"Delay of tasks. {name}, {which}")
    handles, names = [*parts.containers, *times.lines[: len(series)]], [*PARTS]
    names += [one.label for one in series]
    if len(times.lines) > len(series):
        handles.append(times.lines[-1])
        names.append("deadline")
    columns = 5 if width > NARROW else 2
    figure.legend(handles, names, loc="outside lower center", ncols=columns)
    return figure


def _all_series(runs: Sequence[Run], episode: int | None) -> list[Series]:
    """Return the series of all runs, in the order of the runs and then of the services' names."""
    alike = alike_in_all_but_seeds(runs)
    found = []
    for name, group in alike:
        tasks = pd.concat([_tasks(run, episode) for run in group])
        for service in sorted(tasks["service"].unique()):
            label = service if len(alike) == 1 else f"{service}, {name}"
            found.append(Series(short(label), tasks[tasks["service"] == service]))
    return found


def _tasks(run: Run, episode: int | None) -> pd.DataFrame:
    """Return the tasks of a run: the requests of services that need cycles or have deadlines."""
    requests = run.table("requests")
    requests = requests[requests["episode"].isin(counted_episodes(run, episode))]
    if not set(TASKS) <= set(requests):
        raise PolicyError(
            f"{run.folder}: the run has no tasks: none of its services has the kind compute"
        )
    is_task = (requests["gigacycles"] > 0) | requests["deadline_s"].notna()
    of_tasks = requests["service"].isin(requests["service"][is_task].unique())
    if not of_tasks.any():
        raise PolicyError(f"{run.folder}: nobody asked for a task in these episodes")
    return requests[of_tasks]


def _draw_parts(axes: Axes, series: Sequence[Series]) -> None:
    """Draw a bar for each series, as long as its mean delay."""
    rows, left = np.arange(len(series)), np.zeros(len(series))
    lengths = np.array([one.parts() for one in series])
    for number, dressed in enumerate(PARTS.values()):
        axes.barh(rows, lengths[:, number], left=left, height=0.62, lw=0.6, **dressed)
        left += lengths[:, number]
    for row, end in enumerate(left):
        text = f"{end:.2f} s" if len(series[row].done) else "none done"
        axes.annotate(text, (end, row), (4, 0), textcoords="offset points", va="center", fontsize=8)
    axes.set_yticks(
        rows, [f"{one.label}\n{len(one.done)} of {len(one.tasks)} done" for one in series]
    )
    axes.set(title="Parts of the mean delay", xlabel="time from the request, s")
    axes.set_xlim(0, 1.18 * max(float(left.max()), 1e-6))
    axes.invert_yaxis()
    axes.grid(visible=False, axis="y")


def _draw_times(axes: Axes, series: Sequence[Series]) -> None:
    """Draw the share of tasks that were done within a time, and the deadlines."""
    deadlines_s = set[float]()
    for number, one in enumerate(series):
        within_s = np.sort(one.done["completion_s"].to_numpy())
        share = 100 * np.arange(1, len(within_s) + 1) / len(one.tasks)
        axes.step([0, *within_s], [0, *share], where="post", label=one.label, **look(number))
        left_s = (one.tasks["deadline_s"] - one.tasks["t_request_s"]).dropna()
        deadlines_s |= set(left_s.round(6))
    for deadline_s in sorted(deadlines_s):
        axes.axvline(deadline_s, color="0.4", ls=":", linewidth=1)
    axes.set(title="Distribution", xlabel="done within, s", ylabel="tasks, %", ylim=(0, 102))
    axes.set_xlim(0, None)
