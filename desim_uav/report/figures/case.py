"""The picture of a case: its map, users and their walks, and the drones' paths."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from desim_uav.errors import PolicyError
from desim_uav.report.figures.map import (
    centre_m,
    draw_buildings,
    draw_cells,
    draw_clusters,
    draw_points,
    draw_rings,
    draw_stations,
    draw_zones,
)
from desim_uav.report.figures.style import NARROW, drone_look, named, styled
from desim_uav.report.links import rings_m
from desim_uav.report.run import Run, opened
from desim_uav.world import World


@styled
def case_picture(
    run: Run | Path, episode: int = 0, minute: float = math.inf, width: float = 7.2
) -> Figure:
    """Draw the map of a run: buildings, stations, users and their walks, and the drones' paths.

    The state is that after ``minute`` of the episode, with the footprints of the drones that serve.
    ``width`` is in inches. Raises PolicyError if the folder is not that of a run, and UsageError if
    it has no such episode.
    """
    run = opened(run)
    episode = run.episode(episode)
    if set(run.of("steps", episode)["drone"]) != set(range(run.scenario.drone_count)):
        raise PolicyError(
            f"{run.folder / 'steps.parquet'}: not of this run, episode {episode}: "
            "the drones are not those of the scenario"
        )
    steps, users = (
        frame[frame["t_s"] <= minute * 60] for frame in (run.of(n, episode) for n in PARTS)
    )
    world = run.map

    figure = Figure(figsize=(width, width * 6.4 / 7.2))
    axes = figure.add_subplot()
    buildings = draw_buildings(axes, world)
    draw_cells(axes, world)
    draw_clusters(axes, world)
    draw_stations(axes, world)
    draw_zones(axes, run.world)
    _draw_users(axes, users)
    draw_points(axes, run.world)
    _draw_drones(axes, steps, run.world, world)
    if buildings is not None:
        figure.colorbar(buildings, ax=axes, shrink=0.6, label="building height, m")
    figure.legend(loc="outside lower center", ncols=3 if width > NARROW else 2, fontsize=9)
    return figure


PARTS = ("steps", "users")


def _draw_users(axes: Axes, users: pd.DataFrame) -> None:
    """Draw all walks as one line with gaps between users, which is fast for thousands of them."""
    users = users.sort_values(["user", "t_s"], kind="stable")
    user = users["user"].to_numpy()
    breaks = np.flatnonzero(user[1:] != user[:-1]) + 1
    x_m, y_m = (np.insert(users[name].to_numpy(), breaks, np.nan) for name in ("x_m", "y_m"))
    axes.plot(x_m, y_m, color="0.55", ls="-", linewidth=0.5, zorder=2)
    homes = users.drop_duplicates("user")
    dot: dict[str, Any] = {"color": "0.25", "markersize": 4, "zorder": 2}
    axes.plot(homes["x_m"], homes["y_m"], ".", label="user at the start, and walk", **dot)


def _draw_drones(axes: Axes, steps: pd.DataFrame, links: World, world: dict[str, Any]) -> None:
    for drone, cell in enumerate(world["start_cells"]):
        path = steps[steps["drone"] == drone]
        dressed = drone_look(drone)
        start = centre_m(world, cell)
        xs, ys = [start[0], *path["x_m"]], [start[1], *path["y_m"]]
        axes.plot(xs, ys, **dressed, linewidth=1.6, zorder=4)
        mode = path["mode"].iloc[-1] if len(path) else "flying"
        colour = dressed["color"]
        label = named(drone, len(world["start_cells"]), f"drone {drone}, {mode}")
        axes.plot(xs[-1], ys[-1], "X", color=colour, markersize=9, label=label, zorder=5)
        if mode == "flying":
            z_m = path["z_m"].iloc[-1] if len(path) else links.grid.levels_m[0]
            draw_rings(axes, (xs[-1], ys[-1]), rings_m(links, z_m, drone), colour)
