"""Requests whose rate changes through the day: counts, times and their integral."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scipy import stats

from desim_uav.model.demand.day_profile import DayProfile, passed_at, time_of
from tests.verification.demand import DUE, US, ask
from tests.verification.figure import Estimate, check
from tests.verification.mobility import HOUR_S, MORNING, NIGHT, of_profiles, passed, rate_of


@pytest.mark.parametrize("shape", ["steps", "linear"])
@pytest.mark.parametrize("profile", [MORNING, NIGHT, ((3.0, 5.0),)])
def test_the_integral_and_its_inverse(profile: Any, shape: str):
    model = DayProfile((((1.0, 1.0), (2.0, 2.0)), profile), shape)
    own = model.pieces, int(model.firsts[1]), int(model.firsts[2])
    rng = np.random.default_rng(0)
    for hour in rng.uniform(0.0, 60.0, 200):
        found = passed_at(*own, hour * HOUR_S)
        assert found == pytest.approx(passed(profile, shape, 0.0, hour), abs=1e-7)
        again_s = time_of(*own, found)
        assert passed_at(*own, again_s) == pytest.approx(found, abs=1e-9)
        if rate_of(profile, shape)(hour) > 0.01:
            assert again_s == pytest.approx(hour * HOUR_S, abs=1e-3)
    draws = model.expected_draws(10, 60.0, 30 * HOUR_S) / 10 - 1.0
    first = passed(((1.0, 1.0), (2.0, 2.0)), shape, 0.0, 30.0)
    assert draws == pytest.approx((first + passed(profile, shape, 0.0, 30.0)) / 2, rel=1e-9)


@pytest.mark.thorough
@pytest.mark.parametrize("shape", ["steps", "linear"])
def test_counts(shape: str):
    check(of_profiles(1500, shape))


def test_between_arrivals_a_unit_exponential_passes():
    """The integral of the rate from one arrival to the next, for steps by hand."""
    model = DayProfile((((0.0, 60.0), (0.5, 6.0), (1.5, 200.0)),))
    rows, _ = ask(model, 400, seed=9, horizon_us=int(2 * HOUR_S * US))
    steps = np.array([0.0, 0.5, 1.5, 24.0]), np.array([0.0, 30.0, 36.0, 4536.0])
    gaps = np.concatenate(
        [np.diff(np.interp(each[:, DUE] / US / HOUR_S, *steps), prepend=0.0)[:90] for each in rows]
    )
    assert stats.kstest(gaps, "expon").pvalue > 1e-3


def test_a_constant_profile_is_a_poisson_process():
    rows, _ = ask(DayProfile((((7.0, 60.0),),)), 3000, seed=4)
    check([Estimate.of("count in half an hour", [len(each) for each in rows], 30.0)])


def test_it_goes_on_from_now():
    model = DayProfile((MORNING,), "linear", 23.0, 0.1)
    later = model.from_now(int(2.5 * HOUR_S * US))
    assert later.begins_at_h == pytest.approx(1.5)
    assert (later.profiles, later.shape, later.none) == ((MORNING,), "linear", 0.1)


@pytest.mark.parametrize(
    ("profiles", "problem"),
    [
        ((((0.0, 0.0),),), "profile 0: a user must make at least 0.001 requests a day"),
        ((((0.0, 5.0),), ((3.0, 0.0), (9.0, 0.0))), "profile 1: .* some rate must be above 0"),
    ],
)
def test_a_day_without_requests_is_refused(profiles: Any, problem: str):
    with pytest.raises(ValueError, match=problem):
        DayProfile(profiles)
