"""Zeng, Xu and Zhang 2019: a drone serves nodes on its way with the least energy, or in least time.

The setting is that of the paper's figure 7, whose nodes are in a diagram only. Ours are drawn.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from functools import cache
from itertools import pairwise, permutations
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linprog, minimize

from desim_uav.experiment.papers.flown import ACCELERATION_MPS2, flown
from desim_uav.experiment.papers.row import FigureRow, evaluated
from desim_uav.model.energy.propulsion.rotary_wing import ROTORS, best_speeds, power_w, powers_of

Array = NDArray[np.float64]

POWERS = powers_of(ROTORS["zeng2019"])
HOVER_W = power_w(POWERS, 0.0)
RANGE_MPS = best_speeds(POWERS).range_mps
RANGE_J_M = power_w(POWERS, RANGE_MPS) / RANGE_MPS

APART_MPS = 18.29513
"""The speed of the longest range, by the paper's formulas evaluated apart."""

HEIGHT_M, ABOVE, BAND_HZ = 100.0, 10.0**1.25, 1e6
"""52.5 dB at 1 m in free space, so 12.5 dB at 100 m, in 1 MHz."""

LINK_W, FASTEST_MPS = 5.0, 30.0

START, END = np.array([50.0, 50.0]), np.array([850.0, 850.0])
"""800 m apart along both axes, as in the paper, but from the middle of a cell of our map."""

SIDE_M, NODES, DRAWS = 1000.0, 3, 10
LOW_MBIT, HIGH_MBIT = 0.1, 200.0
PIECE_M = 10.0
"""The longest piece of a path in which a rate is that of the middle of the piece."""


class Cost(NamedTuple):
    """What is minimised, per metre of flight, second of a hover and second of a link; the speed."""

    metre: float
    hover_s: float
    link_s: float
    speed_mps: float


COSTS = {
    "energy": Cost(RANGE_J_M, HOVER_W, LINK_W, RANGE_MPS),
    "time": Cost(1.0 / FASTEST_MPS, 1.0, 0.0, FASTEST_MPS),
}


class Plan(NamedTuple):
    """The places of hovers (nodes, 2) in their order, how long they last, and the cost."""

    places: Array
    hovers_s: Array
    cost: float


Scheme = Callable[[Array, float, Cost], Plan]
"""A plan for nodes, each of which needs so many bits, and a cost."""


def drawn_nodes(draw: int) -> Array:
    """Return the places of the nodes (nodes, 2) of a draw, between the start and the end."""
    return np.asarray(START + (END - START) * np.random.default_rng(draw).random((NODES, 2)))


def rate_bps(away_m: Array) -> Array:
    """Return the rates of a link at horizontal distances."""
    return np.asarray(BAND_HZ * np.log2(1.0 + ABOVE / (1.0 + (away_m / HEIGHT_M) ** 2)))


def ways_m(places: Array) -> list[float]:
    """Return the lengths of the ways from the start through places to the end."""
    return [math.dist(one, other) for one, other in pairwise([START, *places, END])]


def plan(places: Array, nodes: Array, bits: float, cost: Cost) -> Plan:
    """Return the plan that serves a node from each of these places."""
    hovers_s = bits / rate_bps(np.linalg.norm(places - nodes, axis=1))
    total = cost.metre * sum(ways_m(places)) + (cost.hover_s + cost.link_s) * float(hovers_s.sum())
    return Plan(places, hovers_s, total)


# ---- the schemes of figure 7, without those by successive convex approximation


def above_each(nodes: Array, bits: float, cost: Cost) -> Plan:
    """Return the best plan that hovers above each node: that of the shortest way."""
    orders = map(np.array, permutations(nodes.tolist()))
    return min((plan(order, order, bits, cost) for order in orders), key=lambda one: one.cost)


def at_centre(nodes: Array, bits: float, cost: Cost) -> Plan:
    """Return the plan that serves all nodes from their geometric centre."""
    return plan(np.tile(nodes.mean(axis=0), (len(nodes), 1)), nodes, bits, cost)


def optimised(nodes: Array, bits: float, cost: Cost) -> Plan:
    """Return the best plan over orders and places of hovers, by local searches."""
    plans = (_improved(np.array(order), bits, cost) for order in permutations(nodes.tolist()))
    return min(plans, key=lambda one: one.cost)


def _improved(nodes: Array, bits: float, cost: Cost) -> Plan:
    """Return a local optimum from between the nodes and the straight way: both have kinks."""
    straight = START + (END - START) * np.linspace(0.0, 1.0, len(nodes) + 2)[1:-1, None]

    def seconds(places: Array) -> float:
        return plan(places.reshape(-1, 2), nodes, bits, cost).cost / cost.hover_s

    solved = minimize(seconds, (0.5 * (nodes + straight)).ravel(), method="BFGS")
    return plan(solved.x.reshape(-1, 2), nodes, bits, cost)


def continuous(nodes: Array, bits: float, cost: Cost) -> Plan:
    """Return the optimised path, on which nodes are served in flight, too: a linear program."""
    places = optimised(nodes, bits, cost).places
    middles, seconds = _pieces(places, cost.speed_mps)
    spots = np.vstack([middles, places])
    mbps = 1e-6 * rate_bps(np.linalg.norm(spots[:, None] - nodes, axis=2))
    at, users = mbps.shape
    # The variables are the seconds of each link at each spot, and then those of each hover.
    shares = np.kron(np.eye(at), np.ones(users))
    hovers = np.vstack([np.zeros((len(middles), len(places))), -np.eye(len(places))])
    served = np.hstack([np.diag(row) for row in mbps])
    solved = linprog(
        np.repeat([cost.link_s, cost.hover_s], [at * users, len(places)]),
        np.block([[shares, hovers], [-served, np.zeros((users, len(places)))]]),
        np.concatenate([seconds, np.zeros(len(places)), np.full(users, -1e-6 * bits)]),
    )
    return Plan(places, solved.x[at * users :], cost.metre * sum(ways_m(places)) + solved.fun)


