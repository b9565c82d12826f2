"""Path losses and bounds of their change as compiled functions that are called by their addresses.

The kernels that look for changes of a link (``model.radio.air``) are therefore compiled once for
all path losses, and a path loss of one's own takes only as long to compile as its formulas.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from itertools import product
from typing import Any, NamedTuple

from desim_uav.errors import ScenarioError
from desim_uav.model.compiled_rows import entries_at
from desim_uav.model.components import (
    NOT_COMPILED,
    Compiled,
    Function,
    cause_of,
    compiled,
    kind_of,
    over_rows,
    ruled,
)
from desim_uav.model.kernels import rule
from desim_uav.model.radio.functions import elevation_deg
from desim_uav.model.radio.path_loss import LOS, MEAN, NLOS, Rates, RowPathLoss, mean_of

R_LEAST, R_MOST, H_LEAST, H_MOST = range(4)
"""The columns of a row of rates: the least and the most that a level changes, in dB for a metre of
horizontal distance and in dB for a metre of height."""

RATES = 4

WHERE = "where there is interference, where drones climb and for association by level"

Place = tuple[float, float]
"""The horizontal distance of a drone from a user, and its height above it, in metres."""

floats_at = entries_at(float)


def _mean_db(cls: Any) -> Any:
    """Return the mean loss of a class of path losses as a rule."""
    if cls.mean_db is not RowPathLoss.mean_db:
        return ruled(cls.mean_db)
    p_los, los_db, nlos_db = ruled(cls.p_los), ruled(cls.los_db), ruled(cls.nlos_db)

    @rule
    def mean_db(own: Any, distance_m: float, height_m: float, carrier_ghz: float) -> float:
        return mean_of(
            p_los(own, elevation_deg(distance_m, height_m)),
            los_db(own, distance_m, height_m, carrier_ghz),
            nlos_db(own, distance_m, height_m, carrier_ghz),
        )

    return mean_db


def _level(cls: Any, values_at: Any) -> Any:
    """Return the function ``level`` of a class of path losses (see ``Function.around``)."""
    mean_db, los_db, nlos_db = _mean_db(cls), ruled(cls.los_db), ruled(cls.nlos_db)

    def level(
        values: int, carrier_ghz: float, branch: int, distance_m: float, height_m: float
    ) -> float:
        own = values_at(values)
        if branch == LOS:
            return float(los_db(own, distance_m, height_m, carrier_ghz))
        if branch == NLOS:
            return float(nlos_db(own, distance_m, height_m, carrier_ghz))
        return float(mean_db(own, distance_m, height_m, carrier_ghz))

    return level


def _rates_of(cls: Any) -> Any:
    """Return the method ``rates`` of a class of path losses as a rule."""
    if cls.rates is not RowPathLoss.rates:
        return ruled(cls.rates)
    slope = ruled(cls.slope)

    @rule
    def rates_of(own: Any, branch: int, distance_m: float, height_m: float, within_m: float) -> Any:
        away_db, over_db = slope(own, distance_m, height_m, within_m)
        return -away_db, 0.0, -over_db, over_db

    return rates_of


def _rates(cls: Any, values_at: Any) -> Any:
    """Return the function ``rates`` of a class of path losses (see ``Function.around``)."""
    rates_of = _rates_of(cls)

    def rates(
        values: int, branch: int, distance_m: float, height_m: float, within_m: float, out: int
    ) -> None:
        row = floats_at(out, RATES)
        found = rates_of(values_at(values), branch, distance_m, height_m, within_m)
        row[R_LEAST], row[R_MOST], row[H_LEAST], row[H_MOST] = found

    return rates


LEVEL = Function("level", _level, (int, float, int, float, float))
"""The function of a path loss that returns the loss in dB of a branch.

Its arguments are the address of the values, the carrier in GHz, the branch, the horizontal distance
and the height of the drone above the user in metres."""

BOUNDS = Function("rates", _rates, (int, int, float, float, float, int))
"""The function of a path loss that writes a row of rates: bounds for the change of the level.

Its arguments are the address of the values, the branch, the horizontal distance and the height in
metres, a distance in metres, and the address of the row. The bounds hold at all places at most so
far away from this one."""


class Loss(NamedTuple):
    """A compiled path loss: the addresses of its functions and of its values, and the latter.

    The addresses hold in this process, and as long as ``kept`` exists.
    """

    level: int
    rates: int
    values: int
    kept: Compiled


def compiled_loss(path_loss: RowPathLoss) -> Loss:
    """Compile a path loss.

    Raises ScenarioError if it is not bounded (see ``check_bounds``) or cannot be compiled.
    """
    check_bounds(path_loss)
    try:
        made = compiled((LEVEL, BOUNDS), path_loss, ())
    except NOT_COMPILED as error:
        why = cause_of(error, over_rows(path_loss, ()))
        raise ScenarioError(
            f"path_loss: {kind_of(path_loss)!r} must be compiled {WHERE}: {why}"
        ) from error
    level, rates = made.functions["level"], made.functions["rates"]
    return Loss(level, rates, made.values.ctypes.data, made)


def check_bounds(path_loss: RowPathLoss) -> None:
    """Raise ScenarioError if a path loss has no bounds, or if levels seem to exceed them.

    Levels are compared with those at places nearby, which cannot show that the bounds hold.
    """
    name = kind_of(path_loss)
    if not path_loss.is_bounded():
        raise ScenarioError(
            f"path_loss: {name!r} needs a method slope(distance_m, height_m, within_m) {WHERE}"
        )
    for branch, place, share in product((MEAN, LOS, NLOS), CHECKED, (0.001, 0.1, 0.5)):
        within_m = share * math.hypot(*place)
        rates = path_loss.rates(branch, *place, within_m)
        around = (
            f"within {within_m:g} m of a distance of {place[0]:g} m and a height of {place[1]} m"
        )
        if not all(map(math.isfinite, rates)):
            raise ScenarioError(f"path_loss: {name!r}: its slope must be finite {around}")
        for other in _places_near(*place, within_m):
            if not _explains(path_loss, branch, rates, place, other):
                raise ScenarioError(
                    f"path_loss: {name!r}: its loss changes faster than its slope says {around}"
                )


CHECKED_GHZ = 2.0
CHECKED = tuple(product((3.0, 30.0, 100.0, 400.0, 3000.0), (20.0, 120.0)))
"""The carrier, and the distances and heights, at which bounds are checked."""

ROUNDING_DB = 1e-9


def _places_near(distance_m: float, height_m: float, within_m: float) -> Iterator[Place]:
    """Yield distances and heights of the drone, above the user and at most so far from a place."""
    for degrees in range(0, 360, 45):
        away_m, up_m = (math.cos(math.radians(degrees)), math.sin(math.radians(degrees)))
        other = distance_m + 0.999 * within_m * away_m, height_m + 0.999 * within_m * up_m
        if min(other) > 0.0:
            yield other


def _explains(
    path_loss: RowPathLoss, branch: int, rates: Rates, place: Place, other: Place
) -> bool:
    """Return whether bounds allow the change of a level from one place to another."""
    loss_db = (path_loss.mean_db, path_loss.los_db, path_loss.nlos_db)[branch]
    rises_db = loss_db(*place, CHECKED_GHZ) - loss_db(*other, CHECKED_GHZ)
    low = high = 0.0
    for k in range(2):
        move_m = other[k] - place[k]
        low += min(rates[2 * k] * move_m, rates[2 * k + 1] * move_m)
        high += max(rates[2 * k] * move_m, rates[2 * k + 1] * move_m)
    return low - ROUNDING_DB <= rises_db <= high + ROUNDING_DB
