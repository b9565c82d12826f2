"""Maps of a run's links: class, SNR, SINR and serving drone, at an instant or on average."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.colors import BoundaryNorm, ListedColormap
from matplotlib.patches import Patch

from desim_uav.palette import drone_colour
from desim_uav.report.figures.map import attribute, draw_cells, draw_zones, mark_buildings
from desim_uav.report.figures.radio import INK, MAST, SHADES
from desim_uav.report.figures.style import MOST_NAMED, Figure, grid_of, headed, styled
from desim_uav.report.levels import LinksInTime
from desim_uav.report.radio_map import frame_of, playback_of
from desim_uav.report.run import Run, opened

WALLS: dict[str, Any] = {"facecolor": "none", "edgecolor": INK, "linewidth": 0.7, "zorder": 2}
"""The edges of buildings."""

POINT_COLOURS = ("#2F2F2F", "#9A9A9A", "#5C5C5C", "#C8C8C8")
"""The colours of the places that access points serve; they repeat after the last."""


@styled
def map_figure(run: Run | Path, episode: int | None = None, minute: float | None = None) -> Figure:
    """Draw what users on the ground would receive, at a minute of an episode or on average.

    The panels are the class of the best link, its SNR and (with interference) its SINR, and which
    drone or access point has it. Raises UsageError if there is no such minute or episode.
    """
    run = opened(run)
    frame = frame_of(run, episode, minute)
    radios = [links.radio for links in run.world.links]
    kinds = ["link_class"]
    if any(radio.graded for radio in radios):
        kinds += ["snr_db", "sinr_db"] if any(radio.reuse for radio in radios) else ["snr_db"]
    kinds.append("drone")
    figure, panels = grid_of(len(kinds), 4.6, 3.9, across=2)
    for axes, kind in zip(panels, kinds, strict=True):
        _draw(axes, run, frame, kind, minute is None)
    _mark(panels, run, episode, minute)
    attribute(panels[-1], run.world)
    headed(figure, _heading(run, episode, minute))
    handles = [*_patches(run, frame), *panels[0].get_legend_handles_labels()[0]]
    if handles:
        figure.legend(handles=handles, loc="outside lower center", ncols=5, fontsize=8.5)
    figure.table = frame
    return figure


def _draw(axes: Axes, run: Run, frame: pd.DataFrame, kind: str, mean: bool) -> None:
    """Draw one map."""
    width, depth = run.world.area
    shape = frame["y_m"].nunique(), frame["x_m"].nunique()
    values = frame[kind].astype("float64").to_numpy().reshape(shape)
    look: dict[str, Any] = {"origin": "lower", "extent": (0, width, 0, depth), "zorder": 0}
    look["interpolation"] = "nearest"
    draw_cells(axes, run.map)
    if kind == "drone":
        _draw_drones(axes, run, values, look, mean)
    elif kind == "link_class":
        _draw_classes(axes, run, values, look, mean)
    else:
        image = axes.imshow(np.ma.masked_invalid(values), cmap=SHADES, **look)
        axes.figure.colorbar(image, ax=axes, shrink=0.85)
        name = kind.removesuffix("_db").upper()
        axes.set_title(f"{'mean ' if mean else ''}{name} of the best link, dB")
    axes.grid(visible=False, which="both")
    mark_buildings(axes, run.map, run.world, **WALLS)
    draw_zones(axes, run.world)


def _draw_classes(axes: Axes, run: Run, values: Any, look: dict[str, Any], mean: bool) -> None:
    """Draw classes; 0 is white."""
    most = max(len(links.efficiencies) - 1 for links in run.world.links)
    shades = SHADES(np.linspace(0.0, 1.0, most)) if most > 1 else [SHADES(0.6)]
    colours = ListedColormap([(1.0, 1.0, 1.0, 1.0), *map(tuple, shades)])
    if mean:
        image = axes.imshow(values, cmap=SHADES, vmin=0.0, **look)
        axes.figure.colorbar(image, ax=axes, shrink=0.85)
        axes.set_title("mean class of the best link")
        return
    norm = BoundaryNorm(np.arange(-0.5, most + 1.0), most + 1)
    image = axes.imshow(values, cmap=colours, norm=norm, **look)
    ticks = np.unique(np.linspace(0, most, min(most, 8) + 1).round())
    axes.figure.colorbar(image, ax=axes, shrink=0.85, ticks=ticks, format="%d")
    axes.set_title("class of the best link (0: no link)")


def _colours(run: Run) -> list[str]:
    """Return the colour of each drone and access point."""
    points = range(len(run.scenario.access_points))
    drones = [drone_colour(drone) for drone in range(run.scenario.drone_count)]
    return drones + [POINT_COLOURS[k % len(POINT_COLOURS)] for k in points]


def _patches(run: Run, frame: pd.DataFrame) -> list[Patch]:
    """Return the entries of the legend for those who have the best link somewhere."""
    drones = run.scenario.drone_count
    return [
        Patch(
            color=_colours(run)[k],
            label=run.drone_name(k) if k < drones else f"access point {k - drones}",
        )
        for k in sorted(frame["drone"].dropna().unique().tolist())[:MOST_NAMED]
    ]


def _draw_drones(axes: Axes, run: Run, values: Any, look: dict[str, Any], mean: bool) -> None:
    """Draw who has the best link, each in its colour."""
    own = _colours(run)
    norm = BoundaryNorm(np.arange(-0.5, max(len(own), 2)), max(len(own), 2))
    colours = ListedColormap(own if len(own) > 1 else [*own, "white"])
    axes.imshow(np.ma.masked_invalid(values), cmap=colours, norm=norm, **look)
    axes.set_title("who has the best link most often" if mean else "who has the best link")


def _mark(panels: Sequence[Axes], run: Run, episode: int | None, minute: float | None) -> None:
    """Draw access points, and at an instant the drones that serve."""
    places = {} if minute is None else _serving_m(run, episode, minute)
    for axes in panels:
        for k, point in enumerate(run.scenario.access_points):
            label = "access point" if k == 0 else None
            axes.plot(*point.at_m, **MAST | {"label": label, "markersize": 9}, zorder=5)
        for k, (drone, (x, y)) in enumerate(places.items()):
            label = "drone that serves" if k == 0 else None
            look: dict[str, Any] = {"color": drone_colour(drone), "markersize": 8, "ls": ""}
            axes.plot(x, y, "X", label=label, markeredgecolor="white", **look, zorder=6)


def _serving_m(run: Run, episode: int | None, minute: float) -> dict[int, tuple[float, float]]:
    """Return where the drones are that serve at a minute, by their numbers."""
    playback = playback_of(run, episode)
    links, now = LinksInTime(playback), np.array([run.instant_us(playback.episode, minute)])
    places = {}
    for drone in range(run.scenario.drone_count):
        if links.serves(drone, now)[0]:
            x, y, _ = links.places_m(drone, now)[0].tolist()
            places[drone] = (x, y)
    return places


def _heading(run: Run, episode: int | None, minute: float | None) -> str:
    """Return the heading, which says what is left out."""
    if minute is not None:
        when = f"episode {run.episode(episode)}, minute {minute:g}"
    elif episode is not None:
        when = f"mean over episode {episode}"
    else:
        counted = len(run.counted_episodes)
        when = f"mean over {counted} episode{'s' if counted > 1 else ''}"
    radios = [links.radio for links in run.world.links]
    lines = [f"{run.name}, {when}: links to users on the ground"]
    drawn = [getattr(radio, "line_of_sight", "mean") == "drawn" for radio in radios]
    left_out = ["drawn lines of sight"] if any(drawn) else []
    if any(getattr(radio, "shadowing", None) is not None for radio in radios):
        left_out.append("shadowing")
    lines += [f"left out: {' and '.join(left_out)}"] if left_out else []
    return "\n".join(lines)
