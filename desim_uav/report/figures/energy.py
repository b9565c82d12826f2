"""The energy of flight: power and energy per metre over the speed, and what legs take."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import FigureBase

from desim_uav.drone_type import DroneType
from desim_uav.errors import UsageError
from desim_uav.model.energy.battery import in_joules
from desim_uav.model.motion.limits import CALM
from desim_uav.model.motion.motion import Transit
from desim_uav.model.rules import US, Action, kind_of
from desim_uav.registry import kind_name
from desim_uav.report.figures.straight_legs import draw_free_legs, draw_per_metre
from desim_uav.report.figures.style import COLOURS, Figure, headed, styled
from desim_uav.report.straight_legs import FreeLegs
from desim_uav.world import World

POINTS = 400
"""The number of speeds for which a curve is drawn."""

CURVE, ENDURANCE, RANGE, CRUISE = COLOURS[0], COLOURS[5], COLOURS[3], COLOURS[1]
"""The colours of curves, of the two best speeds, and of the speeds of the scenario's flights."""

WIDTH, ROW = 10.4, 3.9
"""The width of the figure and the height of a row of panels, in inches."""

RATIOS = (1.0, 1.0, 1.25)
"""The widths of the panels in a row."""

FIVE_DIGITS = 80_000
"""The energy in joules from which on an axis of bars has fewer numbers, which are long."""

MOST_ROWS = 8
"""The largest number of rows of panels: two of a type that flies freely, else one."""


class SameFlights(NamedTuple):
    """Types of drones that have the same motion and battery, by their names and the first one."""

    names: tuple[str, ...]
    own: DroneType

    @property
    def rows(self) -> int:
        """The number of rows of panels."""
        return 2 if self.own.free else 1


@styled
def energy_figure(world: World, drone: int | None = None) -> Figure:
    """Draw what flight takes by the energy models of a scenario, of each type of drones or of one.

    The power and the energy per metre are drawn over the speed through the air, with the speed of
    the longest endurance and that of the longest range, and those at which drones cruise. Bars show
    the energy of each leg: a step of hovering, the commanded moves with the hover after them, and
    the hops of a return. For drones that fly freely they show that of steps with a command, and
    more panels show the power over a typical leg, and the energy of legs over their length.

    Types that differ in neither motion nor battery have common panels. Those whose batteries have
    no power over the speed are left out, and the heading names them. ``drone`` chooses the type of
    one drone. Raises UsageError if no battery has a power over the speed, for an unknown drone, or
    for too many types.
    """
    flights, others = _types(world, drone)
    if not flights:
        raise UsageError(
            f"drones.battery: {', '.join(others.values())}: energy is drawn for a battery whose "
            "power follows from the speed, such as {kind: rotary_wing}"
        )
    rows = [alike.rows for alike in flights]
    if sum(rows) > MOST_ROWS:
        raise UsageError(
            f"{len(flights)} types of drones with other flights or batteries are too many for a "
            "picture; choose the type of one drone with --drone"
        )
    figure = Figure(figsize=(WIDTH, ROW * sum(rows)))
    heading = f"Energy of flight. {world.scenario.name}"
    if len(flights) == 1 and not others:
        heading += f", {_capacity(flights[0])}"
        _draw_type(figure, flights[0])
    else:
        heading += "".join(f"; {name} ({kind}) left out" for name, kind in others.items())
        parts = figure.subfigures(len(flights), 1, height_ratios=rows, squeeze=False)[:, 0]
        for part, alike in zip(parts, flights, strict=True):
            _draw_type(part, alike)
            how = "in free flight" if alike.own.free else "from cell to cell"
            part.suptitle(
                f"{', '.join(alike.names)}: {how}, {_capacity(alike)}", fontsize=9.5, weight="bold"
            )
    headed(figure, heading)
    return figure


def _types(world: World, drone: int | None) -> tuple[list[SameFlights], dict[str, str]]:
    """Return the types to draw, and the batteries of the others, by name."""
    numbers = range(len(world.types))
    if drone is not None:
        count = world.scenario.drone_count
        if not 0 <= drone < count:
            raise UsageError(
                f"drone: {drone}: {world.scenario.name} has the drones 0 to {count - 1}"
            )
        numbers = range(world.type_numbers[drone], world.type_numbers[drone] + 1)
    flights: list[SameFlights] = []
    others: dict[str, str] = {}
    for number in numbers:
        own, name = world.types[number], world.scenario.type_names[number]
        battery = own.drones.battery
        if not hasattr(battery, "level_w") or not in_joules(battery):
            others[name] = "null" if battery is None else kind_name(battery)
            continue
        for k, (names, first) in enumerate(flights):
            if (first.drones.motion, first.drones.battery) == (own.drones.motion, battery):
                flights[k] = SameFlights((*names, name), first)
                break
        else:
            flights.append(SameFlights((name,), own))
    return flights, others


def _capacity(alike: SameFlights) -> str:
    battery: Any = alike.own.drones.battery
    return f"{battery.capacity_wh:g} Wh"


def _draw_type(figure: FigureBase, alike: SameFlights) -> None:
    """Draw the panels of a type of drones."""
    own = alike.own
    if own.free:
        above, below = figure.subfigures(2, 1, height_ratios=(1.0, 1.1), squeeze=False)[:, 0]
        _draw_free(above, FreeLegs(own))
        draw_free_legs(below, FreeLegs(own))
        return
    power, metre, bars = figure.subplots(1, 3, width_ratios=RATIOS)
    _draw_speeds(power, metre, own, sorted({round(air_mps(each), 3) for each in _flights(own)}))
    _draw_bars(bars, legs_j(own), "energy of a leg, J")


