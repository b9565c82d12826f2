"""Crossings on legs of any direction, level or climbing, against samplers that share no code.

Kernels for the disc and for nested circles know the heading of a leg; those for classes with
interference, pairs of levels, drawn lines of sight and buildings know tracks, which have any.
"""

import numpy as np
import pytest

from desim_uav.model.geometry.coverage import DroneLeg, heading_of
from desim_uav.model.motion.motion import REST, BangCoastBang
from desim_uav.model.rules import US
from tests.model.radio import test_air as air
from tests.model.radio import test_link_nested as nested
from tests.model.radio import test_link_sight as buildings
from tests.model.radio import test_marks as marks
from tests.verification.crossings import at, find, survey
from tests.verification.figure import check

SPAN = (0, 60 * US)


def headed(dx, dy, dz=0.0):
    profile = BangCoastBang().fastest_transit(240.0).rows
    return heading_of(DroneLeg(profile, (7.0, 9.0, 7.0 + dx, 9.0 + dy), SPAN, 1.0, False, dz))


class TestHeading:
    def test_it_is_exact_along_an_axis(self):
        for way in (0.1, 1 / 3, 240.0, 1e-9, 2400.0 / 7):
            assert headed(way, 0.0) == (1.0, 0.0)
            assert headed(0.0, -way) == (0.0, -1.0)

    def test_a_climb_and_a_rest_go_nowhere(self):
        assert headed(0.0, 0.0, 50.0) == (0.0, 0.0)
        assert headed(0.0, 0.0) == (0.0, 0.0)

    def test_a_diagonal_of_a_box(self):
        assert headed(20.0, 10.0, -20.0) == pytest.approx((2 / 3, 1 / 3), abs=1e-15)


class TestByHand:
    FLIGHT = BangCoastBang().fastest_transit(250.0)  # 3-4-5: (150, 200), or (120, 160) and 150 up

    def leaves_at(self, route, user, climb=0.0):
        span = (0, self.FLIGHT.duration_us)
        ((t_us, _, enters),) = find(self.FLIGHT, route, span, [user], climb=climb)
        assert not enters
        return t_us * 1e-6

    def test_a_level_leg(self):
        # The user is 60 m behind; after 40 m the drone is 100 m away.
        t = self.leaves_at((0, 0, 150, 200), at(0.6 * (40 - 600), 0.8 * (40 - 600)))
        assert t == pytest.approx(8.3 / 4.0 + (40.0 - 8.61125) / 8.3, abs=1e-6)

    def test_a_climbing_leg_covers_less_ground(self):
        # 50 m of the way are 40 m on the map.
        t = self.leaves_at((0, 0, 120, 160), at(0.6 * (40 - 600), 0.8 * (40 - 600)), 150.0)
        assert t == pytest.approx(8.3 / 4.0 + (50.0 - 8.61125) / 8.3, abs=1e-6)

    def test_a_vertical_leg_crosses_as_a_hover_does(self):
        user = at(-1000, 300, 1.5)
        rows = find(self.FLIGHT, (0, 0, 0, 0), (0, 2000 * US), [user], climb=250.0)
        assert rows == find(REST, (0, 0, 0, 0), (0, 2000 * US), [user])


def test_turned_maps_have_the_same_crossings():
    rng = np.random.default_rng(3)
    flight = BangCoastBang(timing="minimum_time").fastest_transit(240.0)
    for _ in range(100):
        turn = rng.uniform(0.0, 2 * np.pi)
        c, s = np.cos(turn), np.sin(turn)
        x, y, vx, vy = *rng.uniform(-700.0, 700.0, 2), *rng.uniform(-5.0, 5.0, 2)
        plain = find(flight, (0, 0, 240, 0), SPAN, [at(x, y, vx, vy)])
        turned = at(c * x - s * y, s * x + c * y, c * vx - s * vy, s * vx + c * vy)
        rows = find(flight, (0, 0, 240 * c, 240 * s), SPAN, [turned])
        assert [row[1:] for row in rows] == [row[1:] for row in plain]
        assert all(abs(one[0] - two[0]) <= 1 for one, two in zip(rows, plain, strict=True))


def check_disc(seen):
    check(seen.figures())
    assert seen.by_roots.sum() > 0.9 * seen.pairs and (seen.by_roots[:4] > 0).all()


def test_a_sampler_sees_the_same_crossings_of_the_disc():
    check_disc(survey(60, oblique=True))


@pytest.mark.thorough
def test_a_sampler_sees_the_same_crossings_of_the_disc_on_two_thousand_legs():
    check_disc(survey(700, oblique=True))


@pytest.mark.thorough
def test_a_sampler_sees_the_same_crossings_of_circles():
    nested.check(nested.survey(60, 5, oblique=True))


@pytest.mark.slow
def test_a_sampler_sees_the_same_crossings_of_circles_on_two_thousand_legs():
    nested.check(nested.survey(2500, 6, oblique=True))


@pytest.mark.slow
def test_a_sampler_sees_the_same_classes_with_interference_on_two_thousand_legs():
    air.check(air.survey_classes(2000, 7, oblique=True), 3)


@pytest.mark.slow
def test_a_sampler_sees_the_same_pairs_of_levels_on_two_thousand_legs():
    air.check(air.survey_pairs(2000, 8, oblique=True), 0.5)


@pytest.mark.slow
def test_a_sampler_sees_the_same_drawn_lines_of_sight_on_two_thousand_legs():
    marks.check(marks.survey(2000, 9, oblique=True))


@pytest.mark.slow
def test_a_ray_caster_sees_the_same_past_buildings_on_two_thousand_legs():
    seen = buildings.survey(2000, 10, oblique=True)
    assert seen.wrong == []
    assert seen.rows > 0.5 * seen.legs and seen.unclear <= 0.01 * seen.rows
