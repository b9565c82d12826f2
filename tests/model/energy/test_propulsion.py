"""The power of flight against the figures of the papers, and its integrals against quadrature."""

import math
from itertools import pairwise

import numpy as np
import pytest

from desim_uav.model.energy.propulsion import fixed_wing, rotary_wing
from desim_uav.model.energy.propulsion.rotary_wing import ROTORS, Powers, best_speeds, powers_of
from desim_uav.model.energy.propulsion.search import root_between

ZENG = powers_of(ROTORS["zeng2019"])
FIRST = powers_of(ROTORS["zeng2018"])


def power_w(speed_mps, blade_w, induced_w, drag_w, tip_mps, flow_mps):
    """P(V) as the paper prints it, eq. (12)."""
    v, v0 = np.asarray(speed_mps, np.longdouble), flow_mps
    blade = blade_w * (1 + 3 * v**2 / tip_mps**2)
    induced = induced_w * np.sqrt(np.sqrt(1 + v**4 / (4 * v0**4)) - v**2 / (2 * v0**2))
    return blade + induced + drag_w * v**3


def integrated(function, low, high, pieces=40):
    """An integral by Gauss-Legendre quadrature of 40 points in each of so many pieces."""
    nodes, weights = np.polynomial.legendre.leggauss(40)
    ends = np.linspace(low, high, pieces + 1)
    total = np.longdouble(0)
    for begin, end in pairwise(ends):
        middle, half = (begin + end) / 2, (end - begin) / 2
        total += half * np.sum(weights * function(middle + half * nodes))
    return float(total)


class TestRotaryWing:
    def test_the_coefficients_of_table_1(self):
        assert pytest.approx(79.856280, abs=5e-7) == ZENG.blade_w
        assert pytest.approx(88.627938, abs=5e-7) == ZENG.induced_w
        assert rotary_wing.power_w(ZENG, 0.0) == pytest.approx(168.484218, abs=5e-7)
        assert pytest.approx((580.65, 790.67), abs=5e-3) == (FIRST.blade_w, FIRST.induced_w)
        assert rotary_wing.power_w(FIRST, 0.0) == pytest.approx(1371.32, abs=5e-3)

    @pytest.mark.parametrize(
        ("speed", "power"),
        [
            (5, 143.608),
            (10, 126.029),
            (15, 138.543),
            (18, 158.968),
            (20, 178.296),
            (25, 248.952),
            (30, 356.284),
        ],
    )
    def test_the_power_curve(self, speed, power):
        assert rotary_wing.power_w(ZENG, float(speed)) == pytest.approx(power, abs=5e-4)

    @pytest.mark.parametrize("own", [ZENG, FIRST])
    def test_the_formula_of_the_paper(self, own):
        speeds = np.linspace(0.0, 60.0, 601)
        found = [rotary_wing.power_w(own, float(v)) for v in speeds]
        assert found == pytest.approx(power_w(speeds, *own).astype(float), rel=1e-12)

    def test_the_speeds_of_longest_endurance_and_range(self):
        endurance, far = best_speeds(ZENG)
        assert endurance == pytest.approx(10.21247, abs=5e-6)
        assert rotary_wing.power_w(ZENG, endurance) == pytest.approx(126.0027, abs=5e-5)
        assert far == pytest.approx(18.29513, abs=5e-6)
        assert rotary_wing.power_w(ZENG, far) == pytest.approx(161.5227, abs=5e-5)
        assert rotary_wing.power_w(ZENG, far) / far == pytest.approx(8.828727, abs=5e-7)

    def test_the_first_version_of_the_paper(self):
        assert best_speeds(FIRST).endurance_mps == pytest.approx(21.50, abs=5e-3)
        assert rotary_wing.power_w(FIRST, best_speeds(FIRST)[0]) == pytest.approx(936.07, abs=5e-3)
        misprint = FIRST._replace(tip_mps=500.0)
        speed = best_speeds(misprint).endurance_mps
        assert speed == pytest.approx(22.30, abs=5e-3)
        assert rotary_wing.power_w(misprint, speed) == pytest.approx(918.53, abs=5e-3)

    @pytest.mark.parametrize("own", [ZENG, FIRST])
    def test_the_best_speeds_are_best(self, own):
        speeds = np.linspace(0.5, 60.0, 100_001)
        powers = power_w(speeds, *own)
        endurance, far = best_speeds(own)
        assert speeds[np.argmin(powers)] == pytest.approx(endurance, abs=1e-3)
        assert speeds[np.argmin(powers / speeds)] == pytest.approx(far, abs=1e-3)

    @pytest.mark.parametrize(
        ("induced_w", "speed", "expected"),
        [(88.6279, 8.3, 562.793013693), (88.6279, 20.0, 874.619414342)],
    )
    def test_the_induced_part_of_a_ramp(self, induced_w, speed, expected):
        found = induced_w * rotary_wing.induced_integral(speed, 4.03)
        assert found == pytest.approx(expected, rel=1e-11)

    @pytest.mark.parametrize("speed", [1e-6, 1e-3, 0.1, 0.333798, 4.068986, 8.3, 20.0, 60.0, 400.0])
    def test_the_induced_part_is_its_integral(self, speed):
        def term(v):
            x = (v / np.longdouble(4.03)) ** 2 / 2
            return 1 / np.sqrt(np.sqrt(1 + x * x) + x)

        found = rotary_wing.induced_integral(speed, 4.03)
        assert found == pytest.approx(integrated(term, 0.0, speed, 200), rel=1e-12)

    @pytest.mark.parametrize("own", [ZENG, FIRST])
    @pytest.mark.parametrize("speed", [0.01, 4.068986, 8.3, 20.0, 60.0])
    def test_a_ramp_is_the_integral_of_the_power(self, own, speed):
        expected = integrated(lambda v: power_w(v, *own), 0.0, speed)
        assert rotary_wing.speeding_j(own, speed) == pytest.approx(expected, rel=1e-12)

    def test_a_ramp_by_its_series_at_low_speeds(self):
        # sqrt(sqrt(1 + x²) - x) = 1 - x/2 + x²/8 + ..., with x = V²/2 v0²
        speed, v0 = 1e-4, 4.03
        series = speed - speed**3 / (12 * v0**2)
        assert rotary_wing.induced_integral(speed, v0) == pytest.approx(series, rel=1e-15)

    def test_the_slope_is_that_of_the_power(self):
        for speed in (0.5, 4.0, 10.0, 30.0):
            difference = (
                rotary_wing.power_w(ZENG, speed + 1e-5) - rotary_wing.power_w(ZENG, speed - 1e-5)
            ) / 2e-5
            assert rotary_wing.slope_w(ZENG, speed) == pytest.approx(difference, rel=1e-6)

    def test_a_fuselage_without_drag_still_has_best_speeds(self):
        own = Powers(80.0, 90.0, 0.0, 120.0, 4.0)
        endurance, far = best_speeds(own)
        assert 0.0 < endurance < far < 120.0


