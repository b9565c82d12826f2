"""Which of two drones a user receives better, if levels fall with the logarithm of the distance.

Two such levels differ by a given number of decibels where the two distances have a fixed ratio. In
the plane these places are a circle of Apollonius. The ratio of the distances passes a value at the
roots of a polynomial of degree two while both drones coast, and four while one accelerates.
For other path losses see ``model.radio.sinr``.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from desim_uav.model.kernels import kernel, part
from desim_uav.model.radio.polynomial import sign_changes
from desim_uav.model.radio.tracks import (
    BEGIN,
    PULL_AT,
    Point,
    Rows,
    note,
    place,
    rounded_us,
    row_at,
    velocity,
)

GRAZE = 1e-14
"""How close to zero an extremum of the difference of squared distances, relative to them, touches
it without a change of sign."""


@kernel
def distance_ratio(gain_db: float, exponent: float) -> float:
    """Return the ratio of two distances over which path losses differ by ``gain_db``."""
    return float(10.0 ** (gain_db / (10.0 * exponent)))


@kernel
def nearer_changes(
    tracks: NDArray[np.float64],
    one: Rows,
    other: Rows,
    ratio: float,
    span_us: tuple[int, int],
    held: int,
    out: NDArray[np.int64],
) -> int:
    """Write when one drone is at most ``ratio`` times as far from a user as another one is.

    ``one`` and ``other`` are their tracks relative to the user. The state is 1 then, else 0.
    ``held`` is the state before the span: a row at its start says if it is another one there. Rows
    (time, state) go into ``out``. States at both ends of the span depend on the places there only,
    and changes in one microsecond cancel. If ``out`` is too short, the number is larger than its
    length, and with that many rows it is long enough.
    """
    square = ratio * ratio
    i, j = one[0], other[0]
    state = _is_nearer(place(tracks, i, 0.0), place(tracks, j, 0.0), square)
    rows = note(out, 0, held, span_us[0], state)
    end = tracks[one[1] - 1, BEGIN]
    at = 0.0
    while at < end:
        i = row_at(tracks, i, one[1], at)
        j = row_at(tracks, j, other[1], at)
        until = min(
            tracks[i + 1, BEGIN] if i + 1 < one[1] else end,
            tracks[j + 1, BEGIN] if j + 1 < other[1] else end,
        )
        near, far = _squared(tracks, i, at), _squared(tracks, j, at)
        c = (
            near[0] - square * far[0],
            near[1] - square * far[1],
            near[2] - square * far[2],
            near[3] - square * far[3],
            near[4] - square * far[4],
        )
        graze = GRAZE * (near[0] + square * far[0])
        count, roots = sign_changes(c, state == 0, until - at, graze)
        for k in range(count):
            state = 1 - state
            rows = note(out, rows, held, rounded_us(span_us[0], at + roots[k]), state)
        at = until
    i, j = one[1] - 1, other[1] - 1
    state = _is_nearer(place(tracks, i, end), place(tracks, j, end), square)
    return note(out, rows, held, span_us[1], state)


@part
def _is_nearer(one: Point, other: Point, square: float) -> int:
    near = one[0] * one[0] + one[1] * one[1] + one[2] * one[2]
    far = other[0] * other[0] + other[1] * other[1] + other[2] * other[2]
    return 1 if near <= square * far else 0


@part
def _squared(
    tracks: NDArray[np.float64], row: int, at: float
) -> tuple[float, float, float, float, float]:
    """Return the squared distance from a time on, as a polynomial of the seconds since then."""
    (px, py, pz), (vx, vy, vz) = place(tracks, row, at), velocity(tracks, row, at)
    ax, ay, az = tracks[row, PULL_AT], tracks[row, PULL_AT + 1], tracks[row, PULL_AT + 2]
    return (
        px * px + py * py + pz * pz,
        2.0 * (px * vx + py * vy + pz * vz),
        vx * vx + vy * vy + vz * vz + px * ax + py * ay + pz * az,
        vx * ax + vy * ay + vz * az,
        0.25 * (ax * ax + ay * ay + az * az),
    )
