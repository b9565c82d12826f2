"""Means and t-intervals, against values from tables and against SciPy's own."""

import math
import subprocess
import sys

import numpy as np
import pytest
from scipy import stats

from desim_uav.experiment.statistics import Estimate, estimate, paired


def test_by_hand():
    """1, 2, 3: s = 1, and Student's t with 2 degrees of freedom is (2p - 1) / sqrt(2p(1 - p))."""
    found = estimate([1.0, 2.0, 3.0])
    assert (found.n, found.mean) == (3, 2.0)
    assert found.half_width == pytest.approx(
        0.95 / math.sqrt(1.95 * 0.025) / math.sqrt(3), rel=1e-12
    )
    assert found.low == 2.0 - found.half_width
    assert found.high == 2.0 + found.half_width


def test_two_values():
    """With one degree of freedom t is Cauchy's: tan(0.475 π) = 12.7062."""
    found = estimate([10.0, 14.0])
    assert found.mean == 12.0
    assert found.half_width == pytest.approx(2 * math.tan(0.475 * math.pi), rel=1e-12)


@pytest.mark.parametrize("n", [2, 3, 10, 50])
def test_is_what_scipy_says(n):
    values = np.random.default_rng(n).normal(50.0, 8.0, n)
    found = estimate(values.tolist())
    low, high = stats.t.interval(0.95, n - 1, values.mean(), stats.sem(values))
    assert (found.low, found.high) == pytest.approx((low, high), rel=1e-12)


@pytest.mark.parametrize("n", [3, 10])
def test_a_paired_difference_is_the_paired_t_test(n):
    rng = np.random.default_rng(7)
    reference = rng.normal(50.0, 8.0, n)
    values = reference + rng.normal(1.0, 1.0, n)
    found = paired(values.tolist(), reference.tolist())
    low, high = stats.ttest_rel(values, reference).confidence_interval(0.95)
    assert (found.low, found.high) == pytest.approx((low, high), rel=1e-12)
    apart = stats.ttest_ind(values, reference, equal_var=False).confidence_interval(0.95)
    assert found.half_width < (apart.high - apart.low) / 2


def test_one_replication_has_no_interval():
    found = estimate([3.0])
    assert found == Estimate(1, 3.0, None)
    assert (found.low, found.high, found.excludes_zero) == (None, None, None)


def test_no_replication_has_no_mean():
    assert estimate([]) == Estimate(0, None, None)
    assert paired([], []) == Estimate(0, None, None)


def test_missing_values_are_left_out():
    assert estimate([1.0, None, 2.0, math.nan, 3.0]) == estimate([1.0, 2.0, 3.0])
    assert estimate([None, math.nan]) == Estimate(0, None, None)


def test_a_pair_needs_both():
    values, reference = [5.0, None, 7.0, math.nan, 9.0], [1.0, 2.0, None, 4.0, 6.0]
    assert paired(values, reference) == estimate([4.0, 3.0])


def test_pairs_are_of_the_same_replications():
    with pytest.raises(ValueError, match="shorter"):
        paired([1.0, 2.0], [1.0])


@pytest.mark.parametrize(
    ("values", "excludes"),
    [
        ([1.0, 2.0], False),  # 1.5 ± 6.4
        ([1.0, 1.1], True),  # 1.05 ± 0.64
        ([-1.0, -1.1], True),
        ([0.0, 0.0], False),
        ([2.0, 2.0], True),  # no spread: the interval is the value
    ],
)
def test_excludes_zero(values, excludes):
    assert estimate(values).excludes_zero is excludes


@pytest.mark.thorough
def test_scipy_is_imported_when_an_interval_is_made():
    code = "import sys, desim_uav.experiment.compare; print('scipy.stats' in sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout == "False\n"


@pytest.mark.slow
def test_nineteen_of_twenty_intervals_hold_the_mean():
    rng = np.random.default_rng(0)
    held = 0
    for _ in range(4000):
        found = estimate(rng.normal(3.0, 2.0, 5).tolist())
        held += found.low <= 3.0 <= found.high
    assert held / 4000 == pytest.approx(0.95, abs=4 * math.sqrt(0.95 * 0.05 / 4000))


def test_is_shown_as_far_as_there_is_one():
    assert f"{Estimate(3, 12.345, 0.5):.1f}" == "12.3 ± 0.5"
    assert f"{estimate([3.0]):.2f}" == "3.00"
    assert f"{estimate([]):.2f}" == "-"
