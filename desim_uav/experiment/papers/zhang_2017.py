"""Zhang, Zeng and Zhang 2017: the shortest flight on which a drone never loses its link."""

from __future__ import annotations

import math
from collections.abc import Iterator
from functools import cache
from itertools import combinations, pairwise
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize
from scipy.sparse import csr_array
from scipy.sparse.csgraph import dijkstra, minimum_spanning_tree

from desim_uav.experiment.papers.flown import SPEED_MPS, STOP_S, Place, flown
from desim_uav.experiment.papers.row import FigureRow
from desim_uav.model.radio.link import LinkBudget
from desim_uav.model.radio.path_loss import LogDistance
from desim_uav.model.radio.rings import ring_m

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure

Array = NDArray[np.float64]

SIDE_M, HEIGHT_M = 10_000.0, 77.5
"""The side of the map, and the height of the drone above the stations."""

STATIONS_M = (
    *((1000.0, 1000.0), (3000.0, 800.0), (5000.0, 1400.0), (6600.0, 3000.0), (5600.0, 5000.0)),
    *((3400.0, 5400.0), (1600.0, 6800.0), (2600.0, 8600.0), (4800.0, 9200.0), (7000.0, 8400.0)),
    (9000.0, 9000.0),
)
"""Places of our own: the paper's are in a figure only."""

START, GOAL = (500.0, 500.0), (9500.0, 9500.0)
BUDGET = LinkBudget(power_dbm=0.0, bandwidth_mhz=1.0, noise_figure_db=0.0, noise_dbm_per_hz=-140.0)
LOSS = LogDistance(2.0, 0.0)
"""Together they give a signal-to-noise ratio of 80 dB at 1 m, which falls with the square."""

TARGETS_DB = (14.0, 15.0, 16.0, 17.0)
OUTSIDE_M, INSIDE_M = 1.0, 0.001
ROUNDING_M = 1e-7


class Flight(NamedTuple):
    """A shortest flight: the places at which it begins, turns and ends, and its length."""

    places: tuple[Place, ...]
    length_m: float


def stations() -> Array:
    """Return the places of the base stations, as (x, y) in metres."""
    return np.array(STATIONS_M)


def reach_m(target_db: float) -> float:
    """Return the horizontal distance up to which a station is received as well as the target."""
    largest_db = BUDGET.largest_loss_db(target_db)
    return ring_m(lambda away_m: LOSS.los_db(away_m, HEIGHT_M, 2.0), largest_db)


def shortest(centres: Array, radius_m: float, start: Place, goal: Place) -> Flight:
    """Return the shortest flight between two places within equal discs; inf long if there is none.

    Within a disc, which is convex, a shortest flight is straight. So it turns only where it passes
    from one disc to another one at a point on the edge of their union that points inwards: a point
    in which two circles intersect. It is a shortest path in the graph of these points, the start
    and the goal, of which two are joined if all of the line between them is within the discs.
    """
    nodes = np.array([start, goal, *_crossings(centres, radius_m)])
    links = np.zeros((len(nodes), len(nodes)))
    for one, other in combinations(range(len(nodes)), 2):
        if outside_m(centres, radius_m, nodes[one], nodes[other]) <= ROUNDING_M:
            links[one, other] = math.dist(nodes[one], nodes[other])
    lengths, before = dijkstra(
        csr_array(links), directed=False, indices=0, return_predecessors=True
    )
    at, places = 1, [goal]
    while before[at] >= 0:
        at = before[at]
        places.append((float(nodes[at][0]), float(nodes[at][1])))
    return Flight(tuple(reversed(places)), float(lengths[1]))


def _crossings(centres: Array, radius_m: float) -> Iterator[Array]:
    """Yield the points in which two circles intersect."""
    for one, other in combinations(centres, 2):
        apart_m = math.dist(one, other)
        if apart_m <= 2.0 * radius_m:
            aside = math.sqrt(radius_m**2 - (apart_m / 2.0) ** 2) / apart_m
            across = np.array([one[1] - other[1], other[0] - one[0]]) * aside
            yield (one + other) / 2.0 + across
            yield (one + other) / 2.0 - across


def outside_m(centres: Array, radius_m: float, start: Array, goal: Array) -> float:
    """Return how much of the line between two places is in none of the discs, in metres."""
    length_m = math.dist(start, goal)
    if length_m == 0.0:
        return 0.0
    ahead = (goal - start) / length_m
    middles = (centres - start) @ ahead
    squares = radius_m**2 - ((centres - start) ** 2).sum(axis=1) + middles**2
    halves = np.sqrt(squares[squares >= 0.0])
    middles = middles[squares >= 0.0]
    reached_m, gaps_m = 0.0, 0.0
    for enter_m, leave_m in sorted(zip(middles - halves, middles + halves, strict=True)):
        gaps_m += max(0.0, min(enter_m, length_m) - reached_m)
        reached_m = max(reached_m, leave_m)
    return float(gaps_m + max(0.0, length_m - reached_m))


