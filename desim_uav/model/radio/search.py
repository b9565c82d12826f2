"""When the ratios of signals to noise and interference pass thresholds, for one user.

Within a stretch (``model.radio.links``), levels have bounds for how fast they rise and fall
(``model.radio.bounds``). Where these show that a ratio is monotone, it passes each threshold at
most once; elsewhere they show how far it can go. The search looks at shorter and shorter times
until one of the two settles the classes. docs/explanation/sinr.md proves it.
"""

from __future__ import annotations

import numpy as np

from desim_uav.model.radio.bounds import bound_levels, bound_ratio, bound_stretch, turns_back
from desim_uav.model.radio.links import LOOKS, Air, Link, compare, look
from desim_uav.model.radio.passing import pass_thresholds
from desim_uav.rowcode.kernels import kernel, rule

TOLERANCE_DB = 1e-4
"""Stays on the other side of a threshold that go less far than this beyond it may be missed."""

SHORTEST_S = 1e-7
"""The search looks at least so far ahead: what comes and goes in between lasts no microsecond."""


@kernel
def search(air: Air, begin: float, lasts: float) -> None:
    """Write the changes of class of all signals that are sought in a stretch.

    It begins ``begin`` seconds after the span, with the look in row 0, whose classes are noted.
    Afterwards, row 0 is the look at its end.

    Rows of looks are a stack: the time that is looked at lies between the last two of them, and
    those before it are later.
    """
    links, looked_s = air.links, air.looked_s
    if not _moves(air):
        return
    _copy(air, 0, 1)
    looked_s[1] = 0.0
    look(air, 0, lasts)
    bound_stretch(air, lasts)
    for k in range(air.used):
        if links[k].sought:
            links[k].settled_s = 0.0
            compare(air, 0, k)
    left = 1
    while left > 0:
        since, until = looked_s[left], looked_s[left - 1]
        shortest = until - since <= SHORTEST_S or left + 1 >= LOOKS
        bounded, settled = False, True
        for k in range(air.used):
            link = links[k]
            if link.sought and link.settled_s <= since:
                if _keeps(air, k, left):
                    link.settled_s = until
                    continue
                if not bounded:
                    bound_levels(air, left)
                    bounded = True
                if _settle(air, k, left, begin, shortest):
                    link.settled_s = until
                else:
                    settled = False
        if settled:
            left -= 1
            continue
        _copy(air, left, left + 1)
        look(air, left, since + 0.5 * (until - since))
        for k in range(air.used):
            if links[k].sought and links[k].settled_s <= since:
                compare(air, left, k)
        left += 1


@rule
def _copy(air: Air, one: int, other: int) -> None:
    """Copy a look into another row."""
    air.looked_s[other] = air.looked_s[one]
    for k in range(air.used):
        had, gets = air.links[k].looks[one], air.links[k].looks[other]
        gets.level_dbm, gets.power_mw, gets.ratio_db = had.level_dbm, had.power_mw, had.ratio_db


@rule
def _moves(air: Air) -> bool:
    """Return whether any drone moves relative to the user."""
    for k in range(air.used):
        link = air.links[k]
        if link.vx_mps != 0.0 or link.vy_mps != 0.0 or link.vz_mps != 0.0:
            return True
        if link.ax_mps2 != 0.0 or link.ay_mps2 != 0.0 or link.az_mps2 != 0.0:
            return True
    return False


@rule
def _keeps(air: Air, k: int, left: int) -> bool:
    """Return whether a signal keeps its class between two looks, by the bounds of the stretch."""
    link, others = air.links[k], 0.0
    for i in range(air.used):
        if i != k:
            others = max(others, air.links[i].steep)
    goes = (link.steep + others) * (air.looked_s[left - 1] - air.looked_s[left])
    before, after = link.looks[left].ratio_db, link.looks[left - 1].ratio_db
    if not goes < np.inf:
        return False
    # It turns back at most so far as if it were always as fast as it can be.
    low, high = 0.5 * (before + after - goes), 0.5 * (before + after + goes)
    low, high = min(low, before, after), max(high, before, after)
    return stays(air, link, low, high)


@kernel
def _settle(air: Air, k: int, left: int, begin: float, shortest: bool) -> bool:
    """Write the changes of a signal's class between two looks, if bounds show what they are.

    The bounds of all levels are known. If the time is one of the ``shortest``, what the two looks
    show is taken for all that happens.
    """
    link, thresholds_db = air.links[k], air.thresholds_db
    width = air.looked_s[left - 1] - air.looked_s[left]
    before, after = link.looks[left].ratio_db, link.looks[left - 1].ratio_db
    least, most = bound_ratio(air, k)
    state, lowest, top = link.state, link.lowest, link.top
    reached = state
    while lowest + reached < top and after >= thresholds_db[lowest + reached]:
        reached += 1
    while reached > 0 and after < thresholds_db[lowest + reached - 1]:
        reached -= 1
    monotone = least >= 0.0 or most <= 0.0
    if not monotone and not shortest:
        turns = turns_back(width, after - before, least, most)
        if turns > 0.5 * TOLERANCE_DB:
            beyond = turns - 0.5 * TOLERANCE_DB
            low, high = min(before, after) - beyond, max(before, after) + beyond
            if reached != state or not stays(air, link, low, high):
                return False
    if reached != state:
        slopes = (least, most) if reached > state else (-most, -least)
        pass_thresholds(air, k, left, left - 1, begin, reached, slopes)
    return True


@rule
def stays(air: Air, link: Link, low: float, high: float) -> bool:
    """Return whether two ratios are in the class of a signal."""
    above = link.lowest + link.state
    if link.state > 0 and low < air.thresholds_db[above - 1]:
        return False
    return above == link.top or high < air.thresholds_db[above]
