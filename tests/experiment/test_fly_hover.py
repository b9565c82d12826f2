"""Plans that fly, hover and serve: worked by hand, and what a place of a hover trades off."""

import math

import numpy as np
import pytest

from desim_uav.experiment.papers import fly_hover

ABOVE_BPS = 1e6 * math.log2(1.0 + 10.0**1.25)


def test_a_plan_by_hand():
    # 300 m to the first node, 400 m to the second and 640.3 m to the end, at 8.828728 J/m; hovers
    # above both, with a link of 5 W.
    nodes = np.array([[350.0, 50.0], [350.0, 450.0]])
    plan = fly_hover.plan(nodes, nodes, 1e9, fly_hover.COSTS["energy"])
    assert plan.hovers_s.tolist() == pytest.approx([1e9 / ABOVE_BPS] * 2)
    way_m = 700.0 + math.hypot(500.0, 400.0)
    energy_j = way_m * 8.828728 + (168.484218 + 5.0) * 2e9 / ABOVE_BPS
    assert plan.cost == pytest.approx(energy_j, rel=1e-6)
    plan = fly_hover.plan(nodes, nodes, 1e9, fly_hover.COSTS["time"])
    assert plan.cost == pytest.approx(way_m / 30.0 + 2e9 / ABOVE_BPS)


def test_the_best_speed_is_that_of_the_longest_range():
    assert fly_hover.best_speed() == pytest.approx(fly_hover.RANGE_MPS, abs=1e-4)


@pytest.mark.thorough
@pytest.mark.parametrize("name", fly_hover.COSTS)
def test_with_more_to_send_it_pays_to_fly_nearer(name):
    nodes, cost = fly_hover.drawn_nodes(1), fly_hover.COSTS[name]
    little, much = (fly_hover.optimised(nodes, mbit * 1e6, cost) for mbit in (0.01, 1000.0))
    direct = cost.metre * math.dist(fly_hover.START, fly_hover.END)
    assert direct < little.cost < 1.001 * direct  # no way round
    above = fly_hover.above_each(nodes, 1e9, cost)
    assert 0.99 * above.cost < much.cost < above.cost
    assert fly_hover.at_centre(nodes, 1e9, cost).cost > 1.2 * above.cost
    costs = [one(nodes, 3e8, cost).cost for one in fly_hover.SCHEMES.values()]
    assert costs == sorted(costs, reverse=True) and len(set(costs)) == len(costs)
