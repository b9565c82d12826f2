"""The elevations at which Al-Hourani's mean loss at a fixed distance is stationary."""

import numpy as np
import pytest

from desim_uav.experiment.papers.stationary import stationary_elevations

pytestmark = pytest.mark.thorough  # it is long to compile, and no engine uses it yet

TOWNS = {
    "suburban": (20.9, 4.88, 0.43),
    "urban": (19.0, 9.61, 0.16),
    "dense_urban": (21.4, 12.08, 0.11),
    "high_rise": (31.7, 27.23, 0.08),
}


def turning(town):
    out = np.zeros(8)
    return out[: stationary_elevations(*town, out)].copy()


class TestStationaryElevations:
    @pytest.mark.parametrize(
        ("town", "degrees"),
        [
            ("suburban", [20.338708]),
            ("urban", [42.438557]),
            ("dense_urban", [54.619150]),
            ("high_rise", [6.669199, 23.731943, 75.518762]),
        ],
    )
    def test_al_hourani(self, town, degrees):
        assert turning(TOWNS[town]) == pytest.approx(degrees, abs=5e-7)

    def test_none_is_missed_of_a_thousand_towns(self):
        rng, counts = np.random.default_rng(1), []
        grid = np.linspace(0.0, 90.0, 90_001)[1:-1]
        for _ in range(1000):
            town = (rng.uniform(0.0, 40.0), rng.uniform(1.0, 45.0), 10 ** rng.uniform(-2.0, -0.3))
            fall, a, b = town
            sees = 1.0 / (1.0 + a * np.exp(-b * (grid - a)))
            slope = np.pi / 9 / np.log(10) * np.tan(np.radians(grid)) - fall * b * sees * (1 - sees)
            passed = np.flatnonzero((slope[1:] > 0.0) != (slope[:-1] > 0.0))
            found = turning(town)
            found = found[found > grid[0]]
            assert len(found) == len(passed), town
            assert np.abs(found - grid[passed]).max(initial=0.0) <= 1.1e-3
            counts.append(len(found))
        assert {1, 3} <= set(counts)

    def test_room_that_is_too_short_is_said(self):
        out = np.zeros(1)
        assert stationary_elevations(*TOWNS["high_rise"], out) == 3
        assert out[0] == pytest.approx(6.669199, abs=5e-7)
