"""Cases 1-5: to be attached is to be served, and the measures of quality are of one thing."""

from __future__ import annotations

import pytest

from tests.verification.figure import check
from tests.verification.identities import CASES, POLICIES, figures, played


@pytest.mark.parametrize("policy", POLICIES)
@pytest.mark.parametrize("case", CASES)
def test_served_is_attached(case: str, policy: str):
    for seed in range(3):
        results = played(case, policy, seed)
        assert len(results.episodes) == 3
        assert results.episodes["qoe1_percent"].between(0, 100).all()
        requests = results.requests
        assert (requests["served_s"] == requests["attached_s"]).all()
        if policy == "baseline":
            assert results.episodes["qoe1_percent"].between(1, 99).any(), "the test sees something"


@pytest.mark.parametrize("quick", [True, pytest.param(False, marks=pytest.mark.slow)])
def test_the_measures_of_quality_are_of_one_thing(quick: bool):
    check(figures(quick))
