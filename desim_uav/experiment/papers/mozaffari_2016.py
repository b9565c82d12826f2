"""Mozaffari, Saad, Bennis and Debbah 2016: several drones over a disc are packed circles."""

from __future__ import annotations

import math
from collections.abc import Iterator
from functools import cache
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize

from desim_uav.experiment.papers.row import FigureRow, evaluated

if TYPE_CHECKING:
    from matplotlib.figure import Figure

STARTS, SEED = 12, 2016

Array = NDArray[np.float64]


def _ring(around: int) -> float:
    """Return the radius of ``around`` equal discs in a ring that touches the unit circle."""
    return 1.0 / (1.0 + 1.0 / math.sin(math.pi / around))


OPTIMA = {
    **{2: _ring(2), 3: _ring(3), 4: _ring(4), 5: _ring(5), 6: _ring(6)},
    **{7: 1.0 / 3.0, 8: _ring(7), 9: _ring(8)},
}
"""The largest radius of equal discs in a unit disc (Graham 1968, Pirl 1969): a ring, from seven
discs on with one in the middle."""


def rows() -> Iterator[FigureRow]:
    """Yield the radius of each drone's disc, and the share of the area that all cover."""
    how = "optimum known in closed form"
    for count, optimum in OPTIMA.items():
        radius, _ = packing(count)
        yield evaluated(f"{count} drones: radius of each", how, optimum, radius, 6)
        share, ours = count * optimum**2, count * radius**2
        yield evaluated(f"{count} drones: share covered", how, share, ours, 6, half_units=8.0)


@cache
def packing(count: int) -> tuple[float, Array]:
    """Return the radius and centres of the largest equal discs found in a unit disc.

    It is the best of several local optima from random centres, with a fixed seed.
    """
    random = np.random.default_rng(SEED)
    best: tuple[float, Array] = (0.0, np.zeros((count, 2)))
    for _ in range(STARTS):
        angles = random.uniform(0.0, 2.0 * math.pi, count)
        places = 0.8 * random.uniform(size=count) ** 0.25  # most of them near the edge
        centres = np.column_stack([places * np.cos(angles), places * np.sin(angles)])
        solution = minimize(
            lambda z: -z[-1],
            np.append(centres, 0.02),
            jac=lambda z: np.append(np.zeros(len(z) - 1), -1.0),
            constraints={"type": "ineq", "fun": _room, "jac": _room_by_place},
            method="SLSQP",
            options={"maxiter": 200, "ftol": 1e-10},
        )
        if solution.x[-1] > best[0] and _room(solution.x).min() > -1e-9:
            best = float(solution.x[-1]), solution.x[:-1].reshape(-1, 2)
    return best


def _room(z: Array) -> Array:
    """Return the room between discs and to the edge, as differences of squares, not negative."""
    centres, radius = z[:-1].reshape(-1, 2), z[-1]
    one, other = np.triu_indices(len(centres), 1)
    between = ((centres[one] - centres[other]) ** 2).sum(1) - 4.0 * radius**2
    within = (1.0 - radius) ** 2 - (centres**2).sum(1)
    return np.concatenate([between, within])


def _room_by_place(z: Array) -> Any:
    """Return the derivatives of the room by the places of the discs and their radius."""
    centres, radius = z[:-1].reshape(-1, 2), z[-1]
    count = len(centres)
    one, other = np.triu_indices(count, 1)
    pairs = np.arange(len(one))
    slopes = np.zeros((len(one) + count, count, 2))
    apart = 2.0 * (centres[one] - centres[other])
    slopes[pairs, one], slopes[pairs, other] = apart, -apart
    alone = np.arange(count)
    slopes[len(one) + alone, alone] = -2.0 * centres
    by_radius = np.append(np.full(len(one), -8.0 * radius), np.full(count, -2.0 * (1.0 - radius)))
    return np.column_stack([slopes.reshape(len(slopes), -1), by_radius])


def draw() -> Figure:
    """Draw the packings that were found."""
    from desim_uav.report.figures.papers import discs_figure

    return discs_figure("Largest equal discs in a disc", [packing(count) for count in OPTIMA])
