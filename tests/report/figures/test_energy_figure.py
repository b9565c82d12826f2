"""The figure of energy shows the power, the best speeds and the energy of legs."""

import numpy as np
import pytest

from desim_uav.errors import UsageError
from desim_uav.report.figures import energy_figure
from desim_uav.report.figures.energy import legs_j
from desim_uav.scenario.load import from_mapping
from desim_uav.world import build_world
from tests.model.energy.test_propulsion import ZENG, power_w


def world_of(battery, **motion):
    """A map of 5 x 4 cells of 240 m by 200 m, with levels at 20 and 40 m."""
    return build_world(
        from_mapping(
            {
                "name": "hills",
                "map": {
                    "size_m": [1200, 800],
                    "cells": [5, 4],
                    "obstacles": {"cells": [[0, 0, 35]]},
                },
                "drones": {
                    "count": 1,
                    "start_cells": [[2, 2]],
                    "battery": battery,
                    "motion": {"kind": "bang_coast_bang", **motion},
                },
                "stations": {"count": 1, "radius_m": 0},
            }
        ),
        0,
    )


@pytest.mark.parametrize("electronics_w", [0.0, 40.0])
def test_the_curves_and_their_best_speeds(electronics_w):
    world = world_of({"kind": "rotary_wing", "electronics_w": electronics_w})
    power, metre, _ = energy_figure(world).axes
    for axes, over in ((power, 1.0), (metre, None)):
        curve, *marks = axes.lines
        speeds, values = curve.get_data()
        expected = power_w(speeds, *ZENG).astype(float) + electronics_w
        assert values == pytest.approx(expected / (over or speeds), rel=1e-9)
        (endurance, _), (far, least) = ([*np.array(line.get_data())[:, 0]] for line in marks[-2:])
        assert speeds[np.argmin(expected)] == pytest.approx(endurance, abs=0.1)
        assert speeds[np.argmin(expected / speeds)] == pytest.approx(far, abs=0.1)
        if over is None:
            assert least == pytest.approx(np.min(expected / speeds), rel=1e-4)


def test_the_speeds_at_which_drones_cruise():
    world = world_of({"kind": "rotary_wing"}, max_speed_mps=12.0)
    _, cruise, *_ = energy_figure(world).axes[0].lines
    filling = [(240 - np.sqrt(240**2 - 16 * d)) / 2 for d in (200.0, 240.0)]
    assert cruise.get_xdata() == pytest.approx([*filling, 12.0], abs=1e-3)


def test_the_bars_are_the_energy_of_the_legs():
    world = world_of({"kind": "rotary_wing"})
    bars = energy_figure(world).axes[2].patches
    legs = legs_j(world.types[0])
    assert [bar.get_width() for bar in bars] == [*legs.values()]
    assert legs["hover, 60 s"] == pytest.approx(60 * 168.484218, abs=1e-4)
    assert legs["right, 60 s"] == pytest.approx(9031.517, abs=1e-3)
    assert legs["return along x, 31 s"] == pytest.approx(4061.566, abs=1e-3)
    assert legs["return up, 4.48 s"] - legs["return down, 4.48 s"] == pytest.approx(400.0)


@pytest.mark.parametrize(
    ("battery", "kind"), [(None, "null"), ({"kind": "endurance"}, "endurance")]
)
def test_a_battery_without_a_power(battery, kind):
    with pytest.raises(UsageError, match=f"drones.battery: {kind}: energy is drawn"):
        energy_figure(world_of(battery))