# ---- the paper's own form of the problem


def shortest_by_sequences(centres: Array, radius_m: float, start: Place, goal: Place) -> float:
    """Return the length of the shortest flight by the paper's form of the problem, in metres.

    For each sequence of stations, the places of the handovers are those of a convex program: the
    lengths of the straight lines between them add up to the least, with each place in both discs.
    """
    reached = [
        [k for k, centre in enumerate(centres) if math.dist(centre, end) <= radius_m]
        for end in (start, goal)
    ]
    best_m = math.inf
    for first in reached[0]:
        for sequence in _sequences(centres, radius_m, [first], set(reached[1])):
            best_m = min(best_m, _handovers_m(centres[sequence], radius_m, start, goal))
    return best_m


def _sequences(
    centres: Array, radius_m: float, begun: list[int], last: set[int]
) -> Iterator[list[int]]:
    """Yield all sequences of different stations whose neighbours' discs overlap."""
    if begun[-1] in last:
        yield begun
    for number, centre in enumerate(centres):
        if number not in begun and math.dist(centres[begun[-1]], centre) <= 2.0 * radius_m:
            yield from _sequences(centres, radius_m, [*begun, number], last)


def _handovers_m(centres: Array, radius_m: float, start: Place, goal: Place) -> float:
    """Return the least length of a flight that is handed over along a sequence of stations."""
    if len(centres) == 1:
        return math.dist(start, goal)
    unit = radius_m

    def length(places: Array) -> float:
        points = np.vstack([start, places.reshape(-1, 2) * unit, goal])
        return float(np.linalg.norm(np.diff(points, axis=0), axis=1).sum() / unit)

    def within(places: Array) -> Array:
        points = places.reshape(-1, 2)
        both = np.concatenate([points - centres[:-1] / unit, points - centres[1:] / unit])
        return np.asarray(1.0 - (both**2).sum(axis=1), dtype=np.float64)

    middles = (centres[:-1] + centres[1:]) / 2.0 / unit
    solved = minimize(
        length,
        middles.ravel(),
        method="SLSQP",
        constraints={"type": "ineq", "fun": within},
        options={"maxiter": 500, "ftol": 1e-12},
    )
    return float(solved.fun * unit) if within(solved.x).min() > -1e-9 else math.inf


def widest_target_db(centres: Array, start: Place, goal: Place) -> float:
    """Return the highest target that a flight can keep, by the paper's condition.

    There is a flight if and only if start and goal are each within reach of a station, and these
    two are joined by stations of which neighbours are at most twice the reach apart.
    """
    points = np.vstack([start, goal, centres])
    apart_m = np.linalg.norm(points[:, None] - points[None], axis=2)
    apart_m[2:, 2:] /= 2.0
    apart_m[0, 1] = apart_m[1, 0] = 0.0  # not joined but by stations
    tree = minimum_spanning_tree(csr_array(apart_m)).toarray()
    _, before = dijkstra(tree + tree.T, indices=0, return_predecessors=True)
    at, widest_m = 1, 0.0
    while before[at] >= 0:
        widest_m = max(widest_m, apart_m[at, before[at]])
        at = int(before[at])
    return BUDGET.snr_db(LOSS.los_db(widest_m, HEIGHT_M, 2.0))


# ---- the simulator


@cache
def simulated(target_db: float, wider_m: float) -> tuple[float, float]:
    """Return when a flight has ended in the simulator, and for how long it had no link, in seconds.

    It is the shortest flight within discs that are so much wider than the reach of the stations.
    """
    flight = shortest(stations(), reach_m(target_db) + wider_m, START, GOAL)
    scenario = {
        "map": {"cells": [10, 10], "levels": {"min_altitude_m": HEIGHT_M}},
        "drones": {
            "start_cells": [[0, 0]],
            "radio": {
                "kind": "link_classes",
                "power_dbm": BUDGET.power_dbm,
                "bandwidth_mhz": BUDGET.bandwidth_mhz,
                "noise_figure_db": BUDGET.noise_figure_db,
                "noise_dbm_per_hz": BUDGET.noise_dbm_per_hz,
                "path_loss": {"kind": "log_distance", "exponent": 2, "at_1m_db": 0},
                "classes": [{"snr_db": target_db, "bit_s_hz": 1}],
            },
        },
        "users": {"positions_m": stations().tolist(), "mobility": {"kind": "static"}},
        "episode": {"steps": 10, "step_s": 60},
    }
    tables = flown(scenario, SIDE_M, [(place, 0) for place in flight.places[1:]])
    assert tables.events is not None
    arrivals = tables.events.loc[tables.events["kind"] == "arrive", "t_us"]
    end_us = int(arrivals.iloc[len(flight.places) - 2])
    return end_us / 1e6, _without_link_us(tables.events, end_us) / 1e6