def _draw_free(figure: FigureBase, legs: FreeLegs) -> None:
    """Draw the panels of free flight that are as those of flight from cell to cell."""
    power, metre, bars = figure.subplots(1, 3, width_ratios=RATIOS)
    _draw_speeds(power, metre, legs.own, legs.cruises_mps)
    draw_per_metre(metre, legs)
    metre.legend(loc="upper right", fontsize="small", frameon=True, framealpha=1, edgecolor="1")
    step_s = legs.own.scenario.episode.step_s
    _draw_bars(bars, legs.steps_j(), f"energy of a step of {step_s:g} s, J")


def _draw_speeds(power: Axes, metre: Axes, own: DroneType, cruises: Sequence[float]) -> None:
    """Draw the power and the energy per metre over the speed, with the best speeds."""
    battery: Any = own.drones.battery
    best = battery.best_speeds()
    speeds = np.linspace(0.0, 1.6 * max(best.range_mps, *cruises), POINTS)[1:]
    powers = np.array([battery.level_w(float(v)) for v in speeds])
    _draw_curve(power, speeds, powers, cruises, battery.level_w)
    _draw_curve(metre, speeds, powers / speeds, cruises, lambda v: battery.level_w(v) / v)
    marks = [("endurance", best.endurance_mps, ENDURANCE, "v")]
    marks += [("range", best.range_mps, RANGE, "D")]
    for name, speed, colour, shape in marks:
        watts = battery.level_w(speed)
        label = f"{name}: {speed:.2f} m/s"
        look: dict[str, Any] = {"color": colour, "marker": shape, "ls": "", "zorder": 4}
        power.plot(speed, watts, label=f"{label}, {watts:.1f} W", **look)
        metre.plot(speed, watts / speed, label=f"{label}, {watts / speed:.2f} J/m", **look)
    lowest = battery.level_w(best.range_mps) / best.range_mps
    most_w = max(2.4 * powers[0], 1.5 * max(map(battery.level_w, cruises)))
    power.set(ylabel="power, W", ylim=(0.0, most_w))
    metre.set(ylabel="energy per metre, J/m", ylim=(0.0, 6.0 * lowest))
    for axes in (power, metre):
        over = "speed" if own.scenario.wind_mps == CALM else "speed through the air"
        axes.set(xlabel=f"{over}, m/s", xlim=(0.0, speeds[-1]))
        axes.legend(loc="upper left" if axes is power else "upper right", fontsize="small")


def _draw_curve(
    axes: Axes, speeds: Any, values: Any, cruises: Sequence[float], at: Callable[[float], float]
) -> None:
    """Draw a curve over the speed, with the speeds at which drones cruise on it."""
    axes.plot(speeds, values, color=CURVE)
    look: dict[str, Any] = {"color": CRUISE, "marker": "o", "ls": "", "mec": CURVE, "zorder": 3}
    axes.plot(cruises, [at(v) for v in cruises], label="cruise", **look)


def _flights(own: DroneType) -> list[Transit]:
    """Return the level flights of a type of drones."""
    flights = [*own.epoch_transits.values(), *own.return_transits.values()]
    return [flight for flight in flights if flight.rises == 0.0]


def air_mps(flight: Transit) -> float:
    """Return the speed through the air of a level flight that cruises."""
    return math.hypot(float(flight.rows["speed_mps"].max()) - flight.tail_mps, flight.side_mps)


def legs_j(own: DroneType) -> dict[str, float]:
    """Return the energy in joules of each kind of leg from cell to cell, by its name."""
    energy: Any = own.drones.battery
    scenario = own.scenario
    step_us, calm = round(scenario.episode.step_s * US), scenario.wind_mps == CALM
    rest = own.rest
    energies_j = {f"hover, {step_us / US:g} s": energy.drain_of(rest, step_us) / 1e6}
    for action, flight in own.epoch_transits.items():
        if calm and kind_of(action) in (Action.BACKWARD, Action.LEFT):
            continue  # which take what their opposites take
        rest_us = max(0, step_us - flight.duration_us)
        used = energy.drain_of(flight, flight.duration_us) + energy.drain_of(rest, rest_us)
        energies_j[f"{action.name.lower()}, {step_us / US:g} s"] = used / 1e6
    names = {(1, 0, 0): "along x", (-1, 0, 0): "along -x", (0, 1, 0): "along y"}
    names |= {(0, -1, 0): "along -y", (0, 0, 1): "up", (0, 0, -1): "down"}
    for hop, name in names.items():
        if calm and min(hop[:2]) < 0:
            continue
        flight = own.return_transits[hop]
        if not hop[2] or scenario.three_d:
            seconds = flight.duration_us / US
            energies_j[f"return {name}, {seconds:.3g} s"] = (
                energy.drain_of(flight, flight.duration_us) / 1e6
            )
    return energies_j


def _draw_bars(axes: Axes, energies_j: dict[str, float], label: str) -> None:
    """Draw energies as bars, with their names."""
    places = np.arange(len(energies_j))
    bars = axes.barh(places, [*energies_j.values()], color=CRUISE, height=0.7)
    axes.bar_label(bars, [f"{joules:,.0f}" for joules in energies_j.values()], padding=3)
    axes.set_yticks(places, [*energies_j])
    axes.invert_yaxis()
    axes.set(xlabel=label, xlim=(0.0, 1.2 * max(energies_j.values())))
    if max(energies_j.values()) >= FIVE_DIGITS:
        axes.locator_params("x", nbins=4)
    axes.grid(visible=False, axis="y")
