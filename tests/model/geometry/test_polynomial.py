"""Changes of sign that are found nearly, and those of polynomials of degree one."""

from __future__ import annotations

import numpy as np

from desim_uav.model.geometry.polynomial import APART, NEARLY, near_changes, sign_changes


def test_near_places_are_as_many_and_close_to_the_exact_ones() -> None:
    rng, compared = np.random.default_rng(0), 0
    for _ in range(3000):
        places = rng.uniform(-20.0, 80.0, rng.integers(1, 4))
        c = (np.poly(places)[::-1] * rng.normal()).tolist()
        c = (*c, *[0.0] * (5 - len(c)))
        count, exact = sign_changes(c, c[0] > 0.0, 60.0, 0.0)
        number, near = near_changes(c, c[0] > 0.0, 60.0)
        assert number == count == sum((places > 0.0) & (places < 60.0))
        if np.diff(np.sort(places)).min(initial=1.0) > APART:
            assert np.abs(np.subtract(near[:count], exact[:count])).max(initial=0.0) < NEARLY * 60.0
            compared += count
    assert compared > 2000


def test_roots_of_lines_are_found_in_the_same_steps_as_others() -> None:
    """A coefficient too small to change any number makes it a polynomial of degree two."""
    rng, found = np.random.default_rng(1), 0
    for at, slope in rng.normal(0.0, (3000.0, 100.0), (3000, 2)).tolist():
        line = sign_changes((at, slope, 0.0, 0.0, 0.0), at > 0.0, 60.0, 0.0)
        assert line == sign_changes((at, slope, 1e-250, 0.0, 0.0), at > 0.0, 60.0, 0.0)
        found += line[0]
    assert found > 500
