"""What does not fit is lost: Erlang's formula, through a loss admission of a user's own."""

from __future__ import annotations

import math
from statistics import fmean

import numpy as np
import pytest
from scipy import stats

from desim_uav.model.rules import Outcome
from tests.engine.helpers import US, events, fly, path_of, seen, strip
from tests.selection import at_length
from tests.verification.demand import (
    LOSS,
    blocking,
    engset,
    erlang,
    erlang_b,
    hovered,
    under_one_drone,
)
from tests.verification.figure import check

# ---- by hand


def test_what_does_not_fit_at_once_is_refused():
    # Two units. User 2 finds none free, user 3 one that has become free in that very instant.
    world = strip(users=[(120, 120)] * 4, steps=1, drones={"admission": LOSS}, bandwidth_kbps=200)
    asks = {0: [(0, 30, 100)], 1: [(10, 30, 100)], 2: [(20, 30, 100)], 3: [(30, 20, 100)]}
    log = fly(world, path_of(world, asks))
    assert seen(log, "serve", "refuse", "complete") == events("""
               0  7  serve     0  0  0
        10000000  7  serve     0  1  1
        20000000  7  refuse    0  2  2
        30000000  1  complete  0  0  0
        30000000  7  serve     0  3  3
        40000000  1  complete  0  1  1
        50000000  1  complete  0  3  3
    """)
    refused = log.requests[2]
    assert (refused.outcome, refused.served_us) == (Outcome.NEVER_SERVED, 0)
    assert refused.t_end_us == refused.t_request_us == 20 * US


def test_a_refused_user_thinks_and_asks_again():
    world = strip(users=[(120, 120)] * 2, steps=1, drones={"admission": LOSS}, bandwidth_kbps=100)
    asks = {0: [(0, 30, 100)], 1: [(5, 10, 100), (12, 10, 100), (15, 10, 100)]}
    log = fly(world, path_of(world, asks, thinking=True))
    assert seen(log, "request", "refuse", "serve") == events("""
               0  5  request  -  0  0
               0  7  serve    0  0  0
         5000000  5  request  -  1  1
         5000000  7  refuse   0  1  1
        17000000  5  request  -  1  2
        17000000  7  refuse   0  1  2
        32000000  5  request  -  1  3
        32000000  7  serve    0  1  3
    """)


def test_two_arrivals_of_one_instant_are_one_request_though_the_first_is_refused():
    # Arrivals are of phase 5, the refusal of phase 7: the second finds the first one open.
    world = strip(users=[(120, 120)] * 2, steps=1, drones={"admission": LOSS}, bandwidth_kbps=100)
    log = fly(world, path_of(world, {0: [(0, 30, 100)], 1: [(5, 10, 100), (5, 10, 100)]}))
    assert log.suppressed == 1
    assert len(log.requests) == 2


# ---- Erlang B


def test_the_formula():
    assert erlang_b(7, 10) == pytest.approx(0.0787408830, abs=5e-11)
    assert engset(20_000, 7, 10) == pytest.approx(0.0787408830, rel=2e-3)


@pytest.mark.parametrize(
    ("users", "expected"),
    [pytest.param(1000, 0.0764929, marks=pytest.mark.thorough), (40, 0.0325576)],
)
def test_blocking_is_what_engset_says_of_some_users(users: int, expected: float):
    # Users do not ask while they are served; 1,000 of them are within 3 % of infinitely many.
    assert engset(users, 7, 10) == pytest.approx(expected, rel=2e-3)
    found = blocking(users, hours=12, runs=20, theory=engset(users, 7, 10))
    check([found])
    assert found.error < 0.05 * found.theory, "not sharp enough to tell"


@pytest.mark.slow
def test_blocking_is_what_erlang_says_of_many():
    found = erlang()
    check([found])
    assert found.error < 0.01 * found.theory, "not sharp enough to tell"


# ---- demand, as it comes out of the engine


@pytest.mark.thorough
def test_think_times_are_exponential():
    # The first five of each user: all of them end long before the episode does.
    demand = {"kind": "dynamic", "think_time_s": 300, "mix": {"unit": 1}}
    world = under_one_drone(400, demand, hours=5, drones={"bandwidth_kbps": None})
    log = hovered(world, seed=3)
    by_user: list[list[int]] = [[] for _ in range(400)]
    ended = [0] * 400
    for request in log.requests:
        if len(by_user[request.user]) < 6:
            by_user[request.user].append(request.t_request_us - ended[request.user])
        ended[request.user] = request.t_end_us
    assert all(len(times) == 6 and times[0] == 0 for times in by_user)
    think_s = np.array([times[1:] for times in by_user]).ravel() / US
    assert abs(think_s.mean() - 300) < 4 * 300 / math.sqrt(len(think_s))
    assert stats.kstest(think_s, stats.expon(scale=300).cdf).pvalue > 1e-4


def test_a_draw_of_nothing_is_another_think_time():
    # With probability 1/2 nothing: from the end of a request to the next, 1, 2, 3 ... think times
    # of 300 s, a geometric number of exponential times: exponential with mean 600 s.
    demand = {"kind": "dynamic", "think_time_s": 300, "none": 0.5, "mix": {"unit": 1}}
    world = under_one_drone(600, demand, hours=5, drones={"bandwidth_kbps": None})
    log = hovered(world, seed=4)
    own = [[r for r in log.requests if r.user == user][:3] for user in range(600)]
    at_once = sum(requests[0].t_request_us == 0 for requests in own)
    assert abs(at_once - 300) < 4 * math.sqrt(600 * 0.25)
    gaps_s = np.array([(b.t_request_us - a.t_end_us) / US for a, b, *_ in own])
    assert stats.kstest(gaps_s, stats.expon(scale=600).cdf).pvalue > 1e-4


@pytest.mark.thorough
@pytest.mark.parametrize("users", at_length(20, 200))
def test_arrivals_are_poisson_whether_asked_or_suppressed(users: int):
    demand = {"kind": "poisson", "rate_per_hour": 30, "mix": {"unit": 1}}
    world = under_one_drone(users, demand, hours=4, drones={"bandwidth_kbps": None})
    counts = []
    for seed in range(20):
        log = hovered(world, seed)
        counts.append(len(log.requests) + log.suppressed)
        assert log.suppressed > 0.3 * counts[-1], "3 of 5 minutes are busy"
    mean = users * 30 * 4
    assert abs(fmean(counts) - mean) < 4 * math.sqrt(mean / 20)
    dispersion = sum((count - fmean(counts)) ** 2 for count in counts) / mean
    assert stats.chi2(19).ppf(1e-5) < dispersion < stats.chi2(19).ppf(1 - 1e-5)
