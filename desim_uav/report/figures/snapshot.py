"""The paper's figure 1: a three-dimensional map at an instant, with drones and their paths."""

from __future__ import annotations

import math
import textwrap
from collections.abc import Sequence
from itertools import pairwise, product
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.text import Text
from matplotlib.transforms import Bbox
from mpl_toolkits.mplot3d import Axes3D, proj3d
from mpl_toolkits.mplot3d.art3d import Poly3DCollection
from numpy.typing import NDArray

from desim_uav.engine.base import UserState
from desim_uav.model.rules import US, Mode
from desim_uav.palette import USERS
from desim_uav.report.figures.case import case_picture
from desim_uav.report.figures.map import ACROSS, NO_FLIGHT, POINT, centre_m, zone_words
from desim_uav.report.figures.style import Figure, drone_look, named, styled
from desim_uav.report.links import point_rings_m, rings_m, shade
from desim_uav.report.playback import Moment, Playback
from desim_uav.report.run import Run, opened
from desim_uav.user_group import streets_of
from desim_uav.world import World

AROUND = np.linspace(0.0, 2.0 * math.pi, 73)
MARKERS = {
    UserState.SERVED: "o",
    UserState.OPEN: "D",
    UserState.ATTACHED: "^",
    UserState.IDLE: "v",
}
SIZES = {UserState.SERVED: 22, UserState.OPEN: 20, UserState.ATTACHED: 20, UserState.IDLE: 16}
"""The sizes of users by state, in square points, which differ enough for grey prints."""

WIDTH = 7.6
"""The least width of the figure in inches."""

BOX = (7.144, 4.94)
"""The width and height of the axes in inches, on which the size of the map depends."""

MARGIN, TITLE = 0.1, 0.3
"""The space round the map and the legend, and that for the title, in inches."""

FARTHEST = 20
"""How often the label of an axis is moved away from its ticks, each time by two points."""

UNIT = np.array([(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)])
"""The corners of a cell, in cells."""

PATH_S = 5.0
"""The time between two points of a path."""


@styled
def snapshot_figure(
    run: Run | Path, episode: int | None = None, minute: float | None = None
) -> Figure:
    """Draw the map at ``minute`` of an episode (by default its end), seen from the south-west.

    Crosses are drones, lines their paths so far, filled circles their footprints. Users are
    coloured by state. A flat map is drawn flat. Raises PolicyError if the folder is not that of a
    run, NoEventsError if it has no events, and UsageError if there is no such episode or minute.
    """
    run = opened(run)
    episode = run.episode(episode)
    t_us = None if minute is None else run.instant_us(episode, minute)
    if not run.scenario.three_d:
        return case_picture(run, episode, math.inf if minute is None else minute)
    playback = Playback(run, episode)
    t_us = playback.duration_us if t_us is None else t_us
    figure = Figure(figsize=BOX)
    figure.set_layout_engine("none")
    axes = figure.add_axes((0.0, 0.0, 1.0, 1.0), projection="3d", computed_zorder=False)
    assert isinstance(axes, Axes3D)
    world = run.map
    moment = playback.at(t_us)
    _draw_ground(axes, world)
    for line in streets_of(run.scenario):
        x, y = zip(*line, strict=True)
        axes.plot(x, y, 0, color="0.8", ls="-", linewidth=1.4, zorder=1.5)
    _draw_footprints(axes, moment, run.world)
    _draw_points(axes, run.world)
    _draw_users(axes, moment)
    _draw_zones(axes, run.world)
    _draw_buildings(axes, world)
    _draw_drones(axes, playback, moment)
    for artist in (*axes.lines, *axes.collections):
        artist.set_clip_on(False)  # the axes are narrower than the map that they show
    figure.suptitle(f"{run.name}, episode {episode}, minute {t_us / US / 60:g}", fontsize=9.5)
    _lay_out(figure, axes, run.world.attribution)
    return figure


def _lay_out(figure: Figure, axes: Any, attribution: str) -> None:
    """Stack title, map, legend and whose data the map has, and make the figure as large as these.

    The size of the map stays as it is, because labels of ticks reach differently far from it.
    """
    figure.draw_without_rendering()
    _move_labels(figure, axes)
    dots = figure.dpi_scale_trans.inverted()
    around = _extent(axes).transformed(dots)
    title = figure.texts[0].get_window_extent().transformed(dots)
    most = max(WIDTH, around.width + 2 * MARGIN, title.width + 2 * MARGIN)
    for columns in (3, 2, 1):
        legend = figure.legend(loc="lower center", ncols=columns, borderaxespad=0.0)
        size = legend.get_window_extent().transformed(dots)
        if size.width + 2 * MARGIN <= most or columns == 1:
            break
        legend.remove()
    width = max(most, size.width + 2 * MARGIN)
    text = textwrap.fill(attribution, 3 * ACROSS)
    whose = figure.text(0.0, 0.0, text, fontsize=5, ha="right", va="bottom")
    low = MARGIN + (whose.get_window_extent().transformed(dots).height if text else 0.0)
    height = low + size.height + around.height + TITLE + MARGIN
    left, bottom = (width - around.width) / 2 - around.x0, low + size.height + MARGIN - around.y0
    figure.set_size_inches(width, height)
    legend.set_bbox_to_anchor((0.5, low / height))
    whose.set_position((1.0 - MARGIN / width, 0.3 * MARGIN / height))
    axes.set_position((left / width, bottom / height, BOX[0] / width, BOX[1] / height))
    figure.texts[0].set_y(1.0 - MARGIN / height)


