"""Radii of classes between two levels, as polynomials of the height.

While a drone climbs or descends, each class holds within a circle whose radius changes with the
height. The square of a radius is a smooth function of the height where the path loss is. Between
two neighbouring levels it is therefore fitted by polynomials, on slabs of equal thickness, through
radii that are computed to the last bits (``radii_at``). A fit is only used if it is close
to the radii at heights between those through which it goes.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from desim_uav.model.radio.levels import compiled_loss
from desim_uav.model.radio.path_loss import MEAN, RowPathLoss
from desim_uav.model.radio.rings import FARTHEST_M
from desim_uav.rowcode.compiled_rows import call_for_float
from desim_uav.rowcode.kernels import kernel

TERMS = 10
"""The number of terms of a polynomial."""

STEEP, CURVED = TERMS, TERMS + 1
TERM_COLUMNS = TERMS + 2
"""The columns behind the coefficients of a polynomial, and the number of columns: bounds of the
polynomial's first and second derivative in its slab."""

SLABS = (4, 8, 16, 32)
"""The numbers of slabs that are tried, one after the other."""

FIT_M, FIT = 1e-10, 3e-13
"""How far a radius after a fit may be from the radius at a height: in metres, and as a share of it,
for levels are known to some bits only."""

CHECKED = 9
"""The number of heights of a slab at which fits are checked."""

MOST_FITS = 20_000
"""The most radii of a class between two levels, for a group of users, that are fitted."""

Array = NDArray[np.float64]


class Fits(NamedTuple):
    """The squared radii of classes between neighbouring levels, in square metres.

    ``terms`` (pairs, groups, classes, slabs, TERM_COLUMNS) are polynomials of u, which rises from
    -1 to 1 from the lower end of a slab to its upper end; the first pair of levels is the lowest,
    and so is the first slab. ``ranges`` (pairs, groups, slabs, 2, classes) are the least and the
    most squared radii in each slab, and ``bounds_m`` (pairs, 2, groups, classes) the least and the
    most radii between both levels. A class that holds nowhere between two levels has the squared
    radius and the radius -1.
    """

    terms: Array
    ranges: Array
    bounds_m: Array


NONE = Fits(np.empty((0, 0, 0, 0, TERM_COLUMNS)), np.empty((0, 0, 0, 2, 0)), np.empty((0, 2, 0, 0)))
"""No fits: changes are then sought by a search for each user (``model.radio.air``)."""


@kernel
def radii_at(
    loss: tuple[int, int],
    carrier_ghz: float,
    largest_db: Array,
    heights_m: Array,
    out: Array,
) -> bool:
    """Write the radii of classes at some heights, and return whether all were found.

    ``loss`` holds the addresses of a path loss (``levels.Loss``: level and values). ``largest_db``
    (classes,) are the largest losses of the classes, and ``out`` is (heights, classes). A class
    that does not hold even below the drone gets -1.
    """
    for k in range(len(largest_db)):
        guess = 1.0
        for i in range(len(heights_m)):
            height, largest = heights_m[i], largest_db[k]
            out[i, k] = -1.0
            if not _beyond_db(loss, carrier_ghz, height, largest, 0.0) <= 0.0:
                continue
            low, high = 0.0, guess
            below = _beyond_db(loss, carrier_ghz, height, largest, low)
            above = _beyond_db(loss, carrier_ghz, height, largest, high)
            while not above > 0.0:
                low, below = high, above
                high *= 2.0
                if high > FARTHEST_M:
                    return False
                above = _beyond_db(loss, carrier_ghz, height, largest, high)
            near = 0.98 * high if low == 0.0 else low
            while near > low and low == 0.0:
                value = _beyond_db(loss, carrier_ghz, height, largest, near)
                if value <= 0.0:
                    low, below = near, value
                else:
                    high, above = near, value
                    near *= 0.5
                    if near < 1e-9:
                        break
            out[i, k] = guess = _crossed(
                loss, carrier_ghz, height, largest, (low, below, high, above)
            )
            guess *= 1.01
    return True


@kernel
def _crossed(
    loss: tuple[int, int],
    carrier_ghz: float,
    height_m: float,
    largest_db: float,
    ends: tuple[float, float, float, float],
) -> float:
    """Return where a loss passes a limit, by the Illinois method that is safeguarded by bisection.

    ``ends`` are the two ends of where it does, each followed by the excess there.
    """
    low, below, high, above = ends
    kept_low, kept_high = below, above
    for step in range(200):
        if high - low <= 4e-16 * high or below == 0.0:
            break
        at = high - kept_high * (high - low) / (kept_high - kept_low)
        if step % 4 == 3 or not low < at < high:
            at = 0.5 * (low + high)
        if not low < at < high:
            break
        value = _beyond_db(loss, carrier_ghz, height_m, largest_db, at)
        if value <= 0.0:
            low, below, kept_low = at, value, value
            kept_high *= 0.5
        else:
            high, above, kept_high = at, value, value
            kept_low *= 0.5
    return float(low if -below < above else high)


