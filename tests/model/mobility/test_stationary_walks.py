"""Walks against the distributions that are known for them, each user an independent replication."""

from __future__ import annotations

import math
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from scipy import integrate, stats

from desim_uav.model.mobility import walking
from desim_uav.model.mobility.gauss_markov import GaussMarkov
from desim_uav.model.mobility.group import Group
from desim_uav.model.mobility.levy import Levy
from desim_uav.model.mobility.manhattan import Manhattan
from desim_uav.model.mobility.mobility import leaves_the_map
from desim_uav.model.mobility.random_waypoint import RandomWaypoint
from desim_uav.model.mobility.walks import Area
from desim_uav.model.random.distributions import mean_distance, mean_of_power_law, mean_slowness
from tests.verification.figure import Estimate, check
from tests.verification.mobility import (
    SQUARE,
    of_gauss_markov,
    of_groups,
    of_levy,
    of_manhattan,
    of_random_waypoint,
    under_way,
)
from tests.verification.walked import (
    US,
    legs_at,
    nth_legs,
    places_at,
    speeds_at,
    starts_of,
    velocities_of,
    walked,
)

SPEEDS = [((1.0, 19.0), 6.113219), ((1.0, 20.0), 6.342356), ((2.0, 2.0), 2.0)]
"""The mean speed in the long run, (v2 - v1) / ln(v2 / v1)."""


