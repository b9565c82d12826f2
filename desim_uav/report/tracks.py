"""The exact positions of a drone along its legs."""

from __future__ import annotations

import math
from bisect import bisect_right
from collections.abc import Iterator
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from desim_uav.model.geometry.grid import Grid
from desim_uav.model.motion.motion import (
    REST,
    Transit,
    TransitLeg,
    flown_transit,
)
from desim_uav.model.motion.space import flight_of
from desim_uav.model.motion.wind import flown_along, motion_in, way_between
from desim_uav.model.radio.tracks import Flight
from desim_uav.model.rules import US, Mode
from desim_uav.model.sums import in_order
from desim_uav.report.run import Run

Ints = NDArray[np.int64]
Position = tuple[float, float, float]


class Track:
    """The legs of a drone in an episode, and its position at any time."""

    def __init__(self, legs: pd.DataFrame, run: Run, drone: int) -> None:
        self._own = run.world.type_of(drone)
        self.starts_us: Ints = (legs["t_s"] * US).round().to_numpy(np.int64)
        self.modes = [Mode[mode.upper()] for mode in legs["mode"]]
        self.ends_us = self.starts_us + (legs["duration_s"] * US).round().to_numpy(np.int64)
        self.places = [_places(row) for row in legs.to_dict("records")]
        self._legs = [self._leg(number, run) for number in range(len(legs))]

    def _leg(self, number: int, run: Run) -> TransitLeg:
        start, end = self.places[number]
        if self._own.free:
            space = self._own.space
            flown = space.leg(start, end, int(self.ends_us[number] - self.starts_us[number]))
            return TransitLeg(flight_of(flown, space.wind), start[:2], end[:2], start[2], end[2])
        length_m = in_order(abs(b - a) for a, b in zip(start, end, strict=True))
        transit: Transit = REST
        duration_us = int(self.ends_us[number] - self.starts_us[number])
        if duration_us > 0:
            commanded, step_s = self.modes[number] is Mode.FLYING, run.scenario.episode.step_s
            wind, way = run.scenario.wind_mps, way_between(start, end)
            motion = motion_in(self._own.drones.motion, wind, way)
            transit = flown_transit(motion, commanded, length_m, step_s, duration_us)
            transit = flown_along(transit, wind, way)
        return TransitLeg(transit, start[:2], end[:2], start[2], end[2])

    def flights(self) -> Iterator[tuple[int, Transit]]:
        """Yield the number and the transit of each leg that leads somewhere."""
        for number, leg in enumerate(self._legs):
            if leg.transit.duration_us > 0:
                yield number, leg.transit

    def flown(self, end_us: int) -> list[tuple[Flight, tuple[int, int]]]:
        """Return the flights until a time, each with the time from its start to the next one's."""
        until_us = np.append(self.starts_us[1:], end_us)
        spans = zip(np.maximum(self.starts_us, 0).tolist(), until_us.tolist(), strict=True)
        return [
            (
                Flight(leg.transit.rows, (*start, *stop), int(self.starts_us[number])),
                (since_us, min(to_us, end_us)),
            )
            for number, ((since_us, to_us), leg, (start, stop)) in enumerate(
                zip(spans, self._legs, self.places, strict=True)
            )
            if since_us < to_us
        ]

    def until_us(self, number: int) -> int:
        """Return the end of a leg, or the time at which another one cuts it off."""
        later = self.starts_us[number + 1 :]
        end_us = int(self.ends_us[number])
        return min(end_us, int(later[0])) if len(later) else end_us

    def cuts_us(self, grid: Grid) -> Ints:
        """Return times between which the drone stays in one cell while it flies on one leg.

        A transit from cell to cell changes cells in its middle. A leg of free flight changes them
        where it crosses the lines between cells.
        """
        if not self._own.free:
            middles: Ints = (self.starts_us + self.ends_us) // 2
            return middles
        cuts = [
            start_us + round(after_s(leg.transit, share * leg.transit.distance_m) * US)
            for start_us, leg, (start, end) in zip(
                self.starts_us.tolist(), self._legs, self.places, strict=True
            )
            if leg.transit.distance_m > 0.0
            for share in (
                *_shares(start[0], end[0], grid.cell_m[0]),
                *_shares(start[1], end[1], grid.cell_m[1]),
            )
        ]
        return np.array(sorted({*self.starts_us.tolist(), *cuts}), np.int64)

    def position_m(self, t_us: int) -> tuple[float, float, float]:
        """Return x, y and z on the latest leg, or at its end if it is over."""
        last = int(np.searchsorted(self.starts_us, t_us, "right")) - 1
        if t_us >= self.ends_us[last]:
            return self.places[last][1]
        return self._legs[last].position_m((t_us - int(self.starts_us[last])) / US)


def after_s(transit: Transit, metres: float) -> float:
    """Return the time at which a transit has flown so far: the inverse of ``motion.travelled``."""
    begun = bisect_right(transit.pieces, metres, key=lambda piece: piece.from_m)
    start_s, from_m, speed, acceleration = transit.pieces[max(0, begun - 1)]
    left_m = metres - from_m
    if left_m <= 0.0:
        return start_s
    reached = math.sqrt(max(0.0, speed * speed + 2.0 * acceleration * left_m))
    return start_s + 2.0 * left_m / (speed + reached)


def _shares(start: float, end: float, cell_m: float) -> list[float]:
    """Return the shares of a way, along one axis, at which it crosses lines between cells."""
    low, high = sorted((start, end))
    lines = range(math.floor(low / cell_m) + 1, math.ceil(high / cell_m))
    return [(line * cell_m - start) / (end - start) for line in lines]


def _places(leg: dict[str, Any]) -> tuple[Position, Position]:
    start, end = ((leg[f"x_{s}_m"], leg[f"y_{s}_m"], leg[f"z_{s}_m"]) for s in ("from", "to"))
    return start, end
