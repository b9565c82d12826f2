"""The radio of a drone: levels and classes of its links from above, by distance and by height."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property
from math import hypot
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import LinearSegmentedColormap, Normalize
from matplotlib.lines import Line2D
from matplotlib.patches import Circle
from matplotlib.patheffects import withStroke
from matplotlib.ticker import MaxNLocator
from numpy.typing import NDArray

from desim_uav.errors import UsageError, in_short
from desim_uav.model.radio.path_loss import Use
from desim_uav.model.radio.radio import LinkClasses
from desim_uav.palette import drone_colour
from desim_uav.registry import naming_plug_ins
from desim_uav.report.figures.style import Figure, headed, styled
from desim_uav.scenario.description import described
from desim_uav.world import World

SHADES = LinearSegmentedColormap.from_list(
    "level", ["#FCFBE3", "#D5E3A8", "#8CC7A1", "#54A9AE", "#5590B8", "#5B78B5"]
)
"""Darker where the level is higher, so that the colour-blind can read it; a black line can be seen
on each of them."""

POINTS = 241
"""The number of points along the longer side of the map, and along distances and heights."""

BEYOND = 1.15
"""How far distances go, relative to the widest class."""

WRITTEN = 0.88
"""How high the numbers of classes are written, relative to the largest height shown."""

MOST_TEXT = 120
"""The length of a line of the heading, in characters."""

FEW_KM = 10
"""From this many km on, distances are in km."""

INK = "#101010"
EDGE, INNER = 1.7, 0.6
"""The widths of lines at the edge of class 1, and of higher classes."""

HALO = [withStroke(linewidth=2.2, foreground="white")]
DRONE: dict[str, Any] = {"color": drone_colour(1), "marker": "X", "markersize": 8, "ls": ""}
DRONE |= {"markeredgecolor": INK, "label": "drone"}
MAST: dict[str, Any] = {"color": "white", "marker": "^", "markersize": 14, "ls": ""}
MAST |= {"markeredgecolor": INK, "markeredgewidth": 1.3, "label": "access point"}


@styled
@naming_plug_ins()
def radio_figure(
    world: World, level: int | None = None, at_m: tuple[float, float] | None = None
) -> Figure:
    """Draw what a lone drone offers to users on the ground, by the mean path loss.

    The drone is at ``at_m`` (by default above the middle of the map), and at a level of altitude
    (by default the lowest). A map shows the level that a user receives, with a line where the class
    of the link changes, and access points. The others show the rate and the class over the
    horizontal distance, and the level over distance and height.

    Raises UsageError if links have no level, and for a level or a place that the map does not have.
    """
    radio = RadioView(world, _radio(world), _altitude_m(world, level), _place_m(world, at_m))
    figure = Figure(figsize=(10.4, 6.4))
    grid = figure.add_gridspec(3, 2, width_ratios=(1.12, 1.0), height_ratios=(1.0, 1.0, 2.1))
    above, rate = figure.add_subplot(grid[:, 0]), figure.add_subplot(grid[0, 1])
    steps = figure.add_subplot(grid[1, 1], sharex=rate)
    side = figure.add_subplot(grid[2, 1], sharex=rate)
    image = _draw_map(above, radio)
    _draw_steps(rate, radio, radio.rates_mbit_s, "rate, Mbit/s")
    _draw_steps(steps, radio, range(len(radio.rates_mbit_s)), "class", whole=True)
    _draw_side(side, radio)
    for axes in (rate, steps):
        axes.tick_params(labelbottom=False)
    rate.set_title(f"To users on the ground, with a drone at {radio.altitude_m:g} m")
    bar: dict[str, Any] = {"location": "bottom", "extend": "max", "aspect": 50, "shrink": 0.7}
    figure.colorbar(image, ax=(above, side), label="received level, dBm", **bar)
    headed(figure, radio.heading)
    figure.legend(handles=_legend(radio), loc="outside lower center", ncols=5)
    return figure


@dataclass(frozen=True)
class RadioView:
    """A drone at a place of a world, and the levels and classes of its links."""

    world: World
    radio: LinkClasses
    altitude_m: float
    at_m: tuple[float, float]

    @cached_property
    def rings_m(self) -> list[float]:
        """The radius of each class for users on the ground, the widest first; -1 for none."""
        return list(self._rings_m(self.altitude_m))

    def _rings_m(self, height_m: float) -> tuple[float, ...]:
        return self.radio.radii_m(height_m, self.world.only_type.drones.footprint_radius_m)

    def class_at(self, distance_m: float) -> int:
        """Return the class of a link to a user on the ground."""
        return sum(distance_m <= radius for radius in self.rings_m)

    @property
    def rates_mbit_s(self) -> list[float]:
        """What a user who has the whole bandwidth gets in each class, from class 0 on."""
        links = self.world.links[0]
        return [each * links.bandwidth_hz / 1e12 for each in links.efficiencies]

    @cached_property
    def thresholds_dbm(self) -> NDArray[np.float64]:
        """The least level of each class."""
        return self.radio.budget.noise_dbm + np.array(self.world.links[0].thresholds_db)

    @cached_property
    def farthest_m(self) -> float:
        """The largest distance shown: beyond all classes, or half of the map if there are none."""
        levels_m = self.world.grid.levels_m
        reach_m = max(self._rings_m(height)[0] for height in (levels_m[0], levels_m[-1]))
        reach_m = BEYOND * max(reach_m, self.rings_m[0])
        return reach_m if reach_m > 0.0 else hypot(*self.world.area) / 2

    @property
    def unit(self) -> tuple[float, str]:
        """The metres in the unit of distances, and its name."""
        return (1000.0, "km") if self.farthest_m >= FEW_KM * 1000 else (1.0, "m")

    @cached_property
    def map_dbm(self) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
        """The coordinates x and y of points on the map, and the level (y, x) at each."""
        longer_m = max(self.world.area)
        counts = (max(2, round(POINTS * side / longer_m)) for side in self.world.area)
        xs, ys = (np.linspace(0.0, a, n) for a, n in zip(self.world.area, counts, strict=True))
        away_m = np.hypot(xs[None, :] - self.at_m[0], ys[:, None] - self.at_m[1])
        return xs, ys, self._levels_dbm(away_m, np.full_like(away_m, self.altitude_m))

    @cached_property
    def side_dbm(self) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
        """Distances and heights, and the level (height, distance) at each."""
        middles = (np.arange(POINTS) + 0.5) / POINTS
        heights_m = 2.0 * max(self.world.grid.levels_m) * middles
        distances_m = np.linspace(0.0, self.farthest_m, POINTS)
        return distances_m, heights_m, self._levels_dbm(*np.meshgrid(distances_m, heights_m))

    @property
    def shade(self) -> dict[str, Any]:
        """The colours of levels, the same in both pictures.

        They end at the highest level that a user on the ground can receive: that below a drone at
        the lowest altitude.
        """
        low = min(np.nanmin(dbm) for _, _, dbm in (self.map_dbm, self.side_dbm))
        high = self._level_dbm(0.0, self.world.grid.levels_m[0])
        norm = Normalize(low, max(high, low + 1.0))
        return {"cmap": SHADES, "norm": norm, "interpolation": "bilinear", "aspect": "auto"}

    def _levels_dbm(
        self, distances_m: NDArray[np.float64], heights_m: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        places = zip(distances_m.ravel().tolist(), heights_m.ravel().tolist(), strict=True)
        levels_dbm = [self._level_dbm(*place) for place in places]
        return np.array(levels_dbm).reshape(distances_m.shape)

    def _level_dbm(self, distance_m: float, height_m: float) -> float:
        """Return the mean level, or NaN where the path loss is not defined."""
        radio = self.radio
        where = Use(True, height_m, height_m, distance_m, 0.0, "mean")
        if any(radio.path_loss.problems(where)):
            return float("nan")
        try:
            return radio.power_dbm - radio.loss.mean_db(distance_m, height_m, radio.carrier_ghz)
        except (ValueError, ArithmeticError):
            return float("nan")

    @property
    def heading(self) -> str:
        """The heading of the figure, which also says what is left out."""
        radio = self.radio
        loss = described(radio.path_loss)
        numbers = {k: f"{v:g}" if isinstance(v, float) else v for k, v in loss.items()}
        parameters = ", ".join(f"{key} {v}" for key, v in numbers.items() if key != "kind")
        left_out = ["interference"] if radio.reuse else []
        left_out += ["drawn line of sight"] if radio.line_of_sight == "drawn" else []
        left_out += ["line of sight between buildings"] if radio.sight == "buildings" else []
        left_out += ["shadowing"] if radio.shadowing is not None else []
        lines = [
            f"{self.world.scenario.name}: {radio.power_dbm:g} dBm, {radio.bandwidth_mhz:g} MHz at "
            f"{radio.carrier_ghz:g} GHz",
            f"mean loss of {loss['kind']}" + (f" ({parameters})" if parameters else ""),
        ]
        lines += [f"left out: {', '.join(left_out)}"] if left_out else []
        return "\n".join(in_short(line, MOST_TEXT) for line in lines)


def _radio(world: World) -> LinkClasses:
    """Return the drones' radio. Raises UsageError if it is not one with levels."""
    drones = world.require_one_type("a picture of the radio").drones
    radio, name = drones.radio, world.scenario.name
    if not isinstance(radio, LinkClasses):
        raise UsageError(
            f"{name}: the radio of its drones is {described(radio)['kind']}, which has no levels "
            "and no classes; write drones.radio: {kind: link_classes} in the scenario, and leave "
            "out drones.footprint_radius_m and drones.bandwidth_kbps"
        )
    return radio


