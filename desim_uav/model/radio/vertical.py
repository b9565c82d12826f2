"""When a level passes thresholds while a drone climbs or descends above users who stand still.

The horizontal distance then stays the same, and the level depends on the height alone. It is
monotone between the heights at which it is stationary, so it passes a threshold between two of them
at most once. For Al-Hourani's mean loss these heights are at the stationary elevations; there can
be several (three in the environment high_rise).

If the horizontal distance changes too, the turning points of the level are unknown for a path loss
of which it is only known that it rises with the distance at each height. ``model.radio.sinr`` then
needs a bound on the change of the level.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from desim_uav.model.kernels import kernel, part
from desim_uav.model.radio.polynomial import sign_changes
from desim_uav.model.radio.sinr import ROOT_S, class_of, passing_of, ratio_of
from desim_uav.model.radio.slopes import DEGREES
from desim_uav.model.radio.tracks import (
    BEGIN,
    PULL_AT,
    note,
    place,
    rounded_us,
    velocity,
)

GRAZE_DB = 1e-11
"""How close to a threshold an extremum of the level touches it without passing it."""

FINEST_DEG = 1e-9
"""Elevations that are closer together than this are taken for one."""


def climb(level: Any) -> Any:
    """Return the kernel that finds when a level passes thresholds on a vertical leg.

    ``level`` is a compiled function (see ``sinr.ratio_of``). It must be monotone in the height
    between the heights below. The function returned is not compiled yet:

    ``changes(links, heights_m, thresholds_db, span_us, held, out)`` writes rows (time, class) into
    ``out`` and returns how many. ``links`` has one link, whose horizontal distance does not change,
    and noise of 0 dBm. ``heights_m`` are the heights above the user at which the level is
    stationary at this distance, in order. For the rest see ``sinr.advance``.
    """
    ratio_db = ratio_of(level)
    passing = passing_of(ratio_db)

    def changes(
        links: Any,
        heights_m: Any,
        thresholds_db: Any,
        span_us: Any,
        held: int,
        out: Any,
    ) -> int:
        tracks, last = links.tracks, links.offsets[1] - 1
        state = class_of(ratio_db(links, 0.0), thresholds_db)
        rows = note(out, 0, held, span_us[0], state)
        for row in range(links.offsets[0], last):
            t, end = tracks[row, BEGIN], tracks[row + 1, BEGIN]
            while t < end:
                until = next_turn(tracks, row, t, end, heights_m)
                reached = settled(ratio_db(links, until), thresholds_db, state, until < end)
                if row + 1 == last and until >= end:
                    reached = class_of(ratio_db(links, end), thresholds_db)
                low = t
                while state != reached:
                    rises = reached > state
                    threshold = thresholds_db[state if rises else state - 1]
                    low, _ = passing(links, threshold, rises, low, until)
                    state += 1 if rises else -1
                    rows = note(out, rows, held, rounded_us(span_us[0], low), state)
                t = until
        return rows

    return changes


@kernel
def next_turn(
    tracks: NDArray[np.float64], row: int, t: float, end: float, heights: NDArray[np.float64]
) -> float:
    """Return when a drone next passes one of these heights or turns, or else ``end``.

    Heights and turns within the next ``ROOT_S`` seconds do not count.
    """
    z, speed, pull = place(tracks, row, t)[2], velocity(tracks, row, t)[2], tracks[row, PULL_AT + 2]
    until = end - t
    if pull != 0.0 and ROOT_S < -speed / pull < until:
        until = -speed / pull
    for height in heights:
        c = (z - height, speed, 0.5 * pull, 0.0, 0.0)
        count, roots = sign_changes(c, c[0] > 0.0, until, 0.0)
        if count > 0 and roots[0] > ROOT_S:
            until = min(until, roots[0])
    return min(t + until, end)


@part
def settled(value: float, thresholds: NDArray[np.float64], state: int, turns: bool) -> int:
    """Return the class at a value; where a level turns, thresholds it only touches do not count."""
    reached = class_of(value, thresholds)
    if turns:
        while reached > state and value - thresholds[reached - 1] <= GRAZE_DB:
            reached -= 1
        while reached < state and thresholds[reached] - value <= GRAZE_DB:
            reached += 1
    return reached


STEEPEST = 1.0 / (6.0 * np.sqrt(3.0))
"""The largest value of p (1 - p) (1 - 2 p), at p = 1/2 - 1/(2 sqrt 3)."""

TANGENT = np.pi / (9.0 * np.log(10.0))
"""The factor of the tangent in the slope of the free-space loss, in dB per degree."""


@kernel
def stationary_elevations(fall_db: float, a: float, b: float, out: NDArray[np.float64]) -> int:
    """Write the elevations at which Al-Hourani's mean loss at a fixed distance is stationary.

    They are the roots of equation 13 of Al-Hourani et al. 2014, in degrees and in order. Returns
    their number; those for which there is no room are counted only. For the parameters see
    ``slopes.logistic_slope``.

    None is missed: each stretch of elevations is left only when bounds of the equation's two terms
    exclude a root there, or when bounds of their derivatives show that there is at most one.
    """
    low, width, found = 0.0, 1.0, 0
    while low < 90.0:
        high = min(low + width, 90.0)
        falls, bends = _logistic_bounds(a, b, low, high)
        most = TANGENT * np.tan(high / DEGREES) - fall_db * falls[0]
        least = TANGENT * np.tan(low / DEGREES) - fall_db * falls[1]
        secant, tilt = 1.0 / np.cos(low / DEGREES), 1.0 / np.cos(high / DEGREES)
        rises = TANGENT / DEGREES * secant * secant > fall_db * bends[1]
        sinks = TANGENT / DEGREES * tilt * tilt < fall_db * bends[0]
        if least <= 0.0 <= most and not (rises or sinks) and high - low > FINEST_DEG:
            width = 0.5 * (high - low)
            continue
        if least <= 0.0 <= most:
            begins = _steepness(fall_db, a, b, low) > 0.0
            if (_steepness(fall_db, a, b, high) > 0.0) != begins:
                if found < len(out):
                    out[found] = _stationary(fall_db, a, b, low, high)
                found += 1
        low, width = high, 2.0 * width
    return found


@part
def _logistic(a: float, b: float, elevation: float) -> tuple[float, float]:
    """Return the derivatives of first and second order of the probability of line of sight."""
    p = 1.0 / (1.0 + a * np.exp(-b * (elevation - a)))
    return b * p * (1.0 - p), b * b * p * (1.0 - p) * (1.0 - 2.0 * p)


@part
def _logistic_bounds(
    a: float, b: float, low: float, high: float
) -> tuple[tuple[float, float], tuple[float, float]]:
    """Return the least and the largest derivatives of both orders between two elevations."""
    steepest, off = a + np.log(a) / b, np.log(2.0 + np.sqrt(3.0)) / b
    (one, bend), (other, last) = _logistic(a, b, low), _logistic(a, b, high)
    most = 0.25 * b if low <= steepest <= high else max(one, other)
    least_bend, most_bend = min(bend, last), max(bend, last)
    if low <= steepest - off <= high:
        most_bend = STEEPEST * b * b
    if low <= steepest + off <= high:
        least_bend = -STEEPEST * b * b
    return (min(one, other), most), (least_bend, most_bend)


@part
def _steepness(fall_db: float, a: float, b: float, elevation: float) -> float:
    return float(TANGENT * np.tan(elevation / DEGREES) - fall_db * _logistic(a, b, elevation)[0])


@kernel
def _stationary(fall_db: float, a: float, b: float, low: float, high: float) -> float:
    """Return the root between two elevations at which the slope has different signs."""
    begins = _steepness(fall_db, a, b, low) > 0.0
    while True:
        middle = 0.5 * (low + high)
        if not low < middle < high:
            return float(middle)
        if (_steepness(fall_db, a, b, middle) > 0.0) == begins:
            low = middle
        else:
            high = middle
