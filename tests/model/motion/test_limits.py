"""The speeds and accelerations that limits and wind leave along a direction."""

import numpy as np
import pytest

from desim_uav.model.motion.legs import leg_between
from desim_uav.model.motion.limits import (
    CALM,
    Limits,
    acceleration_along,
    can_hold,
    speed_along,
)

LIMITS = Limits(10.0, 4.0, 5.0, 3.0, 2.0)
TEN = Limits(10.0, 4.0, 10.0, 10.0, 4.0)


def random_ahead(rng):
    way = rng.normal(size=3) * rng.choice([0.0, 1.0], 3, p=[0.2, 0.8])
    return tuple(way / np.linalg.norm(way)) if way.any() else (1.0, 0.0, 0.0)


class TestAnchors:
    """Two ways of 1 km at 10 m/s in a wind of 5 m/s, without the ramps."""

    @pytest.mark.parametrize(
        ("stop", "seconds"), [((1000.0, 0.0, 0.0), 266.6667), ((0.0, 1000.0, 0.0), 230.9401)]
    )
    def test_there_and_back(self, stop, seconds):
        wind, home = (5.0, 0.0), (0.0, 0.0, 0.0)
        legs = [leg_between(TEN, wind, np.inf, *ends) for ends in ((home, stop), (stop, home))]
        ramps = sum(leg.speed_mps / leg.acceleration_mps2 for leg in legs)
        assert sum(leg.duration_s for leg in legs) - ramps == pytest.approx(seconds, abs=5e-5)

    def test_ground_speeds(self):
        assert speed_along(TEN, (5.0, 0.0), (1.0, 0.0, 0.0)) == 15.0
        assert speed_along(TEN, (5.0, 0.0), (-1.0, 0.0, 0.0)) == 5.0
        assert speed_along(TEN, (5.0, 0.0), (0.0, 1.0, 0.0)) == pytest.approx(75.0**0.5)


class TestDirections:
    def test_level_and_vertical(self):
        assert speed_along(LIMITS, CALM, (0.0, -1.0, 0.0)) == 10.0
        assert speed_along(LIMITS, CALM, (0.0, 0.0, 1.0)) == 5.0
        assert speed_along(LIMITS, CALM, (0.0, 0.0, -1.0)) == 3.0
        assert acceleration_along(LIMITS, (0.0, 1.0, 0.0)) == 4.0
        assert acceleration_along(LIMITS, (0.0, 0.0, -1.0)) == 2.0

    def test_a_slope_keeps_both_limits(self):
        assert speed_along(LIMITS, CALM, (0.8, 0.0, 0.6)) == pytest.approx(5.0 / 0.6)
        assert speed_along(LIMITS, CALM, (0.6, 0.0, 0.8)) == pytest.approx(5.0 / 0.8)
        assert speed_along(LIMITS, CALM, (0.99, 0.0, (1 - 0.99**2) ** 0.5)) == pytest.approx(
            10.0 / 0.99
        )
        assert acceleration_along(LIMITS, (0.6, 0.0, 0.8)) == pytest.approx(2.0 / 0.8)

    def test_no_limit_is_broken_and_one_is_reached(self):
        rng = np.random.default_rng(1)
        for _ in range(2000):
            limits = Limits(*rng.uniform(0.5, 20.0, 5))
            heading = rng.uniform(0.0, 2 * np.pi)
            blows = limits.level_mps * rng.choice([0.0, rng.uniform(0.0, 0.999)])
            wind = (blows * np.cos(heading), blows * np.sin(heading))
            ahead = np.array(random_ahead(rng))
            speed = speed_along(limits, wind, tuple(ahead))
            vertical = limits.climb_mps if ahead[2] > 0 else limits.descent_mps
            for share in (0.0, 0.3, 0.7, 1.0):
                through = np.hypot(*(share * speed * ahead[:2] - wind))
                assert through <= limits.level_mps * (1 + 1e-12)
            shares = through / limits.level_mps, abs(speed * ahead[2]) / vertical
            if not ahead[:2].any():
                shares = (0.0, shares[1])
            assert max(shares) == pytest.approx(1.0, rel=1e-12)
            pulled = acceleration_along(limits, tuple(ahead)) * np.abs(ahead)
            pulls = np.hypot(*pulled[:2]) / limits.level_mps2, pulled[2] / limits.vertical_mps2
            assert max(pulls) == pytest.approx(1.0, rel=1e-12)


class TestStrongWind:
    @pytest.mark.parametrize("wind", [(10.0, 0.0), (-6.0, 8.0), (0.0, 11.0), (50.0, 50.0)])
    def test_nobody_flies_who_cannot_hover(self, wind):
        assert not can_hold(TEN, wind)
        for ahead in ((1.0, 0.0, 0.0), (0.6, 0.8, 0.0), (0.0, 0.0, 1.0)):
            assert speed_along(TEN, wind, ahead) == 0.0
            leg = leg_between(TEN, wind, np.inf, (0.0, 0.0, 0.0), ahead)
            assert leg.duration_us == -1

    def test_a_wind_just_below_the_limit(self):
        assert can_hold(TEN, (0.0, 9.999))
        speed = speed_along(TEN, (0.0, 10.0 - 1e-9), (0.0, -1.0, 0.0))
        assert speed == pytest.approx(1e-9, rel=1e-6)
