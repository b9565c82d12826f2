"""Rings: the horizontal distances from a drone within which the classes of a link hold.

At a fixed height difference a level falls with the horizontal distance, so each class of a link
holds in a disc. Radii are rounded to whole micrometres: libraries that compute a logarithm
differently in the last bit then still give the same radius.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from desim_uav.model.radio.functions import elevation_deg
from desim_uav.model.radio.link import LinkBudget, LinkClass
from desim_uav.model.radio.path_loss import RowPathLoss
from desim_uav.registry import kind_name

FARTHEST_M = 1e7
"""The largest radius of a ring."""

LOOKED_AT = 200
"""The number of distances at which a loss is checked to rise."""

ROUNDING_DB = 1e-9
"""The largest decrease of a loss, in dB, that is taken for rounding."""


class Rings(NamedTuple):
    """The radii of each class in metres, the outermost first: they fall as the class rises."""

    los_m: tuple[float, ...]
    nlos_m: tuple[float, ...]
    mean_m: tuple[float, ...]


def rings(
    path_loss: RowPathLoss,
    carrier_ghz: float,
    height_m: float,
    budget: LinkBudget,
    classes: Sequence[LinkClass],
) -> Rings:
    """Return the rings of each class with and without line of sight, and of the mean loss.

    A radius is 0 if the class does not hold even below the drone. Raises ValueError if a loss does
    not rise with the distance, or if a ring is larger than ``FARTHEST_M``.
    """
    if not (math.isfinite(height_m) and height_m > 0.0):
        raise ValueError(f"a drone must be above its users, not by {height_m:g} m")
    radii_m = []
    for method in (path_loss.los_db, path_loss.nlos_db, path_loss.mean_db):

        def loss_db(distance_m: float, method: Callable[..., float] = method) -> float:
            return method(distance_m, height_m, carrier_ghz)

        radii = [ring_m(loss_db, budget.largest_loss_db(one.snr_db)) for one in classes]
        _check_rise(
            loss_db, 2.0 * max(radii[0], height_m), f"{kind_name(path_loss)}.{method.__name__}"
        )
        radii_m.append(tuple(radii))
    return Rings(*radii_m)


def ring_m(loss_db: Callable[[float], float], largest_db: float) -> float:
    """Return the horizontal distance up to which a loss is at most ``largest_db``, in metres.

    It is 0 if the loss is larger even below the drone. Raises ValueError if the loss is still
    smaller at ``FARTHEST_M``.
    """
    if not loss_db(0.0) <= largest_db:
        return 0.0
    outside_m = 1.0
    while loss_db(outside_m) <= largest_db:
        outside_m *= 2.0
        if outside_m > FARTHEST_M:
            raise ValueError(
                f"a loss of {largest_db:g} dB is not reached within {FARTHEST_M / 1000:,.0f} km"
            )
    return last_m(lambda distance_m: loss_db(distance_m) <= largest_db, outside_m)


def line_of_sight_ring_m(path_loss: RowPathLoss, height_m: float, uniform: float) -> float:
    """Return the radius within which a user sees the drone, if ``uniform`` is the user's draw.

    The user sees the drone where the draw, uniform in [0, 1), is below the probability of line of
    sight. This probability rises with the elevation, so it does so within a circle; its radius
    is inf if that is everywhere within ``FARTHEST_M``, and 0 if it is nowhere.
    Raises ValueError if the probability does not rise with the elevation.
    """
    check_sight(path_loss)

    def sees(distance_m: float) -> bool:
        return uniform < path_loss.p_los(elevation_deg(distance_m, height_m))

    if not sees(0.0):
        return 0.0
    if sees(FARTHEST_M):
        return math.inf
    return last_m(sees, FARTHEST_M)


def last_m(holds: Callable[[float], bool], outside_m: float) -> float:
    """Return the distance up to which a condition holds, by bisection, in metres.

    It holds at 0 and not at ``outside_m``. The distance is rounded to whole micrometres.
    """
    inside_m = 0.0
    while outside_m - inside_m > 1e-9:
        middle_m = 0.5 * (inside_m + outside_m)
        if middle_m in (inside_m, outside_m):
            break
        if holds(middle_m):
            inside_m = middle_m
        else:
            outside_m = middle_m
    return round(0.5 * (inside_m + outside_m) * 1e6) / 1e6


def _check_rise(loss_db: Callable[[float], float], up_to_m: float, name: str) -> None:
    """Raise ValueError if a loss seems to fall somewhere, or is no number."""
    before_m, before_db = 0.0, loss_db(0.0)
    for distance_m in np.geomspace(up_to_m * 1e-3, up_to_m, LOOKED_AT).tolist():
        found_db = loss_db(distance_m)
        if not found_db >= before_db - ROUNDING_DB:
            raise ValueError(
                f"{name} must rise with the distance, but it is {before_db:g} dB at {before_m:g} m "
                f"and {found_db:g} dB at {distance_m:g} m; its classes are no discs"
            )
        before_m, before_db = distance_m, found_db


def check_sight(path_loss: RowPathLoss) -> None:
    """Raise ValueError if the probability of line of sight seems to fall with the elevation."""
    before = 0.0
    for elevation in range(91):
        share = path_loss.p_los(float(elevation))
        if not before <= share <= 1.0:
            raise ValueError(
                f"{kind_name(path_loss)}.p_los must rise with the elevation and stay within 0 and "
                f"1, but it is {share:g} at {elevation} degrees after {before:g}"
            )
        before = share
