"""When the ratios of signals to noise and interference pass thresholds, for one user.

Within a stretch (``model.radio.links``), levels have bounds for how fast they rise and fall
(``model.radio.bounds``). Where these show that a ratio is monotone, it passes each threshold at
most once; elsewhere they show how far it can go. The search looks at shorter and shorter times
until one of the two settles the classes. docs/explanation/sinr.md proves it.
"""

from __future__ import annotations

import numpy as np

from desim_uav.model.radio.bounds import bound_levels, bound_ratio, bound_stretch, turns_back
from desim_uav.model.radio.links import (
    AX,
    AY,
    AZ,
    LOOKED,
    LOOKED_COLUMNS,
    LOOKS,
    LOWEST,
    RATIO_DB,
    SETTLED_S,
    SOUGHT,
    STATE,
    STEEP,
    TIME_S,
    TOP,
    VX,
    VY,
    VZ,
    Links,
    compare,
    look,
)
from desim_uav.model.radio.passing import pass_thresholds
from desim_uav.rowcode.kernels import kernel, rule

TOLERANCE_DB = 1e-4
"""Stays on the other side of a threshold that go less far than this beyond it may be missed."""

SHORTEST_S = 1e-7
"""The search looks at least so far ahead: what comes and goes in between lasts no microsecond."""


@kernel
def search(links: Links, begin: float, lasts: float) -> None:
    """Write the changes of class of all signals that are sought in a stretch.

    It begins ``begin`` seconds after the span, with the look in row 0, whose classes are noted.
    Afterwards, row 0 is the look at its end.

    Rows of looks are a stack: the time that is looked at lies between the last two of them, and
    those before it are later.
    """
    looks, words, table = links.looks, links.words, links.table
    if not _moves(links):
        return
    _copy(links, 0, 1)
    looks[1, TIME_S] = 0.0
    look(links, 0, lasts)
    bound_stretch(links, lasts)
    for k in range(links.used):
        if words[k, SOUGHT]:
            table[k, SETTLED_S] = 0.0
            compare(links, 0, k)
    left = 1
    while left > 0:
        since, until = looks[left, TIME_S], looks[left - 1, TIME_S]
        shortest = until - since <= SHORTEST_S or left + 1 >= LOOKS
        bounded, settled = False, True
        for k in range(links.used):
            if words[k, SOUGHT] and table[k, SETTLED_S] <= since:
                if _keeps(links, k, left):
                    table[k, SETTLED_S] = until
                    continue
                if not bounded:
                    bound_levels(links, left)
                    bounded = True
                if _settle(links, k, left, begin, shortest):
                    table[k, SETTLED_S] = until
                else:
                    settled = False
        if settled:
            left -= 1
            continue
        _copy(links, left, left + 1)
        look(links, left, since + 0.5 * (until - since))
        for k in range(links.used):
            if words[k, SOUGHT] and table[k, SETTLED_S] <= since:
                compare(links, left, k)
        left += 1


@rule
def _copy(links: Links, one: int, other: int) -> None:
    """Copy a look into another row."""
    for column in range(LOOKED + LOOKED_COLUMNS * links.used):
        links.looks[other, column] = links.looks[one, column]


@rule
def _moves(links: Links) -> bool:
    """Return whether any drone moves relative to the user."""
    for k in range(links.used):
        for column in (VX, VY, VZ, AX, AY, AZ):
            if links.table[k, column] != 0.0:
                return True
    return False


@rule
def _keeps(links: Links, k: int, left: int) -> bool:
    """Return whether a signal keeps its class between two looks, by the bounds of the stretch."""
    looks, table, at = links.looks, links.table, LOOKED + LOOKED_COLUMNS * k + RATIO_DB
    others = 0.0
    for i in range(links.used):
        if i != k:
            others = max(others, table[i, STEEP])
    goes = (table[k, STEEP] + others) * (looks[left - 1, TIME_S] - looks[left, TIME_S])
    before, after = looks[left, at], looks[left - 1, at]
    if not goes < np.inf:
        return False
    # It turns back at most so far as if it were always as fast as it can be.
    low, high = 0.5 * (before + after - goes), 0.5 * (before + after + goes)
    low, high = min(low, before, after), max(high, before, after)
    return _stays(links, k, links.words[k, STATE], low, high)


@kernel
def _settle(links: Links, k: int, left: int, begin: float, shortest: bool) -> bool:
    """Write the changes of a signal's class between two looks, if bounds show what they are.

    The bounds of all levels are known. If the time is one of the ``shortest``, what the two looks
    show is taken for all that happens.
    """
    looks, words, at = links.looks, links.words, LOOKED + LOOKED_COLUMNS * k + RATIO_DB
    width = looks[left - 1, TIME_S] - looks[left, TIME_S]
    before, after, state = looks[left, at], looks[left - 1, at], words[k, STATE]
    least, most = bound_ratio(links, k)
    lowest, top = words[k, LOWEST], words[k, TOP]
    reached = state
    while lowest + reached < top and after >= links.thresholds_db[lowest + reached]:
        reached += 1
    while reached > 0 and after < links.thresholds_db[lowest + reached - 1]:
        reached -= 1
    monotone = least >= 0.0 or most <= 0.0
    if not monotone and not shortest:
        turns = turns_back(width, after - before, least, most)
        if turns > 0.5 * TOLERANCE_DB:
            beyond = turns - 0.5 * TOLERANCE_DB
            low, high = min(before, after) - beyond, max(before, after) + beyond
            if reached != state or not _stays(links, k, state, low, high):
                return False
    if reached != state:
        slopes = (least, most) if reached > state else (-most, -least)
        pass_thresholds(links, k, left, left - 1, begin, reached, slopes)
    return True


@rule
def _stays(links: Links, k: int, state: int, low: float, high: float) -> bool:
    """Return whether two ratios are in a class."""
    lowest, top = links.words[k, LOWEST], links.words[k, TOP]
    if state > 0 and low < links.thresholds_db[lowest + state - 1]:
        return False
    return bool(lowest + state == top or high < links.thresholds_db[lowest + state])
