"""Path loss between drones and base stations on the ground, after 3GPP TR 36.777.

Annex B of the report (V15.0.0), tables B-1 and B-2. The drone is the aerial user of the report, and
a user of the scenario stands where the base station does, whose antenna is ``STATION`` metres above
the ground. Heights are those of the drone above the ground, distances are in metres, and carriers
in GHz. The report has no links between drones and users in the street: ``AlHourani`` has.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, field, fields
from typing import Any, Literal

from desim_uav.model.radio.functions import exp, log10
from desim_uav.model.radio.path_loss import (
    LOS,
    MEAN,
    SPEED_OF_LIGHT_MPS,
    Rates,
    RowPathLoss,
    Use,
    mean_of,
)
from desim_uav.registry import register
from desim_uav.rowcode.kernels import rule

HIGHEST_M = 300.0
"""The largest height of an aerial user in the report, in metres."""

NEAREST_M = 1.0
"""Nearer to the station's antenna than this, the loss is that at this distance."""

LN10 = math.log(10.0)

FREE_DB = 20.0 * math.log10(4e9 * math.pi / SPEED_OF_LIGHT_MPS)
"""The loss in free space over 1 m at 1 GHz, in dB."""
WAVE_DB = 20.0 * math.log10(40.0 * math.pi / 3.0)
"""The same with c = 3e8 m/s, as the report rounds it."""
NEVER_DB = -1000.0
"""A lower limit of a loss that is none."""

Site = Literal["rma", "uma", "umi"]


SITES: dict[Site, tuple[float, ...]] = {
    "rma": (
        *(35.0, 10.0, 40.0, 10_000.0),
        *(15021.0, -16053.0, 1000.0, 1350.8, -1602.0, 18.0),
        *(WAVE_DB, 23.9, 1.8, 20.0, NEVER_DB),
        *(WAVE_DB - 12.0, 35.0, 5.3, 0.0, 0.0),
    ),
    "uma": (
        *(25.0, 22.5, 100.0, 4_000.0),
        *(4300.0, -3800.0, 0.0, 460.0, -700.0, 18.0),
        *(28.0, 22.0, 0.0, 0.0, NEVER_DB),
        *(WAVE_DB - 17.5, 46.0, 7.0, 0.0, NEVER_DB),
    ),
    "umi": (
        *(10.0, 22.5, HIGHEST_M, 4_000.0),
        *(233.98, -0.95, 0.0, 294.05, -432.94, 18.0),
        *(30.9, 22.25, 0.5, 0.0, FREE_DB),
        *(32.4, 43.2, 7.6, 0.0, 0.0),
    ),
}
"""The numbers of ``Aerial``, in the order of its fields, for RMa-AV (villages and fields), UMa-AV
(towns, stations above the roofs) and UMi-AV (streets, stations below the roofs). Table B-2 lets the
loss of UMa-AV without line of sight begin at 10 m; TR 38.901 applies up to 22.5 m, so it begins
there here."""


@rule
def station_range_m(loss: Any, distance_m: float, height_m: float) -> float:
    """Return the distance in space from the station's antenna, at least ``NEAREST_M``."""
    up_m = height_m - loss.station_m
    return max(math.sqrt(distance_m * distance_m + up_m * up_m), NEAREST_M)


@rule
def seen_per_decade_db(loss: Any, height_m: float) -> float:
    """Return how much the loss with line of sight rises for a tenfold distance."""
    per_db = loss.seen_per_decade_db - loss.seen_less_db * log10(height_m)
    return float(max(per_db, loss.seen_least_db))


@rule
def blocked_per_decade_db(loss: Any, height_m: float) -> float:
    """Return how much the loss without line of sight rises for a tenfold distance."""
    per_db = loss.blocked_per_decade_db - loss.blocked_less_db * log10(height_m)
    return float(max(per_db, loss.blocked_least_db))