def _altitude_m(world: World, level: int | None) -> float:
    """Return the altitude of a level. Raises UsageError if there is no such level."""
    levels_m = world.grid.levels_m
    if level is not None and not 0 <= level < len(levels_m):
        raise UsageError(
            f"level: {level}: {world.scenario.name} has the levels 0 to {len(levels_m) - 1}"
        )
    return levels_m[level or 0]


def _place_m(world: World, at_m: tuple[float, float] | None) -> tuple[float, float]:
    """Return the place, by default the middle. Raises UsageError if it is not on the map."""
    width_m, depth_m = world.area
    x_m, y_m = (width_m / 2, depth_m / 2) if at_m is None else at_m
    if not (0.0 <= x_m <= width_m and 0.0 <= y_m <= depth_m):
        raise UsageError(
            f"at: {x_m:g},{y_m:g}: the map of {world.scenario.name} goes from 0,0 to "
            f"{width_m:g},{depth_m:g}"
        )
    return x_m, y_m


# ---- the panels


def _draw_map(axes: Axes, radio: RadioView) -> Any:
    """Draw the map from above; return the image of the levels."""
    (x_m, y_m), (width_m, depth_m) = radio.at_m, radio.world.area
    xs, ys, dbm = radio.map_dbm
    image = _draw_levels(axes, xs, ys, dbm, radio)
    for number, radius_m in enumerate(radio.rings_m, 1):
        line = {"edgecolor": INK, "linewidth": _width(number), "fill": False}
        axes.add_patch(Circle((x_m, y_m), max(radius_m, 0.0), **line))
    for point in radio.world.scenario.access_points:
        axes.plot(*point.at_m, **MAST, zorder=5)
    axes.plot(x_m, y_m, **DRONE, zorder=6)
    corners = [(x, y) for x in (0.0, width_m) for y in (depth_m, 0.0)]
    far = max(corners, key=lambda corner: hypot(corner[0] - x_m, corner[1] - y_m))
    length_m = hypot(far[0] - x_m, far[1] - y_m)
    ray = ((far[0] - x_m) / length_m, (far[1] - y_m) / length_m)
    gap_m = 0.045 * max(width_m, depth_m)
    within = [(number, r) for number, r in enumerate(radio.rings_m, 1) if r < length_m - gap_m]
    for number, radius_m in _apart(within, gap_m):
        _write_class(axes, number, x_m + radius_m * ray[0], y_m + radius_m * ray[1])
    axes.set(xlim=(0, width_m), ylim=(0, depth_m), aspect="equal", xlabel="x, m", ylabel="y, m")
    title = f"From above, with a drone at {radio.altitude_m:g} m"
    if radio.class_at(0.0) == radio.class_at(length_m):
        title += f": class {radio.class_at(0.0)} everywhere"
    axes.set_title(title)
    _frame(axes)
    return image


