"""Wu, Zeng and Zhang 2018: the least of the users' mean rates, for one drone and for two."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from functools import cache
from itertools import permutations
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linprog, minimize

from desim_uav.experiment.papers.flown import SPEED_MPS, STOP_S, flown
from desim_uav.experiment.papers.max_min import best_flights
from desim_uav.experiment.papers.row import FigureRow, evaluated
from desim_uav.model.radio.link import LinkBudget
from desim_uav.model.radio.path_loss import LogDistance

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Array = NDArray[np.float64]

HEIGHT_M, USERS, SIDE_M = 100.0, 6, 2000.0
LOSS = LogDistance(2.0, 60.0)
BUDGET = LinkBudget(power_dbm=20.0, bandwidth_mhz=1e-6, noise_figure_db=0, noise_dbm_per_hz=-110)
"""0.1 W, and noise of -110 dBm in all: the paper gives no density, so the band counts as 1 Hz."""

DRAWS, DRAWS_OF_TWO = 20, 3
"""How often the places of users are drawn: the paper has them in a diagram only."""

CELL_M, SLOT_S = 10.0, 2.0
LONG_S = 800.0
READ = {"static": 0.65, "circular": 0.9, "optimised": 1.58}
READ_OF_TWO = {70: 1.6, 90: 1.85}
"""The paper's rates for one drone, and those of two by the time of the flight in seconds."""

CLASSES, LOWEST = 64, 3.0
"""The classes by which the flight is simulated, and about the lowest of their rates."""


class Tour(NamedTuple):
    """A flight from user to user, in a circle, with hovers above each of them.

    ``legs_s`` (users) is the time of the leg that begins at a user, ``carried`` (users) what a user
    gets while the drone flies, in bit/Hz, and ``rate`` what each gets with the hovers ``hovers_s``,
    in bit/s/Hz.
    """

    order: tuple[int, ...]
    legs_s: Array
    carried: Array
    hovers_s: Array
    rate: float


def rows() -> Iterator[FigureRow]:
    """Yield the link right below the drone, the bound, and the rates of several ways to fly."""
    how = "eq. 41 with the numbers of section V"
    snr_db = BUDGET.snr_db(LOSS.los_db(0.0, HEIGHT_M, 2.0))
    yield evaluated("signal-to-noise ratio right above a user, dB", how, 30.0, snr_db, 4)
    yield evaluated(
        "bound of the least rate of 6 users, bit/s/Hz", how, 1.6612, least_rate_bound(USERS), 4
    )
    found = {
        "static": [static(users(seed)) for seed in range(DRAWS)],
        "circular": [circular(users(seed)) for seed in range(DRAWS)],
        "optimised": [long_tour(users(seed), LONG_S).rate for seed in range(DRAWS)],
    }
    for name, rates in found.items():
        where = "800 s" if name == "optimised" else "any time"
        yield _drawn(f"one drone, {name}, {where}, bit/s/Hz", READ[name], rates)
    yield from _simulated()
    for time_s, rate in READ_OF_TWO.items():
        ours = [two_drones(seed, time_s) for seed in range(DRAWS_OF_TWO)]
        yield _drawn(f"two drones, optimised, {time_s} s, bit/s/Hz", rate, ours, 0.1)


def _drawn(figure: str, read: float, ours: Sequence[float], unit: float = 0.01) -> FigureRow:
    """Return a row whose figure depends on the places of the users, which are drawn.

    Ours is the mean, rounded to ``unit``; the range of the draws is rounded outwards.
    """
    low, high = math.floor(min(ours) / unit) * unit, math.ceil(max(ours) / unit) * unit
    mean = round(float(np.mean(ours)) / unit) * unit
    how = f"read off a figure; ours: mean of {len(ours)} draws of users, {low:.2f} to {high:.2f}"
    return FigureRow(figure, how, read, mean, None, 2)


def least_rate_bound(users: int) -> float:
    """Return what the least of the users' mean rates cannot exceed, in bit/s/Hz.

    The drone sends to one user at a time, at a rate that is highest right above this user. So all
    mean rates together are at most this rate, and the least one is at most an equal share of it.
    """
    return float(rate_at(np.zeros(1))[0]) / users


def rate_at(away_m: Array) -> Array:
    """Return the rates at horizontal distances from the drone, in bit/s/Hz."""
    return np.asarray(np.log2(1.0 + _above() / (1.0 + (away_m / HEIGHT_M) ** 2)))


