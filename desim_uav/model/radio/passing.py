"""When the ratio of a signal to noise and interference passes thresholds that it does pass."""

from __future__ import annotations

import numpy as np

from desim_uav.model.geometry.relative import rounded_us
from desim_uav.model.radio.links import EQUAL_DB, Air, note, ratio_db
from desim_uav.rowcode.kernels import kernel, part, rule

ROOT_S = 1e-9
"""How far a time may be from where the ratio passes a threshold, before it is rounded."""

SOON_S = 1e-6
"""How long after a look at which a ratio is a threshold it is looked at again."""


Slopes = tuple[float, float]


@kernel
def pass_thresholds(
    air: Air, k: int, left: int, right: int, begin: float, reached: int, slopes: Slopes
) -> None:
    """Write when a signal passes all thresholds between its class and another one.

    It passes each of them once between two looks, in a stretch that begins ``begin`` seconds after
    the span. It rises or falls by ``slopes`` in dB/s, the least and the most; if the least is not
    above 0, it may turn.

    The time is in an interval, the ends of which are moved to inverse interpolations of up to four
    of the last looks, and sometimes to the middle. This ends when both ends are in one microsecond,
    or when the slope shows that the last look was near enough. A ratio that is a threshold at one
    of the two looks passes it there, as if it were known without rounding.
    """
    link = air.links[k]
    looks, state, start_us = link.looks, link.state, air.start_us
    low, before = air.looked_s[left], looks[left].ratio_db
    until = high = air.looked_s[right]
    end = after = looks[right].ratio_db
    first, last, since = low, before, -np.inf
    later, beyond = high, after
    if right > 0 and (looks[right - 1].ratio_db > after) == (after > before):
        later, beyond = air.looked_s[right - 1], looks[right - 1].ratio_db
    rises = reached > state
    while state != reached:
        threshold = air.thresholds_db[link.lowest + (state if rises else state - 1)]
        while (after >= threshold) != rises:
            first, last, low, before, high, after = low, before, high, after, later, beyond
            later, beyond = until, end
            if high >= until:
                high, after = until, end
                break
        root, width, tries = high, high - low, 0
        if before == threshold:
            leaves = _leaves_at(air, k, (low, high), threshold, rises)
            if leaves == low:
                root, high, after = low, low, before
            else:
                first, last, low, before = low, before, leaves, ratio_db(air, k, leaves)
        elif after == threshold:
            low, before = high, after
        while not _meet(start_us, begin, low, high):
            tries += 1
            share = 0.5
            if tries % 4 > 0 or high - low < 0.1 * width:
                share = _share(
                    (first, low, high, later),
                    (last - threshold, before - threshold, after - threshold, beyond - threshold),
                )
            if tries % 4 == 0:
                width = high - low
            least = 0.25 * ROOT_S
            root = min(max(low + share * (high - low), low + least), high - least)
            if not low < root < high:
                break
            value = ratio_db(air, k, root)
            if (value >= threshold) == rises:
                later, beyond, high, after = high, after, root, value
            else:
                first, last, low, before = low, before, root, value
            if slopes[0] > 0.0:  # the root is between two times on one side
                gap = threshold - value if rises else value - threshold
                one, other = root + gap / slopes[0], root + gap / slopes[1]
                if _meet(start_us, begin, min(one, other), max(one, other)):
                    root = one
                    break
            root = high
        since = max(since, root)
        state += 1 if rises else -1
        note(link, rounded_us(start_us, begin + since), state)
    link.state = state


@kernel
def _leaves_at(
    air: Air, k: int, between: tuple[float, float], threshold: float, rises: bool
) -> float:
    """Return the first of two times if a ratio that is a threshold then passes it at once.

    Else it goes to the side from which it comes first, and a time at which it is there is returned.
    """
    first, end = between
    after = SOON_S
    while first + after < end:
        value = ratio_db(air, k, first + after)
        if abs(value - threshold) > EQUAL_DB:
            return first if (value >= threshold) == rises else first + after
        after *= 4.0
    return first


@part
def _meet(start_us: int, begin: float, low: float, high: float) -> bool:
    """Return whether two times are rounded to one microsecond, or are as near as they need be."""
    return high - low <= ROOT_S or rounded_us(start_us, begin + low) == rounded_us(
        start_us, begin + high
    )


Four = tuple[float, float, float, float]


@rule
def _share(t: Four, values: Four) -> float:
    """Return where the inverse interpolation of values is 0, as a share of the middle interval.

    The first two times are one if there is no earlier value, and so are the last two. The share is
    one half where the interpolation is of no use.
    """
    w = t[2] - t[1]
    f0, f1, f2, f3 = values
    share = f1 / (f1 - f2)
    early, late = t[0] != t[1], t[3] != t[2]
    if early or late:
        a = 0.0
        if early:
            x = (t[0] - t[1]) / w
            # Neville's scheme for the times, in shares of the interval, at the value 0.
            a = -f1 * x / (f0 - f1)
            a = (f0 * share - f2 * a) / (f0 - f2)
        b = 0.0
        if late:
            x = (t[3] - t[1]) / w
            b = (f2 * x - f3) / (f2 - f3)
            b = (f1 * b - f3 * share) / (f1 - f3)
        share = a if early else b
        if early and late:
            share = (f0 * b - f3 * a) / (f0 - f3)
    return share if 0.0 <= share <= 1.0 else 0.5
