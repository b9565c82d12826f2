"""The gain of a path loss over the distance at one height, as a cubic in each of many cells.

A cubic is far faster to compute than a loss, and how far it may be from it is known. While drones
keep their heights and their line of sight is not drawn, it therefore decides most of what the
search for classes with interference asks (``model.radio.quick``).
"""

from __future__ import annotations

from typing import Any

import numpy as np

from desim_uav.model.radio.levels import RateRow
from desim_uav.model.radio.path_loss import MEAN
from desim_uav.model.radio.slopes import DB
from desim_uav.rowcode.compiled_registers import bits_of
from desim_uav.rowcode.compiled_rows import call, call_for_float, entries_at, pointer_to
from desim_uav.rowcode.kernels import kernel, rule
from desim_uav.rowcode.rows import Row, Table, address, blank, row
from desim_uav.rowcode.views import zeros

CELLS = 4096
"""The number of cells, a power of two."""

FEWEST_PARTS, MOST_PARTS = 12, 500
"""How many parts of a cell are bounded, one after another. The error of a bound falls with the
square of their number."""

ENOUGH_DB = 2e-9
"""A cell whose error is known to be no larger is not divided into more parts."""

MOST_CURVES = 8
"""The most heights of a radio for which there are curves; each takes 384 KiB."""


@row
class Cell(Row):
    """The gain (mW for 1 mW) over a cell, as a polynomial of the share of the cell from 0 to 1.

    A level differs from that of the polynomial by at most ``error_db``. It rises by at least
    ``least`` < 0 and at most ``most`` for a metre. A cell is as long as a line of a cache.
    """

    c0: float
    c1: float
    c2: float
    c3: float
    error_db: float
    least: float
    most: float
    unused: float


@row
class Slope(Row):
    """The least and the most that a level rises for a metre of distance, in a range of cells."""

    least: float
    most: float


@row
class Curve(Row):
    """The gain at a height above the user, up to ``reach_m``, with so many cells ``per_m``.

    ``error_db`` is the largest error of a cell, or infinite if there is no bound. ``slopes`` is a
    binary tree: the two halves of range n are 2 n and 2 n + 1; range 1 is all cells, and cell i is
    range ``CELLS`` + i.
    """

    height_m: float
    per_m: float
    reach_m: float
    error_db: float
    cells: Table[Cell]
    slopes: Table[Slope]
    rates: RateRow


curve_at, curves_at = pointer_to(Curve), entries_at(Curve)


def blank_curve(height_m: float, reach_m: float) -> Curve:
    """Return a curve that is still to be drawn (``draw``)."""
    curve: Any = blank(Curve)
    curve.height_m, curve.reach_m, curve.per_m = height_m, reach_m, CELLS / reach_m
    curve.error_db, curve.cells, curve.slopes = np.inf, zeros(Cell, CELLS), zeros(Slope, 2 * CELLS)
    typed: Curve = curve
    return typed


@kernel
def draw(curves: int, count: int, level: int, rates_of: int, values: int, carrier: float) -> None:
    """Compute curves at an address, of a path loss that is given by addresses (``levels.Loss``).

    The cubic goes through the gains at both ends and at the thirds of a cell, as they are computed
    from the path loss. How far its level may be from that of the path loss is bounded in parts of
    the cell (``_bound``), of which there are more where the error is larger.
    """
    own, loss = curves_at(curves, count), (level, rates_of, values, carrier)
    for number in range(count):
        curve = own[number]
        curve.error_db = 0.0
        third = 1.0 / (3.0 * curve.per_m)
        place = (values, carrier, MEAN, 0.0, curve.height_m)
        end = np.exp(-call_for_float(level, place) / DB)
        for i in range(CELLS):
            g0, near_m = end, i / curve.per_m
            place = (values, carrier, MEAN, near_m + third, curve.height_m)
            g1 = np.exp(-call_for_float(level, place) / DB)
            place = (values, carrier, MEAN, near_m + 2.0 * third, curve.height_m)
            g2 = np.exp(-call_for_float(level, place) / DB)
            place = (values, carrier, MEAN, (i + 1) / curve.per_m, curve.height_m)
            end = np.exp(-call_for_float(level, place) / DB)
            cell, slope = curve.cells[i], curve.slopes[CELLS + i]
            _fit(cell, g0, g1, g2, end)
            _bound(curve, i, FEWEST_PARTS, loss)
            if ENOUGH_DB < cell.error_db < np.inf:
                more = FEWEST_PARTS * np.sqrt(cell.error_db / ENOUGH_DB) + 1.0
                _bound(curve, i, int(min(more, MOST_PARTS)), loss)
            slope.least, slope.most = cell.least, cell.most
            curve.error_db = max(curve.error_db, cell.error_db)
        for k in range(CELLS - 1, 0, -1):
            one, other = curve.slopes[2 * k], curve.slopes[2 * k + 1]
            slope = curve.slopes[k]
            slope.least, slope.most = min(one.least, other.least), max(one.most, other.most)
        if not curve.error_db < np.inf:
            curve.error_db = np.inf


