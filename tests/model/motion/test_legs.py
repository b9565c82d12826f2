"""Free legs and commands, against the sampler's own closed forms."""

import numpy as np
import pytest

from desim_uav.model.motion.legs import (
    LegBounds,
    commanded,
    leg_between,
    reach_along,
    reach_m,
)
from desim_uav.model.motion.limits import CALM, Limits
from desim_uav.model.motion.motion import BangCoastBang
from desim_uav.model.motion.space import flight_of
from desim_uav.model.radio.tracks import Flight, TrackRow, fly, place, row_at
from desim_uav.rowcode.kernels import kernel
from desim_uav.rowcode.views import zeros
from tests.model.motion.places import place_on
from tests.model.radio.looking import Trip
from tests.model.sampler import Flight as Flown

LIMITS = Limits(10.0, 4.0, 5.0, 3.0, 2.0)
MAP = LegBounds(2400.0, 2000.0, 20.0, 120.0)
STEP_S = 60.0


def random_leg(rng):
    limits = Limits(*rng.uniform(0.5, 20.0, 5))
    wind = tuple(rng.uniform(-0.7, 0.7, 2) * limits.level_mps)
    start, stop = rng.uniform(0.0, 500.0, (2, 3))
    kind = rng.random()
    if kind < 0.2:
        stop[2] = start[2]
    elif kind < 0.3:
        stop[:2] = start[:2]
    elif kind < 0.5:
        stop = start + 1e-2 * (stop - start)
    cruise = np.inf if rng.random() < 0.7 else rng.uniform(0.5, 20.0)
    return limits, wind, cruise, tuple(start), tuple(stop)


def profile_of(leg):
    return flight_of(leg, (0.0, 0.0)).rows


class TestLegs:
    def test_a_leg_along_an_axis_is_the_transit_of_cells(self):
        for metres in (240.0, 10.0, 1e-3):
            cells = BangCoastBang(10.0, 4.0, "minimum_time").fastest_transit(metres)
            leg = leg_between(LIMITS, CALM, np.inf, (0.0, 0.0, 50.0), (0.0, metres, 50.0))
            assert (profile_of(leg) == cells.rows).all()
            assert (leg.duration_us, leg.distance_m) == (cells.duration_us, metres)

    @pytest.mark.thorough
    def test_places_are_those_of_the_sampler(self):
        rng = np.random.default_rng(1)
        for _ in range(300):
            limits, wind, cruise, start, stop = random_leg(rng)
            leg = leg_between(limits, wind, cruise, start, stop)
            own = Flown.minimum_time(
                np.linalg.norm(np.subtract(stop, start)), *self.limits(limits, wind, cruise, leg)
            )
            trip = Trip(np.array(start), np.array(stop), own)
            assert leg.duration_s == pytest.approx(own.total_s, rel=1e-12)
            times = rng.uniform(0.0, 1.2 * own.total_s, 20)
            profile = profile_of(leg)
            tracks = zeros(TrackRow, 10)
            end = fly(
                Flight(profile, leg.route, 0),
                (0, 2 * leg.duration_us),
                tracks,
                0,
            )
            for t, expected in zip(times, trip.at(times), strict=True):
                assert place_on(leg, profile, t) == pytest.approx(expected, abs=1e-9)
                assert place(tracks[row_at(tracks, 0, end, t)], t) == pytest.approx(
                    expected, abs=1e-5
                )

    @staticmethod
    def limits(limits, wind, cruise, leg):
        """The speed and the acceleration along a leg, by a search of its own."""
        ahead = (np.array(leg.route[3:]) - leg.route[:3]) / leg.distance_m
        low, high = 0.0, 1e4

        def allowed(v):
            level = np.hypot(*(v * ahead[:2] - wind)) <= limits.level_mps
            return level and -limits.descent_mps <= v * ahead[2] <= limits.climb_mps

        for _ in range(100):
            middle = 0.5 * (low + high)
            low, high = (middle, high) if allowed(middle) else (low, middle)
        with np.errstate(divide="ignore"):
            pulls = (
                limits.level_mps2 / np.hypot(*ahead[:2]),
                limits.vertical_mps2 / abs(ahead[2]),
            )
        return min(low, cruise), min(pulls)

    def test_a_leg_to_the_same_place_is_a_hover(self):
        for apart in (0.0, 9e-7):
            leg = leg_between(LIMITS, CALM, np.inf, (1.0, 2.0, 3.0), (1.0, 2.0 + apart, 3.0))
            assert (leg.distance_m, leg.duration_us) == (0.0, 0)
            profile = profile_of(leg)
            assert profile.tolist() == [(0.0,) * 4]
            assert place_on(leg, profile, 9.0) == (1.0, 2.0, 3.0)


