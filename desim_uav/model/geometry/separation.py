"""When two drones come nearer to each other than a least distance, and when they part again.

The drones are tracks of one table (``model.radio.tracks``): pieces of constant acceleration in any
direction. In a piece of both, the squared distance is a polynomial of degree four or less, whose
passages of the squared least distance are found as those of ``model.geometry.polynomial``.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from desim_uav.model.geometry.polynomial import Coefficients, sign_changes, square_of
from desim_uav.model.geometry.relative import rounded_us
from desim_uav.model.radio.tracks import (
    Point,
    Rows,
    TrackRow,
    Turn,
    next_s,
    note,
    place,
    pulled,
    row_at,
    velocity,
)
from desim_uav.rowcode.kernels import kernel, part
from desim_uav.rowcode.rows import Table

CLEAR, NEAR = 0, 1
"""The states of a pair of drones: NEAR where their distance is less than the least one."""

GRAZE = 1e-14
"""How close to the squared least distance, relative to the squared distance at the start of a
piece, an extremum touches it without a change."""


class Approach(NamedTuple):
    """The least distance of two drones in a span, and the first time at which they have it."""

    distance_m: float
    at_s: float


@kernel
def conflicts(
    tracks: Table[TrackRow],
    one: Rows,
    other: Rows,
    least_m: float,
    span_us: tuple[int, int],
    initial: int,
    out: Table[Turn],
) -> int:
    """Write when two drones come nearer than ``least_m`` and part again; return the rows' number.

    Both tracks are of the span. Turns go into ``out``; ``initial`` is the state before
    the span, and a row at its start says if it is another one there (-1: always). States at both
    ends of the span depend on the places there only, changes in one microsecond cancel, and a pair
    at just the least distance is clear. If ``out`` is too short, the number is larger than its
    length, and with that many rows it is long enough.
    """
    limit, i, j = least_m * least_m, one[0], other[0]
    state = NEAR if limit > _square(tracks[i], tracks[j], 0.0)[0] else CLEAR
    rows = note(out, 0, initial, span_us[0], state)
    end, at = tracks[one[1] - 1].begin_s, 0.0
    while at < end:
        i, j = row_at(tracks, i, one[1], at), row_at(tracks, j, other[1], at)
        until = next_s(tracks, j, other[1], next_s(tracks, i, one[1], end))
        square = _square(tracks[i], tracks[j], at)
        c = (limit - square[0], -square[1], -square[2], -square[3], -square[4])
        count, roots = sign_changes(c, state == NEAR, until - at, GRAZE * (square[0] + limit))
        for k in range(count):
            state = 1 - state
            rows = note(out, rows, initial, rounded_us(span_us[0], at + roots[k]), state)
        at = until
    last = _square(tracks[one[1] - 1], tracks[other[1] - 1], end)
    return note(out, rows, initial, span_us[1], NEAR if limit > last[0] else CLEAR)


@kernel
def approach(
    tracks: Table[TrackRow], one: Rows, other: Rows, begin_s: float, end_s: float
) -> Approach:
    """Return the least distance of two drones in a part of the span of their tracks."""
    i, j, at = one[0], other[0], begin_s
    least = Approach(np.inf, begin_s)
    while True:
        i, j = row_at(tracks, i, one[1], at), row_at(tracks, j, other[1], at)
        least = _nearer(tracks[i], tracks[j], at, least)
        if not at < end_s:
            return least
        until = next_s(tracks, j, other[1], next_s(tracks, i, one[1], end_s))
        _, c1, c2, c3, c4 = _square(tracks[i], tracks[j], at)
        slope = (c1, 2.0 * c2, 3.0 * c3, 4.0 * c4, 0.0)
        count, turns = sign_changes(slope, c1 > 0.0, until - at, 0.0)
        for k in range(count):
            least = _nearer(tracks[i], tracks[j], at + turns[k], least)
        at = until


@part
def _apart(one: TrackRow, other: TrackRow, t: float) -> Point:
    """Return the place of one drone relative to another."""
    (x, y, z), (u, v, w) = place(one, t), place(other, t)
    return x - u, y - v, z - w


@part
def _square(one: TrackRow, other: TrackRow, t: float) -> Coefficients:
    """Return the squared distance as a polynomial of the time from ``t`` on."""
    (vx, vy, vz), (wx, wy, wz) = velocity(one, t), velocity(other, t)
    (ax, ay, az), (bx, by, bz) = pulled(one), pulled(other)
    pull = ax - bx, ay - by, az - bz
    return square_of(_apart(one, other, t), (vx - wx, vy - wy, vz - wz), pull)


@part
def _nearer(one: TrackRow, other: TrackRow, t: float, least: Approach) -> Approach:
    """Return the nearer one of an approach and the places at a time."""
    x, y, z = _apart(one, other, t)
    distance = np.sqrt(x * x + y * y + z * z)
    return Approach(distance, t) if distance < least.distance_m else least
