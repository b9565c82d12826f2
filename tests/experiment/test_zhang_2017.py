"""The shortest flight within discs: worked by hand, and against the paper's form of the problem."""

import math

import numpy as np
import pytest

from desim_uav.experiment.papers import zhang_2017 as paper
from desim_uav.experiment.papers.zhang_2017 import outside_m, shortest

TWO = np.array([[0.0, 0.0], [6.0, 0.0]])
"""Of radius 5, their circles intersect in (3, 4) and (3, -4)."""


class TestByHand:
    def test_a_flight_turns_where_two_circles_intersect(self):
        flight = shortest(TWO, 5.0, (0.0, 4.9), (6.0, 4.9))
        assert flight.places == ((0.0, 4.9), pytest.approx((3.0, 4.0)), (6.0, 4.9))
        assert flight.length_m == pytest.approx(2.0 * math.hypot(3.0, 0.9))

    def test_a_straight_flight_is_the_shortest_where_it_can_be(self):
        flight = shortest(TWO, 5.0, (0.0, 3.9), (6.0, 3.9))
        assert flight == (((0.0, 3.9), (6.0, 3.9)), 6.0)

    def test_there_is_no_flight_between_discs_that_do_not_meet(self):
        assert shortest(TWO, 2.99, (0.0, 0.0), (6.0, 0.0)).length_m == math.inf
        assert shortest(TWO, 3.0, (0.0, 0.0), (6.0, 0.0)).length_m == pytest.approx(6.0)

    def test_there_is_no_flight_from_outside(self):
        assert shortest(TWO, 5.0, (0.0, 5.1), (6.0, 0.0)).length_m == math.inf

    @pytest.mark.parametrize(
        ("start", "goal", "length"),
        [
            ((0, 0), (6, 0), 2.0),  # from 2 to 4
            ((-3, 0), (0, 0), 1.0),  # the disc begins at -2
            ((0, 0), (0, 5), 3.0),
            ((0, 9), (6, 9), 6.0),
            ((1, 1), (1, 1), 0.0),
        ],
    )
    def test_how_much_of_a_line_is_outside(self, start, goal, length):
        found = outside_m(TWO, 2.0, np.array(start, float), np.array(goal, float))
        assert found == pytest.approx(length)


@pytest.mark.parametrize("seed", range(8))
def test_it_is_as_short_as_by_the_convex_programs_and_is_there_up_to_the_highest_target(seed):
    draws = np.random.default_rng(seed)
    centres = draws.uniform(0.0, 4000.0, (4, 2))
    start, goal = (tuple(centre + draws.uniform(-300.0, 300.0, 2)) for centre in centres[:2])
    highest = paper.widest_target_db(centres, start, goal)
    radius = paper.reach_m(highest - 0.5)
    flight = shortest(centres, radius, start, goal)
    apart = paper.shortest_by_sequences(centres, radius, start, goal)
    assert flight.length_m == pytest.approx(apart, rel=1e-6)
    assert math.isfinite(shortest(centres, paper.reach_m(highest - 1e-6), start, goal).length_m)
    assert math.isinf(shortest(centres, paper.reach_m(highest + 1e-6), start, goal).length_m)


@pytest.mark.thorough
def test_flown_along_it_the_link_holds_and_a_metre_outside_it_does_not():
    ends = paper.reach_m(15.0)
    assert len(shortest(paper.stations(), ends, paper.START, paper.GOAL).places) == 6
    took, lost = paper.simulated(15.0, -paper.INSIDE_M)
    assert took == pytest.approx(312.8211, abs=1e-3) and lost == 0.0
    assert paper.simulated(15.0, paper.OUTSIDE_M)[1] > 1.0
