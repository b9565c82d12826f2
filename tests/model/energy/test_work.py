"""The energy of a piece in wind, against SciPy's adaptive quadrature."""

from itertools import pairwise

import numpy as np
import pytest
from scipy.integrate import quad

from desim_uav.model.energy.work import NODES, WEIGHTS, speeding_in_wind_j
from desim_uav.model.motion.limits import wind_along

V0 = 4.03


def rotary_wing(values, v):
    """Zeng, Xu and Zhang (2019), table I."""
    square = v * v
    blade = 79.856280 * (1.0 + 3.0 * square / 14400.0)
    lift = np.sqrt(1.0 + square * square / (4.0 * V0**4)) - square / (2.0 * V0**2)
    return blade + 88.627938 * np.sqrt(lift) + 0.009243 * square * v


def cube(values, v):
    return v * v * v


def energy_j(power, wind, ahead, speeds, lasts, smooth):
    """The energy of a piece of a leg in wind, whose ground speed changes evenly."""
    level, (tail, side) = np.hypot(*ahead[:2]), (0.0, np.hypot(*wind))
    if level > 0.0:
        tail, side = wind_along(wind, ahead)
    first, last = (level * speed - tail for speed in speeds)
    return speeding_in_wind_j(power, 0, side, first, last, lasts, smooth)


def by_quadrature(wind, ahead, speeds, lasts, power):
    """The same by SciPy, split where the air speed is least."""
    ahead, wind = np.array(ahead[:2]), np.array(wind)

    def at(t):
        v = np.hypot(*((speeds[0] + (speeds[1] - speeds[0]) * t / lasts) * ahead - wind))
        return power(0, float(v))

    rate = (speeds[1] - speeds[0]) / lasts * (ahead @ ahead)
    least = (wind @ ahead - speeds[0] * (ahead @ ahead)) / rate if rate else 0.0
    near = [least + sign * 0.5**k for sign in (-1, 1) for k in range(0, 16, 3)]
    ends = np.unique(np.clip([0.0, least, *near, lasts], 0.0, lasts))
    parts = [quad(at, *pair, epsabs=0.0, epsrel=1e-12, limit=200)[0] for pair in pairwise(ends)]
    return sum(parts)


def test_nodes_and_weights_are_numpys():
    nodes, weights = np.polynomial.legendre.leggauss(10)
    assert nodes[5:] == pytest.approx(NODES, abs=1e-15)
    assert weights[5:] == pytest.approx(WEIGHTS, abs=1e-15)


def test_a_ramp_without_wind_has_a_closed_form():
    # The induced term alone, integrated from 0 to V, is Pi v0 / 2 (q + artanh q).
    for v in (0.5, 8.3, 20.0):
        x = v * v / (2 * V0**2)
        q = np.sqrt(1.0 - (np.sqrt(1 + x * x) - x) ** 2)
        induced = 88.627938 * V0 / 2 * (q + np.arctanh(q))
        over_v = induced + 79.856280 * (v + v**3 / 14400) + 0.009243 * v**4 / 4
        found = energy_j(rotary_wing, (0.0, 0.0), (0.6, 0.8, 0.0), (0.0, v), v / 4.0, V0)
        assert found == pytest.approx(over_v / 4.0, rel=1e-12)


def test_the_cube_of_the_air_speed_by_hand():
    # From 2 to 6 m/s against a wind of 1 m/s: (7^4 - 3^4) / 4 over 4 m/s, and 0.5 s for 1 m/s.
    found = energy_j(cube, (-1.0, 0.0), (1.0, 0.0, 0.0), (2.0, 6.0), 2.0, 1.0)
    assert found == pytest.approx((7**4 - 3**4) / 4 * 0.5, rel=1e-14)
    # With the wind: the air speed falls to 0 and rises again.
    found = energy_j(cube, (4.0, 0.0), (1.0, 0.0, 0.0), (2.0, 6.0), 2.0, 1.0)
    assert found == pytest.approx(2 * 2**4 / 4 * 0.5, rel=1e-14)


def test_at_an_even_speed_and_on_a_climb_the_power_is_constant():
    found = energy_j(rotary_wing, (3.0, 4.0), (1.0, 0.0, 0.0), (3.0, 3.0), 7.0, V0)
    assert found == 7.0 * rotary_wing(0, 4.0)
    found = energy_j(rotary_wing, (3.0, 4.0), (0.0, 0.0, 1.0), (1.0, 6.0), 7.0, V0)
    assert found == pytest.approx(7.0 * rotary_wing(0, 5.0), rel=1e-14)


def test_ramps_in_wind_are_those_of_adaptive_quadrature():
    rng = np.random.default_rng(4)
    for number in range(100):
        heading, steep = rng.uniform(0.0, 2 * np.pi), rng.uniform(-1.4, 1.4) * (number % 2)
        along = np.array([np.cos(heading), np.sin(heading)])
        wind = rng.uniform(-8.0, 8.0, 2)
        if number % 3 == 0:  # a weak wind from the side
            across = np.array([-along[1], along[0]]) * 10 ** rng.uniform(-9, 0)
            wind = along * rng.uniform(-8.0, 8.0) + across
        ahead = (*(along * np.cos(steep)), np.sin(steep))
        speeds, lasts = tuple(rng.uniform(0.0, 20.0, 2)), rng.uniform(0.3, 5.0)
        found = energy_j(rotary_wing, tuple(wind), ahead, speeds, lasts, V0)
        expected = by_quadrature(wind, ahead, speeds, lasts, rotary_wing)
        assert found == pytest.approx(expected, rel=2e-12)