def _without_link_us(events: pd.DataFrame, end_us: int) -> int:
    """Return for how long no station was in reach, from a log of events."""
    linked, since_us, without_us = 0, 0, 0
    own = events[events["kind"].isin(["enter", "exit"]) & (events["t_us"] <= end_us)]
    for t_us, kind in zip(own["t_us"].tolist(), own["kind"].tolist(), strict=True):
        if linked == 0:
            without_us += t_us - since_us
        linked, since_us = linked + (1 if kind == "enter" else -1), t_us
    return without_us if linked else without_us + end_us - since_us


def rows() -> Iterator[FigureRow]:
    """Yield the shortest flights, found in two ways and flown, and the highest target."""
    centres = stations()
    for target in TARGETS_DB:
        radius, what = reach_m(target), f"{target:.0f} dB: "
        flight = shortest(centres, radius, START, GOAL)
        apart = shortest_by_sequences(centres, radius, START, GOAL) / SPEED_MPS
        how = "the paper's convex program, for each sequence of stations"
        ours = flight.length_m / SPEED_MPS
        yield FigureRow(what + "shortest flight, s", how, apart, ours, 1e-5, 5)
        inside = shortest(centres, radius - INSIDE_M, START, GOAL)
        legs = len(inside.places) - 1
        took, lost = simulated(target, -INSIDE_M)
        how = f"the length over 50 m/s, and {legs} stops of 5 ms; simulated"
        expected = inside.length_m / SPEED_MPS + legs * STOP_S
        yield FigureRow(what + "flown, s", how, expected, took, 1e-6 * legs, 6)
        how = "within reach all the time; simulated"
        yield FigureRow(what + "without a link, s", how, 0.0, lost, 0.0, 6)
        yield from _outside(what, target)
    ours = _widest_by_flights_db()
    how = "the paper's condition on the distances of stations"
    yield FigureRow(
        "highest target, dB", how, widest_target_db(centres, START, GOAL), ours, 1e-5, 5
    )


def _outside(what: str, target_db: float) -> Iterator[FigureRow]:
    """Yield how long the link is lost on a flight that turns a metre too far out."""
    radius = reach_m(target_db)
    flight = shortest(stations(), radius + OUTSIDE_M, START, GOAL)
    gaps_s = sum(
        outside_m(stations(), radius, np.array(one), np.array(other)) / SPEED_MPS
        for one, other in pairwise(flight.places)
    )
    lost = simulated(target_db, OUTSIDE_M)[1]
    turns = len(flight.places) - 2
    how = f"the line outside the discs over 50 m/s, and {turns} stops of 5 ms; simulated"
    yield FigureRow(
        f"{what}a metre outside, without a link, s",
        how,
        gaps_s + turns * STOP_S,
        lost,
        2e-6 * turns,
        6,
    )


def _widest_by_flights_db() -> float:
    """Return the highest target at which there is a shortest flight, by bisection."""
    low, high = 0.0, 40.0
    while high - low > 1e-7:
        middle = (low + high) / 2.0
        there_is = math.isfinite(shortest(stations(), reach_m(middle), START, GOAL).length_m)
        low, high = (middle, high) if there_is else (low, middle)
    return low


def draw() -> Figure:
    """Draw the time of the shortest flight over the target, with that of the straight flight."""
    from desim_uav.report.figures.papers import Series, lines_figure

    highest = widest_target_db(stations(), START, GOAL)
    targets = [*np.arange(10.0, highest, 0.1).tolist(), highest - 1e-6]
    times = [shortest(stations(), reach_m(t), START, GOAL).length_m / SPEED_MPS for t in targets]
    straight = math.dist(START, GOAL) / SPEED_MPS
    return lines_figure(
        "Shortest flight that keeps the link",
        "target of the signal-to-noise ratio, dB",
        "time, s",
        [
            Series("shortest", targets, times),
            Series("straight", [targets[0], targets[-1]], [straight, straight]),
        ],
    )
