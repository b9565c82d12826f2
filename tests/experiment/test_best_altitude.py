"""The best altitude after Al-Hourani, Kandeepan and Lardner."""

from itertools import pairwise
from math import log10, radians, tan

import pytest

from desim_uav.experiment.papers.best_altitude import (
    best_coverage,
    coverage_at,
    optimal_elevation_deg,
    stationary_elevations_deg,
)
from desim_uav.model.radio.path_loss import SPEED_OF_LIGHT_MPS, AlHourani
from desim_uav.model.radio.rings import ring_m

NAMES = ("suburban", "urban", "dense_urban", "high_rise")
ELEVATIONS = (20.338708, 42.438557, 54.619150, 75.518762)
BEST = {
    100.0: (
        *((1089.0506, 403.6887), (706.5488, 646.0401)),
        *((448.0749, 630.9491), (60.6681, 234.9035)),
    ),
    103.0: (
        *((1538.3248, 570.2254), (998.0267, 912.5560)),
        *((632.9226, 891.2393), (85.6960, 331.8101)),
    ),
    110.0: (
        *((3443.8803, 1276.5756), (2234.3034, 2042.9583)),
        *((1416.9371, 1995.2362), (191.8495, 742.8302)),
    ),
}


@pytest.mark.parametrize("name, elevation", list(zip(NAMES, ELEVATIONS, strict=True)))
def test_optimal_elevations(name, elevation):
    assert round(optimal_elevation_deg(AlHourani(name)), 6) == elevation


def test_another_common_b_is_another_angle():
    model = AlHourani(a=4.88, b=0.429, eta_los_db=0.1, eta_nlos_db=21.0)
    assert round(optimal_elevation_deg(model), 6) == 20.365820


def test_the_high_rise_environment_has_three_stationary_elevations():
    found = stationary_elevations_deg(AlHourani("high_rise"))
    assert [round(angle, 3) for angle in found] == [6.669, 23.732, 75.519]
    assert all(len(stationary_elevations_deg(AlHourani(name))) == 1 for name in NAMES[:3])


@pytest.mark.parametrize("name", NAMES)
def test_a_climb_is_monotone_between_stationary_elevations(name):
    """At a fixed distance, the loss turns where the elevation is stationary, and only there."""
    model = AlHourani(name)
    angles = [0.5 * k for k in range(2, 179)]
    losses = [model.mean_db(500.0, 500.0 * tan(radians(angle)), 2.0) for angle in angles]
    turns = stationary_elevations_deg(model)
    rising = [later > before for before, later in pairwise(losses)]
    found = [angles[k + 1] for k, (one, other) in enumerate(pairwise(rising)) if one is not other]
    assert found == pytest.approx(turns, abs=0.51)


@pytest.mark.parametrize("largest_db", BEST)
@pytest.mark.parametrize("k", range(4))
def test_best_radius_and_height(largest_db, k):
    found = best_coverage(AlHourani(NAMES[k]), largest_db, 2.0)
    assert (round(found.radius_m, 4), round(found.height_m, 4)) == BEST[largest_db][k]


@pytest.mark.parametrize("name", NAMES)
def test_the_radius_is_the_ring_at_this_height_and_no_other_height_has_a_larger_one(name):
    model = AlHourani(name)
    best = best_coverage(model, 103.0, 2.0)

    def radius(height_m):
        return ring_m(lambda r: model.mean_db(r, height_m, 2.0), 103.0)

    assert radius(best.height_m) == pytest.approx(best.radius_m, abs=1e-5)
    for share in (0.1, 0.5, 0.99, 1.01, 1.5):
        assert radius(share * best.height_m) < best.radius_m
        assert coverage_at(model, share * best.elevation_deg, 103.0, 2.0).radius_m < best.radius_m


@pytest.mark.parametrize(
    "radius_m, height_m, power_dbm",
    [(500.0, 311.730, -14.788), (1000.0, 623.459, -8.768), (1500.0, 935.189, -5.246)],
)
def test_the_least_power_for_a_radius(radius_m, height_m, power_dbm):
    """Mozaffari et al. 2015: noise of -120 dBm, a threshold of 10 dB, 2 GHz."""
    model = AlHourani(a=9.6, b=0.28, eta_los_db=1.0, eta_nlos_db=20.0)
    at_100_db = best_coverage(model, 100.0, 2.0)
    assert round(at_100_db.elevation_deg, 6) == 31.941849
    assert round(radius_m * at_100_db.height_m / at_100_db.radius_m, 3) == height_m
    with_c_of_3e8_db = 20.0 * log10(SPEED_OF_LIGHT_MPS / 3e8)  # as the figures were computed
    loss_db = model.mean_db(radius_m, height_m, 2.0) + with_c_of_3e8_db
    assert round(loss_db - 120.0 + 10.0, 3) == power_dbm
