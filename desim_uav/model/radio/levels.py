"""Path losses and bounds of their change as compiled functions that are called by their addresses.

The kernels that look for changes of a link (``model.radio.air``) are therefore compiled once for
all path losses, and a path loss of one's own takes only as long to compile as its formulas.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from functools import cache
from itertools import product
from typing import Any, NamedTuple

from desim_uav.errors import ScenarioError
from desim_uav.model.radio.functions import elevation_deg
from desim_uav.model.radio.path_loss import LOS, MEAN, NLOS, Rates, RowPathLoss, mean_of
from desim_uav.model.radio.sampled import sampled_rates
from desim_uav.rowcode.compiled_rows import pointer_to
from desim_uav.rowcode.components import (
    NOT_COMPILED,
    Compiled,
    Function,
    call_at,
    cause_of,
    compiled,
    kind_of,
    over_rows,
    ruled,
)
from desim_uav.rowcode.kernels import rule
from desim_uav.rowcode.rows import Row, row


@row
class RateRow(Row):
    """The least and the most that a level changes.

    In dB for a metre of horizontal distance (``away``), and in dB for a metre of height (``up``).
    """

    least_away: float
    most_away: float
    least_up: float
    most_up: float


WHERE = "where there is interference, where drones climb and for association by level"

Place = tuple[float, float]
"""The horizontal distance of a drone from a user, and its height above it, in metres."""

rates_at = pointer_to(RateRow)


def mean_db_of(cls: Any) -> Any:
    """Return a rule that computes the mean loss of a class of path losses."""
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


@cache
def _loss_of(cls: Any) -> Any:
    """Return a rule for the loss of a class of path losses, at a carrier and of a branch."""
    mean_db, los_db, nlos_db = mean_db_of(cls), ruled(cls.los_db), ruled(cls.nlos_db)

    @rule
    def loss_db(
        own: Any, carrier_ghz: float, branch: int, distance_m: float, height_m: float
    ) -> float:
        if branch == LOS:
            return float(los_db(own, distance_m, height_m, carrier_ghz))
        if branch == NLOS:
            return float(nlos_db(own, distance_m, height_m, carrier_ghz))
        return float(mean_db(own, distance_m, height_m, carrier_ghz))

    return loss_db


def _level(cls: Any, values_at: Any) -> Any:
    """Return the function ``level`` of a class of path losses (see ``Function.around``)."""
    loss_db = _loss_of(cls)

    def level(
        values: int, carrier_ghz: float, branch: int, distance_m: float, height_m: float
    ) -> float:
        return float(loss_db(values_at(values), carrier_ghz, branch, distance_m, height_m))

    return level


@cache
def rates_of_class(cls: Any) -> Any:
    """Return a rule that computes ``rates`` of a class of path losses at a carrier.

    If the class has no bounds, they are sampled at the carrier.
    """
    if not cls.is_bounded():
        return sampled_rates(_loss_of(cls))
    rates, slope = ruled(cls.rates), ruled(cls.slope)
    if cls.rates is not RowPathLoss.rates:

        @rule
        def rates_of(
            own: Any,
            carrier_ghz: float,
            branch: int,
            distance_m: float,
            height_m: float,
            within_m: float,
        ) -> Any:
            return rates(own, branch, distance_m, height_m, within_m)

        return rates_of

    @rule
    def rates_by_slope(
        own: Any,
        carrier_ghz: float,
        branch: int,
        distance_m: float,
        height_m: float,
        within_m: float,
    ) -> Any:
        away_db, over_db = slope(own, distance_m, height_m, within_m)
        return -away_db, 0.0, -over_db, over_db

    return rates_by_slope


def _rates(cls: Any, values_at: Any) -> Any:
    """Return the function ``rates`` of a class of path losses (see ``Function.around``)."""
    rates_of = rates_of_class(cls)

    def rates(
        values: int,
        carrier_ghz: float,
        branch: int,
        distance_m: float,
        height_m: float,
        within_m: float,
        out: int,
    ) -> None:
        row, own = rates_at(out), values_at(values)
        bounds = rates_of(own, carrier_ghz, branch, distance_m, height_m, within_m)
        row.least_away, row.most_away, row.least_up, row.most_up = bounds

    return rates


LEVEL = Function("level", _level, (int, float, int, float, float))
"""The function of a path loss that returns the loss in dB of a branch.

Its arguments are the address of the values, the carrier in GHz, the branch, the horizontal distance
and the height of the drone above the user in metres."""


BOUNDS = Function("rates", _rates, (int, float, int, float, float, float, int))
"""The function of a path loss that writes a row of rates: bounds for the change of the level.

