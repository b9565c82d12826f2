"""Plans that fly, hover and serve: worked by hand, and what a place of a hover trades off."""

import math

import numpy as np
import pytest

from desim_uav.experiment.papers import fly_hover

ABOVE_BPS = 1e6 * math.log2(1001.0)


def test_a_plan_by_hand():
    # 300 m to the first node and 400 m to the second one, at 8.828728 J/m; hovers above both.
    nodes = np.array([[350.0, 50.0], [350.0, 450.0]])
    plan = fly_hover.plan(nodes, nodes, 1e9)
    assert plan.hovers_s.tolist() == pytest.approx([1e9 / ABOVE_BPS] * 2)
    energy = 700.0 * 8.828728 + 168.484218 * 2e9 / ABOVE_BPS
    assert plan.energy_j == pytest.approx(energy, rel=1e-6)


def test_the_best_speed_is_that_of_the_longest_range():
    assert fly_hover.best_speed() == pytest.approx(fly_hover.RANGE_MPS, abs=1e-4)


@pytest.mark.thorough
def test_with_more_to_send_it_pays_to_fly_nearer():
    little, much = (fly_hover.optimised(mbit * 1e6) for mbit in (10.0, 1000.0))
    one_place = fly_hover.from_one_place(10e6)
    assert np.linalg.norm(little.places - fly_hover.START, axis=1).max() < 1.0  # flies nowhere
    assert little.energy_j == pytest.approx(one_place.energy_j, rel=1e-5)
    assert little.energy_j < fly_hover.above_nodes(10e6).energy_j / 10.0
    above = fly_hover.above_nodes(1e9)
    assert 0.99 * above.energy_j < much.energy_j < above.energy_j
    assert fly_hover.from_one_place(1e9).energy_j > 1.2 * above.energy_j
    plans = (fly_hover.optimised, fly_hover.from_one_place, fly_hover.above_nodes)
    energies = [one(300e6).energy_j for one in plans]
    assert energies == sorted(energies) and len(set(energies)) == 3
