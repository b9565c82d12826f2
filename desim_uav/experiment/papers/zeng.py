"""Zeng, Xu and Zhang 2019, and Zeng and Zhang 2017: the power of flight and the best speeds."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

from desim_uav.experiment.papers import fly_hover
from desim_uav.experiment.papers.row import FigureRow, evaluated
from desim_uav.model.energy.fixed_wing import FixedWing
from desim_uav.model.energy.propulsion.rotary_wing import ROTORS, best_speeds, power_w, powers_of
from desim_uav.model.energy.rotary_wing import RotaryWing
from desim_uav.model.motion.motion import REST, BangCoastBang

if TYPE_CHECKING:
    from matplotlib.figure import Figure

APART = "the paper's formulas, evaluated apart"
POWERS_W = {5: 143.608, 10: 126.029, 15: 138.543, 20: 178.296, 25: 248.952, 30: 356.284}
"""The power at some speeds in m/s, by the paper's Table I."""


def rows() -> Iterator[FigureRow]:
    """Yield powers in a hover and in flight, the best speeds, and the energy of flights."""
    own, first = powers_of(ROTORS["zeng2019"]), powers_of(ROTORS["zeng2018"])
    yield evaluated("blade power P0, W", APART, 79.856280, own.blade_w, 6)
    yield evaluated("induced power Pi, W", APART, 88.627938, own.induced_w, 6)
    yield evaluated("hover, W", APART, 168.484218, power_w(own, 0.0), 6)
    for speed, watts in POWERS_W.items():
        yield evaluated(f"power at {speed} m/s, W", APART, watts, power_w(own, float(speed)), 3)
    best = best_speeds(own)
    yield evaluated("longest endurance, m/s", APART, 10.21247, best.endurance_mps, 5)
    yield evaluated("its power, W", APART, 126.0027, power_w(own, best.endurance_mps), 4)
    yield evaluated("longest range, m/s", APART, 18.29513, best.range_mps, 5)
    yield evaluated("its power, W", APART, 161.5227, power_w(own, best.range_mps), 4)
    yield evaluated("first version: hover, W", APART, 1371.32, power_w(first, 0.0), 2)
    early = best_speeds(first).endurance_mps
    yield evaluated("first version: longest endurance, m/s", APART, 21.50, early, 2)
    battery, hop = RotaryWing(), BangCoastBang().fastest_transit(240.0)
    half_hour = battery.drains(REST, 1_800_000_000) / 3.6e9
    yield evaluated("half an hour of hovering, Wh", APART, 84.242, half_hour, 3)
    took = battery.drains(hop, hop.duration_us) / 1e6
    yield evaluated("240 m at 8.3 m/s and 4 m/s², J", "the same, by quadrature", 4061.566, took, 3)
    yield from fly_hover.rows()


def wing_rows() -> Iterator[FigureRow]:
    """Yield the best speeds of the fixed wing."""
    wing = FixedWing()
    best = wing.best_speeds()
    yield evaluated("longest endurance, m/s", APART, 29.9994, best.endurance_mps, 4)
    yield evaluated("its power, W", APART, 100.002, wing.level_w(best.endurance_mps), 3)
    yield evaluated("longest range, m/s", APART, 39.4814, best.range_mps, 4)
    metre = wing.level_w(best.range_mps) / best.range_mps
    yield evaluated("its energy, J/m", APART, 2.886867, metre, 6)


def draw() -> Figure:
    """Draw the power over the speed."""
    from desim_uav.report.figures.papers import Series, lines_figure

    own = powers_of(ROTORS["zeng2019"])
    speeds = [0.1 * k for k in range(301)]
    apart = tuple((float(speed), watts) for speed, watts in POWERS_W.items())
    curve = Series("ours", speeds, [power_w(own, v) for v in speeds], points=apart)
    return lines_figure("Propulsion power, Table I", "speed, m/s", "power, W", [curve], APART)