def _move_labels(figure: Figure, axes: Any) -> None:
    """Move the labels of the axes away from their ticks, until they cover no number."""
    for axis in (axes.xaxis, axes.yaxis, axes.zaxis):
        for _ in range(FARTHEST):
            label = axis.label.get_window_extent()
            if not label.count_overlaps([tick.get_window_extent() for tick in _numbers(axis)]):
                break
            axis.labelpad += 2
            figure.draw_without_rendering()


def _numbers(axis: Any) -> list[Text]:
    """Return the labels of an axis' ticks that are drawn."""
    return [tick.label1 for tick in axis.get_major_ticks() if tick.label1.get_text()]


def _extent(axes: Any) -> Bbox:
    """Return the pixels that the box of the axes, the lines, the ticks and the labels cover.

    Whatever is drawn as a collection lies in the box.
    """
    limits = axes.get_xlim(), axes.get_ylim(), axes.get_zlim()
    corners = np.array(list(product(*limits)))
    x, y, _ = proj3d.proj_transform(*corners.T, axes.get_proj())
    box = Bbox.null()
    box.update_from_data_xy(axes.transData.transform(np.column_stack((x, y))))
    drawn = [line.get_window_extent() for line in axes.lines]
    scales = [axis.get_tightbbox() for axis in (axes.xaxis, axes.yaxis, axes.zaxis)]
    return Bbox.union([box, *drawn, *scales])


def _draw_ground(axes: Any, world: dict[str, Any]) -> None:
    (width, depth), (nx, ny) = world["size_m"], world["cells"]
    for x in np.linspace(0, width, nx + 1):
        axes.plot([x, x], [0, depth], 0, color="0.85", ls="-", linewidth=0.5, zorder=1)
    for y in np.linspace(0, depth, ny + 1):
        axes.plot([0, width], [y, y], 0, color="0.85", ls="-", linewidth=0.5, zorder=1)
    dx, dy = width / nx / 3, depth / ny / 3
    for k, cell in enumerate(world["stations"]):
        x, y = centre_m(world, cell)
        corners = [
            (x - dx, y - dy, 0),
            (x + dx, y - dy, 0),
            (x + dx, y + dy, 0),
            (x - dx, y + dy, 0),
        ]
        name = "charging station" if k == 0 else None
        look = {"facecolor": "white", "edgecolor": "black", "linewidth": 1.4, "zorder": 3}
        axes.add_collection3d(Poly3DCollection([corners], label=name, **look))
    roofs_m = (world.get("city") or {"roofs_m": []})["roofs_m"]
    top = max([*world["open_levels_m"], float(np.max(world["cell_height_m"])), *roofs_m])
    axes.set(xlim=(0, width), ylim=(0, depth), zlim=(0, top))
    axes.set_xlabel("x, m", labelpad=6)
    axes.set_ylabel("y, m", labelpad=6)
    axes.set_zlabel("altitude, m\n(stretched)", labelpad=4)
    longest = max(width, depth)
    axes.set_box_aspect((width / longest, depth / longest, 0.22), zoom=1.2)
    for axis, side in ((axes.xaxis, width), (axes.yaxis, depth)):
        if side < 0.3 * longest:
            axis.set_ticks([0, side])
    axes.set_zticks([0, *world["levels_m"]])
    axes.view_init(elev=36, azim=-60)
    axes.grid(visible=False)
    for pane in (axes.xaxis, axes.yaxis, axes.zaxis):
        pane.set_pane_color((1, 1, 1, 0))


def _draw_buildings(axes: Any, world: dict[str, Any]) -> None:
    """Draw buildings from the back to the front, so that nearer ones cover those behind them."""
    (width, depth), (nx, ny) = world["size_m"], world["cells"]
    if world.get("city"):
        pieces = [np.array(piece) for piece in world["city"]["pieces_m"]]
        prisms = list(zip(pieces, world["city"]["roofs_m"], strict=True))
    else:
        heights, sides = np.array(world["cell_height_m"], float), (width / nx, depth / ny)
        cells = np.argwhere(heights > 0)
        prisms = [((cell + UNIT) * sides, heights[tuple(cell)]) for cell in cells]
    middles = [np.mean(corners, axis=0) for corners, _ in prisms]
    order = sorted(
        range(len(prisms)), key=lambda k: middles[k][0] / width - 1.7 * middles[k][1] / depth
    )
    for k, number in enumerate(order):
        corners, roof_m = prisms[number]
        _draw_prism(axes, corners, float(roof_m), "building" if k == 0 else None)