@rule
def seen_db(loss: Any, height_m: float, range_m: float) -> float:
    """Return the loss with line of sight at 1 GHz."""
    decades = log10(range_m)
    own_db = loss.seen_from_db + seen_per_decade_db(loss, height_m) * decades
    return float(max(own_db, loss.seen_limit_db + 20.0 * decades))


@rule
def blocked_db(loss: Any, height_m: float, range_m: float) -> float:
    """Return the loss without line of sight at 1 GHz."""
    own_db = loss.blocked_from_db + blocked_per_decade_db(loss, height_m) * log10(range_m)
    return float(max(own_db, loss.blocked_limit_db + seen_db(loss, height_m, range_m)))


@rule
def p1_of(loss: Any, height_m: float) -> float:
    """Return p1 of table B-1 in metres."""
    return float(max(loss.p_slope * log10(height_m) + loss.p_from, loss.p_least))


@rule
def d1_of(loss: Any, height_m: float) -> float:
    """Return d1 of table B-1 in metres."""
    return float(max(loss.d_slope * log10(height_m) + loss.d_from, loss.d_least))


@rule
def share_in_sight(loss: Any, distance_m: float, height_m: float) -> float:
    """Return the probability of line of sight."""
    if height_m > loss.always_m:
        return 1.0
    p1_m, d1_m = p1_of(loss, height_m), d1_of(loss, height_m)
    if distance_m <= d1_m:
        return 1.0
    near = d1_m / distance_m
    return float(near + exp(-distance_m / p1_m) * (1.0 - near))


@rule
def loss_rates(
    loss: Any, seen: bool, distance_m: float, range_m: float, within_m: float, spans_m: Any
) -> Rates:
    """Return the least and the most that a loss rises, the one with line of sight if ``seen``.

    Two numbers are for a metre of distance and two for a metre of height, at most ``within_m`` away
    and between the two heights of ``spans_m``. The loss is A + S(h) lg d, whose slope S falls with
    the height, or 20 lg d with another A; which of them is the larger one is left open.
    """
    low_m, high_m = spans_m
    down_m, up_m = low_m - loss.station_m, high_m - loss.station_m
    near_m, far_m = max(range_m - within_m, NEAREST_M), max(range_m + within_m, NEAREST_M)
    least_m, most_m = max(distance_m - within_m, 0.0), distance_m + within_m
    if seen:
        steep = max(seen_per_decade_db(loss, low_m), 20.0)
        flat = min(seen_per_decade_db(loss, high_m), 20.0)
        less_db = loss.seen_less_db
    else:
        steep, flat = blocked_per_decade_db(loss, low_m), blocked_per_decade_db(loss, high_m)
        less_db = loss.blocked_less_db
    steep, flat = steep / LN10, flat / LN10
    if range_m - within_m <= NEAREST_M:
        flat = 0.0
    higher = less_db / (low_m * LN10) * log10(far_m)
    rises = steep * min(up_m / near_m, 1.0) / near_m if up_m > 0.0 else flat * up_m / far_m / far_m
    falls = (
        steep * max(down_m / near_m, -1.0) / near_m
        if down_m < 0.0
        else flat * down_m / far_m / far_m
    )
    return (
        flat * least_m / far_m / far_m,
        steep * min(most_m / near_m, 1.0) / near_m,
        falls - higher,
        rises,
    )


@rule
def sight_rates(loss: Any, distance_m: float, within_m: float, spans_m: Any) -> tuple[float, float]:
    """Return the most that the probability of line of sight falls and rises.

    It falls with each metre of distance, and rises with each metre of height.
    """
    low_m, high_m = spans_m
    near_m = max(distance_m - within_m, d1_of(loss, low_m))
    far_m, d1_m = distance_m + within_m, d1_of(loss, high_m)
    if far_m <= near_m:
        return 0.0, 0.0
    least_m, most_m = p1_of(loss, low_m), p1_of(loss, high_m)
    left = exp(-near_m / most_m)
    turns = min(1.0 / near_m, 1.0 / least_m)  # of (1 - exp(-d / p1)) / d
    falls = d1_m / near_m * turns + left / least_m
    rises = loss.d_slope * turns + loss.p_slope * left * far_m / (least_m * least_m)
    return falls, rises / (low_m * LN10)