Its arguments are the address of the values, the carrier in GHz, the branch, the horizontal distance
and the height in metres, a distance in metres, and the address of the row. The bounds hold at all
places at most so far away from this one."""


class Loss(NamedTuple):
    """A compiled path loss: the addresses of its functions and of its values, and the latter.

    The addresses hold in this process, and as long as ``kept`` exists.
    """

    level: int
    rates: int
    values: int
    kept: Compiled


def compiled_loss(path_loss: RowPathLoss, carrier_ghz: float = 2.0) -> Loss:
    """Compile a path loss.

    Raises ScenarioError if one's own exceeds its bounds at a carrier (see ``problem_of_bounds``),
    or if it cannot be compiled.
    """
    problem = "" if path_loss.is_built_in() else problem_of_bounds(path_loss, carrier_ghz)
    problem = problem or why_not_compiled(path_loss)
    if problem:
        raise ScenarioError(f"path_loss: {kind_of(path_loss)!r}: {problem}")
    code = compiled((LEVEL, BOUNDS), path_loss, ())
    level, rates = code.functions["level"], code.functions["rates"]
    return Loss(level, rates, code.values.ctypes.data, code)


def why_not_compiled(path_loss: RowPathLoss) -> str:
    """Return why a path loss cannot be compiled; an empty text if it can, or if nothing can."""
    if not hasattr(call_at, "overloads"):  # NUMBA_DISABLE_JIT is set
        return ""
    try:
        compiled((LEVEL, BOUNDS), path_loss, ())
    except NOT_COMPILED as error:
        return f"must be compiled {WHERE}: {cause_of(error, over_rows(path_loss, ()))}"
    return ""


def problem_of_bounds(path_loss: RowPathLoss, carrier_ghz: float) -> str:
    """Return why the bounds of a path loss cannot hold; an empty text if none is found.

    Levels are compared with those at places nearby, which cannot show that the bounds hold.
    """
    sampled = not path_loss.is_bounded()
    bounds = "sampled slope (it has no method slope)" if sampled else "slope"
    cls: Any = type(path_loss)
    rates_of = rates_of_class(cls)
    shares, places = ((0.1, 0.5), CHECKED[::3]) if sampled else ((0.001, 0.1, 0.5), CHECKED)
    for branch, place, share in product(_branches(cls), places, shares):
        within_m = share * math.hypot(*place)
        rates = rates_of(path_loss, carrier_ghz, branch, *place, within_m)
        if not all(map(math.isfinite, rates)):
            return (
                f"its {bounds} must be finite at a distance of {place[0]:g} m and a "
                f"height of {place[1]:g} m, within_m: {within_m:g}"
            )
        for other in _places_near(*place, within_m):
            rise_db, low_db, high_db = _change(path_loss, carrier_ghz, branch, rates, place, other)
            if not low_db - ROUNDING_DB <= rise_db <= high_db + ROUNDING_DB:
                allowed_db = high_db if rise_db > high_db else low_db
                return (
                    f"its loss changes faster than its {bounds} says: from a distance of "
                    f"{place[0]:g} m and a height of {place[1]:g} m to {other[0]:.6g} m and "
                    f"{other[1]:.6g} m the level by {BRANCHES[branch]} changes by {rise_db:.4g} "
                    f"dB, but by the {bounds} for within_m: {within_m:g} by {allowed_db:.4g} dB "
                    "at most"
                )
    return ""


def _branches(cls: Any) -> tuple[int, ...]:
    """Return the branches whose losses differ."""
    alike = cls.nlos_db is cls.los_db and cls.mean_db is RowPathLoss.mean_db
    return (LOS,) if alike and cls.p_los is RowPathLoss.p_los else (LOS, NLOS, MEAN)


BRANCHES = {MEAN: "mean_db", LOS: "los_db", NLOS: "nlos_db"}
"""The methods of a path loss by branch."""

CHECKED = tuple(product((3.0, 10.0, 30.0, 100.0, 250.0, 400.0, 1000.0, 3000.0), (20.0, 120.0)))
"""The distances and heights at which bounds are checked."""

ROUNDING_DB = 1e-9


def _places_near(distance_m: float, height_m: float, within_m: float) -> Iterator[Place]:
    """Yield distances and heights of the drone, above the user and at most so far from a place."""
    for degrees in range(0, 360, 45):
        away_m, up_m = (math.cos(math.radians(degrees)), math.sin(math.radians(degrees)))
        other = distance_m + 0.999 * within_m * away_m, height_m + 0.999 * within_m * up_m
        if min(other) > 0.0:
            yield other


def _change(
    path_loss: RowPathLoss,
    carrier_ghz: float,
    branch: int,
    rates: Rates,
    place: Place,
    other: Place,
) -> tuple[float, float, float]:
    """Return how much a level rises from one place to another, and its least and largest bound."""
    loss_db = (path_loss.mean_db, path_loss.los_db, path_loss.nlos_db)[branch]
    rise_db = loss_db(*place, carrier_ghz) - loss_db(*other, carrier_ghz)
    low_db = high_db = 0.0
    for k in range(2):
        move_m = other[k] - place[k]
        low_db += min(rates[2 * k] * move_m, rates[2 * k + 1] * move_m)
        high_db += max(rates[2 * k] * move_m, rates[2 * k + 1] * move_m)
    return rise_db, low_db, high_db
