"""The map of a world in a figure: cells, buildings, charging stations and clusters."""

from __future__ import annotations

import textwrap
from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection, PolyCollection
from matplotlib.patches import Circle, Polygon, Rectangle
from numpy.typing import NDArray

from desim_uav.report.links import point_rings_m, shade
from desim_uav.scenario.map import NoFly
from desim_uav.user_group import streets_of
from desim_uav.world import World

POINT = "0.15"
"""The colour of access points."""

NO_FLIGHT: dict[str, Any] = {"facecolor": "none", "edgecolor": "#C00000", "linewidth": 1.2}
"""The edges of zones without flights, and their hatching."""

ACROSS = 48
"""The characters of a line that says whose data a map shows."""

STATION: dict[str, Any] = {"facecolor": "white", "edgecolor": "black", "linewidth": 1.4}


def centre_m(world: dict[str, Any], cell: Sequence[int]) -> tuple[float, float]:
    """Return the centre of a cell of ``world.json``."""
    (width, depth), (nx, ny), (ix, iy) = world["size_m"], world["cells"], cell
    return (ix + 0.5) * width / nx, (iy + 0.5) * depth / ny


def draw_cells(axes: Axes, world: dict[str, Any]) -> None:
    """Draw the frame of a map, in metres, with lines between cells."""
    (width, depth), (nx, ny) = world["size_m"], world["cells"]
    axes.set_xticks(np.linspace(0, width, nx + 1), minor=True)
    axes.set_yticks(np.linspace(0, depth, ny + 1), minor=True)
    axes.grid(visible=False, which="major")
    axes.grid(visible=True, which="minor", color="0.88", linewidth=0.6)
    axes.tick_params(which="minor", length=0)
    axes.set(xlim=(0, width), ylim=(0, depth), aspect="equal", xlabel="x, m", ylabel="y, m")
    axes.spines[["top", "right"]].set_visible(True)


def draw_buildings(axes: Axes, world: dict[str, Any]) -> Any:
    """Draw buildings, taller ones darker; return the image, or None if there are none."""
    if world.get("city"):
        return _draw_city(axes, world["city"])
    width, depth = world["size_m"]
    heights = np.array(world["cell_height_m"])
    if not heights.any():
        return None
    shades = np.ma.masked_equal(heights.T, 0.0)
    extent = (0, width, 0, depth)
    return axes.imshow(shades, origin="lower", extent=extent, cmap="Greys", vmin=0, alpha=0.75)


def _draw_city(axes: Axes, city: dict[str, Any]) -> Any:
    """Draw footprints, those of taller buildings darker."""
    footprints = PolyCollection(
        city["pieces_m"], array=city["roofs_m"], cmap="Greys", alpha=0.75, edgecolor="face"
    )
    footprints.set(linewidth=0.2, clim=(0, max(city["roofs_m"])))
    axes.add_collection(footprints, autolim=False)
    return footprints


def attribute(axes: Axes, world: World) -> None:
    """Write whose data a map shows in its corner."""
    look: dict[str, Any] = {"fontsize": 5, "ha": "right", "va": "bottom", "zorder": 6}
    look["bbox"] = {"facecolor": "white", "alpha": 0.7, "linewidth": 0, "pad": 0.5}
    text = textwrap.fill(world.attribution, ACROSS)
    axes.text(0.995, 0.005, text, transform=axes.transAxes, **look).set_in_layout(False)


def draw_streets(axes: Axes, world: World) -> None:
    """Draw the streets along which users go."""
    lines = LineCollection(streets_of(world.scenario), color="0.82", linewidth=2.0, zorder=0.5)
    axes.add_collection(lines, autolim=False)


def draw_clusters(axes: Axes, world: dict[str, Any]) -> None:
    """Draw the discs in which users live."""
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


def draw_stations(axes: Axes, world: dict[str, Any], size: float = 110, **look: Any) -> None:
    """Draw a square for each charging station."""
    if world["stations"]:
        xs, ys = zip(*(centre_m(world, cell) for cell in world["stations"]), strict=True)
        axes.scatter(xs, ys, size, marker="s", label="charging station", zorder=3, **STATION | look)


def draw_zones(axes: Axes, world: World) -> None:
    """Draw the zones in which no drone may fly."""
    for k, zone in enumerate(world.scenario.map.no_fly):
        name = zone_words(world) if k == 0 else None
        axes.add_patch(Polygon(zone.polygon_m, hatch="//", label=name, zorder=2, **NO_FLIGHT))


def zone_words(world: World) -> str:
    """Return what the legend says of zones without flights, with the altitudes of a lone one."""
    zone, *others = world.scenario.map.no_fly
    if others or zone.altitude_m == NoFly.model_fields["altitude_m"].default:
        return "no flight"
    low_m, high_m = zone.altitude_m
    return f"no flight, {low_m:g} to {high_m:g} m"


def draw_points(axes: Axes, world: World) -> None:
    """Draw the access points of a world with the rings of their classes."""
    for k, point in enumerate(world.scenario.access_points):
        draw_rings(axes, point.at_m, point_rings_m(world, k), POINT)
        look: dict[str, Any] = {"color": POINT, "markersize": 9, "markeredgecolor": "white"}
        name = "access point" if k == 0 else None
        axes.plot(*point.at_m, "^", label=name, zorder=5, **look)


def draw_rings(
    axes: Axes, at_m: Sequence[float], radii_m: NDArray[np.float64], colour: str
) -> None:
    """Draw the discs in which links have each class, one above the other."""
    for radius_m in radii_m:
        if radius_m > 0.0:
            look: dict[str, Any] = {"alpha": shade(len(radii_m)), "linewidth": 0}
            axes.add_patch(Circle((at_m[0], at_m[1]), radius_m, color=colour, **look))


def draw_field(axes: Axes, world: dict[str, Any], values: NDArray[np.float64], **look: Any) -> Any:
    """Draw a value for each cell (nx, ny) as a shade; NaN stays white."""
    width, depth = world["size_m"]
    return axes.imshow(
        np.ma.masked_invalid(values.T), origin="lower", extent=(0, width, 0, depth), **look
    )


def mark_cells(
    axes: Axes, world: dict[str, Any], cells: NDArray[np.bool_], label: str, **look: Any
) -> None:
    """Fill some cells (nx, ny), with one entry in the legend."""
    (width, depth), (nx, ny) = world["size_m"], world["cells"]
    for k, (ix, iy) in enumerate(np.argwhere(cells)):
        corner = (ix * width / nx, iy * depth / ny)
        name = label if k == 0 else None
        patch = Rectangle(corner, width / nx, depth / ny, label=name, **look)
        patch.set_in_layout(False)
        axes.add_patch(patch)


def mark_buildings(axes: Axes, content: dict[str, Any], world: World, **look: Any) -> None:
    """Mark the cells of buildings, or the walls of a city, with one entry in the legend."""
    if not len(world.grid.city):
        built = np.asarray(content["cell_height_m"], np.float64) > 0.0
        mark_cells(axes, content, built, "building", **look)
        return
    city, walls = world.grid.city, []
    for corners, inner in zip(city.pieces_m, city.inner, strict=True):
        edges = np.stack([corners, np.roll(corners, -1, axis=0)], axis=1)
        walls += list(edges[~inner])
    width = 0.7 * look.get("linewidth", 1.0)
    lines = LineCollection(walls, color=look["edgecolor"], linewidth=width, label="building")
    lines.set_zorder(look.get("zorder", 1.5))
    axes.add_collection(lines, autolim=False)
