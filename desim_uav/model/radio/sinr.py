"""When the ratio of a signal to noise and interference passes thresholds, none of them missed.

The ratio in decibels changes at most so fast as ``model.radio.slopes`` and the speeds of the drones
and the user allow. Nothing can happen before it could have reached the next threshold, so a search
may advance to that time and look again: conservative advancement. docs/explanation/sinr.md proves
the bound.

The same search finds two other things. With one link and noise of 0 dBm, the ratio is the level of
this link, so that thresholds are levels: for legs that change altitude. With two links and noise of
-inf dBm, it is what the first level exceeds the second one by: for handovers.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from desim_uav.model.kernels import part, rule
from desim_uav.model.radio.tracks import BEGIN, note, place, receding, rounded_us, row_at

TOLERANCE_DB = 1e-4
"""Stays on the other side of a threshold that go less far than this beyond it may be missed."""

SHORTEST_S = 1e-7
"""The search advances at least so far: what comes and goes in between lasts no microsecond."""

WORTH = 0.8
"""A bound for a shorter time is sought while the last one was less than this of the one before."""

ROOT_S = 1e-9
"""How far a time may be from where the ratio passes a threshold, before it is rounded."""


class Links(NamedTuple):
    """The links of one user: to the drone that serves it, and to those that interfere.

    ``own`` is what the functions of the path loss know, whatever it is. ``tracks`` has the tracks
    of the drones relative to the user (``tracks.relative``), all of one span; those of link k are
    ``offsets[k]:offsets[k + 1]``, and link 0 serves. ``noise_dbm``: the noise in the band.
    """

    own: Any
    tracks: NDArray[np.float64]
    offsets: NDArray[np.int64]
    noise_dbm: float


def ratio_of(level: Any) -> Any:
    """Return the function (links, seconds) -> signal over noise and interference, in dB.

    ``level(own, link, distance_m, height_m)`` returns the level of a link in dBm, where
    ``distance_m`` is horizontal and ``height_m`` the height of the drone above the user.
    """

    @rule
    def level_at(links: Any, k: int, t: float) -> float:
        first, last = links.offsets[k], links.offsets[k + 1]
        x, y, z = place(links.tracks, row_at(links.tracks, first, last, t), t)
        return float(level(links.own, k, np.sqrt(x * x + y * y), z))

    @rule
    def ratio_db(links: Any, t: float) -> float:
        loudest, total = links.noise_dbm, 1.0
        for k in range(1, len(links.offsets) - 1):
            heard = level_at(links, k, t)
            if heard > loudest:
                total = total * 10.0 ** (0.1 * (loudest - heard)) + 1.0
                loudest = heard
            else:
                total += 10.0 ** (0.1 * (heard - loudest))
        return float(level_at(links, 0, t) - (loudest + 10.0 * np.log10(total)))

    return ratio_db


def steepness_of(slope: Any) -> Any:
    """Return the function (links, since, until) -> the most that the ratio changes, in dB/s.

    ``slope(own, link, distance_m, height_m, within_m)`` returns the most that the level of a link
    changes, in dB a metre of distance and in dB a metre of height, at places at most ``within_m``
    away from a place; inf is allowed.
    """

    @rule
    def steepness(links: Any, since: float, until: float) -> float:
        serving = strongest = 0.0
        for k in range(len(links.offsets) - 1):
            first, last = links.offsets[k], links.offsets[k + 1]
            radial, up, speed = receding(links.tracks, first, last, since, until)
            if speed > 0.0:
                x, y, z = place(links.tracks, row_at(links.tracks, first, last, since), since)
                away, over = slope(links.own, k, np.sqrt(x * x + y * y), z, speed * (until - since))
                steep = (away * radial if radial > 0.0 else 0.0) + (over * up if up > 0.0 else 0.0)
                if k == 0:
                    serving = steep
                else:
                    strongest = max(strongest, steep)
        return float(serving + strongest)

    return steepness


def passing_of(ratio_db: Any) -> Any:
    """Return the function that finds where the ratio passes a threshold between two times.

    It takes (links, threshold, rises, low, high), and returns a time at which the ratio is beyond
    the threshold, ``ROOT_S`` after one at which it is not, and how often it looked. At ``high`` it
    must be beyond. It looks on both sides of where a straight line would pass, and then half-way.
    """

    @rule
    def passing(
        links: Any, threshold: float, rises: bool, low: float, high: float
    ) -> tuple[float, int]:
        before, after = ratio_db(links, low) - threshold, ratio_db(links, high) - threshold
        looked = 2
        while high - low > ROOT_S:
            line = 0.5 * (low + high)
            if before != after:
                line = low - before * (high - low) / (after - before)
            for k in range(3):
                t = line + (k - 0.5) * 0.9 * ROOT_S if k < 2 else 0.5 * (low + high)
                if low < t < high and high - low > ROOT_S:
                    looked += 1
                    beyond = ratio_db(links, t) - threshold
                    if (beyond >= 0.0) == rises:
                        high, after = t, beyond
                    else:
                        low, before = t, beyond
        return high, looked

    return passing


@part
def class_of(value: float, thresholds: NDArray[np.float64]) -> int:
    """Return how many thresholds, which rise, a value has reached."""
    low, high = 0, len(thresholds)
    while low < high:
        middle = (low + high) // 2
        if value >= thresholds[middle]:
            low = middle + 1
        else:
            high = middle
    return low


@part
def margin_of(value: float, thresholds: NDArray[np.float64], state: int) -> float:
    """Return how far a value is from the nearest threshold."""
    margin = np.inf
    if state > 0:
        margin = value - thresholds[state - 1]
    if state < len(thresholds):
        margin = min(margin, thresholds[state] - value)
    return margin


def advance(level: Any, slope: Any) -> Any:
    """Return the kernel that finds when the ratio passes thresholds, for one path loss.

    ``level`` and ``slope`` are compiled functions (see ``ratio_of`` and ``steepness_of``). The
    function returned is not compiled yet:

    ``changes(links, thresholds_db, tolerance_db, span_us, held, out)`` writes rows (time, class)
    into ``out`` and returns how many, and how often it has looked at a level or a slope of all
    links. The class is how many of the rising ``thresholds_db`` the ratio has reached. ``held`` is
    the class before the span: a row at its start says if it is another one there. Classes at both
    ends of the span depend on the places there only, and changes in one microsecond are one, or
    cancel. If ``out`` is too short, the number is larger than its length, and with that many rows
    it is long enough.

    Wherever the class is not the true one, the ratio is within ``tolerance_db`` of a threshold.
    """
    ratio_db, steepness = ratio_of(level), steepness_of(slope)
    passing = passing_of(ratio_db)

    def changes(
        links: Any,
        thresholds_db: Any,
        tolerance_db: float,
        span_us: Any,
        held: int,
        out: Any,
    ) -> tuple[int, int]:
        end = links.tracks[links.offsets[1] - 1, BEGIN]
        value = ratio_db(links, 0.0)
        state = class_of(value, thresholds_db)
        rows, looked = note(out, 0, held, span_us[0], state), 1
        t, window, last = 0.0, end, np.inf
        while t < end:
            until = min(t + window, end)
            steep = steepness(links, t, until)
            looked += 1
            window = until - t
            margin = max(margin_of(value, thresholds_db, state), tolerance_db)
            if steep * window > 4.0 * margin and window > SHORTEST_S and not steep > WORTH * last:
                window, last = 0.25 * window, steep
                continue
            while t < until:
                step = max(margin / steep, SHORTEST_S) if steep > 0.0 else np.inf
                ahead = min(t + step, until)
                value = ratio_db(links, ahead)
                reached = class_of(value, thresholds_db)
                looked += 1
                low = t
                while state != reached:
                    rises = reached > state
                    threshold = thresholds_db[state if rises else state - 1]
                    low, more = passing(links, threshold, rises, low, ahead)
                    looked += more
                    state += 1 if rises else -1
                    rows = note(out, rows, held, rounded_us(span_us[0], low), state)
                margin = max(margin_of(value, thresholds_db, state), tolerance_db)
                t = ahead
            window, last = 4.0 * window, np.inf
        return note(out, rows, held, span_us[1], state), looked

    return changes
