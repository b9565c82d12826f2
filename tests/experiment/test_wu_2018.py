"""Flights that make the least rate of several users large: by hand, by bounds, and flown."""

import math

import numpy as np
import pytest
from scipy.integrate import quad

from desim_uav.experiment.papers import max_min, wu_2018
from desim_uav.experiment.papers.wu_2018 import long_tour, rate_at, shared, static

ABOVE = math.log2(1001.0)
TWO = np.array([[0.0, 0.0], [600.0, 0.0]])


def one_rate(away_m):
    return float(rate_at(np.array([away_m]))[0])


class TestOneDrone:
    def test_the_rate_falls_with_the_distance(self):
        assert one_rate(0.0) == pytest.approx(ABOVE)
        assert one_rate(300.0) == pytest.approx(math.log2(101.0))  # a tenth of the power

    def test_two_users_are_flown_between(self):
        # 12 s there and 12 s back, half of them with each user.
        carried, _ = quad(one_rate, 0.0, 300.0)
        tour = long_tour(TWO, 200.0)
        assert tour.legs_s.tolist() == [12.0, 12.0]
        assert tour.carried.tolist() == pytest.approx([2 * carried / 50.0] * 2, rel=1e-7)
        assert tour.hovers_s.tolist() == pytest.approx([88.0, 88.0])
        assert tour.rate == pytest.approx((88.0 * ABOVE + 2 * carried / 50.0) / 200.0, rel=1e-7)

    def test_a_user_who_gains_more_on_the_way_gets_a_shorter_hover(self):
        places = np.array([[0.0, 0.0], [600.0, 0.0], [300.0, 100.0]])
        tour = long_tour(places, 300.0)
        assert tour.hovers_s.sum() + tour.legs_s.sum() == pytest.approx(300.0)
        got = tour.carried + tour.hovers_s * ABOVE
        assert got.tolist() == pytest.approx([300.0 * tour.rate] * 3)
        assert np.argmin(tour.hovers_s) == np.argmax(tour.carried)

    def test_there_must_be_time_to_hover_above_each_user(self):
        with pytest.raises(ValueError, match="too short to hover"):
            long_tour(TWO, 23.0)

    def test_hovering_at_one_place_shares_the_time(self):
        # At one place, equal rates are shares in inverse proportion to the rates.
        rates = [one_rate(200.0), one_rate(400.0)]
        whole = shared(TWO, np.array([[200.0, 0.0]]))
        assert whole == pytest.approx(1.0 / sum(1.0 / rate for rate in rates))
        assert static(TWO + 500.0) >= whole - 1e-9

    def test_serving_the_best_link_is_the_best_division_of_the_time_on_a_tour(self):
        places = wu_2018.users(0)
        tour = long_tour(places, 800.0)
        times = np.arange(2.0, 800.0, 4.0)
        shown = shared(places, np.array([place_at(tour, places, t) for t in times]))
        assert tour.rate == pytest.approx(shown, rel=0.01)
        bound = wu_2018.least_rate_bound(6)
        assert static(places) < wu_2018.circular(places) < tour.rate < bound


def place_at(tour, places, time_s):
    """Where the drone is on a tour that begins with the hover above its first user."""
    for at, user in enumerate(tour.order):
        ahead = places[tour.order[(at + 1) % len(tour.order)]]
        if time_s <= tour.hovers_s[user]:
            return places[user]
        time_s -= tour.hovers_s[user]
        if time_s <= tour.legs_s[at]:
            return places[user] + time_s / tour.legs_s[at] * (ahead - places[user])
        time_s -= tour.legs_s[at]
    return places[tour.order[0]]


class TestTwoDrones:
    def test_two_users_far_apart_have_a_drone_each(self):
        users = np.array([[0.0, 0.0], [20.0, 0.0]])
        places = np.repeat(users[:, None], 3, axis=1)
        shares, rate = max_min.divided(users, 1000.0, places)
        assert rate == pytest.approx(math.log2(1.0 + 1000.0 / (1.0 + 1000.0 / 401.0)))
        assert shares.sum() == pytest.approx(3.0)

    def test_near_each_other_they_take_turns(self):
        users = np.array([[0.0, 0.0], [0.1, 0.0]])
        places = np.repeat(users[:, None], 3, axis=1)
        assert max_min.divided(users, 1000.0, places)[1] == pytest.approx(ABOVE / 2.0)

    @pytest.mark.thorough
    def test_flights_keep_to_their_limits_and_are_better_than_circles(self):
        users = wu_2018.users(1) / 100.0
        flights = max_min.best_flights(users, 1000.0, 2.0, 14)
        hops = np.linalg.norm(np.roll(flights.places, -1, axis=1) - flights.places, axis=2)
        assert hops.max() <= 2.0 + 1e-9
        assert np.linalg.norm(flights.places[0] - flights.places[1], axis=1).min() >= 1.0
        assert flights.rate == pytest.approx(max_min.divided(users, 1000.0, flights.places)[1])
        circles = max_min.divided(users, 1000.0, max_min._first(users, 2.0, 14))[1]
        assert 1.2 * circles < flights.rate < ABOVE / 3.0

    def test_a_small_step_raises_the_rate_as_its_slope_says(self):
        users = wu_2018.users(0) / 100.0
        places = max_min._first(users, 2.0, 14)
        shares, rate = max_min.divided(users, 1000.0, places)
        gains = []
        for step in (1e-3, 2e-3):
            moved = places + max_min._shifts(users, 1000.0, 2.0, places, shares, step)
            gains.append(max_min.divided(users, 1000.0, moved)[1] - rate)
        assert gains[0] > 0.0 and gains[1] == pytest.approx(2.0 * gains[0], rel=0.05)


@pytest.mark.thorough
def test_the_flight_gives_the_computed_rates_in_the_simulator():
    tour = long_tour(wu_2018.users(0), 800.0)
    rates = wu_2018.simulated(0)
    assert sum(rates) / 6 == pytest.approx(tour.rate, abs=1e-3)
    assert min(rates) > tour.rate - 0.01 and max(rates) < tour.rate + 0.01
