"""Outcomes, waiting times and QoE1 of each service."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes

from desim_uav.errors import PolicyError
from desim_uav.qoe import DROPPED, LATE, OUTCOMES
from desim_uav.report.figures.style import FAIR, NARROW, Figure, headed, look, short, styled
from desim_uav.report.figures.visits import counted_episodes
from desim_uav.report.run import Run, opened

BARS: dict[str, dict[str, Any]] = {
    "completed": {"facecolor": "#009E73", "hatch": "", "edgecolor": "white"},
    "unfinished": {"facecolor": FAIR, "hatch": "////", "edgecolor": "0.35"},
    "never_served": {"facecolor": "#D55E00", "hatch": "....", "edgecolor": "black"},
    LATE: {"facecolor": "#CC79A7", "hatch": "xxxx", "edgecolor": "black"},
    DROPPED: {"facecolor": "#F0E442", "hatch": "\\\\", "edgecolor": "black"},
}


@styled
def services_figure(run: Run | Path, episode: int | None = None, width: float = 9.6) -> Figure:
    """Draw outcomes by service, and the distributions of waiting time and QoE1 over requests.

    The requests are those of all counted episodes, or of one. ``width`` is in inches; in a narrow
    figure the panels are below each other. Raises PolicyError if the folder is not that of a run or
    has no requests.
    """
    run = opened(run)
    episodes = counted_episodes(run, episode)
    requests = run.table("requests")
    requests = requests[requests["episode"].isin(episodes)]
    if requests.empty:
        raise PolicyError(f"{run.folder}: the run has no requests")
    services = sorted(requests["service"].unique())
    figure, panels = _panels(width, len(services))
    _draw_outcomes(panels[0], requests, services)
    waits = [_of(requests, service)["wait_s"] / 60 for service in services]
    qoe1s = [100 * _of(requests, service)["qoe1"] for service in services]
    _draw_shares(panels[1], waits, services)
    _draw_shares(panels[2], qoe1s, services)
    panels[1].set(title="Waiting time", xlabel="waited at most, min", xlim=(0, None))
    panels[1].set_ylabel("requests, %")
    panels[2].set(title="QoE1", xlabel="QoE1 at most, %", xlim=(0, 100))
    panels[2].set_ylabel("requests, %")
    which = f"episode {episode}" if episode is not None else f"{len(episodes)} episode(s)"
    headed(figure, f"Services. {run.name}, {which}")
    handles: list[Any] = [*panels[0].containers, *panels[1].lines]
    names = [*(short(word).replace("_", " ") for word in (*OUTCOMES, *services))]
    columns = 6 if width > NARROW else 3 if len(services) < 9 else 2
    figure.legend(handles, names, loc="outside lower center", ncols=columns)
    return figure


def _panels(width: float, services: int) -> tuple[Figure, Sequence[Axes]]:
    """Return three panels side by side, or below each other."""
    if width > NARROW:
        figure = Figure(figsize=(width, 3.4 + 0.12 * max(0, services - 4)))
        return figure, figure.subplots(1, 3, width_ratios=(1.25, 1, 1))
    bars = 0.9 + 0.4 * services
    figure = Figure(figsize=(width, 0.8 + bars + 2 * 1.9))
    return figure, figure.subplots(3, 1, height_ratios=(bars, 1.9, 1.9))


def _of(requests: pd.DataFrame, service: str) -> pd.DataFrame:
    return requests[requests["service"] == service]


def _draw_outcomes(axes: Axes, requests: pd.DataFrame, services: list[str]) -> None:
    """Draw a bar per service, in percent of its requests; large parts show their number."""
    counts = pd.crosstab(requests["service"], requests["outcome"])
    outcomes = (*OUTCOMES, *(outcome for outcome in (LATE, DROPPED) if outcome in counts))
    counts = counts.reindex(index=services, columns=outcomes, fill_value=0)
    shares = 100 * counts.div(counts.sum(axis=1), axis=0)
    left = np.zeros(len(services))
    rows = np.arange(len(services))
    for outcome in outcomes:
        bars = axes.barh(rows, shares[outcome], left=left, height=0.62, lw=0.6, **BARS[outcome])
        numbers = [
            str(count) if share >= 7 else ""
            for count, share in zip(counts[outcome], shares[outcome], strict=True)
        ]
        for text in axes.bar_label(bars, numbers, label_type="center", fontsize=8):
            text.set_bbox({"facecolor": "white", "edgecolor": "none", "pad": 1.0, "alpha": 0.85})
        left += shares[outcome].to_numpy()
    axes.set_yticks(
        rows, [f"{short(s).replace('_', ' ')}\n{counts.loc[s].sum()} requests" for s in services]
    )
    axes.set(title="Outcomes", xlabel="requests, %", xlim=(0, 100))
    axes.invert_yaxis()
    axes.grid(visible=False, axis="y")


def _draw_shares(axes: Axes, values: list[pd.Series], services: list[str]) -> None:
    """Draw empirical distribution functions, in percent."""
    for number, (shares, service) in enumerate(zip(values, services, strict=True)):
        at = np.sort(shares.to_numpy())
        share = 100 * np.arange(1, len(at) + 1) / len(at)
        axes.step([at[0], *at], [0, *share], where="post", label=service, **look(number))
    axes.set_ylim(0, 102)