class TestFixedWing:
    WING = fixed_wing.WINGS["zeng2017"]

    def test_the_figures_of_the_paper(self):
        endurance, far = fixed_wing.best_speeds(self.WING)
        assert endurance == pytest.approx(29.9994, abs=5e-5)
        assert fixed_wing.power_w(self.WING, endurance) == pytest.approx(100.002, abs=5e-4)
        assert far == pytest.approx(39.4814, abs=5e-5)
        assert fixed_wing.power_w(self.WING, far) == pytest.approx(113.978, abs=5e-4)
        assert fixed_wing.power_w(self.WING, far) / far == pytest.approx(2.886867, abs=5e-7)

    def test_a_turn_takes_more_lift(self):
        level, turn = (fixed_wing.power_w(self.WING, 30.0, across) for across in (0.0, 9.8))
        assert turn - level == pytest.approx(2250 / 30)

    @pytest.mark.parametrize(("begin", "end"), [(5.0, 30.0), (30.0, 5.0), (20.0, 20.001)])
    def test_a_ramp_is_the_integral_of_the_power(self, begin, end):
        expected = integrated(lambda v: 9.26e-4 * v**3 + 2250.0 / v, begin, end)
        found = fixed_wing.speeding_j(9.26e-4, 2250.0, begin, end)
        assert found == pytest.approx(expected, rel=1e-12)


class TestRoots:
    def test_down_to_a_float(self):
        root = root_between(lambda v: v * v - 2.0, 0.0, 0.01)
        assert root == pytest.approx(math.sqrt(2), rel=3e-16)

    def test_without_a_root(self):
        with pytest.raises(ValueError, match="does not rise"):
            root_between(lambda v: -1.0, 0.0, 1.0)