@rule
def rates_near(
    loss: Any, branch: int, distance_m: float, height_m: float, within_m: float
) -> Rates:
    """Return the least and the most that a level changes near a place (``RowPathLoss.rates``).

    Only heights of the report count, and on the mean only those on the same side of the height from
    which on there is always line of sight.
    """
    low_m, high_m = max(height_m - within_m, loss.above_m), min(height_m + within_m, HIGHEST_M)
    always = branch == LOS or (branch == MEAN and height_m > loss.always_m)
    if branch == MEAN and height_m <= loss.always_m:
        high_m = min(high_m, loss.always_m)
    spans_m = min(low_m, high_m), high_m
    up_m = height_m - loss.station_m
    range_m = math.sqrt(distance_m * distance_m + up_m * up_m)
    away, away_most, up, up_most = loss_rates(loss, True, distance_m, range_m, within_m, spans_m)
    if not always:
        own = loss_rates(loss, False, distance_m, range_m, within_m, spans_m)
        away, away_most = min(away, own[0]), max(away_most, own[1])
        up, up_most = min(up, own[2]), max(up_most, own[3])
    if branch == MEAN and not always:
        near_m, far_m = max(range_m - within_m, NEAREST_M), max(range_m + within_m, NEAREST_M)
        most_db = blocked_db(loss, spans_m[0], far_m) - seen_db(loss, high_m, near_m)
        falls, rises = sight_rates(loss, distance_m, within_m, spans_m)
        away_most += falls * max(most_db, 0.0)
        up -= rises * max(most_db, 0.0)
    return -away_most, -away, -up_most, -up


