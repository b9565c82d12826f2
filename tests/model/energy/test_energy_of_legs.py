"""The energy of free legs in wind, against a sampler.

The sampler finds the speeds over the ground by bisection (``tests/reference/free.py``) and takes
the integral of the power at the speed through the air by SciPy's quadrature.
"""

from __future__ import annotations

import math
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from scipy.integrate import quad

from desim_uav.model.energy.rotary_wing import RotaryWing
from desim_uav.model.motion.legs import leg_between
from desim_uav.model.motion.limits import Limits
from desim_uav.model.motion.space import flight_of
from desim_uav.model.rules import US
from tests.model.motion.test_legs import LIMITS, random_leg
from tests.reference.energy import Rotor
from tests.reference.free import Space
from tests.selection import by_default


def space_of(limits: Limits, wind: tuple[float, float]) -> Space:
    """The limits of the reference, without a map."""
    return Space(*limits, (0.0, 0.0), (), (), (), 1.0, wind)


def along(space: Space, start: Any, stop: Any, rotor: Rotor, lasts_s: float) -> float:
    """The energy of the first seconds of a leg and of the hover after it, by quadrature."""
    way = np.subtract(stop, start)
    length = float(np.linalg.norm(way))
    hover_w = rotor.power_w(math.hypot(*space.wind_mps), 0.0)
    if length < 1e-6:
        return hover_w * lasts_s
    hop, ahead = space.leg(tuple(start), tuple(stop)), way / length
    ramp = hop.speed_mps / hop.acceleration_mps2

    def power_w(t: float) -> float:
        v = min(hop.speed_mps, hop.acceleration_mps2 * min(t, hop.duration_s - t))
        east, north, up = v * ahead
        air = math.hypot(east - space.wind_mps[0], north - space.wind_mps[1])
        return rotor.power_w(air, up)

    lasts, total = min(lasts_s, hop.duration_s), 0.0
    for low, high in pairwise([0.0, ramp, hop.duration_s - ramp, hop.duration_s]):
        if low < min(high, lasts):
            total += quad(power_w, low, min(high, lasts), epsabs=0, epsrel=1e-11, limit=400)[0]
    return total + hover_w * (lasts_s - lasts)


@pytest.mark.parametrize("seed", by_default(range(8), range(400)))
def test_energy_of_a_leg(seed: int):
    rng = np.random.default_rng([21, seed])
    limits, wind, _, start, stop = random_leg(rng)
    leg = leg_between(limits, wind, np.inf, start, stop)
    flight, space = flight_of(leg, wind), space_of(limits, wind)
    battery = RotaryWing(capacity_wh=9000.0, climb=seed % 3 > 0, electronics_w=7.5)
    rotor = Rotor(climbs=battery.climb, electronics_w=7.5)
    for share in (*rng.uniform(0.0, 1.0, 4), 1.0, 1.3):
        elapsed_us = round(share * leg.duration_us)
        joules = along(space, start, stop, rotor, elapsed_us / US)
        found = battery.drain_of(flight, elapsed_us)
        assert found == pytest.approx(1e6 * joules, rel=1e-9, abs=4)
        assert battery.lasts_us(flight, found) <= elapsed_us
        assert battery.lasts_us(flight, found + 1) > elapsed_us


def test_a_leg_without_wind_is_as_it_was():
    leg = leg_between(LIMITS, (0.0, 0.0), np.inf, (0.0, 0.0, 0.0), (-300.0, 20.0, 40.0))
    assert flight_of(leg, (0.0, 0.0))[4:] == (0.0, 0.0)
