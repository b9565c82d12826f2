"""Figures of published papers, drawn anew."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.patches import Circle
from numpy.typing import NDArray

from desim_uav.report.figures.style import COLOURS, Figure, grid_of, headed, look, styled

DOT: dict[str, Any] = {"marker": "o", "markersize": 5, "linestyle": "", "markerfacecolor": "none"}


@dataclass(frozen=True)
class Series:
    """A line of a figure, and points in its colour that are compared with it."""

    name: str
    x: Sequence[float]
    y: Sequence[float]
    points: tuple[tuple[float, float], ...] = ()


@styled
def lines_figure(
    title: str, x_label: str, y_label: str, series: Sequence[Series], points: str = ""
) -> Figure:
    """Draw lines with their points; ``points`` is what the legend says of all points."""
    figure = Figure(figsize=(7.6, 3.6))
    axes = figure.subplots()
    for number, one in enumerate(series):
        axes.plot(one.x, one.y, label=one.name, **look(number))
        if one.points:
            axes.plot(*zip(*one.points, strict=True), **DOT, color=look(number)["color"])
    if points:
        axes.plot([], [], **DOT, color="grey", label=points)
    axes.set(xlabel=x_label, ylabel=y_label)
    axes.legend(loc="upper left", bbox_to_anchor=(1.0, 1.0))
    headed(figure, title)
    return figure


@styled
def discs_figure(title: str, packings: Sequence[tuple[float, NDArray[np.float64]]]) -> Figure:
    """Draw equal discs in a unit disc; a packing is their radius and their centres."""
    figure, panels = grid_of(len(packings), 1.5, 1.6, across=4)
    for axes, (radius, centres) in zip(panels, packings, strict=True):
        axes.add_patch(Circle((0.0, 0.0), 1.0, fill=False))
        for centre in centres:
            axes.add_patch(Circle((float(centre[0]), float(centre[1])), radius, color=COLOURS[1]))
        axes.set(xlim=(-1.05, 1.05), ylim=(-1.05, 1.05), aspect="equal")
        axes.set_title(f"{len(centres)}: {radius:.4f}")
        axes.set_axis_off()
    headed(figure, title)
    return figure
