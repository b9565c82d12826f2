"""The picture of a case: its map, users and their walks, and the drones' paths."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes

from desim_uav.errors import NoEventsError, PolicyError
from desim_uav.model.rules import US
from desim_uav.report.figures.map import (
    attribute,
    centre_m,
    draw_buildings,
    draw_cells,
    draw_clusters,
    draw_points,
    draw_rings,
    draw_stations,
    draw_streets,
    draw_zones,
)
from desim_uav.report.figures.style import NARROW, Figure, drone_look, named, styled
from desim_uav.report.links import rings_m
from desim_uav.report.playback import Playback
from desim_uav.report.run import Run, opened

Positions = Sequence[tuple[float, float]]


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
    draw_streets(axes, run.world)
    buildings = draw_buildings(axes, world)
    draw_cells(axes, world)
    attribute(axes, run.world)
    draw_clusters(axes, world)
    draw_stations(axes, world)
    draw_zones(axes, run.world)
    _draw_users(axes, users)
    draw_points(axes, run.world)
    _draw_drones(axes, run, steps, _ways_m(run, episode, minute, steps))
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


def _ways_m(run: Run, episode: int, minute: float, steps: pd.DataFrame) -> list[Positions]:
    """Return the places (x, y) that the path of each drone joins.

    They are those at the ends of steps. If drones fly freely, they are those at the ends of legs,
    because a return bends within a step, unless the run has no events and cannot be played again.
    """
    if run.world.free:
        try:
            run.need([episode])
        except NoEventsError:
            pass
        else:
            playback = Playback(run, episode)
            t_us = round(min(minute * 60, run.duration_s(episode)) * US)
            drones = range(run.scenario.drone_count)
            return [playback.way_m(drone, t_us)[:, :2].tolist() for drone in drones]
    starts = [centre_m(run.map, cell) for cell in run.map["start_cells"]]
    paths = [steps[steps["drone"] == drone] for drone in range(len(starts))]
    return [
        [start, *zip(path["x_m"], path["y_m"], strict=True)]
        for start, path in zip(starts, paths, strict=True)
    ]


def _draw_drones(axes: Axes, run: Run, steps: pd.DataFrame, ways_m: list[Positions]) -> None:
    """Draw the path of each drone, where it is, and its footprint if it serves."""
    for drone, way_m in enumerate(ways_m):
        path = steps[steps["drone"] == drone]
        dressed = drone_look(drone)
        xs, ys = zip(*way_m, strict=True)
        axes.plot(xs, ys, **dressed, linewidth=1.6, zorder=4)
        mode = path["mode"].iloc[-1] if len(path) else "flying"
        colour = dressed["color"]
        label = named(drone, len(ways_m), f"{run.drone_name(drone)}, {mode}")
        look: dict[str, Any] = {"markersize": 9, "zorder": 5, "clip_on": False}
        axes.plot(xs[-1], ys[-1], "X", color=colour, label=label, **look)
        if mode == "flying":
            z_m = path["z_m"].iloc[-1] if len(path) else run.world.grid.levels_m[0]
            draw_rings(axes, (xs[-1], ys[-1]), rings_m(run.world, z_m, drone), colour)
