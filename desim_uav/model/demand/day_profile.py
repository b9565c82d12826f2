"""Requests whose rate changes through the day, from hotspot to hotspot."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from itertools import pairwise
from typing import Annotated, Any, ClassVar, Literal

import numpy as np
from annotated_types import Ge, Le, Lt, MaxLen, MinLen

from desim_uav.model.demand.asking import NO_MORE_US, RowDemand, ask_for_mix
from desim_uav.model.demand.demand import PAPER_MIX, MixWeight, Nothing, too_few
from desim_uav.model.random.streams import uniform
from desim_uav.model.rules import US
from desim_uav.registry import Checked, register
from desim_uav.rowcode.kernels import rule
from desim_uav.rowcode.rows import Table

DAY_S = 86_400.0

MOST_POINTS = 1000

LEAST_A_DAY = 1e-3
"""The least mean number of requests of a user in a day."""

Point = tuple[Annotated[float, Ge(0), Lt(24)], Annotated[float, Ge(0), Le(1e6)]]
Profile = Annotated[tuple[Point, ...], MinLen(1), MaxLen(MOST_POINTS)]


def _check(profiles: tuple[Profile, ...]) -> None:
    """Raise ValueError if the hours of a profile do not rise."""
    for number, profile in enumerate(profiles):
        for (before, _), (hour, _) in pairwise(profile):
            if hour <= before:
                raise ValueError(f"profile {number}: hours must rise: {hour:g} follows {before:g}")


Profiles = Annotated[tuple[Profile, ...], MinLen(1), MaxLen(1000), Checked(_check)]


@register("demand", "profile")
@dataclass(frozen=True)
class DayProfile(RowDemand):
    """Each user's requests arrive as a Poisson process whose rate changes through the day.

    Arrivals are found exactly, by inversion of the integral of the rate. A day repeats itself. An
    arrival during an open request of the same user is dropped.
    """

    profiles: Profiles
    """One or more profiles of a day, each a list of points [hour, arrivals per hour and user]. User
    u follows profile u modulo their number, as it lives in cluster u modulo `users.clusters.count`:
    with as many profiles as clusters, each cluster is a hotspot with a day of its own.
    """
    shape: Literal["steps", "linear"] = "steps"
    """`steps`: a rate holds from its hour to that of the next point. `linear`: between points, the
    rate changes at an even pace. The point after the last is the first one of the next day.
    """
    begins_at_h: Annotated[float, Ge(0), Lt(24)] = 0.0
    """The hour of the day at which an episode begins."""
    none: Nothing = 0.0
    """The probability that an arrival is no request."""
    mix: dict[str, MixWeight] = field(default_factory=PAPER_MIX.copy)
    """The weight of each service. Weights are normalised; a service that is not named has
    none.
    """

    after_previous = False
    asks_from_lists = True
    remembers: ClassVar = {"t_us": int, "passed": float}

    pieces: Table[float] = field(init=False, repr=False, compare=False)
    """The pieces of all days, PIECE numbers each: see ``_pieces``."""
    firsts: Table[float] = field(init=False, repr=False, compare=False)
    """The number of the first piece of each profile, and the number of all pieces."""
    begins_s: float = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        """Set the pieces of the days. Raises ValueError for a profile without requests."""
        pieces: list[float] = []
        firsts = [0.0]
        for number, profile in enumerate(self.profiles):
            own = _pieces(profile, self.shape == "linear")
            a_day = own[-1][PASSED]
            if a_day < LEAST_A_DAY:
                raise ValueError(
                    f"profile {number}: a user must make at least {LEAST_A_DAY:g} requests a day "
                    f"on average, not {a_day:g}; some rate must be above 0"
                )
            pieces += [value for piece in own for value in piece]
            firsts.append(len(pieces) / PIECE)
        object.__setattr__(self, "pieces", Table(pieces))
        object.__setattr__(self, "firsts", Table(firsts))
        object.__setattr__(self, "begins_s", self.begins_at_h * 3600.0)

    def next_request(self, asker: Any, stream: Any, services: Any) -> None:
        """Draw a request at the time until which a unit exponential of the integral has passed."""
        pieces, which = self.pieces, asker.user % (len(self.firsts) - 1)
        first, end = int(self.firsts[which]), int(self.firsts[which + 1])
        if asker.draws == 0:
            asker.passed = passed_at(pieces, first, end, self.begins_s)
        asker.passed -= math.log1p(-uniform(stream))
        t_s = time_of(pieces, first, end, asker.passed) - self.begins_s
        asker.wait_us = NO_MORE_US
        if t_s < 1e12:
            t_us = max(int(np.rint(t_s * 1e6)), asker.t_us)
            asker.wait_us, asker.t_us = t_us - asker.t_us, t_us
        ask_for_mix(asker, stream, services, self.none)

    def from_now(self, now_us: int) -> DayProfile:
        """Return the model of episodes that begin at a time of this one's."""
        return replace(self, begins_at_h=(self.begins_at_h + now_us / US / 3600.0) % 24.0)

    def expected_draws(self, users: int, required_s: float, horizon_s: float) -> float:
        """Return the mean number of arrivals in an episode, of requests or of nothing."""
        return users * (1.0 + self._arrivals_of_a_user(horizon_s))

    def doubts(self, users: int, horizon_s: float) -> Iterator[str]:
        """Yield whether hardly any request is made in an episode, at its hours of the day."""
        hours = f"from begins_at_h: {self.begins_at_h:g} to {self.begins_at_h + horizon_s / 3600:g}"
        for doubt in too_few((1.0 - self.none) * users * self._arrivals_of_a_user(horizon_s)):
            yield f"{doubt}, {hours} h"

    def _arrivals_of_a_user(self, horizon_s: float) -> float:
        """Return the mean number of arrivals of a user in an episode."""
        means = []
        for k in range(len(self.profiles)):
            own = self.pieces, int(self.firsts[k]), int(self.firsts[k + 1])
            end = passed_at(*own, self.begins_s + horizon_s)
            means.append(end - passed_at(*own, self.begins_s))
        return math.fsum(means) / len(means)


