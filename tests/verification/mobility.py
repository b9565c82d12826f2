"""Walks and arrivals against the distributions that are known for them in the long run."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from itertools import pairwise
from typing import Any

import numpy as np
from scipy import integrate

from desim_uav.model.demand.day_profile import DayProfile
from desim_uav.model.mobility.gauss_markov import GaussMarkov
from desim_uav.model.mobility.group import Group
from desim_uav.model.mobility.levy import Levy
from desim_uav.model.mobility.manhattan import Manhattan
from desim_uav.model.mobility.random_waypoint import RandomWaypoint
from tests.verification.demand import DUE, US, ask
from tests.verification.figure import Estimate, Figure
from tests.verification.walked import (
    legs_at,
    nth_legs,
    places_at,
    speeds_at,
    starts_of,
    velocities_of,
    walked,
)

SQUARE = (1000.0, 1000.0)
HOUR_S = 3600.0
MORNING = ((6.0, 4.0), (8.5, 30.0), (12.0, 0.0), (17.0, 18.0), (22.0, 1.0))
NIGHT = ((0.0, 9.0), (5.0, 0.0), (20.0, 3.0))


def figures(quick: bool = False) -> Iterator[Figure]:
    """A replication a user, or a group; counts of arrivals a replication a user."""
    users = 4000 if quick else 20_000
    yield from of_random_waypoint(users)
    yield from of_gauss_markov(users // 2)
    yield from of_manhattan(users)
    yield from of_groups(users // 4)
    yield from of_levy(users // 2)
    for shape in ("steps", "linear"):
        yield from of_profiles(users // 10, shape)


def under_way(side_m: tuple[float, float], users: int) -> tuple[float, float]:
    """The mean squared distances to the middle along x and y, by a sampler of its own.

    It draws ways without rejection and weighs them by their lengths.
    """
    rng = np.random.default_rng(12)
    begin, end = rng.uniform(0.0, side_m, (2, users, 2))
    place = begin + rng.random((users, 1)) * (end - begin) - np.array(side_m) / 2
    weights = np.hypot(*(end - begin).T)
    return tuple((weights[:, None] * place**2).sum(axis=0) / weights.sum())


def of_random_waypoint(users: int) -> Iterator[Figure]:
    """Pauses, speeds and places of the stationary start, now and later."""
    low, high = 10.0, 190.0
    walks = walked(RandomWaypoint((1.0, 19.0), (low, high)), users, SQUARE, 4000.0)
    moves_s, rests_s = 521.405433 * math.log(19.0) / 18.0, 100.0
    theory = under_way(SQUARE, 4_000_000)
    for t in (0.0, 900.0, 2500.0):
        speeds = speeds_at(walks, t)
        share = rests_s / (rests_s + moves_s)
        yield Estimate.of(f"random waypoint: share that pauses, {t:g} s", speeds == 0.0, share)
        yield Estimate.of(
            f"random waypoint: speed of who walks, m/s, {t:g} s", speeds[speeds > 0.0], 6.113219
        )
        resting = legs_at(walks, t)[speeds == 0.0]
        rest_s = walks.legs["begin_us"][resting + 1] / US - t
        squares = (high**3 - low**3) / (3.0 * (high - low))
        yield Estimate.of(
            f"random waypoint: rest of a pause, s, {t:g} s", rest_s, squares / (2.0 * rests_s)
        )
        walking = places_at(walks, t)[speeds > 0.0]
        for axis in (0, 1):
            away2 = (walking[:, axis] - 500.0) ** 2
            yield Estimate.of(
                f"random waypoint: squared distance to the middle, m², axis {axis}, {t:g} s",
                away2,
                theory[axis],
            )


def of_gauss_markov(users: int) -> Iterator[Figure]:
    """Speeds and headings far from any edge, and places on a small map."""
    alpha, sigma = 0.85, math.radians(30.0)
    model = GaussMarkov(10.0, 1.0, 30.0, alpha, 5.0, start="home")
    walks = walked(model, users, (1e6, 1e6), 100.0)
    legs = [walks.legs[legs_at(walks, 5.0 * k + 2.5)] for k in range(20)]
    speeds = [np.hypot(leg["vx_mps"], leg["vy_mps"]) - 10.0 for leg in legs]
    for k in (0, 1, 19):
        yield Estimate.of(f"Gauss-Markov: speed in step {k}, m/s", speeds[k] + 10.0, 10.0)
        yield Estimate.of(f"Gauss-Markov: variance of the speed in step {k}", speeds[k] ** 2, 1.0)
    for k in (1, 2, 3):
        together = speeds[4] * speeds[4 + k]
        yield Estimate.of(
            f"Gauss-Markov: autocorrelation of the speed, {k} steps", together, alpha**k
        )
        one, other = (np.arctan2(leg["vy_mps"], leg["vx_mps"]) for leg in (legs[4], legs[4 + k]))
        turned = math.exp(-(sigma**2) * (1.0 - alpha**k))
        yield Estimate.of(
            f"Gauss-Markov: cosine of the turn in {k} steps", np.cos(one - other), turned
        )
    small = walked(GaussMarkov(10.0, 3.0, 30.0, alpha, 5.0), users, (300.0, 100.0), 500.0)
    for t in (0.0, 500.0):
        places = places_at(small, t) / (300.0, 100.0)
        for axis in (0, 1):
            yield Estimate.of(f"Gauss-Markov: place, axis {axis}, {t:g} s", places[:, axis], 0.5)
            yield Estimate.of(
                f"Gauss-Markov: place squared, axis {axis}, {t:g} s",
                places[:, axis] ** 2,
                1.0 / 3.0,
            )
        velocities = velocities_of(small.legs[legs_at(small, t)])
        for axis in (0, 1):
            yield Estimate.of(
                f"Gauss-Markov: velocity, axis {axis}, {t:g} s", velocities[:, axis], 0.0
            )


def of_manhattan(users: int) -> Iterator[Figure]:
    """Of 31 blocks of a map of 4 x 3, 14 lie on its edge; speeds are drawn for each block."""
    walks = walked(Manhattan(100.0, (1.0, 19.0)), users, (400.0, 300.0), 2000.0)
    for t in (0.0, 300.0, 2000.0):
        places, legs = places_at(walks, t), walks.legs[legs_at(walks, t)]
        at_edge = (places[:, 0] < 1e-6) | (places[:, 0] > 400.0 - 1e-6)
        at_edge = np.where(legs["vx_mps"] == 0.0, at_edge, False)
        below = (places[:, 1] < 1e-6) | (places[:, 1] > 300.0 - 1e-6)
        at_edge |= np.where(legs["vy_mps"] == 0.0, below, False)
        yield Estimate.of(f"Manhattan: share at the edge, {t:g} s", at_edge, 14.0 / 31.0)
        yield Estimate.of(f"Manhattan: speed, m/s, {t:g} s", speeds_at(walks, t), 6.113219)
        yield Estimate.of(f"Manhattan: way along x, {t:g} s", np.sign(legs["vx_mps"]), 0.0)


def of_groups(groups: int) -> Iterator[Figure]:
    """Two members of each group; the leader of one of them that keeps no distance."""
    radius_m = 40.0
    walks = walked(
        Group(groups, radius_m, 10.0, (0.01, 0.01), (0.0, 0.0)), 2 * groups, SQUARE, 300.0
    )
    for t, theory in ((0.0, 1.0), (200.0, 1.0), (205.0, 0.5)):
        one, other = places_at(walks, t).reshape(2, groups, 2)
        apart = ((one - other) ** 2).sum(axis=1) / radius_m**2
        yield Estimate.of(f"group: squared distance of members / radius², {t:g} s", apart, theory)
    walks = walked(Group(groups, 0.0, 1e5, (1.0, 19.0), (0.0, 0.0)), groups, SQUARE, 1500.0)
    for t in (0.0, 1500.0):
        yield Estimate.of(f"group: speed of leaders, m/s, {t:g} s", speeds_at(walks, t), 6.113219)


def moment(low: float, high: float, exponent: float, power: int) -> float:
    whole, part = (
        integrate.quad(lambda x, k=k: x ** (k - 1.0 - exponent), low, high, limit=400)[0]
        for k in (0, power)
    )
    return part / whole


def of_levy(users: int) -> Iterator[Figure]:
    """Flights and pauses as drawn, and what is under way in the long run."""
    flights = Levy((5.0, 5e5), 1.5, (3e4, 3e4), 1.0, 200.0, start="home")
    legs, lasts_s = nth_legs(walked(flights, users, (1e6, 1e6), 3e4), 0)
    inner = (np.abs(starts_of(legs) - 5e5) < 2e5).all(axis=1)  # whose flights meet no edge soon
    lengths = np.hypot(legs["vx_mps"], legs["vy_mps"]) * lasts_s
    cut = np.log(np.minimum(lengths[inner], 2e5) / 5.0)
    yield Estimate.of("Lévy: Hill: 1 / tail exponent", cut, (1.0 - (2e5 / 5.0) ** -1.5) / 1.5)
    model = Levy((5.0, 300.0), 0.8, (3.0, 90.0), 1.2, 4.0)
    walks = walked(model, users, (200.0, 150.0), 900.0)
    flight_s, pause_s = moment(5.0, 300.0, 0.8, 1) / 4.0, moment(3.0, 90.0, 1.2, 1)
    rest_s = moment(3.0, 90.0, 1.2, 2) / (2.0 * pause_s)
    for t in (0.0, 100.0, 700.0):
        speeds, places = speeds_at(walks, t), places_at(walks, t) / (200.0, 150.0)
        yield Estimate.of(
            f"Lévy: share that walks, {t:g} s", speeds > 0, flight_s / (flight_s + pause_s)
        )
        resting = legs_at(walks, t)[speeds == 0.0]
        yield Estimate.of(
            f"Lévy: rest of a pause, s, {t:g} s",
            walks.legs["begin_us"][resting + 1] / US - t,
            rest_s,
        )
        for axis in (0, 1):
            yield Estimate.of(f"Lévy: place, axis {axis}, {t:g} s", places[:, axis], 0.5)
            yield Estimate.of(
                f"Lévy: place squared, axis {axis}, {t:g} s", places[:, axis] ** 2, 1.0 / 3.0
            )
    # The rest of the flight under way at the start, whose parts between edges are put together.
    lengths = np.zeros(users)
    flies = speeds_at(walks, 0.0) > 0.0
    for user in np.flatnonzero(flies):
        own = walks.legs[walks.offsets[user] : walks.offsets[user + 1]]
        ends = np.flatnonzero(own["vx_mps"] == 0.0)[0]
        lengths[user] = 4.0 * own["begin_us"][ends] / US
    theory = moment(5.0, 300.0, 0.8, 2) / (2.0 * moment(5.0, 300.0, 0.8, 1))
    yield Estimate.of("Lévy: rest of a flight, m, 0 s", lengths[flies], theory)


def rate_of(profile: Any, shape: str) -> Callable[[float], float]:
    """The rate per hour at an hour, written once more: three days of points, interpolated."""
    hours = [h + 24.0 * day for day in range(-1, 4) for h, _ in profile]
    rates = [rate for _ in range(-1, 4) for _, rate in profile]

    def rate(hour: float) -> float:
        if shape == "linear":
            return float(np.interp(hour, hours, rates))
        return rates[int(np.searchsorted(hours, hour, side="right")) - 1]

    return rate


def passed(profile: Any, shape: str, begin_h: float, end_h: float) -> float:
    """The mean number of arrivals between two hours, by quadrature from corner to corner."""
    rate = rate_of(profile, shape)
    corners = [h + 24.0 * day for day in range(4) for h, _ in profile]
    cuts = [begin_h, *(c for c in sorted(corners) if begin_h < c < end_h), end_h]
    parts = (integrate.quad(rate, a + 1e-12, b - 1e-12)[0] for a, b in pairwise(cuts))
    return math.fsum(parts)


def of_profiles(users: int, shape: str) -> Iterator[Figure]:
    """Counts in hours and half hours of a day and a half, for users of two hotspots."""
    begins_h = 7.25
    model = DayProfile((MORNING, NIGHT), shape, begins_h)
    rows, follow = ask(model, 2 * users, seed=5, horizon_us=int(36 * HOUR_S * US))
    assert not follow
    for which, profile in enumerate((MORNING, NIGHT)):
        own = [np.array(each[:, DUE]) / US / HOUR_S + begins_h for each in rows[which::2]]
        for begin, end in ((7.25, 8.25), (8.25, 8.75), (11.5, 13.0), (20.0, 26.0), (29.0, 33.0)):
            counts = np.array([((t >= begin) & (t < end)).sum() for t in own])
            mean = passed(profile, shape, begin, end)
            name = f"profile, {shape}, hotspot {which}, hours {begin:g} to {end:g}"
            if mean < 1e-9:
                assert counts.sum() == 0
                continue
            yield Estimate.of(f"{name}: mean", counts, mean)
            yield Estimate.of(f"{name}: variance", (counts - mean) ** 2, mean)
        one = np.array([((t >= 7.5) & (t < 9.5)).sum() for t in own])
        other = np.array([((t >= 9.5) & (t < 11.0)).sum() for t in own])
        if one.any() and other.any():
            apart = (passed(profile, shape, *span) for span in ((7.5, 9.5), (9.5, 11.0)))
            together = (one - next(apart)) * (other - next(apart))
            yield Estimate.of(
                f"profile, {shape}, hotspot {which}: covariance of two spans", together, 0.0
            )