@pytest.fixture
def in_python(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let models be run by Python, since to compile them takes longer than to draw a few walks."""
    monkeypatch.setattr(walking, "compiled_walk", lambda mobility: None)


MODELS = [
    RandomWaypoint((0.5, 9.0)),
    GaussMarkov(5.0, 2.0, step_s=7.0),
    Manhattan(50.0),
    Group(3, 40.0, 20.0),
    Levy((3.0, 900.0), pause_s=(1.0, 90.0), speed_mps=6.0),
]


@pytest.mark.parametrize("start", ["stationary", "home"])
@pytest.mark.parametrize("model", MODELS, ids=lambda model: model.kind)
def test_walks_join_and_stay_on_the_map(model: RandomWaypoint, start: str, in_python: None):
    side_m, users, last_s = (300.0, 150.0), 12, 900.0
    walks = walked(replace(model, start=start), users, side_m, last_s)
    assert leaves_the_map(walks, Area(*side_m), int(last_s * US)) == ""
    for first, end in pairwise(walks.offsets):
        legs = walks.legs[first:end]
        lasts_s = np.diff(legs["begin_us"])[:, None] / US
        assert legs["begin_us"][0] == 0 and (lasts_s > 0).all()
        ends = starts_of(legs[:-1]) + velocities_of(legs[:-1]) * lasts_s
        assert ends == pytest.approx(starts_of(legs[1:]), abs=1e-3)
    expected = model.expected_legs(users, Area(*side_m), last_s)
    assert expected / 2 < len(walks.legs) < expected * 2


class TestMeans:
    def test_distances(self):
        unit = (2 + math.sqrt(2) + 5 * math.log(1 + math.sqrt(2))) / 15
        assert mean_distance(1.0, 1.0) == pytest.approx(unit, rel=1e-14)
        assert unit == pytest.approx(0.521405, abs=5e-7)
        assert mean_distance(3.0, 1e-5) == pytest.approx(1.0, rel=1e-9)
        assert mean_distance(2.0, 7.0) == mean_distance(7.0, 2.0)
        rng = np.random.default_rng(0)
        away = (rng.random((200_000, 2)) - rng.random((200_000, 2))) * (2.0, 7.0)
        check([Estimate.of("2 x 7", np.hypot(*away.T), mean_distance(2.0, 7.0))])

    @pytest.mark.parametrize(("speeds", "mean"), SPEEDS)
    def test_speeds(self, speeds: tuple[float, float], mean: float):
        assert 1.0 / mean_slowness(*speeds) == pytest.approx(mean, abs=5e-7)

    @pytest.mark.parametrize("exponent", [-3.5, -2.0, -1.0, -0.999999999999, 0.0, 1.0])
    def test_power_laws(self, exponent: float):
        whole, first = (
            integrate.quad(lambda x, k=k: x ** (exponent + k), 3.0, 50.0)[0] for k in (0, 1)
        )
        assert mean_of_power_law(3.0, 50.0, exponent) == pytest.approx(first / whole, rel=1e-9)


# ---- random waypoint


@pytest.mark.thorough
@pytest.mark.parametrize(("speeds", "mean"), SPEEDS[:2])
def test_the_speed_of_random_waypoint_does_not_decay(speeds: tuple[float, float], mean: float):
    walks = walked(RandomWaypoint(speeds, (0.0, 0.0)), 5000, SQUARE, 1500.0)
    times = (0.0, 40.0, 400.0, 1500.0)
    check(Estimate.of(f"speed at {t:g} s", speeds_at(walks, t), mean) for t in times)


def test_without_a_stationary_start_it_decays():
    """It begins with the mean of the range, and comes down to that of the long run."""
    model = RandomWaypoint((1.0, 19.0), (0.0, 0.0), start="home")
    walks = walked(model, 5000, SQUARE, 4000.0)
    check(
        [
            Estimate.of("speed at 0 s", speeds_at(walks, 0.0), 10.0),
            Estimate.of("speed at 4000 s", speeds_at(walks, 4000.0), 6.113219),
        ]
    )
    decay = [speeds_at(walks, t).mean() for t in (0.0, 30.0, 100.0, 300.0)]
    assert all(later < sooner - 0.2 for sooner, later in pairwise(decay))


def test_ways_are_as_long_as_those_between_uniform_points():
    model = RandomWaypoint((1.0, 19.0), (0.0, 0.0), start="home")
    legs, lasts_s = nth_legs(walked(model, 10_000, SQUARE, 9000.0), 1)
    lengths = np.hypot(legs["vx_mps"], legs["vy_mps"]) * lasts_s
    speeds = np.hypot(legs["vx_mps"], legs["vy_mps"])
    check([Estimate.of("length", lengths, 521.405433), Estimate.of("speed", speeds, 10.0)])
    assert stats.kstest(speeds, stats.uniform(1.0, 18.0).cdf).pvalue > 1e-3


@pytest.mark.thorough
def test_random_waypoint_with_pauses():
    check(of_random_waypoint(20_000))


@pytest.mark.parametrize("t_s", [0.0, 1000.0])
def test_on_a_line_places_have_the_known_density(t_s: float):
    """On a line of length 1 it is 6 x (1 - x)."""
    walks = walked(RandomWaypoint((5.0, 9.0), (0.0, 0.0)), 5000, (1000.0, 0.01), 1000.0)
    places = places_at(walks, t_s)[:, 0] / 1000.0
    assert stats.kstest(places, stats.beta(2, 2).cdf).pvalue > 1e-3


# ---- Gauss-Markov


@pytest.mark.thorough
def test_gauss_markov():
    check(of_gauss_markov(10_000))


# ---- Manhattan


def blocks(walks: object, t_s: float, street_m: float) -> np.ndarray:
    """The middle of the block that each user is on, in halves of a block."""
    legs = walks.legs[legs_at(walks, t_s)]
    places = places_at(walks, t_s) / street_m
    along_x = legs["vx_mps"] != 0.0
    twice = np.rint(2.0 * places).astype(int)
    middle = 2 * np.floor(places).astype(int) + 1
    return np.where(np.column_stack([along_x, ~along_x]), middle, twice)


@pytest.mark.thorough
@pytest.mark.parametrize("t_s", [0.0, 300.0, 2000.0])
def test_users_are_uniform_on_streets(t_s: float):
    walks = walked(Manhattan(100.0, (1.0, 19.0)), 20_000, (400.0, 300.0), 2000.0)
    assert ((walks.legs["vx_mps"] == 0.0) != (walks.legs["vy_mps"] == 0.0)).all()
    _, counts = np.unique(blocks(walks, t_s, 100.0), axis=0, return_counts=True)
    assert len(counts) == 4 * 4 + 3 * 5
    assert stats.chisquare(counts).pvalue > 1e-3
    legs = walks.legs[legs_at(walks, t_s)]
    check(
        [
            Estimate.of("speed", speeds_at(walks, t_s), 6.113219),
            Estimate.of("to the east", np.sign(legs["vx_mps"]), 0.0),
            Estimate.of("to the north", np.sign(legs["vy_mps"]), 0.0),
        ]
    )
    within = (places_at(walks, t_s) / 100.0)[legs["vx_mps"] != 0.0][:, 0] % 1.0
    assert stats.kstest(within, "uniform").pvalue > 1e-3


def test_turns_at_crossings(in_python: None):
    """One half straight on, a quarter to each side; back where the draw leads off the map."""
    users = 2000
    model = Manhattan(100.0, (2.0, 2.0), start="home")
    walks = walked(model, users, (400.0, 300.0), 300.0)
    legs, _ = nth_legs(walks, 3)
    after, _ = nth_legs(walks, 4)
    at, way, next_way = (
        starts_of(after),
        np.sign(velocities_of(legs)),
        np.sign(velocities_of(after)),
    )
    ahead = (way * next_way).sum(axis=1)
    left = way[:, 0] * next_way[:, 1] - way[:, 1] * next_way[:, 0]
    inner = ((at > 1.0) & (at < np.array([399.0, 299.0]))).all(axis=1)
    assert not (ahead[inner] < 0).any()
    corner = ((at < 1.0) | (at > np.array([399.0, 299.0]))).all(axis=1)
    check(
        [
            Estimate.of("straight on", ahead[inner] > 0, 0.5),
            Estimate.of("to the left", left[inner] > 0, 0.25),
            Estimate.of("to the right", left[inner] < 0, 0.25),
            Estimate.of("back at a corner", ahead[corner] < 0, 0.75),
        ]
    )
    first, _ = nth_legs(walks, 0)
    to = starts_of(walks.legs[walks.offsets[:-1] + 1])
    away = np.abs(starts_of(first) - np.rint(starts_of(first) / 100.0) * 100.0)
    assert np.abs(to - starts_of(first)).sum(axis=1) == pytest.approx(away.min(axis=1), abs=1e-9)


# ---- groups


@pytest.mark.thorough
def test_leaders_walk_on_random_waypoints():
    """Who keeps no distance walks as its leader does; here each user has one."""
    users = 10_000
    model = Group(users, 0.0, 1e5, (1.0, 19.0), (0.0, 0.0))
    walks = walked(model, users, SQUARE, 1500.0)
    times = (0.0, 40.0, 1500.0)
    check(Estimate.of(f"speed at {t:g} s", speeds_at(walks, t), 6.113219) for t in times)
    theory = under_way(SQUARE, 4_000_000)[0]
    away2 = {t: (places_at(walks, t)[:, 0] - 500.0) ** 2 for t in times}
    check(Estimate.of(f"place at {t:g} s", away2[t], theory) for t in times)
    together = walked(Group(3, 0.0, 60.0), 30, SQUARE, 1500.0)
    for t in times:
        places = places_at(together, t).reshape(10, 3, 2)
        assert np.allclose(places, places[:1], atol=1e-4)
        assert len(np.unique(places[0].round(3), axis=0)) == 3


@pytest.mark.thorough
def test_shares_at_the_edge_and_distances_of_members():
    check(of_manhattan(10_000))
    check(of_groups(4000))


@pytest.mark.thorough
@pytest.mark.parametrize("start", ["stationary", "home"])
def test_members_keep_within_the_disc(start: str):
    """Each group is a replication: two members, each uniform in the disc at the ends of steps.

    Leaders pause in all that time, or walk for ever if their map is large and they are slow.
    """
    groups, radius_m = 5000, 40.0
    for speeds, pause_s in (((0.01, 0.01), (0.0, 0.0)), ((5.0, 9.0), (900.0, 900.0))):
        model = Group(groups, radius_m, 10.0, speeds, pause_s, start=start)
        walks = walked(model, 2 * groups, SQUARE, 600.0)
        apart = {}
        for t in (0.0, 10.0, 15.0, 200.0, 205.0, 437.7):
            places = places_at(walks, t).reshape(2, groups, 2)
            assert places.min() >= 0.0 and places.max() <= 1000.0
            apart[t] = np.hypot(*(places[0] - places[1]).T)
            if t > 0.0 or start == "stationary":
                assert apart[t].max() <= (2.0 * radius_m if t >= 10.0 or start != "home" else 1e9)
        if speeds[0] < 1.0:
            check(
                [
                    Estimate.of("at the end of a step", apart[10.0] ** 2, radius_m**2),
                    Estimate.of("at the end of a step", apart[200.0] ** 2, radius_m**2),
                    Estimate.of("in the middle of a step", apart[205.0] ** 2, radius_m**2 / 2),
                ]
            )


# ---- Lévy


@pytest.mark.thorough
def test_levy():
    check(of_levy(10_000))