# ---- the integral of the rate, and its inverse

PIECE = 4
FROM_S, RATE, SLOPE, PASSED = range(PIECE)
"""A piece of a day: its begin in s, the rate there per s, its slope, and the integral before."""


def _pieces(profile: tuple[Point, ...], linear: bool) -> list[tuple[float, ...]]:
    """Return the pieces of a day of a profile, the last of which ends at midnight.

    What is before the first point belongs to the piece after the last one, of the day before.
    """
    points = [(3600.0 * hour, rate / 3600.0) for hour, rate in profile]
    (first_s, first), (last_s, last) = points[0], points[-1]
    slope = (first - last) / (first_s + DAY_S - last_s) if linear else 0.0
    if first_s > 0.0:
        points.insert(0, (0.0, last + slope * (DAY_S - last_s)))
    points.append((DAY_S, last + slope * (DAY_S - last_s)))
    pieces, integral = [], 0.0
    for (from_s, rate), (to_s, after) in pairwise(points):
        lasts_s = to_s - from_s
        change = (after - rate) / lasts_s if linear else 0.0
        pieces.append((from_s, rate, change, integral))
        integral += lasts_s * (rate + 0.5 * change * lasts_s)
    return [*pieces, (DAY_S, 0.0, 0.0, integral)]


@rule
def passed_at(pieces: Table[float], first: int, end: int, t_s: float) -> float:
    """Return the integral of the rate from a midnight to a time in seconds after it.

    Those of a profile's pieces are ``first`` to ``end`` - 1, the last of which is of no length.
    """
    days = math.floor(t_s / DAY_S)
    t_s -= days * DAY_S
    k = first
    while k < end - 2 and pieces[PIECE * (k + 1) + FROM_S] <= t_s:
        k += 1
    since_s = t_s - pieces[PIECE * k + FROM_S]
    rate = pieces[PIECE * k + RATE] + 0.5 * pieces[PIECE * k + SLOPE] * since_s
    whole = days * pieces[PIECE * (end - 1) + PASSED]
    return float(whole + pieces[PIECE * k + PASSED] + rate * since_s)


@rule
def time_of(pieces: Table[float], first: int, end: int, integral: float) -> float:
    """Return the time in seconds after a midnight at which the integral of the rate has a value."""
    a_day = pieces[PIECE * (end - 1) + PASSED]
    days = math.floor(integral / a_day)
    left = max(integral - days * a_day, 0.0)
    k = first
    while k < end - 2 and pieces[PIECE * (k + 1) + PASSED] <= left:
        k += 1
    left -= pieces[PIECE * k + PASSED]
    rate, slope = pieces[PIECE * k + RATE], pieces[PIECE * k + SLOPE]
    # The root of slope t² / 2 + rate t = left, in the form that subtracts nothing.
    root = math.sqrt(max(rate * rate + 2.0 * slope * left, 0.0))
    since_s = 2.0 * left / (rate + root) if left > 0.0 and rate + root > 0.0 else 0.0
    return float(days * DAY_S + pieces[PIECE * k + FROM_S] + since_s)
