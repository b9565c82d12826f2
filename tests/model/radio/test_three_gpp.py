"""TR 36.777: its formulas, evaluated apart, its bounds and rings, and where it does not hold."""

import math
from collections.abc import Iterator

import numpy as np
import pytest

from desim_uav.errors import ScenarioError
from desim_uav.model.radio.link import LinkBudget, LinkClass
from desim_uav.model.radio.path_loss import LOS, MEAN, NLOS
from desim_uav.model.radio.rings import rings
from desim_uav.model.radio.three_gpp import (
    HIGHEST_M,
    SITES,
    Aerial,
    d1_of,
    p1_of,
    share_in_sight,
    station_range_m,
)
from desim_uav.scenario.load import from_mapping
from tests.engine.random_aerial import unlike, world_of
from tests.engine.random_radio import audited
from tests.selection import by_default

RMA, UMA, UMI = Aerial("rma"), Aerial("uma"), Aerial("umi")
ALL = {"rma": RMA, "uma": UMA, "umi": UMI}


@pytest.mark.parametrize(
    "site, height_m, distance_m, share",
    [
        *((UMA, 50, 200, 0.967150), (UMA, 50, 500, 0.888749), (UMA, 50, 1000, 0.772052)),
        *((UMA, 50, 2000, 0.582954), (UMA, 50, 4000, 0.333356)),
        *((UMA, 100, 1000, 0.853310), (UMA, 100, 4000, 0.465695)),
        *((RMA, 30, 1000, 0.908744), (RMA, 30, 4000, 0.568093), (RMA, 40, 2000, 0.841166)),
        *((UMI, 50, 200, 0.735896), (UMI, 50, 500, 0.378936)),
        *((UMI, 100, 500, 0.546735), (UMI, 300, 1000, 0.420591)),
        *((UMA, 100.001, 4000, 1.0), (RMA, 41, 9000, 1.0), (UMA, 50, 81, 1.0)),
    ],
)
def test_probability_of_line_of_sight(site, height_m, distance_m, share):
    assert round(share_in_sight(site, float(distance_m), float(height_m)), 6) == share


@pytest.mark.parametrize(
    "site, height_m, p1_m, d1_m",
    [
        (UMA, 50.0, 3505.571019, 81.526202),
        (UMA, 100.0, 4800.0, 220.0),
        (UMI, 100.0, 467.01, 155.16),
        (RMA, 12.0, 1000.0, 18.0),
    ],
)
def test_parameters(site, height_m, p1_m, d1_m):
    values = p1_of(site, height_m), d1_of(site, height_m)
    assert [round(value, 6) for value in values] == [p1_m, d1_m]


@pytest.mark.parametrize(
    "site, height_m, distance_m, los_db, nlos_db",
    [
        (UMA, 50, 500, 93.409868, 113.035201),
        (UMA, 100, 1000, 100.047397, 117.001349),
        (UMA, 300, 2000, 106.732736, None),
        (RMA, 30, 1000, 102.186033, 107.976292),
        (RMA, 100, 3000, 109.050002, 111.306617),
        (RMA, 300, 5000, 112.453954, 112.453954),
        (UMI, 50, 200, 86.346088, 108.371752),
        (UMI, 100, 500, 94.420847, 114.185632),
    ],
)
def test_losses_at_2_ghz(site, height_m, distance_m, los_db, nlos_db):
    where = float(distance_m), float(height_m), 2.0
    assert round(site.los_db(*where), 6) == los_db
    if nlos_db is not None:
        assert round(site.nlos_db(*where), 6) == nlos_db
        share = share_in_sight(site, *where[:2])
        mean_db = share * los_db + (1.0 - share) * nlos_db
        assert site.mean_db(*where) == pytest.approx(mean_db, abs=1e-6)


def test_distances_are_in_space_from_the_stations_antenna():
    assert round(station_range_m(UMA, 500.0, 50.0), 4) == 500.6246
    assert [one.station_m for one in ALL.values()] == [35.0, 25.0, 10.0]
    assert station_range_m(UMA, 0.0, 25.0) == 1.0


def heights_of(site: Aerial) -> Iterator[float]:
    """Heights of the report, those where something changes among them."""
    low = site.above_m + 1e-6
    yield from (low, 25.0, 35.0, 40.0, 40.001, 60.0, 100.0, 100.001, 147.0, 220.0, HIGHEST_M)


@pytest.mark.parametrize("site", ALL.values(), ids=ALL)
def test_losses_rise_and_sight_falls_with_the_distance(site):
    distances = [0.0, *np.geomspace(0.5, 10_000.0, 500).tolist()]
    for height_m in heights_of(site):
        for values in (
            [site.los_db(d, height_m, 2.0) for d in distances],
            [site.nlos_db(d, height_m, 2.0) for d in distances],
            [site.mean_db(d, height_m, 2.0) for d in distances],
            [-share_in_sight(site, d, height_m) for d in distances],
        ):
            assert np.diff(values).min() > -1e-12


