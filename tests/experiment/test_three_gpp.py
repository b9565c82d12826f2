"""TR 36.777: its formulas, evaluated apart, and where they do not hold."""

import math

import pytest

from desim_uav.experiment.papers.three_gpp import RMA_AV, SCENARIOS, UMA_AV, UMI_AV


@pytest.mark.parametrize(
    "scenario, height_m, distance_m, share",
    [
        *((UMA_AV, 50, 200, 0.967150), (UMA_AV, 50, 500, 0.888749), (UMA_AV, 50, 1000, 0.772052)),
        *((UMA_AV, 50, 2000, 0.582954), (UMA_AV, 50, 4000, 0.333356)),
        *((UMA_AV, 100, 1000, 0.853310), (UMA_AV, 100, 4000, 0.465695)),
        *((RMA_AV, 30, 1000, 0.908744), (RMA_AV, 30, 4000, 0.568093), (RMA_AV, 40, 2000, 0.841166)),
        *((UMI_AV, 50, 200, 0.735896), (UMI_AV, 50, 500, 0.378936)),
        *((UMI_AV, 100, 500, 0.546735), (UMI_AV, 300, 1000, 0.420591)),
        *((UMA_AV, 100.001, 4000, 1.0), (RMA_AV, 41, 9000, 1.0), (UMA_AV, 50, 81, 1.0)),
    ],
)
def test_probability_of_line_of_sight(scenario, height_m, distance_m, share):
    assert round(scenario.p_los(float(distance_m), float(height_m)), 6) == share


@pytest.mark.parametrize(
    "scenario, height_m, p1_m, d1_m",
    [
        (UMA_AV, 50.0, 3505.571019, 81.526202),
        (UMA_AV, 100.0, 4800.0, 220.0),
        (UMI_AV, 100.0, 467.01, 155.16),
        (RMA_AV, 12.0, 1000.0, 18.0),
    ],
)
def test_parameters(scenario, height_m, p1_m, d1_m):
    assert [round(x, 6) for x in scenario.sight(height_m)] == [p1_m, d1_m]


@pytest.mark.parametrize(
    "scenario, height_m, distance_m, los_db, nlos_db",
    [
        (UMA_AV, 50, 500, 93.409868, 113.035201),
        (UMA_AV, 100, 1000, 100.047397, 117.001349),
        (UMA_AV, 300, 2000, 106.732736, None),
        (RMA_AV, 30, 1000, 102.186033, 107.976292),
        (RMA_AV, 100, 3000, 109.050002, 111.306617),
        (RMA_AV, 300, 5000, 112.453954, 112.453954),
        (UMI_AV, 50, 200, 86.346088, 108.371752),
        (UMI_AV, 100, 500, 94.420847, 114.185632),
    ],
)
def test_losses_at_2_ghz(scenario, height_m, distance_m, los_db, nlos_db):
    where = float(distance_m), float(height_m), 2.0
    assert round(scenario.los_db(*where), 6) == los_db
    if nlos_db is not None:
        assert round(scenario.nlos_db(*where), 6) == nlos_db


def test_distances_are_in_space_from_the_stations_antenna():
    assert round(UMA_AV.slant_m(500.0, 50.0), 4) == 500.6246
    assert [one.station_m for one in SCENARIOS.values()] == [35.0, 25.0, 10.0]


def test_shadowing():
    assert round(UMA_AV.sigma_los_db(50.0), 6) == 3.335806
    assert round(UMA_AV.sigma_los_db(100.0), 6) == 2.398190
    assert UMI_AV.sigma_los_db(300.0) == 2.0
    assert RMA_AV.sigma_los_db(100.0) == 4.2 * math.exp(-0.46)
    assert [one.sigma_nlos_db(30.0) for one in SCENARIOS.values()] == [6.0, 6.0, 8.0]


@pytest.mark.parametrize(
    "ask, problem",
    [
        (lambda: RMA_AV.p_los(100.0, 10.0), "RMa-AV: the height must be above 10 m .* TR 38.901"),
        (lambda: UMA_AV.los_db(100.0, 22.5, 2.0), "UMa-AV: the height must be above 22.5 m"),
        (lambda: UMI_AV.nlos_db(100.0, 301.0, 2.0), "UMi-AV: .* at most 300 m, not 301 m$"),
        (lambda: UMA_AV.nlos_db(100.0, 100.5, 2.0), "UMa-AV: .* at most 100 m, not 100.5 m$"),
        (lambda: RMA_AV.sigma_nlos_db(41.0), "RMa-AV: .* at most 40 m, not 41 m$"),
        (lambda: RMA_AV.los_db(10_001.0, 50.0, 2.0), "RMa-AV: the horizontal distance .* 10000 m"),
        (lambda: UMA_AV.los_db(4_001.0, 50.0, 2.0), "UMa-AV: the horizontal distance .* 4000 m"),
        (lambda: UMA_AV.los_db(0.0, 25.0, 2.0), "UMa-AV: there is no loss at the station's own"),
        (lambda: UMI_AV.p_los(-1.0, 50.0), "UMi-AV: the horizontal distance"),
        (lambda: UMI_AV.p_los(1.0, math.nan), "UMi-AV: the height must be"),
        (lambda: UMI_AV.p_los(math.nan, 50.0), "UMi-AV: the horizontal distance"),
    ],
)
def test_where_the_report_says_nothing(ask, problem):
    with pytest.raises(ValueError, match=problem):
        ask()


@pytest.mark.parametrize("scenario", SCENARIOS.values(), ids=SCENARIOS)
def test_losses_rise_and_sight_falls_with_the_distance(scenario):
    distances = [10.0 * k for k in range(1, 400)]
    for height_m in (25.0, 50.0, 99.0):
        for values in (
            [scenario.los_db(d, height_m, 2.0) for d in distances],
            [scenario.nlos_db(d, height_m, 2.0) for d in distances],
            [-scenario.p_los(d, height_m) for d in distances],
        ):
            assert values == sorted(values)
