"""Products with matrices of which most numbers are 0, such as what drones see as ``radar``.

Only about a sixth of these features are not 0. With layers of 128 units, leaving out the others is
faster than a product of whole matrices, although that is better optimised.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from desim_uav.rowcode.kernels import kernel, rule

MANY = 0.3
"""The share of numbers other than 0 from which on whole matrices are multiplied."""

EACH = 16
"""Of so many rows the first one is looked at, to see how many numbers are 0."""


def sums(inputs: NDArray[Any], layer: NDArray[Any]) -> NDArray[Any]:
    """Return ``inputs`` times all rows of ``layer`` but the last, plus the last row.

    The shapes are (rows, features), (features + 1, units), and that of the result (rows, units).
    Raises ValueError if they do not fit.
    """
    _refuse_unfit(inputs, layer)
    if not _mostly_zero(inputs):
        dense: NDArray[Any] = inputs @ layer[:-1] + layer[-1]
        return dense
    found = np.repeat(layer[-1:], len(inputs), 0)
    places, numbers = _room(inputs.shape[1], inputs)
    _sums(inputs, layer, places, numbers, found)
    return found


def slopes_of_sums(inputs: NDArray[Any], slopes: NDArray[Any], found: NDArray[Any]) -> None:
    """Write the slopes in all numbers of a layer to ``found``, from those in its ``sums``.

    The shapes are (rows, features), (rows, units) and (features + 1, units). Raises ValueError if
    they do not fit.
    """
    _refuse_unfit(inputs, found)
    found[-1] = slopes.sum(0)
    if not _mostly_zero(inputs):
        found[:-1] = inputs.T @ slopes
        return
    found[:-1] = 0.0
    places, numbers = _room(len(inputs), inputs)
    _slopes_of_sums(inputs, slopes, places, numbers, found)


def _refuse_unfit(inputs: NDArray[Any], layer: NDArray[Any]) -> None:
    if inputs.shape[1] + 1 != len(layer):
        raise ValueError(f"{inputs.shape[1]} inputs do not fit a layer of {len(layer) - 1}")


def _mostly_zero(inputs: NDArray[Any]) -> bool:
    some = inputs[::EACH]
    return bool(np.count_nonzero(some) < MANY * some.size)


def _room(most: int, like: NDArray[Any]) -> tuple[NDArray[np.int64], NDArray[Any]]:
    """Return room for the places of so many numbers that may not be 0, and for the numbers."""
    return np.empty(most + 1, np.int64), np.empty(most + 1, like.dtype)


@rule
def _add(found: Any, rows: Any, places: Any, numbers: Any, many: int) -> None:
    """Add so many rows, each times its number, to ``found``: four at a time, and then the rest."""
    units, k = found.size, 0
    while k + 4 <= many:
        a, b, c, d = numbers[k], numbers[k + 1], numbers[k + 2], numbers[k + 3]
        of_a, of_b = rows[places[k]], rows[places[k + 1]]
        of_c, of_d = rows[places[k + 2]], rows[places[k + 3]]
        for unit in range(units):
            found[unit] += (a * of_a[unit] + b * of_b[unit]) + (c * of_c[unit] + d * of_d[unit])
        k += 4
    while k < many:
        a, of_a = numbers[k], rows[places[k]]
        for unit in range(units):
            found[unit] += a * of_a[unit]
        k += 1


@kernel
def _sums(inputs: Any, layer: Any, places: Any, numbers: Any, found: Any) -> None:
    rows, features = inputs.shape
    for row in range(rows):
        many = 0
        for feature in range(features):  # a number of 0 is written over by the next one
            places[many], numbers[many] = feature, inputs[row, feature]
            many += inputs[row, feature] != 0.0
        _add(found[row], layer, places, numbers, many)


@kernel
def _slopes_of_sums(inputs: Any, slopes: Any, places: Any, numbers: Any, found: Any) -> None:
    rows, features = inputs.shape
    for feature in range(features):
        many = 0
        for row in range(rows):
            places[many], numbers[many] = row, inputs[row, feature]
            many += inputs[row, feature] != 0.0
        _add(found[feature], slopes, places, numbers, many)
