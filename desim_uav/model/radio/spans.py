"""Bounds of levels for a whole span, which show that a link keeps its class without a search.

While a sender keeps its height, the level falls with the horizontal distance (``RowPathLoss``). So
it stays between the levels at the largest and at the least distance. The sender flies straight, and
the user stays within a circle around the middle of where it walks, so that the distance stays
between those of the sender's way from this circle. A signal that is too weak for the lowest class
even without interference has class 0, whatever the other senders do.

While a sender climbs or descends, a level changes by no more than the bounds of its rates allow for
so long a way (``model.radio.bounds``).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from desim_uav.model.geometry.coverage import MARGIN_M, leg_at, walked
from desim_uav.model.radio.bounds import bound_rates
from desim_uav.model.radio.links import (
    OTHER,
    ROUNDED_DB,
    SIGNAL,
    Air,
    Link,
    class_at,
    loss_db,
)
from desim_uav.model.radio.slopes import DB
from desim_uav.model.radio.stretches import relate, take_first_rows, take_mark
from desim_uav.model.radio.tracks import Walkers, place
from desim_uav.rowcode.kernels import kernel, rule


class Walk(NamedTuple):
    """How a user walks in a span: its first leg, how far it walks, and a circle that it is in."""

    leg: int
    walks_m: float
    x_m: float
    y_m: float
    within_m: float


@kernel
def look_from(air: Air, users: Walkers, span_us: tuple[int, int], user: int) -> None:
    """Relate links to a user at the start of a span, and bound their distances in the span."""
    take_first_rows(air, len(users.heights_m), user)
    walk = _walk_of(users, user, span_us)
    x, y = walked(users.legs[walk.leg], float(span_us[0]))
    velocity = (users.legs[walk.leg].vx_mps, users.legs[walk.leg].vy_mps)
    relate(air, 0.0, (x, y, users.heights_m[user]), velocity)
    for k in range(air.used):
        _bound_distance(air, air.links[k], walk)


@rule
def _walk_of(users: Walkers, user: int, span_us: tuple[int, int]) -> Walk:
    """Return how a user walks in a span. All corners of its way are in the circle, and so is it."""
    legs, after = users.legs, users.legs_at[user + 1]
    first = leg_at(legs, users.legs_at[user], after, span_us[0])
    last = first
    while last + 1 < after and legs[last + 1].begin_us < span_us[1]:
        last += 1
    x, y = walked(legs[first], float(span_us[0]))
    to_x, to_y = walked(legs[last], float(span_us[1]))
    x, y = 0.5 * (x + to_x), 0.5 * (y + to_y)
    far, square, from_us = 0.0, 0.0, float(span_us[0])
    for leg in range(first, last + 1):
        until_us = float(span_us[1]) if leg == last else legs[leg + 1].begin_us
        vx, vy = legs[leg].vx_mps, legs[leg].vy_mps
        far += np.sqrt(vx * vx + vy * vy) * (until_us - from_us) * 1e-6
        for t_us in (from_us, until_us):
            at_x, at_y = walked(legs[leg], t_us)
            square = max(square, (at_x - x) * (at_x - x) + (at_y - y) * (at_y - y))
        from_us = until_us
    return Walk(first, far, x, y, np.sqrt(square) + MARGIN_M)


@rule
def _bound_distance(air: Air, link: Link, walk: Walk) -> None:
    """Write between which horizontal distances a link stays in a span, and how far it moves."""
    last = air.tracks[link.after - 1]
    first, end = place(air.tracks[link.first], 0.0), place(last, last.begin_s)
    dx, dy = end[0] - first[0], end[1] - first[1]
    px, py = first[0] - walk.x_m, first[1] - walk.y_m
    qx, qy = px + dx, py + dy
    begins, ends, square = px * px + py * py, qx * qx + qy * qy, dx * dx + dy * dy
    nearest = np.sqrt(min(begins, ends))
    flies = np.sqrt(square)
    along = -(px * dx + py * dy)
    if 0.0 < along < square:  # then the nearest place is on the way
        nearest = min(nearest, abs(px * dy - py * dx) / flies)
    link.near_m = max(nearest - walk.within_m, 0.0)
    link.far_m = np.sqrt(max(begins, ends)) + walk.within_m
    link.moves_m, link.climbs_m = walk.walks_m + flies, abs(end[2] - first[2])
    link.steep_away = link.steep_up = -1.0


@kernel
def bound_high(air: Air, k: int) -> None:
    """Write the highest level of a link in a span, and also the lowest one if the height changes.

    ``look_from`` must have been called before.
    """
    link = air.links[k]
    if link.climbs_m == 0.0:
        high = _extremes_dbm(air, link, link.near_m)[1]
        link.high_dbm = high + ROUNDED_DB if high < np.inf else np.inf  # no number at the sender
        return
    _bound_steepness(air, link)
    goes = link.steep_up * link.climbs_m
    if link.moves_m > 0.0:
        goes += link.steep_away * link.moves_m
    apart = np.sqrt(link.x_m * link.x_m + link.y_m * link.y_m)
    low, high = _extremes_dbm(air, link, apart)
    link.low_dbm, link.high_dbm = low - goes, high + goes


@kernel
def _bound_low(air: Air, link: Link) -> None:
    """Write the lowest level of a link in a span, after the highest one."""
    if link.climbs_m == 0.0:
        link.low_dbm = _extremes_dbm(air, link, link.far_m)[0] - ROUNDED_DB


@rule
def _extremes_dbm(air: Air, link: Link, distance_m: float) -> tuple[float, float]:
    """Return the lowest and the highest level at a distance, over all marks of a link in a span."""
    mark = link.mark
    low = high = link.base_dbm - loss_db(link, distance_m, link.z_m)
    while link.mark < link.last_mark:
        link.mark += 1
        take_mark(air, link)
        level = link.base_dbm - loss_db(link, distance_m, link.z_m)
        low, high = min(low, level), max(high, level)
    _take_again(air, link, mark)
    return low, high


@rule
def _take_again(air: Air, link: Link, mark: int) -> None:
    """Take the mark of a link that it had before."""
    if link.mark != mark:
        link.mark = mark
        take_mark(air, link)


@kernel
def bound_steepness(air: Air) -> None:
    """Write the most that all levels change in a span for a metre, if it is not known yet."""
    for k in range(air.used):
        if air.links[k].steep_away < 0.0:
            _bound_steepness(air, air.links[k])


@kernel
def _bound_steepness(air: Air, link: Link) -> None:
    """Write the most that a level changes in a span, over all marks, for a metre of each kind."""
    mark, ways = link.mark, link.moves_m + link.climbs_m
    link.steep_away = link.steep_up = 0.0
    if ways == 0.0:
        return
    rates, apart = link.rates, np.sqrt(link.x_m * link.x_m + link.y_m * link.y_m)
    while True:
        bound_rates(link, apart, link.z_m, ways)
        link.steep_away = max(link.steep_away, rates.most_away, -rates.least_away)
        link.steep_up = max(link.steep_up, rates.most_up, -rates.least_up)
        if link.mark >= link.last_mark:
            break
        link.mark += 1
        take_mark(air, link)
    _take_again(air, link, mark)


@kernel
def bound_span(air: Air) -> None:
    """Write the lowest levels of all links in a span, and bounds of their powers."""
    for k in range(air.used):
        link = air.links[k]
        _bound_low(air, link)
        if air.used > 1:
            link.low_mw = np.exp(link.low_dbm / DB)
            link.high_mw = np.exp(link.high_dbm / DB)


@rule
def is_too_weak(air: Air, k: int) -> bool:
    """Return whether a signal is always too weak for the lowest class, even without interference.

    Its class is 0 then.
    """
    link = air.links[k]
    return bool(link.high_dbm - link.noise_dbm < air.thresholds_db[link.lowest])


@rule
def stays_in(air: Air, k: int) -> int:
    """Return the class of a signal if bounds show that it is always the same, or else -1."""
    link = air.links[k]
    least = most = link.noise_mw
    for i in range(air.used):
        if i != k:
            least += air.links[i].low_mw
            most += air.links[i].high_mw
    state = class_at(air, k, link.high_dbm - DB * np.log(least))
    low = class_at(air, k, link.low_dbm - DB * np.log(most))
    return state if low == state else -1


@rule
def stays_apart(air: Air, threshold_db: float) -> int:
    """Return the state of a pair if bounds show that it is always the same, or else -1."""
    signal, other = air.links[SIGNAL], air.links[OTHER]
    _bound_low(air, signal)
    if signal.low_dbm - other.high_dbm > threshold_db:
        return 1
    _bound_low(air, other)
    return 0 if signal.high_dbm - other.low_dbm < threshold_db else -1
