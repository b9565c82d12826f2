"""The age of information of sensors: its mean over time, and its distribution over sensors."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from desim_uav.errors import PolicyError, UsageError
from desim_uav.report.figures.alike import MOST_SERIES, alike_in_all_but_seeds
from desim_uav.report.figures.style import NARROW, Figure, headed, look, short, styled
from desim_uav.report.figures.visits import counted_episodes
from desim_uav.report.run import Run, opened

Floats = NDArray[np.float64]

TIMES = 400
"""The number of times at which mean ages are drawn."""


@dataclass(frozen=True)
class Series:
    """The sensors of a service in some runs: ``ages_s`` at ``times_s``, and rows of their table."""

    label: str
    times_s: Floats
    ages_s: Floats
    sensors: pd.DataFrame


@styled
def age_figure(
    runs: Run | Path | Sequence[Run | Path], episode: int | None = None, width: float = 9.6
) -> Figure:
    """Draw the mean age of sensors over time, and the distribution of their time averages.

    There is a series for each service with sensors and each run; runs that differ only in their
    seeds are one series. Means are over sensors and over all counted episodes, or one. ``width`` is
    in inches; in a narrow figure the panels are below each other. Raises PolicyError if a folder is
    not that of a run, has no sensors or is given twice, and UsageError for an unknown episode or
    for too many series.
    """
    several = [opened(run) for run in (runs if isinstance(runs, Sequence) else [runs])]
    series = _all_series(several, episode)
    if len(series) > MOST_SERIES:
        raise UsageError(
            f"age: {len(series)} services of runs, and a figure shows at most {MOST_SERIES}"
        )
    wide = width > NARROW
    figure = Figure(figsize=(width, 3.6 if wide else 5.4))
    over_time, shares = figure.subplots(*((1, 2) if wide else (2, 1)))
    for number, one in enumerate(series):
        over_time.plot(one.times_s / 60, one.ages_s, label=one.label, **look(number))
        means_s = np.sort(one.sensors["age_s"].to_numpy())
        share = 100 * np.arange(1, len(means_s) + 1) / len(means_s)
        shares.step([means_s[0], *means_s], [0, *share], where="post", **look(number))
    over_time.set(title="Mean over sensors", xlabel="time, min", ylabel="age, s")
    over_time.set(xlim=(0, max(one.times_s[-1] for one in series) / 60), ylim=(0, None))
    shares.set(title="Time average of each sensor", xlabel="at most, s", ylabel="sensors, %")
    shares.set(xlim=(0, None), ylim=(0, 102))
    which = f"episode {episode}" if episode is not None else "all counted episodes"
    name = several[0].name if len(several) == 1 else f"{len(several)} runs"
    headed(figure, f"Age of information. {name}, {which}")
    names = [_in_words(one) for one in series]
    figure.legend(over_time.lines, names, loc="outside lower center", ncols=2 if wide else 1)
    return figure


def _in_words(series: Series) -> str:
    """Return the name of a series with its means."""
    peak_s = series.sensors["peak_age_s"].mean()
    peak = "" if np.isnan(peak_s) else f", peak {peak_s:.0f} s"
    return f"{series.label}: mean {series.sensors['age_s'].mean():.0f} s{peak}"


def _all_series(runs: Sequence[Run], episode: int | None) -> list[Series]:
    """Return the series of all runs, in the order of the runs and then of the services' names."""
    alike, found = alike_in_all_but_seeds(runs), []
    for name, group in alike:
        for run in group:
            if not (run.folder / "sensors.parquet").is_file():
                raise PolicyError(
                    f"{run.folder}: the run has no sensors: no users have the demand sensing"
                )
        sensors = pd.concat([_rows(run, "sensors", episode) for run in group])
        for service in sorted(sensors["service"].unique()):
            label = service if len(alike) == 1 else f"{service}, {name}"
            own = sensors[sensors["service"] == service]
            found.append(Series(short(label), *_mean_ages_s(group, service, episode), own))
    return found


def _rows(run: Run, name: str, episode: int | None) -> pd.DataFrame:
    table = run.table(name)
    return table[table["episode"].isin(counted_episodes(run, episode))]


def _mean_ages_s(runs: Sequence[Run], service: str, episode: int | None) -> tuple[Floats, Floats]:
    """Return some times of an episode, and the mean age of a service's sensors at each of them."""
    lasts_s = min(run.duration_s(n) for run in runs for n in counted_episodes(run, episode))
    times_s, ages_s, count = np.linspace(0.0, lasts_s, TIMES), np.zeros(TIMES), 0
    for run in runs:
        sensors = _rows(run, "sensors", episode)
        updates = _rows(run, "updates", episode)
        own = updates[(updates["service"] == service) & updates["t_delivered_s"].notna()]
        for _, delivered in own.groupby(["episode", "user"]):
            ages_s -= fresh_s(delivered, times_s)
        sensors_here = int((sensors["service"] == service).sum())
        ages_s += sensors_here * times_s
        count += sensors_here
    return times_s, ages_s / count


def fresh_s(delivered: pd.DataFrame, times_s: Floats) -> Floats:
    """Return when the freshest update was taken that a sensor has delivered by each time, or 0."""
    delivered = delivered.sort_values("t_delivered_s", kind="stable")
    taken_s = np.maximum.accumulate(np.append(0.0, delivered["t_generated_s"].to_numpy()))
    counts = np.searchsorted(delivered["t_delivered_s"].to_numpy(), times_s, side="right")
    fresh: Floats = taken_s[counts]
    return fresh