def _pieces(places: Array, speed_mps: float) -> tuple[Array, Array]:
    """Return the middles of a path's pieces (pieces, 2), and the seconds that each takes."""
    middles, seconds = [], []
    for begin, end in pairwise([START, *places, END]):
        count = math.ceil(math.dist(begin, end) / PIECE_M)
        middles += [begin + (end - begin) * (k + 0.5) / count for k in range(count)]
        seconds += [math.dist(begin, end) / count / speed_mps] * count
    return np.array(middles), np.array(seconds)


SCHEMES: dict[str, Scheme] = {
    "at the centre": at_centre,
    "above each": above_each,
    "optimised": optimised,
    "sending in flight": continuous,
}
"""The schemes that are computed, each better than the one before if much is to be sent."""


# ---- what is compared


def rows() -> Iterator[FigureRow]:
    """Yield the speed of Lemma 1, the orderings of figure 7, and plans beside their flights."""
    how = "Lemma 1: on the way to a node, the speed of the longest range, evaluated apart"
    yield evaluated("one node: speed of the best plan, m/s", how, APART_MPS, best_speed(), 3)
    for name in COSTS:
        yield from _orderings(name)
    how = "the paper's formula, with hovers of whole seconds; simulated"
    for name, scheme in SCHEMES.items():
        one = scheme(drawn_nodes(0), 1e6 * HIGH_MBIT, COSTS["energy"])
        expected, ours, limit = flown_j(one)
        figure = f"{HIGH_MBIT:.0f} Mbit each, {name}: energy of flight, J"
        yield FigureRow(figure, how, expected, ours, limit, 0)


def _orderings(name: str) -> Iterator[FigureRow]:
    """Yield the shares of the draws of nodes that have the orderings of the paper's text."""
    pairs = [
        (LOW_MBIT, "at the centre", "above each"),
        (HIGH_MBIT, "above each", "at the centre"),
        (LOW_MBIT, "optimised", "at the centre"),
        (HIGH_MBIT, "optimised", "above each"),
        (LOW_MBIT, "sending in flight", "optimised"),
        (HIGH_MBIT, "sending in flight", "optimised"),
    ]
    for mbit, better, worse in pairs:
        less = np.mean([costs[better] < costs[worse] for costs in _costs(name, mbit)])
        figure = f"{mbit:g} Mbit each: draws with less {name} {better} than {worse}"
        yield FigureRow(figure, "figure 7, the ordering in the text", 1.0, float(less), 0.0, 1)


@cache
def _costs(name: str, mbit: float) -> list[dict[str, float]]:
    """Return the cost of each scheme, for each draw of the nodes."""
    return [
        {
            scheme: of(drawn_nodes(draw), 1e6 * mbit, COSTS[name]).cost
            for scheme, of in SCHEMES.items()
        }
        for draw in range(DRAWS)
    ]


def best_speed() -> float:
    """Return the speed of the best way to a node 1 km away, found with the place of the hover.

    The paper's Lemma 1 finds the place alone, at the speed of the longest range. With 1,000 Mbit it
    lies between the start and the node.
    """

    def energy_j(chosen: Array) -> float:
        way_m, speed_mps = 1000.0 * chosen[0], 10.0 * float(chosen[1])
        hover_s = 1e9 / float(rate_bps(np.array(1000.0 - way_m)))
        return float(way_m * power_w(POWERS, speed_mps) / speed_mps + HOVER_W * hover_s) / 1e4

    options = {"xatol": 1e-9, "fatol": 1e-15, "maxiter": 2000}
    solved = minimize(energy_j, np.array([0.5, 1.0]), method="Nelder-Mead", options=options)
    return 10.0 * float(solved.x[1])


def flown_j(one: Plan) -> tuple[float, float, float]:
    """Return the energy of a flight by formula and in the simulator, and how far apart they may be.

    Hovers are of whole seconds, and in the simulator each leg has a ramp at either end. What the
    drone uses there after its arrival at the end is not counted, nor are links.
    """
    hovers = [math.ceil(each) for each in one.hovers_s]
    ways = ways_m(one.places)
    legs = sum(way > 1e-6 for way in ways)
    flight_s = sum(ways) / RANGE_MPS
    minutes = math.ceil((flight_s + sum(hovers)) / 60.0) + 1
    idle_j = HOVER_W * (60.0 * minutes - flight_s - sum(hovers))
    places = [(float(x), float(y)) for x, y in [*one.places, END]]
    scenario = {
        "map": {"cells": [10, 10], "levels": {"min_altitude_m": HEIGHT_M}},
        "drones": {
            "start_cells": [[0, 0]],
            "battery": {"kind": "rotary_wing", "capacity_wh": 1000},
        },
        "users": {"count": 1, "mobility": {"kind": "static"}},
        "episode": {"steps": minutes, "step_s": 60},
    }
    stops = list(zip(places, [*hovers, 0], strict=True))
    episodes = flown(scenario, SIDE_M, stops, RANGE_MPS).episodes
    expected = sum(ways) * RANGE_J_M + HOVER_W * sum(hovers)
    limit = legs * RANGE_MPS / ACCELERATION_MPS2 * HOVER_W
    return expected, 3600.0 * float(episodes["energy_wh"].sum()) - idle_j, limit
