"""Transits against their closed forms."""

from __future__ import annotations

import math
from collections.abc import Iterator
from decimal import Decimal, localcontext

import numpy as np

from desim_uav.model.motion.motion import BangCoastBang, Transit
from tests.verification.figure import Exact, Figure

FILL = BangCoastBang(8.3, 4.0, "fill_epoch")
FAST = BangCoastBang(8.3, 4.0, "minimum_time")


def flight_s(transit: Transit) -> float:
    """How long it takes."""
    return float(transit.rows["start_s"][-1])


def top_speed(transit: Transit) -> float:
    """The cruise speed, or the peak of a triangle."""
    return float(transit.rows["speed_mps"].max())


def figures(quick: bool = False) -> Iterator[Figure]:
    """T = d/v + v/a, else 2 sqrt(d/a); the cruise that fills a step. By hand and at random."""
    cell, level, short = (FAST.fastest_transit(d) for d in (240.0, 20.0, 10.0))
    filled, climbed = FILL.epoch_transit(240.0, 60.0), FILL.epoch_transit(20.0, 60.0)
    yield Exact("240 m in minimum time, s", flight_s(cell), 30.990662650602406, 1e-15, True)
    yield Exact("20 m in minimum time, s", flight_s(level), 4.484639, 5e-7)
    yield Exact("10 m in minimum time, s", flight_s(short), 3.16227766, 5e-9)
    yield Exact("10 m: peak speed, m/s", top_speed(short), 6.32455532, 5e-9)
    yield Exact("240 m in 60 s: cruise, m/s", top_speed(filled), 4.068986030484496, 2e-15, True)
    yield Exact(
        "240 m in 60 s: cruise, against 50 digits, m/s",
        top_speed(filled),
        float(_cruise()),
        4e-16,
        True,
    )
    yield Exact("240 m in 60 s: ramp, s", float(filled.rows["start_s"][1]), 1.017246508, 5e-10)
    yield Exact("20 m in 60 s: cruise, m/s", top_speed(climbed), 0.333798, 5e-7)
    rng = np.random.default_rng(1)
    limits = rng.uniform((0.01, 0.1, 0.05), (5000.0, 100.0, 50.0), (1000, 3)).tolist()
    yield Exact(
        "minimum time: largest relative error of T",
        max(abs(_over_theory(d, v, a) - 1) for d, v, a in limits),
        0.0,
        1e-12,
        cases=len(limits),
    )
    yield Exact(
        "given time: largest relative error of the cruise",
        max(abs(_over_root(d, a, share) - 1) for d, share, a in limits),
        0.0,
        1e-9,
        cases=len(limits),
    )


def _cruise() -> Decimal:
    """(aT - sqrt((aT)² - 4ad)) / 2, where the difference of floats loses a digit."""
    with localcontext() as context:
        context.prec = 50
        at, ad = Decimal(240), Decimal(960)
        return (at - (at * at - 4 * ad).sqrt()) / 2


def _over_theory(d: float, v: float, a: float) -> float:
    theory = d / v + v / a if d >= v * v / a else 2.0 * math.sqrt(d / a)
    return flight_s(BangCoastBang(v, a).fastest_transit(d)) / theory


def _over_root(d: float, a: float, share: float) -> float:
    """In a time between the least and some times that, at no speed limit."""
    duration = 2.0 * math.sqrt(d / a) * (1.0 + share / 50.0)
    root = (a * duration - math.sqrt((a * duration) ** 2 - 4.0 * a * d)) / 2.0
    return top_speed(BangCoastBang(1e9, a).epoch_transit(d, duration)) / root
