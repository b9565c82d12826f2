"""The figure of energy in free flight, against quadrature; its marks, types and errors."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from matplotlib.figure import Figure

from desim_uav.errors import UsageError
from desim_uav.model.motion.limits import Limits
from desim_uav.report.figures import energy_figure
from desim_uav.report.straight_legs import FreeLegs, Way
from desim_uav.world import World
from tests.engine.helpers import strip
from tests.model.energy.test_energy_of_legs import along, space_of
from tests.reference.energy import Rotor
from tests.report.test_straight_legs import BATTERY, CHOICE, MOTION, flat, hills


def panels(figure: Figure) -> dict[str, Any]:
    """The panels of the first type of drones by the labels of their axes."""
    return {f"{axes.get_xlabel()}: {axes.get_ylabel()}": axes for axes in reversed(figure.axes)}


def curves(world: World, panel: str) -> dict[str, Any]:
    """The curves of a panel by their names in the legend below."""
    figure = energy_figure(world)
    lines = panels(figure)[panel].lines
    legend = next(own for part in figure.subfigs for own in part.legends)
    names = [text.get_text() for text in legend.get_texts()]
    return dict(zip(names, lines, strict=False))


# ---- against quadrature


def by_quadrature(limits: Limits, way: Way, length_m: float) -> float:
    """The energy of a leg of a way by the sampler of the tests of legs, to a microsecond."""
    stop = tuple(length_m * part for part in way.ahead)
    space = space_of(limits, way.wind)
    lasts_s = round(space.leg((0, 0, 0), stop).duration_s, 6)
    return along(space, (0.0, 0.0, 0.0), stop, Rotor(), lasts_s)


WINDS = [(0.0, 0.0), (3.0, 4.0)]


@pytest.mark.parametrize("wind", WINDS)
def test_the_energy_over_the_length(wind):
    world = hills(wind_mps=wind)
    legs, limits = FreeLegs(world.types[0]), Limits(12, 4, 5, 3, 2)
    whole = curves(world, "length of a leg, m: energy of a leg, J")
    metre = curves(world, "length of a leg, m: energy per metre, J/m")
    assert len(legs.ways) == (3 if wind == (0.0, 0.0) else 5)
    for way in legs.ways:
        lengths, joules = whole[way.name].get_data()
        assert lengths[-1] == way.longest_m
        for k in (0, 20, 99):
            expected = by_quadrature(limits, way, lengths[k])
            assert joules[k] == pytest.approx(expected, abs=5e-6)
            assert metre[way.name].get_ydata()[k] == pytest.approx(expected / lengths[k], rel=1e-7)


@pytest.mark.parametrize("wind", WINDS)
def test_the_energy_over_the_cruise_speed(wind):
    world = flat(wind_mps=wind)
    legs = FreeLegs(world.types[0])
    metre = panels(energy_figure(world))[
        "speed, m/s: energy per metre, J/m"
        if wind == (0.0, 0.0)
        else "speed through the air, m/s: energy per metre, J/m"
    ]
    for way, line in zip(legs.ways, metre.lines[4::2], strict=True):
        speeds, values = line.get_data()
        assert speeds[-1] == 12.0
        for k in (30, 99):
            limits = Limits(speeds[k], 4, 5, 3, 2)
            expected = by_quadrature(limits, way, legs.typical_m) / legs.typical_m
            assert values[k] == pytest.approx(expected, rel=1e-8)
    texts = [text.get_text() for text in metre.get_legend().get_texts()]
    assert sum(text.startswith("leg") for text in texts) == len(legs.ways)


def test_the_power_over_a_leg():
    """The power is that at the speed then, and its integral is the energy of the leg."""
    world = hills(wind_mps=(3.0, 4.0))
    legs = FreeLegs(world.types[0])
    over_time = curves(world, "time since the start of a leg, s: power, W")
    for way in legs.ways:
        times, watts = over_time[way.name].get_data()
        length_m = min(legs.typical_m, way.longest_m)
        leg = legs.leg(way, length_m)
        assert times[-1] == pytest.approx(leg.duration_s, abs=1e-6)
        assert np.trapezoid(watts, times) == pytest.approx(legs.energy_j(way, leg), rel=2e-3)
        middle = leg.speed_mps * np.array(way.ahead)
        air = np.hypot(middle[0] - way.wind[0], middle[1] - way.wind[1])
        cruise_w = Rotor().power_w(air, middle[2])
        assert np.interp(times[-1] / 2, times, watts) == pytest.approx(cruise_w, abs=0.02)
        assert watts[0] == pytest.approx(Rotor().power_w(5.0, 0.0), abs=0.1)


# ---- marks, fleets and errors


def test_the_marks_of_cruise_speeds():
    (cruise,) = (
        line for line in energy_figure(flat(CHOICE)).axes[0].lines if line.get_label() == "cruise"
    )
    assert [*cruise.get_xdata()] == [6.0, 10.0, 12.0]  # commands choose from 6 to 10; returns: 12


def fleet(**batteries: Any) -> World:
    """A type that flies from cell to cell, one that flies freely, and one like the latter."""
    motions = {"cells": {"max_speed_mps": 12, "timing": "minimum_time"}}
    types = [
        {"name": name, "count": 1, "motion": motions.get(name, MOTION), "battery": battery}
        for name, battery in batteries.items()
    ]
    return strip(drones=types, stations={"count": 1})


def headings(world: World, drone: int | None = None) -> list[str]:
    figure = energy_figure(world, drone)
    titled = [figure, *figure.subfigs]
    return [part.get_suptitle() for part in titled if part.get_suptitle()]


def test_a_mixed_fleet_has_panels_for_each_type():
    world = fleet(cells=BATTERY, free=BATTERY, other=BATTERY, timed={"autonomy_min": 9})
    assert headings(world) == [
        "Energy of flight. scenario; timed (endurance) left out",
        "cells: from cell to cell, 30 Wh",
        "free, other: in free flight, 30 Wh",
    ]
    figure = energy_figure(world)
    labels = [axes.get_xlabel() for axes in figure.axes]
    assert labels[2::3] == ["energy of a leg, J", "energy of a step of 60 s, J", labels[8]]
    assert headings(world, 0) == ["Energy of flight. scenario, 30 Wh"]
    assert len(energy_figure(world, 0).axes) == 3
    assert headings(world, 2) == ["Energy of flight. scenario, 30 Wh"]
    with pytest.raises(UsageError, match=r"^drone: 4: .* has the drones 0 to 3"):
        energy_figure(world, 4)


def test_a_fleet_without_a_power():
    with pytest.raises(UsageError, match=r"drones\.battery: endurance, null: energy is drawn for"):
        energy_figure(fleet(cells={"autonomy_min": 9}, free=None))
    with pytest.raises(UsageError, match=r"drones\.battery: null: energy is drawn for"):
        energy_figure(fleet(cells=BATTERY, free=None), 1)
    with pytest.raises(UsageError, match=r"drones\.battery: endurance: energy is drawn"):
        energy_figure(strip(battery={"autonomy_min": 9}, drones={"motion": MOTION}))


def test_too_many_types():
    batteries = {f"t{k}": {**BATTERY, "capacity_wh": 30.0 + k} for k in range(5)}
    with pytest.raises(UsageError, match=r"5 types of drones .* choose the type of one drone with"):
        energy_figure(fleet(**batteries))
    assert headings(fleet(**batteries), 3)[0].endswith("33 Wh")


def test_no_text_is_clipped():
    """Every text of the largest figure lies on it."""
    figure = energy_figure(hills(CHOICE, wind_mps=(3.0, 4.0)))
    figure.canvas.draw()
    width, height = figure.bbox.size
    for axes in figure.axes:
        box = axes.get_tightbbox()
        assert box is not None
        assert box.x0 >= 0 and box.y0 >= 0 and box.x1 <= width and box.y1 <= height
