"""Zeng, Xu and Zhang 2019: a drone flies, hovers and serves nodes with the least energy."""

from __future__ import annotations

import math
from collections.abc import Iterator
from functools import cache
from itertools import pairwise, permutations
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize

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

HEIGHT_M, ABOVE, BAND_HZ = 100.0, 1000.0, 1e6
"""Of our own: a band of 1 MHz, in which the signal-to-noise ratio is 30 dB at 100 m."""

SIDE_M, START = 1000.0, (50.0, 50.0)
NODES_M = np.array([[250.0, 850.0], [550.0, 250.0], [650.0, 550.0], [950.0, 750.0]])
REQUIRED_MBIT = 300.0


class Plan(NamedTuple):
    """The places of hovers (nodes, 2) in their order, how long they last, and all energy in J."""

    places: Array
    hovers_s: Array
    energy_j: float


def rate_bps(away_m: Array) -> Array:
    """Return the rates of a link at horizontal distances."""
    return np.asarray(BAND_HZ * np.log2(1.0 + ABOVE / (1.0 + (away_m / HEIGHT_M) ** 2)))


def plan(places: Array, nodes: Array, bits: float, speed_mps: float = RANGE_MPS) -> Plan:
    """Return the plan that flies from the start to places and serves a node from each of them."""
    hovers_s = bits / rate_bps(np.linalg.norm(places - nodes, axis=1))
    way_m = sum(math.dist(one, other) for one, other in pairwise([START, *places]))
    flight_j = way_m * power_w(POWERS, speed_mps) / speed_mps
    return Plan(places, hovers_s, flight_j + HOVER_W * float(hovers_s.sum()))


def above_nodes(bits: float) -> Plan:
    """Return the best plan that hovers above each node: that of the shortest way."""
    orders = permutations(NODES_M.tolist())
    return min((plan(np.array(o), np.array(o), bits) for o in orders), key=lambda p: p.energy_j)


@cache
def optimised(bits: float) -> Plan:
    """Return the best plan over orders and places of hovers, by local searches."""
    best = above_nodes(bits)
    for order in permutations(NODES_M.tolist()):
        nodes = np.array(order)
        # From a little before each node: right above, the way has a kink.
        begin = nodes + 0.1 * (np.vstack([START, nodes[:-1]]) - nodes)
        solved = minimize(_energy_j, begin.ravel(), args=(nodes, bits), method="BFGS")
        flight = plan(solved.x.reshape(-1, 2), nodes, bits)
        best = min(best, flight, key=lambda one: one.energy_j)
    return best


def _energy_j(places: Array, nodes: Array, bits: float) -> float:
    return plan(places.reshape(-1, 2), nodes, bits).energy_j


def from_one_place(bits: float) -> Plan:
    """Return the best plan that serves all nodes from one place."""

    def energy_j(place: Array) -> float:
        return plan(np.tile(place, (len(NODES_M), 1)), NODES_M, bits).energy_j

    axis = np.linspace(0.0, SIDE_M, 21)
    first = min((np.array([x, y]) for x in axis for y in axis), key=energy_j)
    place = minimize(energy_j, first, method="Nelder-Mead").x
    return plan(np.tile(place, (len(NODES_M), 1)), NODES_M, bits)


# ---- what is compared


def rows() -> Iterator[FigureRow]:
    """Yield the speed of Lemma 1, and the energies of three plans beside those of flights."""
    how = "Lemma 1: on the way to a node, the speed of the longest range, evaluated apart"
    yield evaluated("one node: speed of the best plan, m/s", how, APART_MPS, best_speed(), 3)
    bits = REQUIRED_MBIT * 1e6
    plans = {
        "above each": above_nodes(bits),
        "optimised": optimised(bits),
        "from one place": from_one_place(bits),
    }
    how = "the paper's formula, with hovers of whole seconds; simulated"
    for name, one in plans.items():
        expected, ours, limit = flown_j(one)
        yield FigureRow(
            f"{REQUIRED_MBIT:.0f} Mbit each, {name}: energy, J", how, expected, ours, limit, 0
        )


def best_speed() -> float:
    """Return the speed of the best plan for a node 1 km away, found with the place of the hover.

    The paper's Lemma 1 finds the place alone, at the speed of the longest range. With 1,000 Mbit it
    lies between the start and the node.
    """
    node = np.array([[START[0] + 1000.0, START[1]]])

    def energy_j(chosen: Array) -> float:
        place = np.array([[START[0] + 1000.0 * chosen[0], START[1]]])
        return plan(place, node, 1e9, 10.0 * float(chosen[1])).energy_j / 1e4

    options = {"xatol": 1e-9, "fatol": 1e-15, "maxiter": 2000}
    solved = minimize(energy_j, np.array([0.5, 1.0]), method="Nelder-Mead", options=options)
    return 10.0 * float(solved.x[1])


def flown_j(one: Plan) -> tuple[float, float, float]:
    """Return the energy of a plan by formula and in the simulator, and how far apart they may be.

    Hovers are of whole seconds, and in the simulator each leg has a ramp at either end. What the
    drone uses there after its last hover is not counted.
    """
    hovers = [math.ceil(each) for each in one.hovers_s]
    ways = [math.dist(a, b) for a, b in pairwise([START, *one.places.tolist()])]
    legs = sum(way > 1e-6 for way in ways)
    flight_s = sum(ways) / RANGE_MPS
    minutes = math.ceil((flight_s + sum(hovers)) / 60.0) + 1
    idle_j = HOVER_W * (60.0 * minutes - flight_s - sum(hovers))
    stops = [((float(x), float(y)), each) for (x, y), each in zip(one.places, hovers, strict=True)]
    scenario = {
        "map": {"cells": [10, 10], "levels": {"min_altitude_m": HEIGHT_M}},
        "drones": {
            "start_cells": [[0, 0]],
            "battery": {"kind": "rotary_wing", "capacity_wh": 1000},
        },
        "users": {"positions_m": NODES_M.tolist(), "mobility": {"kind": "static"}},
        "episode": {"steps": minutes, "step_s": 60},
    }
    episodes = flown(scenario, SIDE_M, stops, RANGE_MPS).episodes
    expected = sum(ways) * RANGE_J_M + HOVER_W * sum(hovers)
    limit = legs * RANGE_MPS / ACCELERATION_MPS2 * HOVER_W
    return expected, 3600.0 * float(episodes["energy_wh"].sum()) - idle_j, limit
