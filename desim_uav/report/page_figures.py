"""The figures of a report, small: each from a run's tables or from a comparison."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import pandas as pd

from desim_uav.qoe import OUTCOMES
from desim_uav.records import EPISODES, REQUESTS, STEPS
from desim_uav.report.figures import case_picture
from desim_uav.report.figures.style import COLOURS as DRONE_COLOURS
from desim_uav.report.markup import visible
from desim_uav.report.text import COMPARED
from desim_uav.run_folder import read_table

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

WIDTH = 5.0
"""Inches: on a telephone a figure is shown at its size, on a desk two stand side by side."""

LABELLED = 8
"""So many drones have a line and a name of their own."""

LONGEST_LABEL = 28
MOST_SERVICES = 12
LINES = ("-", "--", "-.", ":")
SHADES = {
    "completed": ("#009E73", ""),
    "unfinished": ("#E69F00", "//"),
    "never_served": ("0.6", "xx"),
}


def run_map(run_dir: Path) -> Figure:
    """The map as the first counted episode ends."""
    figure = case_picture(run_dir, first_episode(run_dir))
    figure.set_size_inches(WIDTH + 0.6, WIDTH + 0.4)
    for legend in list(figure.legends):
        if len(legend.get_texts()) > 2 * LABELLED:
            legend.remove()  # a line for each drone leaves no room for the map
        else:
            legend.set_ncols(2)
    return figure


def qoe_over_episodes(run_dir: Path) -> Figure:
    """QoE1 to QoE3 of each counted episode, and where drones crashed."""
    episodes = read_table(run_dir, "episodes", EPISODES)
    episodes = episodes[episodes["episode"] >= 0]
    figure, panels = _panels(3, 1.35, sharex=True)
    labels = ("QoE1, %", "QoE2, it.", "QoE3, %")
    columns = ("qoe1_percent", "qoe2_iterations", "qoe3_percent")
    crashed = episodes[episodes["crashes"] > 0]
    marker = "." if len(episodes) <= 60 else ""
    for axes, column, label in zip(panels, columns, labels, strict=True):
        axes.plot(episodes["episode"], episodes[column], marker=marker, color=DRONE_COLOURS[0])
        look: dict[str, Any] = {"color": DRONE_COLOURS[1], "linestyle": "none", "marker": "x"}
        axes.plot(crashed["episode"], crashed[column], label="a drone crashed", **look)
        axes.set_ylabel(label)
        axes.margins(y=0.15)
    if len(crashed):
        panels[0].legend(frameon=False, fontsize=8)
    panels[-1].set_xlabel("episode")
    panels[-1].set_xlim(episodes["episode"].min() - 0.5, episodes["episode"].max() + 0.5)
    panels[-1].locator_params("x", integer=True)
    return figure


def service_outcomes(run_dir: Path) -> Figure:
    """How the requests of each service ended."""
    requests = read_table(run_dir, "requests", REQUESTS)
    requests = requests[requests["episode"] >= 0]
    counts = pd.crosstab(requests["service"], requests["outcome"])
    counts = counts.reindex(columns=list(OUTCOMES), fill_value=0)
    counts = counts.loc[counts.sum(axis="columns").nlargest(MOST_SERVICES).index[::-1]]
    figure, (axes,) = _panels(1, 1.5 + 0.4 * len(counts))
    names = [visible(str(service), LONGEST_LABEL) for service in counts.index]
    places = range(len(names))
    shares = 100 * counts.div(counts.sum(axis="columns"), axis="index")
    left = pd.Series(0.0, counts.index)
    for outcome, (colour, hatch) in SHADES.items():
        look: dict[str, Any] = {"color": colour, "hatch": hatch, "edgecolor": "white"}
        label = outcome.replace("_", " ")
        axes.barh(places, shares[outcome], left=left, height=0.62, label=label, **look)
        left += shares[outcome]
    axes.set_yticks(places, [f"{n}\n({c})" for n, c in zip(names, counts.sum(axis=1), strict=True)])
    axes.set(xlim=(0, 100), xlabel="share of its requests, %")
    figure.legend(loc="outside upper center", ncols=3, frameon=False, fontsize=9)
    return figure


def battery(run_dir: Path) -> Figure:
    """The battery of each drone over the first counted episode."""
    steps = read_table(run_dir, "steps", STEPS)
    steps = steps[steps["episode"] == first_episode(run_dir)]
    figure, (axes,) = _panels(1, 3.2)
    landed = steps["mode"].isin(["charging", "queued"])
    drones = sorted(steps["drone"].unique())
    for number, drone in enumerate(drones):
        of_drone = steps[steps["drone"] == drone]
        minutes, left = of_drone["t_s"] / 60, of_drone["battery_s"] / 60
        few = len(drones) <= LABELLED
        colour = DRONE_COLOURS[number % len(DRONE_COLOURS)] if few else "0.5"
        label = f"drone {drone}" if few else None
        style = LINES[number % len(LINES)] if few else "-"
        axes.plot(minutes, left, style, color=colour, label=label, linewidth=1.6 if few else 0.6)
        for marker, there in (("s", landed), ("X", steps["crashed"])):
            shown = there[of_drone.index]
            axes.plot(minutes[shown], left[shown], marker, color=colour, markersize=4)
    axes.set(xlabel="time, min", ylabel="battery, min of flight")
    said = {"s": (landed, "charging, or in the queue"), "X": (steps["crashed"], "crashed")}
    for marker, (there, label) in said.items():
        if there.any():
            axes.plot([], [], marker, color="0.5", markersize=4, label=label)
    figure.legend(loc="outside lower center", ncols=3, frameon=False, fontsize=9)
    return figure


def interval_panels(rows: list[dict[str, Any]], policies: list[str], zero: bool) -> Figure:
    """Means and intervals of policies, or of their differences from one, a panel a measure.

    ``rows`` as in the content of a comparison; ``policies``: all, in the order of their colours;
    ``zero``: draw a line there.
    """
    names = [visible(str(row["policy"]), LONGEST_LABEL) for row in rows]
    figure, panels = _panels(len(COMPARED), 0.55 + 0.22 * len(rows))
    for axes, (name, (label, _)) in zip(panels, COMPARED.items(), strict=True):
        for place, row in enumerate(rows):
            found = row["measures"][name]
            if found["mean"] is not None:
                colour = DRONE_COLOURS[policies.index(row["policy"]) % len(DRONE_COLOURS)]
                look: dict[str, Any] = {"fmt": "o", "capsize": 3, "markersize": 5, "color": colour}
                axes.errorbar(found["mean"], place, xerr=found["half_width"], **look)
        if zero:
            axes.axvline(0, color="0.5", linewidth=0.8)
        axes.set_yticks(range(len(names)), names)
        axes.set_ylim(len(names) - 0.4, -0.6)
        axes.locator_params("x", nbins=5)
        axes.set_title(label, fontsize=10, loc="left")
    return figure


def first_episode(run_dir: Path) -> int:
    """The first counted one."""
    numbers = read_table(run_dir, "episodes", EPISODES)["episode"]
    return int(numbers[numbers >= 0].min())


def _panels(number: int, height: float, sharex: bool = False) -> tuple[Figure, list[Axes]]:
    """One under the other, each so many inches high."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(WIDTH, 0.3 + number * height), layout="constrained")
    return figure, list(figure.subplots(number, 1, sharex=sharex, squeeze=False)[:, 0])
