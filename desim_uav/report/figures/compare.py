"""Policies side by side: means over seeds with their intervals, and paired differences."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from matplotlib.axes import Axes

from desim_uav.measures.known import KNOWN
from desim_uav.report.figures.style import COLOURS, NARROW, Figure, headed, marker, short, styled
from desim_uav.report.intervals import interval_words, of_one_seed

PANELS = {
    "qoe1_percent": "QoE1, %",
    "qoe2_iterations": "QoE2, steps",
    "qoe3_percent": "QoE3, %",
    "completion_s": "delay, s",
    "deadlines_met_percent": "in time, %",
    "age_s": "age, s",
    "crashes_per_drone_episode": "crashes per drone\nand episode",
    "reward_mean": "reward per\nepisode",
}
"""The titles of the measures that are drawn if they are there and no others are asked for."""

WIDE = 2.04
"""The width of a panel, in inches."""


@styled
def compare_figure(comparison: dict[str, Any], measures: Sequence[str] | None = None) -> Figure:
    """Draw a row of panels with each policy's mean and interval, and the differences below it.

    ``comparison`` is the plain content of a comparison: ``policies`` and ``differences``, each with
    ``policy``, ``seeds`` and ``measures`` (n, mean, half_width; None if there is none). From one
    seed the values are drawn without intervals, and the heading says so. ``measures`` are names of
    measures that the comparison has, by default those of PANELS.
    """
    titles = _titles(comparison, measures)
    policies, differences = comparison["policies"], comparison["differences"]
    names = [row["policy"] for row in policies]
    rows = 2 if differences else 1
    heights = [len(policies) + 0.6, len(differences) + 0.6][:rows]
    size = (max(5, len(titles)) * WIDE, 1.7 + 0.34 * sum(heights) + 0.55 * (rows - 1))
    figure = Figure(figsize=size)
    panels = figure.subplots(rows, len(titles), squeeze=False, height_ratios=heights)
    for column, (measure, label) in enumerate(titles.items()):
        _draw(panels[0][column], policies, names, measure)
        if differences:
            _draw(panels[1][column], differences, names, measure)
            panels[1][column].axvline(0, color="0.3", ls="-", linewidth=0.9, zorder=1)
        panels[-1][column].set_xlabel(label)
    for axes in panels[:, 1:].flat:
        axes.tick_params(labelleft=False)
    panels[0][0].set_title("Values of one seed" if of_one_seed(policies) else "Mean over seeds")
    if differences:
        how = " on one seed" if of_one_seed(differences) else ", paired by seed"
        panels[1][0].set_title(f"Difference from {comparison['against']}{how}")
    headed(figure, _title(comparison))
    return figure


@styled
def intervals_figure(
    rows: Sequence[dict[str, Any]], policies: Sequence[str], measures: Mapping[str, str], zero: bool
) -> Figure:
    """Draw the rows of policies or of differences alone, one panel below the other.

    ``policies`` are all policies in the order of their colours, ``measures`` the titles of the
    panels; ``zero`` adds a line at zero.
    """
    figure = Figure(figsize=(NARROW, 0.3 + len(measures) * (0.55 + 0.22 * len(rows))))
    panels = figure.subplots(len(measures), 1, squeeze=False)[:, 0]
    for axes, (measure, title) in zip(panels, measures.items(), strict=True):
        _draw(axes, rows, policies, measure)
        axes.set_title(title)
        if zero:
            axes.axvline(0, color="0.3", ls="-", linewidth=0.9, zorder=1)
    return figure


def _titles(comparison: dict[str, Any], measures: Sequence[str] | None) -> dict[str, str]:
    """Return the titles of the panels."""
    if measures is not None:
        return {name: PANELS.get(name, KNOWN[name].label) for name in measures}
    there = comparison["policies"][0]["measures"]
    return {name: title for name, title in PANELS.items() if name in there}


def _title(comparison: dict[str, Any]) -> str:
    counts = sorted({len(row["seeds"]) for row in comparison["policies"]})
    seeds = f"{counts[0]}" if len(counts) == 1 else f"{counts[0]} to {counts[-1]}"
    size = f"{comparison['scenario']}, {seeds} seed(s) of {comparison['episodes']} episode(s)"
    return f"{size}: {interval_words(comparison['policies'])}"


def _draw(axes: Axes, rows: Sequence[dict[str, Any]], names: Sequence[str], measure: str) -> None:
    """Draw a point and its interval for each policy, from top to bottom."""
    for place, row in enumerate(rows):
        estimate, number = row["measures"][measure], names.index(row["policy"])
        if estimate["mean"] is None:
            continue
        dressed: dict[str, Any] = {
            "color": COLOURS[number % len(COLOURS)],
            "marker": marker(number),
        }
        width = estimate["half_width"] or None
        axes.errorbar(
            estimate["mean"], place, xerr=width, capsize=3, ls="none", zorder=3, **dressed
        )
    axes.set_yticks(range(len(rows)), [short(row["policy"]) for row in rows])
    axes.set_ylim(len(rows) - 0.4, -0.6)
    axes.margins(x=0.12)
    axes.grid(visible=False, axis="y")
    axes.locator_params(axis="x", nbins=4)
