"""The minutes of serving flight in each cell."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from desim_uav.errors import UsageError
from desim_uav.report.figures.map import (
    attribute,
    draw_cells,
    draw_field,
    draw_stations,
    draw_zones,
    mark_buildings,
)
from desim_uav.report.figures.style import grid_of, headed, styled
from desim_uav.report.playback import Playback
from desim_uav.report.run import Run, opened

US_MIN = 60_000_000


@styled
def visits_figure(run: Run | Path, episode: int | None = None, drone: int | None = None) -> Figure:
    """Draw one map per drone, shaded by its minutes of serving flight in each cell.

    Minutes are means over the counted episodes, or those of one. Raises PolicyError if the folder
    is not that of a run, NoEventsError if it has no events, and UsageError if it has no such
    episode or drone.
    """
    run = opened(run)
    drones = chosen_drones(run, drone)
    episodes = counted_episodes(run, episode)
    minutes = visit_minutes(run, episodes)
    world = run.map
    figure, panels = grid_of(len(drones), width=3.3, height=3.1)
    top = max(minutes[drones].max(), 1e-9)
    image: Any = None
    for axes, number in zip(panels, drones, strict=True):
        shades = np.where(minutes[number] > 0, minutes[number], np.nan)
        image = draw_field(axes, world, shades, cmap="YlGnBu", vmin=0, vmax=top)
        draw_cells(axes, world)
        look: dict[str, Any] = {"facecolor": "none", "edgecolor": "0.55", "linewidth": 0.4}
        mark_buildings(axes, world, run.world, hatch="////", **look)
        draw_zones(axes, run.world)
        draw_stations(axes, world, size=36)
        axes.set_title(f"{run.drone_name(number)}: {minutes[number].sum():.1f} min")
    attribute(panels[-1], run.world)
    which = f"episode {episode}" if episode is not None else f"mean of {len(episodes)} episode(s)"
    headed(figure, f"Serving flight. {run.name}, {which}")
    figure.colorbar(image, ax=panels, shrink=0.8, label="serving flight, min per episode")
    figure.legend(*panels[0].get_legend_handles_labels(), loc="outside lower center", ncols=3)
    return figure


def visit_minutes(run: Run, episodes: Sequence[int]) -> NDArray[np.float64]:
    """Return the mean minutes of serving flight in each cell per episode, (drones, nx, ny)."""
    minutes = np.zeros((run.scenario.drone_count, *run.world.grid.cells))
    run.need(episodes)
    for episode in episodes:
        playback = Playback(run, episode)
        for drone in range(len(minutes)):
            for start_us, end_us, cell in playback.cell_times_us(drone):
                minutes[drone][cell] += (end_us - start_us) / US_MIN
    return minutes / len(episodes)


def counted_episodes(run: Run, episode: int | None) -> list[int]:
    """Return one episode, or by default all counted ones.

    Raises UsageError if there is no such episode, and PolicyError if none is counted.
    """
    return run.counted_episodes if episode is None else [run.episode(episode)]


def chosen_drones(run: Run, drone: int | None) -> list[int]:
    """Return one drone, or by default all. Raises UsageError if there is no such drone."""
    count = run.scenario.drone_count
    if drone is None:
        return list(range(count))
    if not 0 <= drone < count:
        raise UsageError(f"drone: {drone}: {run.name} has the drones 0 to {count - 1}")
    return [drone]