@rule
def _fit(cell: Cell, g0: float, g1: float, g2: float, g3: float) -> None:
    """Write the cubic that has these values at 0, 1/3, 2/3 and 1."""
    d1, d2, d3 = g1 - g0, g2 - 2.0 * g1 + g0, g3 - 3.0 * g2 + 3.0 * g1 - g0
    cell.c0 = g0
    cell.c1 = 3.0 * d1 - 1.5 * d2 + d3
    cell.c2 = 4.5 * (d2 - d3)
    cell.c3 = 4.5 * d3


@rule
def _bound(curve: Curve, i: int, parts: int, loss: tuple[int, int, int, float]) -> None:
    """Write the bounds of a cell, by so many parts of it.

    At both ends of a part, the difference of both levels is computed. Between them, both slopes
    have bounds: that of the level by the path loss (``rates``), and that of the cubic because its
    derivative is a parabola. The difference therefore grows by at most half the length of the part
    times the most that the slopes differ. docs/explanation/sinr.md proves it.
    """
    level, rates_of, values, carrier = loss
    cell, length, apart = curve.cells[i], 1.0 / (parts * curve.per_m), 0.0
    cell.least, cell.most, cell.error_db = np.inf, -np.inf, 0.0
    for part in range(parts):
        middle_m = i / curve.per_m + (part + 0.5) * length
        near = (values, carrier, MEAN, middle_m, curve.height_m, 0.5 * length)
        call(rates_of, (*near, address(curve.rates)))
        least, most = curve.rates.least_away, curve.rates.most_away
        cell.least, cell.most = min(cell.least, least), max(cell.most, most)
        place = (values, carrier, MEAN, middle_m + 0.5 * length, curve.height_m)
        before, gain = apart, value_of(cell, (part + 1.0) / parts)
        if not gain > 0.0:
            cell.error_db = np.inf
            return
        apart = abs(call_for_float(level, place) + DB * np.log(gain))
        error_db = max(before, apart) + _grows_db(curve, i, part, parts, least, most)
        cell.error_db = max(cell.error_db, error_db)


@rule
def _grows_db(curve: Curve, i: int, part: int, parts: int, least: float, most: float) -> float:
    """Return by how much more two levels may differ within a part of a cell than at its ends.

    One is that of the cubic, and the other one rises by such slopes.
    """
    cell, s, e = curve.cells[i], part / parts, (part + 1.0) / parts
    first = cell.c1 + s * (2.0 * cell.c2 + s * 3.0 * cell.c3)
    last = cell.c1 + e * (2.0 * cell.c2 + e * 3.0 * cell.c3)
    low, high = min(first, last), max(first, last)
    bends = abs(0.75 * cell.c3) / parts**2  # a parabola is at most so far beyond its ends
    low, high = low - bends, high + bends
    begins, ends = value_of(cell, s), value_of(cell, e)
    changes = max(abs(low), abs(high)) / parts
    smallest, largest = min(begins, ends) - changes, max(begins, ends) + changes
    if not smallest > 0.0:
        return np.inf
    by = DB * curve.per_m
    flattest = by * (low / smallest if low < 0.0 else low / largest)
    steepest = by * (high / largest if high < 0.0 else high / smallest)
    apart = max(most - flattest, steepest - least)
    return float(apart / (2.0 * parts * curve.per_m) + 1e-10)


@rule
def value_of(cell: Cell, share: float) -> float:
    """Return the gain at a share of a cell."""
    return cell.c0 + share * (cell.c1 + share * (cell.c2 + share * cell.c3))


@rule
def slopes_between(curve: Curve, near_m: float, far_m: float) -> tuple[float, float]:
    """Return the least and the most that a level rises for a metre between two distances."""
    one, other = int(near_m * curve.per_m), int(far_m * curve.per_m)
    if one == other:
        return curve.cells[one].least, curve.cells[one].most
    one, other = CELLS + one, CELLS + other
    by = bits_of(other - one) - 1
    by += (other >> by) - (one >> by) - 1  # then the two ranges are one, or next to each other
    first, last = curve.slopes[one >> by], curve.slopes[other >> by]
    return min(first.least, last.least), max(first.most, last.most)


@rule
def gain_at(curve: Curve, distance_m: float) -> float:
    """Return the gain at a distance below ``reach_m``."""
    at = distance_m * curve.per_m
    i = int(at)
    return value_of(curve.cells[i], at - i)