def _draw_steps(
    axes: Axes, radio: RadioView, values: Sequence[float], label: str, whole: bool = False
) -> None:
    """Draw a value of each class, from class 0 on, over the distance; it may be ``whole``."""
    scale, _ = radio.unit
    radii_m = [radius for radius in reversed(radio.rings_m) if radius > 0.0]
    edges = np.array([0.0, *radii_m, radio.farthest_m]) / scale
    axes.stairs(values[: len(radii_m) + 1][::-1], edges, color=INK, linewidth=1.6)
    axes.set(ylabel=label, ylim=(0, 1.06 * values[-1]), xlim=(0, edges[-1]))
    axes.yaxis.set_major_locator(MaxNLocator(4, integer=whole))


def _draw_side(axes: Axes, radio: RadioView) -> None:
    """Draw the levels over distance and height."""
    scale, unit = radio.unit
    distances_m, heights_m, dbm = radio.side_dbm
    _draw_levels(axes, distances_m / scale, heights_m, dbm, radio)
    for number, threshold in enumerate(radio.thresholds_dbm, 1):
        if np.nanmin(dbm) < threshold < np.nanmax(dbm):
            line: dict[str, Any] = {"colors": INK, "linewidths": _width(number), "linestyles": "-"}
            axes.contour(distances_m / scale, heights_m, dbm, levels=[threshold], **line)
    axes.axhline(radio.altitude_m, color=INK, ls="--", linewidth=1.0)
    top_m = heights_m[-1] + heights_m[0]
    defined = np.flatnonzero(np.isfinite(dbm).all(axis=1) & (heights_m < WRITTEN * top_m))
    if len(defined):
        row = dbm[defined[-1]]
        crossed = [
            (number, float(np.interp(-threshold, -row, distances_m)))
            for number, threshold in enumerate(radio.thresholds_dbm, 1)
            if row.min() < threshold < row.max()
        ]
        for number, distance_m in _apart(crossed, 0.05 * radio.farthest_m):
            _write_class(axes, number, distance_m / scale, heights_m[defined[-1]])
    axes.set(xlabel=f"horizontal distance, {unit}", ylabel="height above the user, m")
    axes.set(ylim=(0, top_m), xlim=(0, radio.farthest_m / scale))
    axes.set_title("By distance and height")
    _frame(axes)


