"""The energy of flight: power and energy per metre over the speed, and what legs take."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from desim_uav.errors import UsageError
from desim_uav.model.battery import in_joules
from desim_uav.model.free.limits import CALM
from desim_uav.model.motion import Transit
from desim_uav.model.rules import US, Action, kind_of
from desim_uav.report.figures.style import COLOURS, headed, styled
from desim_uav.world import World

POINTS = 400
"""The number of speeds for which a curve is drawn."""

CURVE, ENDURANCE, RANGE, CRUISE = COLOURS[0], COLOURS[5], COLOURS[3], COLOURS[1]
"""The colours of curves, of the two best speeds, and of the speeds of the scenario's flights."""


@styled
def energy_figure(world: World) -> Figure:
    """Draw what flight takes by the energy model of a scenario.

    The power and the energy per metre are drawn over the speed through the air, with the speed of
    the longest endurance and that of the longest range, and those at which drones cruise. Bars show
    the energy of each leg: a step of hovering, the commanded moves with the hover after them, and
    the hops of a return.

    Raises UsageError if the battery has no power over the speed.
    """
    world.scenario.require_cells("a picture of energy")
    battery: Any = world.require_one_type("a picture of energy").drones.battery
    if not hasattr(battery, "level_w") or not in_joules(battery):
        kind = "null" if battery is None else getattr(battery, "kind", type(battery).__name__)
        raise UsageError(
            f"drones.battery: {kind}: energy is drawn for a battery whose power follows from the "
            "speed, such as {kind: rotary_wing}"
        )
    figure = Figure(figsize=(10.4, 3.9))
    power, metre, legs = figure.subplots(1, 3, width_ratios=(1.0, 1.0, 1.25))
    best = battery.best_speeds()
    cruises = sorted({round(air_mps(each), 3) for each in _flights(world)})
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
    power.set(ylabel="power, W", ylim=(0.0, 2.4 * powers[0]))
    metre.set(ylabel="energy per metre, J/m", ylim=(0.0, 6.0 * lowest))
    for axes in (power, metre):
        over = "speed" if world.scenario.wind_mps == CALM else "speed through the air"
        axes.set(xlabel=f"{over}, m/s", xlim=(0.0, speeds[-1]))
        axes.legend(loc="upper right", fontsize="small")
    _draw_legs(legs, world)
    headed(figure, f"Energy of flight. {world.scenario.name}, {battery.capacity_wh:g} Wh")
    return figure


def _draw_curve(axes: Axes, speeds: Any, values: Any, cruises: list[float], at: Any) -> None:
    """Draw a curve over the speed, with the speeds at which drones cruise on it."""
    axes.plot(speeds, values, color=CURVE)
    look: dict[str, Any] = {"color": CRUISE, "marker": "o", "ls": "", "mec": CURVE, "zorder": 3}
    axes.plot(cruises, [at(v) for v in cruises], label="cruise", **look)


def _flights(world: World) -> list[Transit]:
    """Return the level flights of a world."""
    flights = [*world.epoch_transits.values(), *world.return_transits.values()]
    return [flight for flight in flights if flight.rises == 0.0]


def air_mps(flight: Transit) -> float:
    """Return the speed through the air of a level flight that cruises."""
    return math.hypot(float(flight.profile[:, 2].max()) - flight.tail_mps, flight.side_mps)


def legs_j(world: World) -> dict[str, float]:
    """Return the energy in joules of each kind of leg, by its name."""
    of_type = world.require_one_type("a picture of energy")
    energy: Any = of_type.drones.battery
    step_us, rest, calm = world.step_us, of_type.rest, world.scenario.wind_mps == CALM
    found = {f"hover, {step_us / US:g} s": energy.drained_us(rest, step_us) / 1e6}
    for action, flight in world.epoch_transits.items():
        if calm and kind_of(action) in (Action.BACKWARD, Action.LEFT):
            continue  # which take what their opposites take
        rest_us = max(0, step_us - flight.duration_us)
        used = energy.drained_us(flight, flight.duration_us) + energy.drained_us(rest, rest_us)
        found[f"{action.name.lower()}, {step_us / US:g} s"] = used / 1e6
    names = {(1, 0, 0): "along x", (-1, 0, 0): "along -x", (0, 1, 0): "along y"}
    names |= {(0, -1, 0): "along -y", (0, 0, 1): "up", (0, 0, -1): "down"}
    for hop, name in names.items():
        if calm and min(hop[:2]) < 0:
            continue
        flight = world.return_transits[hop]
        if not hop[2] or world.scenario.three_d:
            seconds = flight.duration_us / US
            found[f"return {name}, {seconds:.3g} s"] = (
                energy.drained_us(flight, flight.duration_us) / 1e6
            )
    return found


def _draw_legs(axes: Axes, world: World) -> None:
    """Draw the energy of each kind of leg as a bar."""
    found = legs_j(world)
    places = np.arange(len(found))
    bars = axes.barh(places, [*found.values()], color=CRUISE, height=0.7)
    axes.bar_label(bars, [f"{joules:,.0f}" for joules in found.values()], padding=3)
    axes.set_yticks(places, [*found])
    axes.invert_yaxis()
    axes.set(xlabel="energy of a leg, J", xlim=(0.0, 1.2 * max(found.values())))
    axes.grid(visible=False, axis="y")
