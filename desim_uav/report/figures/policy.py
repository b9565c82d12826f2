"""A learned policy as a map: the best action in each cell, and its value."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import LinearSegmentedColormap
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from numpy.typing import NDArray

from desim_uav.engine.masks import Masks
from desim_uav.errors import DesimError, PolicyError, UsageError
from desim_uav.learning.algorithm import load_algorithm
from desim_uav.learning.initial_q import initial_q
from desim_uav.model.observations import common_features
from desim_uav.model.random.streams import Purpose, Streams
from desim_uav.model.rules import Action, Choice, Variant, kind_of, move_of
from desim_uav.policies.tabular import Greedy, QTable
from desim_uav.report.figures.map import (
    attribute,
    draw_cells,
    draw_field,
    draw_stations,
    mark_cells,
)
from desim_uav.report.figures.style import grid_of, headed, styled
from desim_uav.run_folder import world_content, world_hash
from desim_uav.scenario.load import loads
from desim_uav.world import World, build_world

EVERY = slice(None)
KNOWN = ("cell_x", "cell_y", "level", "battery_min")
SHADES = LinearSegmentedColormap.from_list("value", ["#F7FBFF", "#C6DFF0", "#56B4E9", "#3E86B5"])
INK, UNTRIED = "#101010", "#C8501E"
SYMBOLS = {
    Action.HOVER: ("o", "hover"),
    Action.UP: ("^", "a level up"),
    Action.DOWN: ("v", "a level down"),
    Action.GOTO_CHARGING_STATION: ("*", "go to a charging station"),
    Action.CHARGE: ("P", "charge"),
}
ARROW: dict[str, Any] = {"pivot": "mid", "angles": "xy", "scale_units": "xy", "scale": 1}
ARROW |= {"headwidth": 4.5, "headlength": 4.5, "headaxislength": 4}
NUMBER: dict[str, Any] = {"xytext": (3, 3), "textcoords": "offset points", "color": INK}
NEVER: dict[str, Any] = {"facecolor": "#F2F2F2", "edgecolor": "0.72", "hatch": "....", "lw": 0}
BUILT: dict[str, Any] = {"facecolor": "0.86", "edgecolor": "0.3", "hatch": "/////", "lw": 0.5}


@styled
def policy_figure(
    table: QTable,
    name: str,
    battery_min: int | None = None,
    level: int | None = None,
    drone: int | None = None,
) -> Figure:
    """Draw one map per drone: the best allowed action in each cell, on a shade for its value.

    The battery has ``battery_min`` minutes left (by default half of it), and the drone is at
    ``level`` (by default the lowest). Raises PolicyError if the table has other states than a map
    can show, and UsageError for a drone, battery or level that it does not have.
    """
    read = Reading(table, name)
    battery_min, level = read.battery_min(battery_min), read.level(level)
    drones = list(range(len(table.q))) if drone is None else [drone]
    if not 0 <= drones[0] < len(table.q):
        raise UsageError(f"drone: {drone}: {name} has the drones 0 to {len(table.q) - 1}")
    slices = [read.slice(number, battery_min, level) for number in drones]
    figure, panels = grid_of(len(drones), width=3.5, height=3.3)
    values = np.concatenate([s.value[s.learned] for s in slices] or [np.zeros(1)])
    low, high = (values.min(), values.max()) if len(values) else (0.0, 1.0)
    world = world_content(read.world)
    image: Any = None
    for axes, number, slice_ in zip(panels, drones, slices, strict=True):
        shade = np.where(slice_.learned, slice_.value, np.nan)
        image = draw_field(axes, world, shade, cmap=SHADES, vmin=low, vmax=high)
        draw_cells(axes, world)
        mark_cells(axes, world, slice_.built, "building", **BUILT)
        mark_cells(axes, world, ~slice_.learned & ~slice_.built, "nothing learned", **NEVER)
        draw_stations(axes, world, size=150, facecolor="none")
        _draw_actions(axes, read, slice_)
        axes.set_title(f"drone {number}")
    attribute(panels[-1], read.world)
    headed(figure, _title(read, battery_min, level))
    figure.colorbar(image, ax=panels, shrink=0.8, label="value of the best action")
    figure.legend(handles=_legend(slices, read), loc="outside lower center", ncols=4)
    return figure


@dataclass(frozen=True)
class Slice:
    """What a drone has learned for each cell (nx, ny) at one level and charge.

    ``action`` is the index of the best allowed action. ``tried`` says whether its value differs
    from the initial one, and ``learned`` whether that of any action does. ``built`` are cells that
    cannot be entered at the level.
    """

    action: NDArray[np.int64]
    value: NDArray[np.float64]
    learned: NDArray[np.bool_]
    tried: NDArray[np.bool_]
    built: NDArray[np.bool_]


class Reading:
    """A table and its world."""

    def __init__(self, table: QTable, name: str) -> None:
        """Raise PolicyError if the table has states or actions that a map cannot show."""
        self.table, self.name = table, name
        self.sizes = {feature: high + 1 for feature, high in table.about["features"]}
        unknown = [feature for feature in self.sizes if feature not in KNOWN]
        if unknown or not {"cell_x", "cell_y"} <= set(self.sizes):
            raise PolicyError(
                f"{name}: a map shows states of {', '.join(KNOWN)}, not of {', '.join(self.sizes)}"
            )
        try:
            scenario = loads(table.about["scenario_yaml"])
            self.world: World = build_world(scenario, table.about["world_seed"])
        except (KeyError, TypeError, DesimError) as error:
            raise PolicyError(f"{name}: its scenario cannot be read: {error}") from error
        if world_hash(self.world) != table.about["world_hash"]:
            raise PolicyError(f"{name}: its scenario no longer gives the world of the training")
        here = [action.name.lower() for action in self.world.actions]
        sizes = (self.sizes["cell_x"], self.sizes["cell_y"])
        if here != table.about["actions"] or sizes != self.world.grid.cells:
            raise PolicyError(f"{name}: its states and actions are not those of its scenario")

    def battery_min(self, minutes: int | None) -> int | None:
        """Return the minutes left, by default half of them; None without a battery."""
        return self._of("battery_min", "battery_min", minutes, lambda size: (size - 1) // 2)

    def level(self, number: int | None) -> int | None:
        """Return the level, by default the lowest; None on a flat map."""
        return self._of("level", "level", number, lambda size: 0)

    def _of(self, feature: str, argument: str, value: int | None, usual: Any) -> int | None:
        size = self.sizes.get(feature)
        if size is None and value is not None:
            raise UsageError(f"{argument}: {value}: {self.name} has no {feature} in its states")
        if size is not None and value is not None and not 0 <= value < size:
            raise UsageError(f"{argument}: {value}: {self.name} has 0 to {size - 1}")
        return None if size is None else usual(size) if value is None else value

    @cached_property
    def _beginning(self) -> NDArray[np.float32]:
        """The initial table of the training; values that are still the same were not learned."""
        world, about = self.world, self.table.about
        learning = world.scenario.learning
        features = common_features(world.features_of_types)
        tables = load_algorithm(about["algorithm"]).tables
        streams = Streams(about["seed"], Purpose.LEARNER)
        initial = []
        for drone in range(len(self.table.q)):
            rng = streams.generator(drone)
            each = [
                initial_q(learning.initial_q, features, world.actions, world.facts_of(drone), rng)
                for _ in range(tables)
            ]
            initial.append(np.mean(each, axis=0, dtype=np.float32))
        return np.array(initial)

    def slice(self, drone: int, battery_min: int | None, level: int | None) -> Slice:
        """Return what a drone has learned at one level, with this number of minutes left.

        The battery of a drone without one counts as 0 minutes.
        """
        if not self.world.type_of(drone).limited:
            battery_min = None
        at = {"level": level, "battery_min": battery_min or 0}
        index = tuple(EVERY if f.startswith("cell") else at[f] for f in self.sizes)
        shape = (*self.sizes.values(), -1)
        q, first = (of[drone].reshape(shape)[index] for of in (self.table.q, self._beginning))
        legal = self._legal(drone, battery_min, level)
        best = np.where(legal, q, -np.inf).argmax(axis=2)
        best_at = best[:, :, None]
        changed = q != first
        return Slice(
            best,
            np.take_along_axis(q, best_at, 2)[:, :, 0].astype(float),
            changed.any(axis=2),
            np.take_along_axis(changed, best_at, 2)[:, :, 0],
            self.world.grid.blocked[level or 0],
        )

    @cached_property
    def _masks(self) -> Masks:
        return Masks(self.world, Greedy.ceiling)

    def _legal(self, drone: int, battery_min: int | None, level: int | None) -> NDArray[np.bool_]:
        """Return (nx, ny, actions): the actions that are allowed in flight.

        In buildings, where no drone is, these are all.
        """
        world, own, level = self.world, self.world.type_of(drone), level or 0
        charge = 0 if battery_min is None else battery_min * 60 * own.drain_per_s
        legal = np.ones((*world.grid.cells, len(world.actions)), bool)
        for x, y in np.argwhere(~world.grid.blocked[level]).tolist():
            legal[x, y] = self._masks.at(drone, (x, y, level), charge)
        return legal


def _draw_actions(axes: Axes, read: Reading, slice_: Slice) -> None:
    """Draw an arrow for a move and a symbol for other actions, in vermillion if not learned.

    If commands choose a cruise speed or a share of tasks, the number at an arrow or symbol is that
    of the choice, from 1 on.
    """
    grid = read.world.grid
    cells = np.argwhere(slice_.learned & ~slice_.built)
    by_action: dict[Choice, list[tuple[float, float, str]]] = {}
    for ix, iy in cells.tolist():
        colour = INK if slice_.tried[ix, iy] else UNTRIED
        at = by_action.setdefault(read.world.actions[slice_.action[ix, iy]], [])
        at.append((*grid.centre(ix, iy), colour))
    size = min(1.0, 10 / max(grid.cells))
    for action, places in by_action.items():
        xs, ys, colours = zip(*places, strict=True)
        dx, dy, _ = move_of(action)
        if dx or dy:
            length = (0.66 * dx * grid.cell_m[0], 0.66 * dy * grid.cell_m[1])
            us, vs = ([part] * len(xs) for part in length)
            axes.quiver(xs, ys, us, vs, color=colours, zorder=6, **ARROW, width=0.009 * size)
        else:
            dot = (6.5 * size) ** 2
            symbol, gid = SYMBOLS[kind_of(action)][0], action.name
            axes.scatter(xs, ys, dot, c=colours, marker=symbol, lw=0, zorder=6, gid=gid)
        if isinstance(action, Variant):
            number = _variants(read)[action.suffix]
            for x, y in zip(xs, ys, strict=True):
                axes.annotate(str(number), (x, y), **NUMBER, fontsize=6 * size, zorder=7)


def _variants(read: Reading) -> dict[str, int]:
    """Return the numbers of what commands choose beside a move, by how it is written."""
    variants = [each.suffix for each in read.world.actions if isinstance(each, Variant)]
    return {suffix: number for number, suffix in enumerate(dict.fromkeys(variants), 1)}


def _said(suffix: str) -> str:
    """Return in words what a command chooses beside a move."""
    speed, _, share = suffix.removeprefix("@").partition("+")
    return ", ".join([f"{speed} m/s"] * bool(speed) + [f"{share} offloaded"] * bool(share))


def _legend(slices: list[Slice], read: Reading) -> list[Any]:
    """Return legend entries for everything that is on the maps."""
    on = {
        kind_of(read.world.actions[a])
        for s in slices
        for a in np.unique(s.action[s.learned & ~s.built])
    }
    entries: list[Any] = []
    if any(any(move_of(action)[:2]) for action in on):
        label = ", ".join(
            ["move", *(f"{number}: {_said(s)}" for s, number in _variants(read).items())]
        )
        entries.append(Line2D([], [], color=INK, marker=">", ms=5, lw=1.1, label=label))
    entries += [
        Line2D([], [], color=INK, marker=symbol, ls="", ms=5.5, mew=0, label=word)
        for action, (symbol, word) in SYMBOLS.items()
        if action in on
    ]
    if any((s.learned & ~s.built & ~s.tried).any() for s in slices):
        entries.append(Patch(color=UNTRIED, label="in this colour: action not learned"))
    if read.world.stations:
        look: dict[str, Any] = {"mfc": "none", "mec": "black", "mew": 1.4, "ms": 9}
        entries.append(Line2D([], [], marker="s", ls="", label="charging station", **look))
    if any(s.built.any() for s in slices):
        entries.append(Patch(label="building", **BUILT))
    if any((~s.learned & ~s.built).any() for s in slices):
        entries.append(Patch(label="nothing learned", **NEVER))
    return entries


def _title(read: Reading, battery_min: int | None, level: int | None) -> str:
    about = read.table.about
    title = (
        f"{read.name}: {about['algorithm']}, {about['scenario']}, world seed {about['world_seed']}"
    )
    if battery_min is not None:
        title += f"; {battery_min} min left"
    if level is not None:
        title += f", at {read.world.grid.levels_m[level]:g} m"
    return title