def _above() -> float:
    """Return the signal-to-noise ratio right below the drone."""
    return float(10.0 ** (BUDGET.snr_db(LOSS.los_db(0.0, HEIGHT_M, 2.0)) / 10.0))


def users(seed: int) -> Array:
    """Draw the places of the users: the centres of cells of 10 m, as (x, y) in metres."""
    cells = np.random.default_rng(seed).integers(0, round(SIDE_M / CELL_M), (USERS, 2))
    return np.asarray((cells + 0.5) * CELL_M, dtype=np.float64)


# ---- one drone


def static(places: Array) -> float:
    """Return the least rate if the drone hovers at the best place and shares its time."""

    def inverse(place: Array) -> float:
        return float((1.0 / rate_at(np.linalg.norm(places - place, axis=1))).sum())

    axis = np.linspace(0.0, SIDE_M, 41)
    tried = [np.array([x, y]) for x in axis for y in axis]
    solved = minimize(inverse, min(tried, key=inverse), method="Nelder-Mead")
    return float(1.0 / solved.fun)


def circular(places: Array) -> float:
    """Return the least rate on the best circle round the middle of the users, at even speed."""
    angles = np.linspace(0.0, 2.0 * math.pi, 72, endpoint=False)
    ring = np.column_stack([np.cos(angles), np.sin(angles)])
    middle = places.mean(axis=0)
    return max(shared(places, middle + radius * ring) for radius in np.arange(0.0, 1001.0, 50.0))


def shared(places: Array, way: Array) -> float:
    """Return the least rate of users if the time at each point of a way is divided at its best."""
    rates = rate_at(np.linalg.norm(places[:, None] - way[None], axis=2))
    count, points = rates.shape
    gains = np.hstack([np.ones((count, 1)), -np.eye(count).repeat(points, 1) * rates.ravel()])
    gains[:, 1:] /= points
    times = np.hstack([np.zeros((points, 1)), np.tile(np.eye(points), count)])
    solved = linprog(
        np.eye(1, 1 + rates.size)[0] * -1.0,
        A_ub=np.vstack([gains, times]),
        b_ub=np.concatenate([np.zeros(count), np.ones(points)]),
    )
    return float(-solved.fun)


def long_tour(places: Array, time_s: float) -> Tour:
    """Return the best flight from user to user in straight legs, in a circle.

    Above a user the drone serves this user, and on its way the one whose link is best. If there is
    time to hover above each of them, any second of a hover can be passed on from one user to
    another one. So all users get the same, the sum of all rates is what counts, and the best order
    is that of the shortest tour if a leg is as long as what is lost on it. Raises ValueError if
    there is no time to hover above each user.
    """
    count = len(places)
    legs = {(i, j): _leg(places, i, j) for i in range(count) for j in range(count) if i != j}
    above = float(rate_at(np.zeros(1))[0])
    lost = {pair: time * above - gets.sum() for pair, (time, gets) in legs.items()}
    tours = ((0, *rest) for rest in permutations(range(1, count)))
    order = min(tours, key=lambda tour: sum(lost[pair] for pair in _pairs(tour)))
    flights = [legs[pair] for pair in _pairs(order)]
    legs_s, carried = np.array([leg[0] for leg in flights]), sum(leg[1] for leg in flights)
    rate = float((time_s - legs_s.sum()) * above + np.sum(carried)) / (count * time_s)
    hovers = (rate * time_s - np.asarray(carried)) / above
    if hovers.min() < 0.0:
        raise ValueError(f"{time_s:g} s are too short to hover above each user")
    return Tour(order, legs_s, np.asarray(carried), hovers, rate)


def _pairs(tour: Sequence[int]) -> list[tuple[int, int]]:
    return list(zip(tour, (*tour[1:], tour[0]), strict=True))


def _leg(places: Array, start: int, stop: int) -> tuple[float, Array]:
    """Return the time of a leg, and what each user gets on it if the best link is served."""
    length_m = math.dist(places[start], places[stop])
    share = (np.arange(4000) + 0.5) / 4000
    way = places[start] + share[:, None] * (places[stop] - places[start])
    rates = rate_at(np.linalg.norm(places[:, None] - way[None], axis=2))
    best = rates.argmax(axis=0)
    time_s = length_m / SPEED_MPS
    gets = np.bincount(best, rates[best, np.arange(4000)], len(places)) * time_s / 4000
    return time_s, gets


# ---- the same in the simulator


