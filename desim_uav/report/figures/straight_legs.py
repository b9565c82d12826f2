"""The panels of the energy of free flight: over the time of a leg, its length, and its speed."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import FigureBase
from numpy.typing import NDArray

from desim_uav.report.batteries import powers_w
from desim_uav.report.figures.style import COLOURS, DASHES
from desim_uav.report.straight_legs import FreeLegs, LegEntry, Way

Floats = NDArray[np.float64]

POINTS = 100
"""The number of lengths or speeds for which a curve is drawn."""

RAMP_PARTS = 24
"""The number of pieces of which the power of a ramp is drawn."""

MANY = 4.0
"""The axes show the least energy per metre of a way up to this many times that of the best way."""

SHORTEST = 0.02
"""The shortest leg that is drawn, as a share of the longest one."""

HOVER: dict[str, Any] = {"color": "0.5", "ls": ":", "linewidth": 1}
TYPICAL: dict[str, Any] = {"color": "0.65", "ls": "-", "linewidth": 0.8, "zorder": 1}
"""The looks of the power of a hover, and of the length of a typical leg."""


def draw_per_metre(axes: Axes, legs: FreeLegs) -> None:
    """Draw the energy per metre of whole legs over their cruise speed, with its least value.

    The axes reach up to these values, unless one is many times the least of them.
    """
    least = []
    for number, way in enumerate(way for way in legs.ways if way.level):
        speeds, joules = over_speed(legs, way)
        best = int(np.nanargmin(joules))
        least.append(float(joules[best]))
        look = _look(number)
        axes.plot(speeds, joules, linewidth=1.2, **look)
        name = "leg" if way.name == "level" else f"leg, {way.name}"
        label = f"{name}: {speeds[best]:.1f} m/s, {joules[best]:.1f} J/m"
        axes.plot(speeds[best], joules[best], marker=".", label=label, zorder=3, **look)
    most = max(joules for joules in least if joules <= MANY * min(least))
    axes.set_ylim(0.0, max(axes.get_ylim()[1], 2.0 * most))
    of_leg = (lambda each: each * legs.typical_m, lambda whole: whole / legs.typical_m)
    beside = axes.secondary_yaxis("right", functions=of_leg)
    beside.set_ylabel(f"energy of a leg of {legs.typical_m:g} m, J")


def over_speed(legs: FreeLegs, way: Way) -> tuple[Floats, Floats]:
    """Return highest speeds through the air, and the J/m of a typical leg that keeps to each.

    The highest speed is that of commands. The energy is NaN at speeds at which drones cannot fly.
    """
    wind_mps = math.hypot(*way.wind)
    highest_mps = min(legs.limits.level_mps, legs.cruises_mps[-1])
    speeds = np.linspace(wind_mps, highest_mps, POINTS + 1)[1:]
    joules = [legs.energy_j(way, legs.leg_at(way, legs.typical_m, float(v))) for v in speeds]
    return speeds, np.array(joules) / legs.typical_m


def draw_free_legs(figure: FigureBase, legs: FreeLegs) -> None:
    """Draw the power over typical legs, and the energy of legs and per metre over their length."""
    time, whole, metre = figure.subplots(1, 3)
    battery: Any = legs.own.drones.battery
    hover_w = battery.level_w(math.hypot(*legs.own.scenario.wind_mps))
    most_w, least = hover_w, math.inf
    for number, entry in enumerate(legs.shown):
        look = _look(number)
        times, watts = over_time(legs, entry)
        time.plot(times, watts, **look)
        lengths, joules = over_length(legs, entry)
        whole.plot(lengths, joules, label=entry.name, **look)
        metre.plot(lengths, joules / lengths, **look)
        most_w, least = max(most_w, watts.max()), min(least, (joules / lengths).min())
    time.axhline(hover_w, label="hover", **HOVER)
    time.set(xlabel="time since the start of a leg, s", ylabel="power, W", xlim=(0.0, None))
    time.set(ylim=(0.0, 1.15 * most_w), title=_lengths(legs))
    for axes in (whole, metre):
        axes.axvline(legs.typical_m, **TYPICAL)
        axes.set(xlabel="length of a leg, m", xlim=(0.0, None))
    whole.set(ylabel="energy of a leg, J", ylim=(0.0, None))
    metre.set(ylabel="energy per metre, J/m", ylim=(0.0, 6.0 * least))
    lines = whole.lines[:-1] + time.lines[-1:]
    figure.legend(handles=lines, loc="outside lower center", ncols=7)


def _lengths(legs: FreeLegs) -> str:
    """Return the heading of the panel of typical legs."""
    shorter = any(entry.way.longest_m < legs.typical_m for entry in legs.shown)
    return f"legs of {legs.typical_m:g} m{' at most' if shorter else ''}"


def over_time(legs: FreeLegs, entry: LegEntry) -> tuple[Floats, Floats]:
    """Return times of a typical leg in seconds, and the power then in watts.

    The leg is shorter if the map allows no longer one on its way.
    """
    way = entry.way
    leg = legs.leg(way, min(legs.typical_m, way.longest_m), entry.cruise_mps)
    times, watts = np.array(powers_w(legs.battery, legs.flight(way, leg), RAMP_PARTS)).T
    return times, watts


def over_length(legs: FreeLegs, entry: LegEntry) -> tuple[Floats, Floats]:
    """Return lengths of legs in metres, up to the longest one of a step, and their joules."""
    way = entry.way
    lengths = np.linspace(SHORTEST * way.longest_m, way.longest_m, POINTS)
    joules = [legs.energy_j(way, legs.leg(way, float(m), entry.cruise_mps)) for m in lengths]
    return lengths, np.array(joules)


def _look(number: int) -> dict[str, Any]:
    """Return the look of a series, whose colour is another one than that of curves: black."""
    colour = COLOURS[1 + number % (len(COLOURS) - 1)]
    return {"color": colour, "linestyle": DASHES[number % len(DASHES)]}