@pytest.mark.parametrize("site", ALL.values(), ids=ALL)
def test_a_class_holds_within_its_ring_and_nowhere_else(site):
    """Against 200,001 distances; the classes are 13 dB apart."""
    budget, classes = LinkBudget(10.0, 1.0), [LinkClass(13.0 * k, k + 1.0) for k in range(3)]
    distances = np.linspace(0.0, 10_000.0, 200_001)
    for height_m in (30.0, 90.0, 260.0):
        losses = np.array([site.mean_db(d, height_m, 2.0) for d in distances[::100].tolist()])
        means_m = rings(site, 2.0, height_m, budget, classes).mean_m
        for one, radius_m in zip(classes, means_m, strict=True):
            holds = budget.power_dbm - losses - budget.noise_dbm >= one.snr_db
            assert (holds == (distances[::100] <= radius_m)).all()


def near(random, place: tuple[float, float], within_m: float, site: Aerial, branch: int):
    """A place that is at most so far away, and at which the loss is defined."""
    turn, away_m = random.uniform(0.0, math.tau), within_m * math.sqrt(random.random())
    distance_m, height_m = place[0] + away_m * math.cos(turn), place[1] + away_m * math.sin(turn)
    always = site.always_m
    if not site.above_m < height_m <= HIGHEST_M or (
        branch == MEAN and (height_m > always) != (place[1] > always)
    ):
        height_m = place[1]
    return max(distance_m, 0.0), height_m


@pytest.mark.parametrize("site", ALL.values(), ids=ALL)
@pytest.mark.parametrize("branch", [MEAN, LOS, NLOS])
def test_no_level_changes_faster_than_its_bounds(site, branch):
    random = np.random.default_rng(branch)
    loss_db = (site.mean_db, site.los_db, site.nlos_db)[branch]
    for _ in range(1500):
        low_m = site.above_m + 1e-6
        high_m = random.choice([60.0, HIGHEST_M])
        place = 10.0 ** random.uniform(0.0, 3.8), random.uniform(low_m, high_m)
        within_m = math.hypot(*place) * 10.0 ** random.uniform(-4.0, 0.2)
        rates = site.rates(branch, *place, within_m)
        one, other = (near(random, place, within_m, site, branch) for _ in range(2))
        moves_m = other[0] - one[0], other[1] - one[1]
        ends = [(rates[2 * k] * moves_m[k], rates[2 * k + 1] * moves_m[k]) for k in range(2)]
        rise_db = loss_db(*one, 2.0) - loss_db(*other, 2.0)
        assert sum(map(min, ends)) - 1e-9 <= rise_db <= sum(map(max, ends)) + 1e-9


def scenario(site: str, sight: str = "mean", **levels: float) -> dict:
    """A scenario whose drones have this loss, at levels 40 m apart."""
    loss = {"kind": "tr36777", "environment": site}
    return {
        "map": {
            "size_m": [1200, 1200],
            "cells": [5, 5],
            "levels": {"min_altitude_m": 26, "step_m": 40, **levels},
            "obstacles": {"coverage": [0.1, 0.4], "height_m": [10, 70]},
        },
        "drones": {"radio": {"kind": "link_classes", "path_loss": loss, "line_of_sight": sight}},
        "users": {"max_height_m": 0},
    }


def changed(site: str, sight: str = "mean", **sections: dict) -> dict:
    made = scenario(site, sight)
    return made | {key: made.get(key, {}) | value for key, value in sections.items()}


POINT = {"at_m": [0, 0], "height_m": 25, "radio": scenario("uma")["drones"]["radio"]}


@pytest.mark.parametrize(
    "made, problem",
    [
        (
            scenario("uma", min_altitude_m=20),
            "heights above 22.5 m and up to 300 m, and levels are "
            "from 20 to 100 m; below, it refers to TR 38.901",
        ),
        (
            scenario("umi", step_m=275),
            "above 22.5 m and up to 300 m, and levels are from 26 to 301",
        ),
        (scenario("rma"), "the mean loss of rma jumps at 40 m, .* levels are from 26 to 106 m"),
        (scenario("uma"), "the mean loss of uma jumps at 100 m"),
        (scenario("uma", "buildings"), "no loss without line of sight for uma above 100 m"),
        (scenario("umi", "drawn"), "tells how likely line of sight is at an elevation"),
        (changed("umi", users={"max_height_m": 9}), "users are up to 9 m high; write users.max_he"),
        (changed("umi", map={"size_m": [4000, 30]}), "up to 4 km, and the map is 4 km from corner"),
        (scenario("umi") | {"access_points": [POINT]}, "uma is for drones: TR 36.777 has no links"),
    ],
)
def test_where_the_report_says_nothing(made, problem):
    with pytest.raises(ScenarioError, match=problem):
        from_mapping(made)


@pytest.mark.parametrize(
    "made",
    [
        scenario("umi"),
        scenario("umi", "buildings"),
        scenario("rma", "buildings"),
        scenario("rma", min_altitude_m=40.5),
        scenario("uma", step_m=37),
        scenario("uma", "buildings", step_m=37),
        scenario("uma", min_altitude_m=100.5),
    ],
)
def test_where_it_holds(made):
    assert from_mapping(made).drones.radio.path_loss.environment in SITES


def test_shadowing_needs_to_know_whether_there_is_sight():
    made = scenario("umi")
    made["drones"]["radio"]["shadowing"] = {"los_db": 4, "nlos_db": 8}
    with pytest.raises(ScenarioError, match="does not tell apart"):
        from_mapping(made)


@pytest.mark.parametrize("seed", by_default([0, 1], range(0, 40)))
def test_both_engines_are_equal_and_keep_the_rules(seed):
    world = world_of(seed)
    assert unlike(world, seed) == []
    audited(world)