def _draw_levels(
    axes: Axes,
    xs: NDArray[np.float64],
    ys: NDArray[np.float64],
    dbm: NDArray[np.float64],
    radio: RadioView,
) -> Any:
    """Draw levels (y, x) as shades; return the image."""
    half_x, half_y = (xs[1] - xs[0]) / 2, (ys[1] - ys[0]) / 2
    extent = (xs[0] - half_x, xs[-1] + half_x, ys[0] - half_y, ys[-1] + half_y)
    levels = np.ma.masked_invalid(dbm)
    return axes.imshow(levels, origin="lower", extent=extent, **radio.shade)


def _width(number: int) -> float:
    """Return the width of the line at the edge of a class."""
    return EDGE if number == 1 else INNER


def _apart(places: Iterable[tuple[int, float]], gap: float) -> list[tuple[int, float]]:
    """Return the classes whose lines are far enough from those already chosen, the lowest first."""
    lines: list[tuple[int, float]] = []
    for number, place in places:
        if place > gap and (not lines or lines[-1][1] - place >= gap):
            lines.append((number, place))
    return lines


def _write_class(axes: Axes, number: int, x: float, y: float) -> None:
    """Write the number of a class on its line."""
    text = axes.text(
        x, y, str(number), ha="center", va="center", fontsize=7.5, color=INK, path_effects=HALO
    )
    text.set_in_layout(False)


def _frame(axes: Axes) -> None:
    axes.grid(visible=False)
    axes.spines[["top", "right"]].set_visible(True)


def _legend(radio: RadioView) -> list[Any]:
    """Return the entries of the legend."""
    entries = [Line2D([], [], **DRONE)]
    if radio.world.scenario.access_points:
        entries.append(Line2D([], [], **MAST))
    lines = [("-", EDGE, "edge of class 1: no link beyond")]
    lines += [("-", INNER, "edge of a higher class")] if len(radio.thresholds_dbm) > 1 else []
    lines += [("--", 1.0, "altitude of the drone")]
    entries += [Line2D([], [], color=INK, ls=ls, lw=lw, label=label) for ls, lw, label in lines]
    return entries
