"""The picture of a case: its map, users and their walks, and the drones' paths."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Circle

from desim_uav.report.figures.map import (
    centre_m,
    draw_buildings,
    draw_cells,
    draw_clusters,
    draw_stations,
)
from desim_uav.report.figures.style import look, named, styled
from desim_uav.report.run import Run


@styled
def case_picture(run_dir: Path, episode: int = 0, minute: float = math.inf) -> Figure:
    """The map of a run with its buildings, stations, users and their walks, and the drones' paths.

    The state is that after ``minute`` of the episode, with the footprints of the drones that serve.
    Raises PolicyError where the folder is not a run's.
    """
    run = Run(run_dir)
    steps, users = (
        frame[frame["t_s"] <= minute * 60] for frame in (run.of(n, episode) for n in PARTS)
    )
    world = run.map
    radius_m = run.scenario.drones.footprint_radius_m

    figure = Figure(figsize=(7.2, 6.4))
    axes = figure.add_subplot()
    buildings = draw_buildings(axes, world)
    draw_cells(axes, world)
    draw_clusters(axes, world)
    draw_stations(axes, world)
    _draw_users(axes, users)
    _draw_drones(axes, steps, world, radius_m)
    if buildings is not None:
        figure.colorbar(buildings, ax=axes, shrink=0.6, label="building height, m")
    figure.legend(loc="outside lower center", ncols=3, fontsize=9)
    return figure


PARTS = ("steps", "users")


def _draw_users(axes: Axes, users: pd.DataFrame) -> None:
    for k, (_, walk) in enumerate(users.groupby("user")):
        axes.plot(walk["x_m"], walk["y_m"], color="0.55", ls="-", linewidth=0.5, zorder=2)
        axes.plot(
            walk["x_m"].iloc[0],
            walk["y_m"].iloc[0],
            ".",
            color="0.25",
            markersize=4,
            label="user at home, and walk" if k == 0 else None,
            zorder=2,
        )


def _draw_drones(axes: Axes, steps: pd.DataFrame, world: dict[str, Any], radius_m: float) -> None:
    for drone, cell in enumerate(world["start_cells"]):
        path = steps[steps["drone"] == drone]
        dressed = look(drone)
        start = centre_m(world, cell)
        xs, ys = [start[0], *path["x_m"]], [start[1], *path["y_m"]]
        axes.plot(xs, ys, **dressed, linewidth=1.6, zorder=4)
        mode = path["mode"].iloc[-1] if len(path) else "flying"
        colour = dressed["color"]
        label = named(drone, len(world["start_cells"]), f"drone {drone}, {mode}")
        axes.plot(xs[-1], ys[-1], "X", color=colour, markersize=9, label=label, zorder=5)
        if mode == "flying":
            footprint = Circle((xs[-1], ys[-1]), radius_m, color=colour, alpha=0.13, linewidth=0)
            axes.add_patch(footprint)
