"""The quality of experience of each episode of a run."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from desim_uav.report.figures.style import BAD, COLOURS, Figure, headed, styled
from desim_uav.report.run import Run, opened

PANELS = {"qoe1_percent": "QoE1, %", "qoe2_iterations": "QoE2, steps", "qoe3_percent": "QoE3, %"}
MARKED = 60
"""The largest number of episodes that are drawn with a dot each."""


@styled
def episodes_figure(run: Run | Path, width: float = 7.2) -> Figure:
    """Draw QoE1 to QoE3 of each counted episode, and mark crashes; ``width`` is in inches.

    Raises PolicyError if the folder is not that of a run or has no counted episode.
    """
    run = opened(run)
    numbers, episodes = run.counted_episodes, run.counted("episodes")
    crashed = episodes[episodes["crashes"] > 0]
    figure = Figure(figsize=(width, 4.4))
    panels = figure.subplots(len(PANELS), 1, sharex=True)
    dot: dict[str, Any] = {"marker": "." if len(numbers) <= MARKED else "", "color": COLOURS[0]}
    cross: dict[str, Any] = {"linestyle": "none", "marker": "x", "color": BAD}
    for axes, (column, label) in zip(panels, PANELS.items(), strict=True):
        axes.plot(episodes["episode"], episodes[column], linestyle="-", **dot)
        axes.plot(crashed["episode"], crashed[column], label="a drone crashed", **cross)
        axes.set_ylabel(label)
        axes.margins(y=0.15)
    if len(crashed):
        panels[0].legend()
    panels[-1].set(xlabel="episode", xlim=(numbers[0] - 0.5, numbers[-1] + 0.5))
    panels[-1].locator_params("x", integer=True)
    headed(figure, f"Episodes. {run.name}")
    return figure