class TestReach:
    def test_by_hand(self):
        assert reach_m(10.0, 4.0, 60.0) == 575.0
        assert reach_m(10.0, 4.0, 5.0) == 25.0
        assert reach_m(10.0, 4.0, 2.0) == 4.0

    def test_the_furthest_flight_takes_just_the_time(self):
        rng = np.random.default_rng(2)
        for _ in range(500):
            limits, wind, cruise, start, stop = random_leg(rng)
            ahead = np.subtract(stop, start) / np.linalg.norm(np.subtract(stop, start))
            lasts_s = round(rng.uniform(0.1, 100.0), 6)
            metres = reach_along(limits, wind, cruise, tuple(ahead), lasts_s)
            there = tuple(np.array(start) + metres * ahead)
            leg = leg_between(limits, wind, cruise, start, there)
            assert abs(leg.duration_us - lasts_s * 1e6) <= 1

    def test_it_is_none_in_a_strong_wind(self):
        assert reach_along(LIMITS, (10.0, 0.0), np.inf, (1.0, 0.0, 0.0), 60.0) == 0.0


class TestCommands:
    AT = (1200.0, 1000.0, 70.0)

    def go(self, *command, wind=CALM, at=AT, cruise=np.inf, bounds=MAP):
        return commanded(LIMITS, wind, cruise, bounds, STEP_S, at, command)

    def test_by_hand(self):
        assert self.go(0.0, 0.0, 0.0) == self.AT
        assert self.go(1.0, 0.0, 0.0) == (1775.0, 1000.0, 70.0)
        assert self.go(0.0, -0.5, 0.0) == (1200.0, 712.5, 70.0)
        assert self.go(0.6, 0.8, 0.0) == pytest.approx((1545.0, 1460.0, 70.0))
        assert self.go(0.06, 0.08, 0.0) == pytest.approx((1234.5, 1046.0, 70.0))
        # Up at 5 m/s with ramps of 2.5 s: 287.5 m in a step; down at 3 m/s: 175.5 m.
        assert self.go(0.0, 0.0, 0.1) == pytest.approx((1200.0, 1000.0, 98.75))
        assert self.go(0.0, 0.0, -0.1) == pytest.approx((1200.0, 1000.0, 52.45))

    def test_a_corner_is_cut_to_the_disc(self):
        far = 575.0 / 2**0.5
        assert self.go(1.0, 1.0, 0.0) == pytest.approx((1200 + far, 1000 + far, 70.0))
        assert self.go(9.0, 9.0, 0.0) == self.go(1.0, 1.0, 0.0)

    def test_a_slow_cruise_reaches_less_far(self):
        assert self.go(1.0, 0.0, 0.0, cruise=4.0) == (1200 + 4 * 59.0, 1000.0, 70.0)

    def test_the_map_ends(self):
        assert self.go(1.0, 0.0, 0.0, at=(2300.0, 5.0, 70.0)) == (2400.0, 5.0, 70.0)
        assert self.go(0.0, 0.0, 1.0) == (1200.0, 1000.0, 120.0)
        assert self.go(0.0, 0.0, -1.0) == (1200.0, 1000.0, 20.0)

    def test_the_wind_moves_the_reach(self):
        assert self.go(1.0, 0.0, 0.0, wind=(5.0, 0.0))[0] == 1200 + 15 * (60 - 15 / 4)
        assert self.go(-1.0, 0.0, 0.0, wind=(5.0, 0.0))[0] == 1200 - 5 * (60 - 5 / 4)

    def test_a_step_is_never_exceeded_and_a_whole_command_takes_it_all(self):
        rng, whole = np.random.default_rng(3), 0
        for _ in range(2000):
            limits, wind, cruise, at, _ = random_leg(rng)
            bounds = LegBounds(*rng.uniform(500.0, 3000.0, 2), 0.0, rng.uniform(500.0, 900.0))
            command = rng.uniform(-1.0, 1.0, 3)
            if rng.random() < 0.5:
                command[:2] /= np.hypot(*command[:2])
            target = commanded(limits, wind, cruise, bounds, STEP_S, at, tuple(command))
            leg = leg_between(limits, wind, cruise, at, target)
            assert 0 <= leg.duration_us <= 60_000_000
            assert (np.array(target) >= 0.0).all() and (target <= np.array(bounds)[[0, 1, 3]]).all()
            inside = (np.array(target) > 0.0).all() and (target < np.array(bounds)[[0, 1, 3]]).all()
            if inside and np.hypot(*command[:2]) >= 1.0:
                whole += 1
                assert leg.duration_us >= 59_999_999
        assert whole > 100


@kernel
def in_compiled_code(limits, wind, bounds, at, command):
    target = commanded(limits, wind, np.inf, bounds, 60.0, at, command)
    return leg_between(limits, wind, np.inf, at, target)


def test_compiled_code_gets_the_same():
    at, command, wind = (1200.0, 1000.0, 70.0), (0.3, -0.7, 0.2), (3.0, 1.0)
    found = in_compiled_code(LIMITS, wind, MAP, at, command)
    target = commanded(LIMITS, wind, np.inf, MAP, 60.0, at, command)
    assert found == leg_between(LIMITS, wind, np.inf, at, target)