def _draw_prism(axes: Any, corners: NDArray[np.float64], roof_m: float, name: str | None) -> None:
    """Draw a building; its corners are counterclockwise. Walls to the south-west are lighter."""
    floor, roof = (np.column_stack([corners, np.full(len(corners), z)]) for z in (0.0, roof_m))
    ahead = np.roll(corners, -1, axis=0) - corners
    light = (ahead[:, 1] - ahead[:, 0]) / np.hypot(*ahead.T) / math.sqrt(2.0)
    walls = [
        np.array([floor[k], floor[k - len(floor) + 1], roof[k - len(roof) + 1], roof[k]])
        for k in range(len(corners))
    ]
    shades = [str(round(0.68 - 0.12 * float(part), 3)) for part in light]
    look = {"edgecolor": "0.4", "linewidth": 0.3, "zorder": 5, "clip_on": False}
    faces = [*walls, roof]
    axes.add_collection3d(Poly3DCollection(faces, facecolor=[*shades, "0.88"], label=name, **look))


def _draw_footprints(axes: Axes3D, moment: Moment, world: World) -> None:
    for drone, (x, y, z) in enumerate(moment.drones_m.tolist()):
        if moment.modes[drone] is Mode.FLYING:
            _draw_rings(axes, (x, y), rings_m(world, z, drone), world, drone_look(drone))


def _draw_points(axes: Any, world: World) -> None:
    for k, point in enumerate(world.scenario.access_points):
        _draw_rings(axes, point.at_m, point_rings_m(world, k), world, {"color": POINT})
        x, y = point.at_m
        axes.plot([x, x], [y, y], [0, point.height_m], color=POINT, linewidth=1.2, zorder=6)
        name = "access point" if k == 0 else None
        axes.plot([x], [y], [point.height_m], "^", color=POINT, label=name, zorder=6)


def _draw_zones(axes: Any, world: World) -> None:
    """Draw the walls of zones without flights, as far as the axes reach up, and their floors."""
    top_m = axes.get_zlim()[1]
    look = {**NO_FLIGHT, "facecolor": NO_FLIGHT["edgecolor"], "alpha": 0.14, "zorder": 4}
    for k, zone in enumerate(world.scenario.map.no_fly):
        low_m, high_m = (min(altitude_m, top_m) for altitude_m in zone.altitude_m)
        floor = [(x, y, low_m) for x, y in zone.polygon_m]
        walls = [
            [(*one, low_m), (*two, low_m), (*two, high_m), (*one, high_m)]
            for one, two in pairwise((*zone.polygon_m, zone.polygon_m[0]))
        ]
        name = zone_words(world) if k == 0 else None
        axes.add_collection3d(Poly3DCollection([floor, *walls], label=name, **look))


def _draw_rings(
    axes: Any, at_m: Sequence[float], radii_m: Any, world: World, look: dict[str, Any]
) -> None:
    """Draw the discs in which links have each class on the ground, the widest with its edge."""
    alpha = 0.16 if len(radii_m) == 1 else shade(len(radii_m))
    for k, radius_m in enumerate(radii_m):
        around_x = np.clip(at_m[0] + radius_m * np.cos(AROUND), 0, world.area.width_m)
        around_y = np.clip(at_m[1] + radius_m * np.sin(AROUND), 0, world.area.depth_m)
        disc = np.column_stack((around_x, around_y, np.zeros_like(AROUND)))
        filled = Poly3DCollection([disc], facecolor=look["color"], alpha=alpha, zorder=2)
        axes.add_collection3d(filled)
        if k == 0:
            axes.plot(*disc.T, **look, linewidth=0.9, zorder=2)


def _draw_users(axes: Any, moment: Moment) -> None:
    """Draw users with a colour and marker per state, and their number in the legend."""
    states = np.array(moment.states)
    for state, (word, colour) in USERS.items():
        there = moment.users_m[states == state]
        if len(there):
            style = {"marker": MARKERS[state], "s": SIZES[state], "facecolor": colour}
            style |= {"edgecolor": "white", "linewidth": 0.4, "depthshade": False}
            axes.scatter(*there.T, **style, label=f"user {word} ({len(there)})", zorder=4)


def _draw_drones(axes: Any, playback: Playback, moment: Moment) -> None:
    times_us = np.append(np.arange(0, moment.t_us, round(PATH_S * US)), moment.t_us)
    paths = playback.paths_m(times_us)
    for drone, (x, y, z) in enumerate(moment.drones_m.tolist()):
        dressed = drone_look(drone)
        axes.plot(*paths[drone].T, **dressed, linewidth=1.5, zorder=6)
        axes.plot([x, x], [y, y], [0, z], color="0.3", ls=":", linewidth=0.8, zorder=6)
        mode = moment.modes[drone].name.lower()
        height = f" at {z:.0f} m" if z else ""
        axes.plot(
            *([x], [y], [z], "X"),
            color=dressed["color"],
            markersize=9,
            markeredgecolor="white",
            label=named(drone, len(paths), f"{playback.run.drone_name(drone)}, {mode}" + height),
            zorder=7,
        )