@kernel
def _beyond_db(
    loss: tuple[int, int], carrier_ghz: float, height_m: float, largest_db: float, distance_m: float
) -> float:
    """Return by how much the mean loss at a distance exceeds the largest one, in dB."""
    arguments = (loss[1], carrier_ghz, MEAN, distance_m, height_m)
    return call_for_float(loss[0], arguments) - largest_db


def fits_of(radio: Any, levels_m: Sequence[float], users_m: Sequence[float]) -> Fits:
    """Return the fits of a radio's classes between levels, for users of these heights, or NONE.

    Raises ScenarioError if its path loss cannot be compiled.
    """
    classes, pairs = len(radio.ladder), len(levels_m) - 1
    if pairs < 1 or pairs * len(users_m) * classes > MOST_FITS:
        return NONE
    budget = radio.budget
    largest_db = tuple(budget.largest_loss_db(one.snr_db) for one in radio.ladder)
    levels_and_users = tuple(levels_m), tuple(users_m)
    path_loss, name = radio.loss, repr(radio.loss)
    return _fits(path_loss, radio.carrier_ghz, largest_db, *levels_and_users, name)


@lru_cache(maxsize=32)
def _fits(
    path_loss: RowPathLoss,
    carrier_ghz: float,
    largest_db: tuple[float, ...],
    levels_m: tuple[float, ...],
    users_m: tuple[float, ...],
    name: str = "",
) -> Fits:
    """Return the same as ``fits_of``, with as few slabs as suffice.

    The ``name`` of a path loss is its representation, which tells 1 from 1.0 and 0.0 from -0.0.
    """
    loss = compiled_loss(path_loss, carrier_ghz)

    def squares(heights_m: Array) -> Array:
        """Return squared radii (*heights, classes): -1 where a class does not hold, or NaN."""
        out = np.empty((heights_m.size, len(largest_db)))
        own = (loss.level, loss.values)
        if not radii_at(own, float(carrier_ghz), np.array(largest_db), heights_m.reshape(-1), out):
            out[:] = np.nan
        return np.where(out < 0.0, -1.0, out * out).reshape(*heights_m.shape, -1)

    for slabs in SLABS:
        fits = _fitted(squares, np.array(levels_m), np.array(users_m), slabs)
        if fits is not None:
            return fits
    return NONE


def _fitted(squares: Any, levels_m: Array, users_m: Array, slabs: int) -> Fits | None:
    """Return fits with so many slabs, or None if they are not close enough."""
    nodes = np.sort(np.cos(np.pi * (np.arange(TERMS) + 0.5) / TERMS))
    checks = np.linspace(-1.0, 1.0, CHECKED)

    def heights(u: Array) -> Array:
        """Return heights (pairs, groups, slabs, points) above users at places in slabs."""
        share = (np.arange(slabs)[:, None] + 0.5 * (u + 1.0)) / slabs
        drones_m = levels_m[:-1, None, None] + np.diff(levels_m)[:, None, None] * share
        return np.asarray(drones_m[:, None] - users_m[:, None, None])

    through, held_against = squares(heights(nodes)), squares(heights(checks))
    holds = np.concatenate([through, held_against], axis=3) >= 0.0
    nowhere = ~holds.any(axis=(2, 3))
    if np.isnan(through).any() or not (holds.all(axis=(2, 3)) | nowhere).all():
        return None
    terms = np.einsum("tn,pgsnk->pgkst", np.linalg.inv(np.vander(nodes, increasing=True)), through)
    terms[nowhere] = np.eye(TERMS)[0] * -1.0
    fit_m = np.einsum("pgkst,ct->pgsck", terms, np.vander(checks, TERMS, increasing=True))
    radii = np.sqrt(np.abs(held_against))
    if not (np.abs(fit_m - held_against) <= 2.0 * radii * (FIT_M + FIT * radii)).all():
        return None
    middle, spread = terms[..., 0], np.abs(terms[..., 1:]).sum(axis=-1)
    least, most = (np.moveaxis(middle + sign * spread, 2, 3) for sign in (-1.0, 1.0))
    ranges = np.stack([least, most], axis=3)
    whole = np.stack([least.min(axis=2), most.max(axis=2)], axis=1)
    bounds_m = np.where(whole < 0.0, -1.0, np.sqrt(np.abs(whole)))
    powers, sizes = np.arange(TERMS), np.abs(terms)
    bounds = [sizes @ powers, sizes @ (powers * (powers - 1))]
    terms = np.concatenate([terms, np.stack(bounds, axis=-1)], axis=-1)
    return Fits(terms, ranges, bounds_m)