def _simulated() -> Iterator[FigureRow]:
    """Yield the rates of the first draw's flight beside those that were computed."""
    tour = long_tour(users(0), LONG_S)
    rates = simulated(0)
    above, step = least_rate_bound(1), _step()
    aloft = float(tour.legs_s.sum()) + USERS * STOP_S
    how = f"computed for draw 0; simulated with {CLASSES} classes and hovers of whole seconds"
    limit = (above * 0.5 + step / 2.0 * aloft) / LONG_S
    yield FigureRow("its least rate, flown", how, tour.rate, min(rates), limit, 4)
    limit = step / 2.0 * aloft / LONG_S / USERS + above * STOP_S / LONG_S
    yield FigureRow("its mean rate, flown", how, tour.rate, float(np.mean(rates)), limit, 4)


def _step() -> float:
    """Return by how much the rates of neighbouring classes differ, in bit/s/Hz."""
    return (least_rate_bound(1) - LOWEST) / (CLASSES - 1)


@cache
def simulated(seed: int) -> tuple[float, ...]:
    """Return each user's rate on the flight of 800 s in the simulator, in bit/s/Hz.

    Each user has a download that does not end, and the link with the highest class gets the band of
    1 MHz. A class has the rate in the middle of its interval, and the highest one that of a hover.
    """
    places, tour = users(seed), long_tour(users(seed), LONG_S)
    above, step = least_rate_bound(1), _step()
    rates = [round(above - step * below, 6) for below in reversed(range(CLASSES))]
    classes = [
        {"snr_db": 10.0 * math.log10(2.0 ** (rate - step / 2.0) - 1.0), "bit_s_hz": rate}
        for rate in rates
    ]
    scenario = {
        "map": {"cells": [round(SIDE_M / CELL_M)] * 2, "levels": {"min_altitude_m": HEIGHT_M}},
        "drones": {
            "start_cells": [(places[tour.order[0]] // CELL_M).astype(int).tolist()],
            "radio": {
                "kind": "link_classes",
                "power_dbm": BUDGET.power_dbm,
                "bandwidth_mhz": 1.0,
                "noise_figure_db": 0.0,
                "noise_dbm_per_hz": BUDGET.noise_dbm - 60.0,
                "path_loss": {"kind": "log_distance", "exponent": 2, "at_1m_db": 60},
                "classes": classes,
                "sharing": "max_rate",
            },
        },
        "users": {"positions_m": places.tolist(), "mobility": {"kind": "static"}},
        "services": {"download": {"kind": "transfer", "volume_mbit": [100_000]}},
        "demand": {"kind": "static", "mix": {"download": 1}},
        "episode": {"steps": round(LONG_S / 10.0), "step_s": 10},
    }
    there = [(float(places[user][0]), float(places[user][1])) for user in tour.order]
    hovers = [round(tour.hovers_s[user]) for user in tour.order]
    hovers[0] -= 1  # the command to fly where the drone is lasts for a second
    stops = [*zip(there, hovers, strict=True), (there[0], 0)]
    requests = flown(scenario, SIDE_M, stops).requests.sort_values("user")
    return tuple((requests["delivered_mbit"] / LONG_S).tolist())


# ---- two drones


@cache
def two_drones(seed: int, time_s: int) -> float:
    """Return the least rate of two drones whose flights are optimised, in bit/s/Hz."""
    hop, slots = SPEED_MPS * SLOT_S / HEIGHT_M, round(time_s / SLOT_S)
    return best_flights(users(seed) / HEIGHT_M, _above(), hop, slots).rate


def draw() -> Figure:
    """Draw the rate of one drone over the time of its flight: the range of the draws of users."""
    from desim_uav.report.figures.papers import Series, lines_figure

    times = np.arange(400.0, 1001.0, 50.0).tolist()
    rates = np.array([[long_tour(users(seed), t).rate for t in times] for seed in range(DRAWS)])
    bound = least_rate_bound(USERS)
    drawn = [
        Series("mean", times, rates.mean(axis=0).tolist(), ((LONG_S, READ["optimised"]),)),
        Series(f"lowest of {DRAWS} draws of users", times, rates.min(axis=0).tolist()),
        Series("highest of them", times, rates.max(axis=0).tolist()),
        Series("bound", [times[0], times[-1]], [bound, bound]),
    ]
    how = "read off the paper"
    return lines_figure("One drone, six users", "time, s", "least rate, bit/s/Hz", drawn, how)
