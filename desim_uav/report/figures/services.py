"""How each service fares: outcomes, waiting times, QoE1."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from desim_uav.errors import PolicyError
from desim_uav.qoe import OUTCOMES
from desim_uav.report.figures.style import FAIR, headed, look, styled
from desim_uav.report.figures.visits import counted_episodes
from desim_uav.report.run import Run

BARS: dict[str, dict[str, Any]] = {
    "completed": {"facecolor": "#009E73", "hatch": "", "edgecolor": "white"},
    "unfinished": {"facecolor": FAIR, "hatch": "////", "edgecolor": "0.35"},
    "never_served": {"facecolor": "#D55E00", "hatch": "....", "edgecolor": "black"},
}


@styled
def services_figure(run_dir: Path, episode: int | None = None) -> Figure:
    """Outcomes by service, and the distributions of waiting time and QoE1 over requests.

    Over the counted episodes, or one. Raises PolicyError where the folder is not a run's or
    nothing was asked for.
    """
    run = Run(run_dir)
    episodes = counted_episodes(run, episode)
    requests = run.table("requests")
    requests = requests[requests["episode"].isin(episodes)]
    if requests.empty:
        raise PolicyError(f"{run_dir}: nobody asked for a service")
    services = sorted(requests["service"].unique())
    figure = Figure(figsize=(9.6, 3.4 + 0.12 * max(0, len(services) - 4)))
    panels = figure.subplots(1, 3, width_ratios=(1.25, 1, 1))
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
    handles = [*panels[0].containers, *panels[1].lines]
    names = [*(word.replace("_", " ") for word in (*OUTCOMES, *services))]
    figure.legend(handles, names, loc="outside lower center", ncols=6)
    return figure


def _of(requests: pd.DataFrame, service: str) -> pd.DataFrame:
    return requests[requests["service"] == service]


def _draw_outcomes(axes: Axes, requests: pd.DataFrame, services: list[str]) -> None:
    """A bar a service, in percent of its requests, the largest parts with their number."""
    counts = pd.crosstab(requests["service"], requests["outcome"])
    counts = counts.reindex(index=services, columns=OUTCOMES, fill_value=0)
    shares = 100 * counts.div(counts.sum(axis=1), axis=0)
    left = np.zeros(len(services))
    rows = np.arange(len(services))
    for outcome in OUTCOMES:
        bars = axes.barh(rows, shares[outcome], left=left, height=0.62, lw=0.6, **BARS[outcome])
        numbers = [
            str(count) if share >= 7 else ""
            for count, share in zip(counts[outcome], shares[outcome], strict=True)
        ]
        for text in axes.bar_label(bars, numbers, label_type="center", fontsize=8):
            text.set_bbox({"facecolor": "white", "edgecolor": "none", "pad": 1.0, "alpha": 0.85})
        left += shares[outcome].to_numpy()
    axes.set_yticks(
        rows, [f"{s.replace('_', ' ')}\n{counts.loc[s].sum()} requests" for s in services]
    )
    axes.set(title="Outcomes", xlabel="requests, %", xlim=(0, 100))
    axes.invert_yaxis()
    axes.grid(visible=False, axis="y")


def _draw_shares(axes: Axes, values: list[pd.Series], services: list[str]) -> None:
    """Empirical distribution functions, in percent."""
    for number, (held, service) in enumerate(zip(values, services, strict=True)):
        at = np.sort(held.to_numpy())
        share = 100 * np.arange(1, len(at) + 1) / len(at)
        axes.step([at[0], *at], [0, *share], where="post", label=service, **look(number))
    axes.set_ylim(0, 102)
