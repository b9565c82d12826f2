"""Pictures of a run, drawn from its folder alone."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pandas as pd

from desim_uav.records import STEPS, USERS
from desim_uav.run_folder import read_table

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

# Okabe and Ito's colours: told apart by the colour-blind, and by their lightness in print.
DRONE_COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9")


def case_picture(run_dir: Path, episode: int = 0, minute: float = math.inf) -> Figure:
    """The map of a run with its buildings, stations, users and their walks, and the drones' paths.

    The state is that after ``minute`` of the episode, with the footprints of the drones that serve.
    Raises PolicyError where the folder is not a run's.
    """
    from matplotlib.figure import Figure

    steps = read_table(run_dir, "steps", STEPS)
    users = read_table(run_dir, "users", USERS)
    steps = steps[(steps["episode"] == episode) & (steps["t_s"] <= minute * 60)]
    users = users[(users["episode"] == episode) & (users["t_s"] <= minute * 60)]
    world = json.loads((run_dir / "world.json").read_text(encoding="utf-8"))
    radius_m = _footprint_radius_m(run_dir)

    figure = Figure(figsize=(7.2, 6.4), layout="constrained")
    axes = figure.add_subplot()
    buildings = _draw_map(axes, world)
    _draw_users(axes, users)
    _draw_drones(axes, steps, world, radius_m)
    if buildings is not None:
        figure.colorbar(buildings, ax=axes, shrink=0.6, label="building height, m")
    figure.legend(loc="outside lower center", ncols=3, frameon=False, fontsize=9)
    return figure


def _footprint_radius_m(run_dir: Path) -> float:
    from desim_uav.scenario.load import load

    return load(run_dir / "scenario.yaml").drones.footprint_radius_m


def _draw_map(axes: Axes, world: dict[str, Any]) -> Any:
    """Cells, buildings by height (None where there are none), stations and clusters."""
    import numpy as np
    from matplotlib.patches import Circle

    (width, depth), (nx, ny) = world["size_m"], world["cells"]
    heights = np.array(world["cell_height_m"])
    drawn = None
    if heights.any():
        extent = (0, width, 0, depth)
        shown = np.ma.masked_equal(heights.T, 0.0)
        drawn = axes.imshow(shown, origin="lower", extent=extent, cmap="Greys", vmin=0, alpha=0.75)
    axes.set_xticks(np.linspace(0, width, nx + 1), minor=True)
    axes.set_yticks(np.linspace(0, depth, ny + 1), minor=True)
    axes.grid(which="minor", color="0.88", linewidth=0.6)
    axes.tick_params(which="minor", length=0)
    for k, cluster in enumerate(world["clusters"]):
        circle = Circle(
            (cluster["x_m"], cluster["y_m"]),
            cluster["radius_m"],
            fill=False,
            color="0.45",
            linestyle=":",
            label="cluster" if k == 0 else None,
        )
        axes.add_patch(circle)
    if world["stations"]:
        dx, dy = width / nx, depth / ny
        centres = [((ix + 0.5) * dx, (iy + 0.5) * dy) for ix, iy in world["stations"]]
        xs, ys = zip(*centres, strict=True)
        look: dict[str, Any] = {"facecolor": "white", "edgecolor": "black", "linewidth": 1.4}
        axes.scatter(xs, ys, 110, marker="s", label="charging station", zorder=3, **look)
    axes.set(xlim=(0, width), ylim=(0, depth), aspect="equal", xlabel="x, m", ylabel="y, m")
    return drawn


def _draw_users(axes: Axes, users: pd.DataFrame) -> None:
    for k, (_, walk) in enumerate(users.groupby("user")):
        axes.plot(walk["x_m"], walk["y_m"], color="0.55", linewidth=0.5, zorder=2)
        axes.plot(
            walk["x_m"].iloc[0],
            walk["y_m"].iloc[0],
            ".",
            color="black",
            markersize=4,
            label="user at home, and walk" if k == 0 else None,
            zorder=2,
        )


def _draw_drones(axes: Axes, steps: pd.DataFrame, world: dict[str, Any], radius_m: float) -> None:
    from matplotlib.patches import Circle

    (width, depth), (nx, ny) = world["size_m"], world["cells"]
    for drone, (ix, iy) in enumerate(world["start_cells"]):
        path = steps[steps["drone"] == drone]
        colour = DRONE_COLOURS[drone % len(DRONE_COLOURS)]
        xs = [(ix + 0.5) * width / nx, *path["x_m"]]
        ys = [(iy + 0.5) * depth / ny, *path["y_m"]]
        axes.plot(xs, ys, color=colour, linewidth=1.6, zorder=4)
        mode = path["mode"].iloc[-1]
        label = f"drone {drone}, {mode}"
        axes.plot(xs[-1], ys[-1], "X", color=colour, markersize=9, label=label, zorder=5)
        if mode == "flying":
            footprint = Circle((xs[-1], ys[-1]), radius_m, color=colour, alpha=0.15, linewidth=0)
            axes.add_patch(footprint)