@register("path_loss", "tr36777")
@dataclass(frozen=True)
class Aerial(RowPathLoss):
    """Loses power between a drone and a base station, in whose place a user stands.

    3GPP TR 36.777, Annex B. The station's antenna is 35 m above the ground with `rma`, 25 m with
    `uma` and 10 m with `umi`, so users must stand on the ground. With `line_of_sight: mean` the
    losses with and without line of sight are weighted with the probability of line of sight. All
    levels must be above 22.5 m (`rma`: 10 m) and at most 300 m, and the map at most 4 km (`rma`: 10
    km) from corner to corner.

    The numbers of the report follow from the environment. p1 and d1 of table B-1 are ``slope``
    times the logarithm of the height, plus ``from``, and at least ``least``. A loss of table B-2,
    with line of sight (``seen``) or without (``blocked``), is ``from_db`` over 1 m at 1 GHz. For a
    tenfold distance it rises by ``per_decade_db``, less ``less_db`` for each tenfold height, and at
    least by ``least_db``. With line of sight it is at least ``seen_limit_db`` plus 20 dB for each
    tenfold distance, and without it at least ``blocked_limit_db`` more than with it.
    """

    environment: Site
    """`rma`: villages and fields. `uma`: towns, with stations above the roofs. `umi`: streets, with
    stations below the roofs.
    """
    station_m: float = field(init=False, repr=False)
    """The height of the station's antenna."""
    above_m: float = field(init=False, repr=False)
    """The height above which the formulas hold."""
    always_m: float = field(init=False, repr=False)
    """The height above which there is always line of sight."""
    farthest_m: float = field(init=False, repr=False)
    """The largest horizontal distance of the path loss."""
    p_slope: float = field(init=False, repr=False)
    p_from: float = field(init=False, repr=False)
    p_least: float = field(init=False, repr=False)
    d_slope: float = field(init=False, repr=False)
    d_from: float = field(init=False, repr=False)
    d_least: float = field(init=False, repr=False)
    seen_from_db: float = field(init=False, repr=False)
    seen_per_decade_db: float = field(init=False, repr=False)
    seen_less_db: float = field(init=False, repr=False)
    seen_least_db: float = field(init=False, repr=False)
    seen_limit_db: float = field(init=False, repr=False)
    blocked_from_db: float = field(init=False, repr=False)
    blocked_per_decade_db: float = field(init=False, repr=False)
    blocked_less_db: float = field(init=False, repr=False)
    blocked_least_db: float = field(init=False, repr=False)
    blocked_limit_db: float = field(init=False, repr=False)

    def __post_init__(self) -> None:
        """Look up the numbers of the environment. Raises ValueError if there is none."""
        if self.environment not in SITES:
            raise ValueError(
                f"unknown environment {self.environment!r}; allowed: {', '.join(SITES)}"
            )
        own = [each.name for each in fields(self) if not each.init]
        for name, number in zip(own, SITES[self.environment], strict=True):
            object.__setattr__(self, name, number)

    def doubts(self, carrier_ghz: float) -> Iterator[str]:
        """Yield that users are base stations."""
        yield (
            f"TR 36.777 has links between drones and base stations, so each user is a station with "
            f"an antenna {self.station_m:g} m above it; for users in the street, write "
            "al_hourani"
        )

    def problems(self, use: Use) -> Iterator[str]:
        """Yield where the report says nothing, or its loss jumps."""
        name = self.environment
        low_m, high_m = use.lowest_m, use.highest_m
        if not use.flies:
            yield f"{name} is for drones: TR 36.777 has no links between antennas on the ground"
            return
        if use.tallest_user_m > 0.0:
            yield (
                f"{name} has stations on the ground, but users are up to {use.tallest_user_m:g} m "
                "high; write users.max_height_m: 0"
            )
        if low_m <= self.above_m or high_m > HIGHEST_M:
            yield (
                f"TR 36.777 has {name} for heights above {self.above_m:g} m and up to "
                f"{HIGHEST_M:g} m, and levels are from {low_m:g} to {high_m:g} m"
                + ("; below, it refers to TR 38.901" if low_m <= self.above_m else "")
            )
        elif name == "uma" and use.line_of_sight != "mean" and high_m > self.always_m:
            yield (
                f"TR 36.777 has no loss without line of sight for uma above {self.always_m:g} m, "
                f"where there is always line of sight, and the highest level is at {high_m:g} m"
            )
        elif use.line_of_sight == "mean" and low_m <= self.always_m < high_m:
            yield (
                f"the mean loss of {name} jumps at {self.always_m:g} m, above which there is "
                f"always line of sight, and levels are from {low_m:g} to {high_m:g} m: have all "
                "of them on one side"
            )
        if use.farthest_m > self.farthest_m:
            yield (
                f"TR 36.777 has {name} up to {self.farthest_m / 1000:g} km, and the map is "
                f"{use.farthest_m / 1000:.3g} km from corner to corner"
            )

    def los_db(self, distance_m: float, height_m: float, carrier_ghz: float) -> float:
        """Return the loss with line of sight."""
        range_m = station_range_m(self, distance_m, height_m)
        return seen_db(self, height_m, range_m) + 20.0 * log10(carrier_ghz)

    def nlos_db(self, distance_m: float, height_m: float, carrier_ghz: float) -> float:
        """Return the loss without line of sight."""
        range_m = station_range_m(self, distance_m, height_m)
        return blocked_db(self, height_m, range_m) + 20.0 * log10(carrier_ghz)

    def mean_db(self, distance_m: float, height_m: float, carrier_ghz: float) -> float:
        """Return the mean of both losses, weighted with the probability of line of sight."""
        range_m = station_range_m(self, distance_m, height_m)
        mean = mean_of(
            share_in_sight(self, distance_m, height_m),
            seen_db(self, height_m, range_m),
            blocked_db(self, height_m, range_m),
        )
        return mean + 20.0 * log10(carrier_ghz)

    def rates(self, branch: int, distance_m: float, height_m: float, within_m: float) -> Rates:
        """Return the bounds for the change of a level, by the derivatives of the formulas."""
        return rates_near(self, branch, distance_m, height_m, within_m)
