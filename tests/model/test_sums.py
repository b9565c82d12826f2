"""Sums of floats are the same under every Python."""

from desim_uav.model.sums import in_order


def test_one_addition_after_the_other():
    values = [1e16, 1.0, -1e16]  # Python 3.12's own sum gives 1.0
    assert in_order(values) == (1e16 + 1.0) - 1e16 == 0.0
    assert in_order([0.1] * 10) == 0.1 + 0.1 + 0.1 + 0.1 + 0.1 + 0.1 + 0.1 + 0.1 + 0.1 + 0.1
    assert in_order([]) == 0.0
