"""A step of free flight: drones under random commands never come nearer than the margin."""

import numpy as np
import pytest

from desim_uav.model.geometry.prisms import obstacles
from desim_uav.model.motion.flight import step_leg
from desim_uav.model.motion.legs import LegBounds
from desim_uav.model.motion.limits import CALM, Limits
from desim_uav.model.motion.space import flight_of
from tests.model.geometry.maps import random_town
from tests.model.geometry.test_roads import free_place
from tests.model.motion.places import place_on
from tests.selection import by_default

LIMITS = Limits(10.0, 4.0, 5.0, 3.0, 2.0)
HOUSE = np.zeros((10, 10))
HOUSE[4, 4] = 50.0
MAP = LegBounds(1000.0, 1000.0, 10.0, 120.0)


def test_a_step_before_a_house_by_hand():
    house = obstacles(HOUSE, (100.0, 100.0), [], 5.0)
    leg, blocked = step_leg(
        LIMITS, CALM, np.inf, MAP, house, 60.0, (200.0, 450.0, 40.0), (1.0, 0.0, 0.0)
    )
    assert blocked and leg.route[3:] == pytest.approx((395.0, 450.0, 40.0))
    assert leg.duration_us == pytest.approx((195.0 / 10.0 + 2.5) * 1e6, abs=1)
    again, blocked = step_leg(
        LIMITS, CALM, np.inf, MAP, house, 60.0, leg.route[3:], (1.0, 0.0, 0.0)
    )
    assert blocked and (again.distance_m, again.duration_us) == (0.0, 0)
    over, blocked = step_leg(LIMITS, CALM, np.inf, MAP, house, 60.0, leg.route[3:], (0.0, 0.0, 0.1))
    assert not blocked and over.route[3:] == pytest.approx((395.0, 450.0, 68.75))


def wander(towns, steps, seed):
    """Drones under random commands: (legs, of these blocked, of these blocked at once)."""
    rng, counts = np.random.default_rng(seed), np.zeros(3, int)
    for _ in range(towns):
        town = random_town(rng)
        prisms, bounds = town.prisms(), LegBounds(*town.size_m, 5.0, 120.0)
        wind = tuple(rng.uniform(-4.0, 4.0, 2))
        z = rng.uniform(10.0, 90.0)
        place = free_place(rng, town, prisms, z)
        if place is None:
            continue
        at = (*place, z)
        for _ in range(steps):
            command = rng.uniform(-1.0, 1.0, 3) * (1.0, 1.0, rng.choice([0.0, 0.3]))
            leg, blocked = step_leg(LIMITS, wind, np.inf, bounds, prisms, 30.0, at, tuple(command))
            assert leg.route[:3] == at and 0 <= leg.duration_us <= 30_000_000
            profile = flight_of(leg, wind).rows
            times = np.linspace(0.0, leg.duration_s, 60)
            places = np.array([place_on(leg, profile, t) for t in times])
            assert (town.clearance_m(places) >= town.margin_m - 1e-5).all()
            assert (places >= (-1e-9, -1e-9, 5.0 - 1e-9)).all()
            assert (places <= np.array([*town.size_m, 120.0]) + 1e-9).all()
            counts += 1, blocked, blocked and leg.distance_m == 0.0
            at = leg.route[3:]
    return counts


def test_drones_keep_the_margin():
    legs, blocked, at_once = wander(10, 15, 1)
    assert blocked > 0.05 * legs and at_once < 0.5 * blocked


@pytest.mark.parametrize("maps", by_default([], [100, 250], at_most=1))
def test_drones_keep_the_margin_on_many_maps(maps):
    legs, blocked, at_once = wander(maps, 40, 2)
    assert blocked > 0.05 * legs and at_once < 0.5 * blocked
